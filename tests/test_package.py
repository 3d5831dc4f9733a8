"""The package as a whole: its layers, its packaging, its front door."""

import ast
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
LAYERS = ["geometry", "smal", "labels", "datasets", "report", "training", "evaluate", "cli"]


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
    if target in ("errors", "files", "lazy_exports", "target_schema") or layer == target:
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
    {"records", "images", "storage"},
    {"readers", "bodies", "synthetic"},
    {"formats", "labelling"},
    {"label_dataset", "batches", "format_datasets", "omni3d_dataset", "synthetic_dataset"},
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


def circles(graph: dict[str, set[str]]) -> list[list[str]]:
    """The groups of more than one node that reach each other."""
    reach = {node: set(targets) for node, targets in graph.items()}
    changed = True
    while changed:
        changed = False
        for targets in reach.values():
            more = set().union(*(reach[other] for other in targets if other in reach)) - targets
            if more:
                targets |= more
                changed = True
    groups = {
        tuple(sorted(other for other in reach[node] if node in reach.get(other, ())))
        for node in reach
    }
    return [list(group) for group in groups if len(group) > 1]


def test_no_modules_import_each_other_in_a_circle() -> None:
    assert circles(import_graph()) == []


def test_the_search_for_circles_finds_one() -> None:
    graph = {"a": {"b"}, "b": {"c"}, "c": {"a"}, "d": {"a"}}
    assert circles(graph) == [["a", "b", "c"]]


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
    assert circles(rooms) == []
