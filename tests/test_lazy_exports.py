"""The doors: packages that load what they export on first use."""

import ast
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

from animal3dbox.lazy_exports import lazy_exports

ROOT = Path(__file__).parent.parent
FILES = sorted(
    path
    for folder in ("animal3dbox", "datasets", "transforms")
    for path in (ROOT / folder).rglob("__init__.py")
    if "lazy_exports(" in path.read_text()
    and not (folder == "animal3dbox" and {"datasets", "transforms"} & set(path.parts[-3:-1]))
)


def package_of(path: Path) -> str:
    name = ".".join(path.relative_to(ROOT).parent.parts)
    return name if name.startswith("animal3dbox") else f"animal3dbox.{name}"


DOORS = {package_of(path): path for path in FILES}
EXAMPLES = (
    "animal3dbox",
    "animal3dbox.datasets",
    "animal3dbox.datasets.synthetic",
    "animal3dbox.evaluate",
    "animal3dbox.geometry",
    "animal3dbox.labels",
    "animal3dbox.report",
    "animal3dbox.smal",
    "animal3dbox.training",
    "animal3dbox.training.detector_targets",
    "animal3dbox.training.metrics",
    "animal3dbox.transforms",
)
"""Doors whose every name shows a value."""


def table_of(path: Path) -> set[tuple[str, str]]:
    """(absolute module, name) of the table that lazy_exports is given."""
    (call,) = (
        node
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Call) and ast.unparse(node.func) == "lazy_exports"
    )
    package = package_of(path)
    return {
        (module if module.startswith("animal3dbox.") else f"{package}.{module}", name)
        for module, names in ast.literal_eval(call.args[1]).items()
        for name in names
    }


def checked_imports_of(path: Path) -> set[tuple[str, str]]:
    """(module, name) of the imports that type checkers see."""
    (block,) = (
        node
        for node in ast.parse(path.read_text()).body
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"
    )
    imports = [node for node in block.body if isinstance(node, ast.ImportFrom)]
    assert len(imports) == len(block.body)
    aliases = [(str(node.module), alias) for node in imports for alias in node.names]
    assert all(alias.name == alias.asname for _, alias in aliases)  # else it is no re-export
    return {(module, alias.name) for module, alias in aliases}


def test_the_doors_are_there() -> None:
    assert {"animal3dbox", "animal3dbox.datasets", "animal3dbox.transforms", *EXAMPLES} <= set(
        DOORS
    )


@pytest.mark.parametrize("package", DOORS)
def test_type_checkers_see_the_names_that_are_loaded(package: str) -> None:
    assert checked_imports_of(DOORS[package]) == table_of(DOORS[package])


@pytest.mark.parametrize("package", DOORS)
def test_every_exported_name_is_there_and_listed(package: str) -> None:
    door = import_module(package)
    for module, name in table_of(DOORS[package]):
        assert getattr(door, name) is getattr(import_module(module), name)
    assert {name for _, name in table_of(DOORS[package])} <= set(door.__all__)
    assert dir(door) == door.__all__ == sorted(door.__all__)


@pytest.mark.parametrize("package", DOORS)
def test_no_exported_name_is_that_of_a_module_which_would_replace_it(package: str) -> None:
    siblings = {path.stem for path in DOORS[package].parent.iterdir()}
    assert not siblings & {name for _, name in table_of(DOORS[package])}


@pytest.mark.parametrize("package", DOORS)
def test_importing_a_door_does_not_load_torch(package: str) -> None:
    code = f"import sys, {package}; sys.exit('torch' in sys.modules or 'cv2' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize("package", EXAMPLES)
def test_every_exported_name_has_an_example_that_shows_a_value(package: str) -> None:
    door, without = import_module(package), []
    for module, name in sorted(table_of(DOORS[package])):
        value = getattr(door, name)
        if callable(value):
            text = value.__doc__ or ""
            shown = "Example:" in text and ">>> " in text
        else:  # a constant's example stands in its module's docstring, where doctest finds it
            lines = (import_module(module).__doc__ or "").splitlines()
            shown = any(line.strip().startswith(">>> ") and name in line for line in lines)
        if not shown:
            without.append(name)
    assert without == []


def test_an_unknown_name_is_an_attribute_error_that_names_the_package() -> None:
    load, names, exported = lazy_exports(
        "animal3dbox.geometry",
        {"frame": ("in_frame",), "animal3dbox.errors": ("ShapeError",)},
        defined_here=("HERE",),
    )
    assert names() == exported == ["HERE", "ShapeError", "in_frame"]
    assert load("in_frame").__module__ == "animal3dbox.geometry.frame"
    assert load("ShapeError").__module__ == "animal3dbox.errors"
    with pytest.raises(
        AttributeError, match=r"module 'animal3dbox\.geometry' has no attribute 'x'"
    ):
        load("x")
