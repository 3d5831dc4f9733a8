"""The import structure of a checkout: levels, circles and imports that point upwards.

An import is any `import` or `from ... import` of another module of the package, wherever it
stands: at the top of a file, in a function or under TYPE_CHECKING. `from folder import module`
imports the module, not the folder. A module that imports a folder it lies in (fingerprint.py asks
animal3dbox.datasets for its place) does not count: importing any module runs the `__init__` of its
folders anyway, and what these export lazily is not what they are made of.
"""

import ast
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

LAYOUT = {"datasets": "animal3dbox.datasets", "transforms": "animal3dbox.transforms"}
"""Folders beside the package that are subpackages of it, through links in the tree."""
ROOM_RANKS = {
    "records": 0, "images": 0, "storage": 0,
    "readers": 1, "bodies": 1, "synthetic": 1,
    "labelling": 2,
    "label_dataset": 3,
    "exchange": 4, "inspection": 4,
}  # fmt: skip
"""The order of the rooms of datasets/ as issue 13 draws it: a room imports its like or lower."""
ROOM_MEMBERS = {
    "records": "records",
    "images": "images exif rle segmentation",
    "storage": "codec fingerprint heads json_files packed segments",
    "readers": "animal3d animal3d_camera camera_files coco coco_file deeplabcut deeplabcut_h5 "
    "deeplabcut_table elements mesh_folder mesh_folder_files sources stanfordextra",
    "bodies": "bodies body_options mesh_bodies mesh_files mesh_folder_bodies",
    "synthetic": "animal3d_writer annotation faults ray_shares shading stanfordextra_writer "
    "synthetic synthetic_set synthetic_source truth_file world",
    "labelling": "cache filters given_boxes label_rows labelling ledger opened row_maker scale "
    "targets threads",
    "label_dataset": "label_dataset batches by_format collate format_datasets formats "
    "cuboid_datasets omni3d_dataset reading synthetic_dataset",
}
"""Files at the top of datasets/, and folders of other names, by the room they belong to.

Today's flat files are assigned by what they do and house.md says of the rooms. A folder that is
named like a room is that room without being listed.
"""
ROOM_OF = {name: room for room, names in ROOM_MEMBERS.items() for name in names.split()}


def package_files(root: Path) -> dict[str, Path]:
    """Every Python file of the package by its dotted name; links in the tree are not followed."""
    homes = {"animal3dbox": "animal3dbox", **LAYOUT}
    names: dict[str, Path] = {}
    for folder, home in homes.items():
        for path in sorted((root / folder).rglob("*.py")):
            parts = path.relative_to(root / folder).with_suffix("").parts
            if folder == "animal3dbox" and parts[0] in LAYOUT:
                continue
            names[".".join((home, *parts)).removesuffix(".__init__")] = path
    return names


@dataclass(frozen=True)
class ImportGraph:
    """The modules of a package and which of them import which.

    Attributes:
        statements: pairs (importer, imported), one for each statement and module it names.
        modules: dotted names, among which imports are looked at.
    """

    modules: frozenset[str]
    statements: tuple[tuple[str, str], ...]
    _reachable: dict[str, frozenset[str]] = field(default_factory=dict, compare=False)

    def within(self, prefix: str) -> "ImportGraph":
        """The graph of the modules of one folder, and of the imports among these alone."""
        inside = frozenset(name for name in self.modules if f"{name}.".startswith(f"{prefix}."))
        return ImportGraph(inside, tuple(s for s in self.statements if inside.issuperset(s)))

    @cached_property
    def edges(self) -> dict[str, frozenset[str]]:
        """The modules that each module imports, without itself."""
        edges: dict[str, set[str]] = {name: set() for name in self.modules}
        for importer, imported in self.statements:
            edges[importer].add(imported)
        return {name: frozenset(targets - {name}) for name, targets in edges.items()}

    def reachable(self, name: str) -> frozenset[str]:
        """All modules that a module imports, directly or through others."""
        if name not in self._reachable:
            targets: set[str] = set()
            pending = [name]
            while pending:
                new = self.edges[pending.pop()] - targets
                targets |= new
                pending += new
            self._reachable[name] = frozenset(targets)
        return self._reachable[name]

    def circles(self) -> list[list[str]]:
        """Groups of more than one module in which each imports each other, directly or not."""
        groups = {
            frozenset(n for n in self.reachable(name) if name in self.reachable(n)) | {name}
            for name in self.modules
        }
        return sorted(sorted(group) for group in groups if len(group) > 1)

    def levels(self) -> int:
        """The modules of the longest chain of imports, where a circle counts as one module."""
        group_of = {name: name for name in self.modules}
        group_of |= {name: circle[0] for circle in self.circles() for name in circle}
        targets: dict[str, set[str]] = {group: set() for group in group_of.values()}
        for importer, imported in ((a, b) for a, bs in self.edges.items() for b in bs):
            targets[group_of[importer]].add(group_of[imported])
        heights: dict[str, int] = {}

        def height(group: str) -> int:
            if group not in heights:
                lower = targets[group] - {group}
                heights[group] = 1 + max(map(height, lower), default=0)
            return heights[group]

        return max(map(height, targets), default=0)


