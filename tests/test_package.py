"""The package as a whole: its layers, its packaging, its front door."""

import ast
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
LAYERS = ["geometry", "smal", "labels", "datasets", "report"]
LAYERS += ["training", "evaluate", "bench", "cli"]
OF_ALL = ("errors", "files", "lazy_exports", "plurals", "progress", "target_schema")
"""Modules that any layer may import."""


def modules() -> list[tuple[str, Path]]:
    """Dotted names and files of every module of the package."""
    found = [
        (p.relative_to(ROOT), p)
        for p in sorted((ROOT / "animal3dbox").rglob("*.py"))
        if not {"datasets", "transforms"} & set(p.parts[len(ROOT.parts) :])
    ]
    found += [
        (Path("animal3dbox") / p.relative_to(ROOT), p)
        for home in ("datasets", "transforms")
        for p in sorted((ROOT / home).rglob("*.py"))
    ]
    return [
        (".".join(name.with_suffix("").parts).removesuffix(".__init__"), path)
        for name, path in found
    ]


def imports_of(path: Path) -> set[str]:
    names = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names.add(node.module)
    return {name for name in names if name.startswith("animal3dbox.")}


def allowed(importer: str, imported: str) -> bool:
    layer, target = importer.split(".")[1], imported.split(".")[1]
    if (
        target in ("errors", "files", "lazy_exports", "plurals", "progress", "target_schema")
        or layer == target
    ):
        return True
    if layer in ("transforms", "training"):
        return target == "geometry"
    return layer in LAYERS and target in LAYERS and LAYERS.index(target) < LAYERS.index(layer)


def test_imports_point_one_way() -> None:
    wrong = [
        f"{name} imports {other}"
        for name, path in modules()
        if name.count(".") >= 1
        for other in imports_of(path)
        if not allowed(name, other)
    ]
    wrong = [line for line in wrong if not line.startswith("animal3dbox.__main__")]
    assert wrong == []


def test_the_rule_for_imports_forbids_what_it_should() -> None:
    assert allowed("animal3dbox.labels.label", "animal3dbox.smal.model")
    assert not allowed("animal3dbox.geometry.camera", "animal3dbox.smal.model")
    assert not allowed("animal3dbox.transforms.flip", "animal3dbox.labels.types")
    assert not allowed("animal3dbox.training.checks", "animal3dbox.labels.types")
    assert allowed("animal3dbox.cli.check", "animal3dbox.training.checks")
    assert not allowed("animal3dbox.datasets.labelling.cache", "animal3dbox.transforms.flip")


def test_every_package_is_listed_for_the_build() -> None:
    listed = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["packages"]
    present = {name for name, path in modules() if path.name == "__init__.py"}
    assert sorted(listed) == sorted(present)


def test_no_file_of_the_package_is_longer_than_400_lines() -> None:
    assert [
        f"{path}: {n}" for _, path in modules() if (n := len(path.read_text().splitlines())) > 400
    ] == []


def functions() -> Iterator[tuple[str, ast.FunctionDef]]:
    """Every function of the package, under the name of its file."""
    for _, path in modules():
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.FunctionDef):
                yield f"{path.relative_to(ROOT)}: {node.name}", node


def test_no_function_is_longer_than_40_lines() -> None:
    """Counted from the first statement after the docstring to the last line."""

    def length(node: ast.FunctionDef) -> int:
        said = ast.get_docstring(node) is not None and len(node.body) > 1
        return (node.end_lineno or 0) - node.body[said].lineno + 1

    assert [f"{name}: {n}" for name, node in functions() if (n := length(node)) > 40] == []


def test_no_function_takes_more_than_four_arguments_by_position() -> None:
    def by_position(node: ast.FunctionDef) -> int:
        arguments = (*node.args.posonlyargs, *node.args.args)
        return sum(argument.arg not in ("self", "cls") for argument in arguments)

    assert [f"{name}: {n}" for name, node in functions() if (n := by_position(node)) > 4] == []


