"""The rooms of animal3dbox.transforms have one order, and no modules import in a circle."""

import ast
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

HOME = Path(__file__).parents[2] / "transforms"
PACKAGE = "animal3dbox.transforms"
ROOMS = [
    "camera_law",
    "steps",
    "randomness",
    "draw_context",
    "rendering",
    "target_maps",
    "conventions_door",
    "pipeline",
    "transform",
    "augmentations",
    "kornia_bridge",
    "compose",
]
"""Each imports from itself and from those before it only."""


def module_name(path: Path) -> str:
    parts = path.relative_to(HOME).with_suffix("").parts
    return ".".join((PACKAGE, *parts)).removesuffix(".__init__")


MODULES = {module_name(path): path for path in sorted(HOME.rglob("*.py"))}


def imports_in(source: str) -> set[str]:
    """Modules of the package that a source imports anywhere: also in functions and for types."""
    names = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            submodules = {f"{node.module}.{alias.name}" for alias in node.names} & set(MODULES)
            names |= submodules or {node.module}
    return {name for name in names if name == PACKAGE or name.startswith(PACKAGE + ".")}


IMPORTS = {
    name: imports_in(path.read_text())
    for name, path in MODULES.items()
    if name != PACKAGE  # the door, which nobody inside may use
}


def room_of(module: str) -> str:
    return module.removeprefix(PACKAGE).removeprefix(".").split(".")[0]


def upward(imports: dict[str, set[str]]) -> list[str]:
    """The imports from a room that does not come before, or from the door."""
    return [
        f"{name} imports {other}"
        for name, others in imports.items()
        for other in sorted(others)
        if other == PACKAGE or ROOMS.index(room_of(other)) > ROOMS.index(room_of(name))
    ]


def test_every_module_lies_in_a_room_and_the_package_says_their_order() -> None:
    assert {room_of(name) for name in IMPORTS} == set(ROOMS)
    page = ast.get_docstring(ast.parse(MODULES[PACKAGE].read_text())) or ""
    places = [page.index(f"`{room}`") for room in ROOMS]
    assert places == sorted(places)


def test_rooms_import_only_from_those_before_them() -> None:
    assert upward(IMPORTS) == []


def test_no_modules_import_each_other_in_a_circle() -> None:
    TopologicalSorter(IMPORTS).prepare()


def test_imports_in_functions_and_for_types_count() -> None:
    source = f"""
if TYPE_CHECKING:
    from {PACKAGE}.compose import Compose
def late():
    from {PACKAGE}.kornia_bridge import probe
"""
    imports = {f"{PACKAGE}.transform": imports_in(source)}
    assert upward(imports) == [
        f"{PACKAGE}.transform imports {PACKAGE}.compose",
        f"{PACKAGE}.transform imports {PACKAGE}.kornia_bridge.probe",
    ]
    with pytest.raises(CycleError):
        TopologicalSorter({**IMPORTS, **imports}).prepare()