def import_graph(root: Path) -> ImportGraph:
    """Read the imports of every file of a checkout."""
    files = package_files(root)
    names = frozenset(files)
    statements = [
        (importer, imported)
        for importer, path in files.items()
        for imported in _imports(ast.parse(path.read_text()), names)
        if not importer.startswith(f"{imported}.")
    ]
    return ImportGraph(names, tuple(statements))


def _imports(tree: ast.AST, names: frozenset[str]) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name in names)
        elif isinstance(node, ast.ImportFrom) and node.module is not None:
            members = [f"{node.module}.{alias.name}" for alias in node.names]
            modules = [member for member in members if member in names]
            yield from modules or ([node.module] if node.module in names else [])


def room(module: str) -> str | None:
    """The room of a module of datasets/; None of the door and of files that no table places."""
    parts = module.removeprefix("animal3dbox.datasets").split(".")[1:]
    if not parts:
        return None
    if len(parts) > 1 and parts[0] in ROOM_RANKS:
        return parts[0]
    return ROOM_OF.get(parts[0], parts[0] if parts[0] in ROOM_RANKS else None)


def upward_imports(pairs: Iterable[tuple[str, str]], ranks: Mapping[str, int]) -> list[str]:
    """Imports from a lower room of datasets/ to a higher one, as sentences."""
    lines = []
    for importer, imported in sorted(set(pairs)):
        lower, higher = room(importer), room(imported)
        if lower and higher and ranks[lower] < ranks[higher]:
            lines.append(f"{importer} ({lower}) imports {imported} ({higher})")
    return lines


def room_circles(pairs: Iterable[tuple[str, str]]) -> list[list[str]]:
    """Groups of rooms in which each imports each other, directly or not."""
    rooms = [(room(importer) or "", room(imported) or "") for importer, imported in pairs]
    return ImportGraph(frozenset(ROOM_RANKS), tuple(r for r in rooms if all(r))).circles()


def import_counts(root: Path) -> tuple[dict[str, float], dict[str, list[str]]]:
    """What is counted of a checkout's imports: numbers, and the lists behind them.

    - statements: imports as written, one for each module they name, among modules of datasets/;
      "of its top files" are those that stand in files directly in datasets/ (house.md's 183).
    - pairs: the same, but one for each pair of importing and imported module.
    - levels: see ImportGraph.levels; "of its top files" leaves out imports of and by folders.
    - upward: pairs whose imported module is in a higher room by ROOM_RANKS and room(). "In the
      strict sequence" no two rooms are of one rank: each may import only those before it as
      ROOM_RANKS lists them. house.md counts 13 without saying how; this is the nearest to it.
    - circles: see ImportGraph.circles; their members are the modules that they hold together.
    """
    graph = import_graph(root)
    datasets = graph.within(LAYOUT["datasets"])
    top = _top_files(root, datasets.modules)
    top_graph = ImportGraph(top, tuple(s for s in datasets.statements if top.issuperset(s)))
    upward = upward_imports(datasets.statements, ROOM_RANKS)
    sequence = {name: place for place, name in enumerate(ROOM_RANKS)}
    strict_upward = upward_imports(datasets.statements, sequence)
    strays = sorted(m for m in datasets.modules if m.count(".") > 1 and room(m) is None)
    counts: dict[str, float] = {
        "datasets/: import statements": len(datasets.statements),
        "datasets/: import statements of its top files": sum(
            importer in top for importer, _ in datasets.statements
        ),
        "datasets/: import pairs": len(set(datasets.statements)),
        "datasets/: levels": datasets.levels(),
        "datasets/: levels of its top files": top_graph.levels(),
        "datasets/: upward imports": len(upward),
        "datasets/: upward imports in the strict sequence": len(strict_upward),
        "datasets/: files in no known room": len(strays),
    }
    lists = {"upward imports": upward, "upward imports in the strict sequence": strict_upward}
    lists |= {"files in no known room": strays}
    circles = circle_counts(graph)
    return counts | circles[0], lists | circles[1]


def circle_counts(graph: ImportGraph) -> tuple[dict[str, float], dict[str, list[str]]]:
    """The circles of files, of the two root folders and of the package, and those of rooms."""
    datasets, transforms = (graph.within(home) for home in LAYOUT.values())
    counts: dict[str, float] = {}
    lists: dict[str, list[str]] = {}
    for where, circles in {
        "datasets/": datasets.circles(),
        "transforms/": transforms.circles(),
        "the package": graph.circles(),
        "rooms of datasets/": room_circles(datasets.statements),
    }.items():
        counts[f"{where}: circles"] = len(circles)
        counts[f"{where}: members of circles"] = sum(map(len, circles))
        lists[f"circles of {where}"] = [f"{len(names)}: {', '.join(names)}" for names in circles]
    return counts, lists


def _top_files(root: Path, modules: frozenset[str]) -> frozenset[str]:
    files = package_files(root)
    return frozenset(name for name in modules if files[name].parent == root / "datasets")