@pytest.mark.parametrize("folder", ["datasets", "transforms"])
def test_the_root_folders_refuse_to_be_imported_by_their_bare_names(folder: str) -> None:
    ran = subprocess.run(
        [sys.executable, "-c", f"import sys; sys.path.insert(0, {str(ROOT)!r}); import {folder}"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert f"import animal3dbox.{folder}" in ran.stderr


def test_importing_the_package_or_its_command_line_does_not_load_torch() -> None:
    code = (
        "import sys, animal3dbox, animal3dbox.cli.main; sys.exit('torch' in sys.modules or 'cv2' in"
        " sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


DATASET_ROOMS = (
    {"records", "sightings", "images", "storage"},
    {"readers", "bodies", "synthetic"},
    {"formats", "cuboid_formats", "labelling", "read_options", "record_changes"},
    {"label_dataset", "batches", "format_datasets", "synthetic_dataset"}
    | {"cuboid_datasets", "joined_dataset"},
    {"exchange", "inspection"},
)
"""The rooms and files of datasets/ from the lowest: each imports from its own tier and from those
before it."""


def all_imports(path: Path) -> set[str]:
    """Modules that a file imports anywhere, in functions and for type checkers too."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return names


def import_graph() -> dict[str, set[str]]:
    """Every module of the package that is no door (__init__) -> those it imports."""
    paths = {
        ".".join(name.split(".")): path for name, path in modules() if path.name != "__init__.py"
    }
    return {name: (all_imports(path) & set(paths)) - {name} for name, path in paths.items()}


def check_no_circle(graph: dict[str, set[str]]) -> None:
    """Raise a CycleError that names the circle, if there is one."""
    TopologicalSorter(graph).prepare()


def test_no_modules_import_each_other_in_a_circle() -> None:
    check_no_circle(import_graph())


def test_the_search_for_circles_finds_one() -> None:
    with pytest.raises(CycleError):
        check_no_circle({"a": {"b"}, "b": {"c"}, "c": {"a"}, "d": {"a"}})


def dataset_room(module: str) -> str:
    return module.removeprefix("animal3dbox.datasets.").split(".")[0]


def test_the_rooms_of_datasets_have_one_order() -> None:
    tier_of = {room: tier for tier, rooms in enumerate(DATASET_ROOMS) for room in rooms}
    graph = {
        module: {other for other in imported if other.startswith("animal3dbox.datasets.")}
        for module, imported in import_graph().items()
        if module.startswith("animal3dbox.datasets.")
    }
    assert {dataset_room(module) for module in graph} == set(tier_of)
    upward = [
        f"{module} imports {other}"
        for module, imported in graph.items()
        for other in imported
        if tier_of[dataset_room(other)] > tier_of[dataset_room(module)]
    ]
    assert upward == []
    rooms: dict[str, set[str]] = {room: set() for room in tier_of}
    for module, imported in graph.items():
        room = dataset_room(module)
        rooms[room] |= {dataset_room(other) for other in imported} - {room}
    check_no_circle(rooms)


@pytest.mark.parametrize("layer", ["geometry", "smal"])
def test_modules_and_rooms_of_a_layer_import_each_other_in_no_circle(layer: str) -> None:
    prefix = f"animal3dbox.{layer}."
    imports = {
        name: {other for other in imports_of(path) if other.startswith(prefix)}
        for name, path in modules()
        if name.startswith(prefix)
    }

    def room(name: str) -> str:
        """A folder of the layer for all that is in it, a module at the top for itself."""
        return ".".join(name.split(".")[:3])

    rooms: dict[str, set[str]] = {}
    for name, others in imports.items():
        rooms.setdefault(room(name), set()).update({room(other) for other in others} - {room(name)})
    for graph in (imports, rooms):
        TopologicalSorter(graph).prepare()  # raises a CycleError that names the circle
