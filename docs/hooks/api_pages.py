"""The pages of the API: one a door, with an entry for every name that the door exports.

The names are read from the calls of `lazy_exports` without importing anything, and mkdocstrings
writes each entry from the docstring at the name's home.
"""

import ast
import posixpath
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[2]


@cache
def doors() -> dict[str, Path]:
    """Dotted name -> `__init__.py` of every package that says what it exports."""
    found = {}
    for home in ("animal3dbox", "datasets", "transforms"):
        for path in sorted((ROOT / home).rglob("__init__.py")):
            below = path.relative_to(ROOT).parent
            is_linked = below.parts[:2] in (
                ("animal3dbox", "datasets"),
                ("animal3dbox", "transforms"),
            )
            if not is_linked and "lazy_exports(" in path.read_text():
                name = ".".join(below.parts)
                found[name if home == "animal3dbox" else f"animal3dbox.{name}"] = path
    return dict(sorted(found.items()))


def homes_of(door: str, source: str) -> dict[str, str]:
    """Name -> the dotted place that defines it, of all that a door exports.

    Example:
        >>> source = 'a, b, c = lazy_exports(__name__, {"camera": ("project",)})'
        >>> homes_of("animal3dbox.geometry", source)
        {'project': 'animal3dbox.geometry.camera.project'}
    """
    (call,) = (
        node
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.Call) and ast.unparse(node.func) == "lazy_exports"
    )
    homes = {}
    for module, names in ast.literal_eval(call.args[1]).items():
        full = module if module.startswith("animal3dbox.") else f"{door}.{module}"
        homes.update({name: f"{full}.{name}" for name in names})
    return dict(sorted(homes.items()))


def page_name(door: str) -> str:
    """The page of a door, from the site's root.

    Example:
        >>> page_name("animal3dbox"), page_name("animal3dbox.training.metrics")
        ('api/animal3dbox.md', 'api/training.metrics.md')
    """
    return f"api/{door.removeprefix('animal3dbox.')}.md"


def api_pages() -> dict[str, str]:
    """Page -> its text, in the language of mkdocstrings.

    A name that several doors export is described at the outermost of them; the others link there.
    """
    sources = {door: path.read_text() for door, path in doors().items()}
    homes = {door: homes_of(door, source) for door, source in sources.items()}
    described_at: dict[str, str] = {}
    for door in sorted(homes, key=len):
        for home in homes[door].values():
            described_at.setdefault(home, door)
    pages = {}
    for door, source in sources.items():
        summary = (ast.get_docstring(ast.parse(source)) or "").split("\n\n")[0]
        parts = [f"# {door}\n\n{' '.join(summary.split())}\n"]
        for name, home in homes[door].items():
            page = posixpath.relpath(page_name(described_at[home]), "api")
            is_here = described_at[home] == door
            parts.append(f"::: {home}\n" if is_here else f"## {name}\n\n[{home}]({page}#{home})\n")
        pages[page_name(door)] = "\n".join(parts)
    return pages
