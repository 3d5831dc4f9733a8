"""Names that a package exports, each loaded from its module when it is first used (PEP 562).

A door such as `animal3dbox.geometry` names what users need without importing it, so that
`import animal3dbox` and the command line do not wait for torch.
"""

from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from typing import Any

ROOT = __name__.partition(".")[0]


def lazy_exports(
    package: str, homes: Mapping[str, Sequence[str]], *, defined_here: Sequence[str] = ()
) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """The `__getattr__`, `__dir__` and `__all__` of a package that loads its names on first use.

    Type checkers and editors cannot see through this, so an `if TYPE_CHECKING:` block beside the
    call imports the same names; a test of every package that uses this holds the two equal.

    Args:
        package: the package's own `__name__`.
        homes: module -> the names it has; a module relative to the package ("camera"), or an
            absolute one of another room ("animal3dbox.geometry.camera"). No name may be that of a
            module of the package: importing the module would replace it.
        defined_here: names that the package's own file defines, exported as well.

    Returns:
        The three, to be assigned in this order at the top of the package's `__init__.py`.

    Raises:
        AttributeError: from `__getattr__`, of a name that the package does not export.

    Example:
        >>> load, names, exported = lazy_exports("animal3dbox", {"errors": ("ShapeError",)})
        >>> exported, load("ShapeError").__module__
        (['ShapeError'], 'animal3dbox.errors')
    """
    home_of = {
        name: module if module.startswith(f"{ROOT}.") else f"{package}.{module}"
        for module, names in homes.items()
        for name in names
    }
    exported = sorted({*home_of, *defined_here})

    def load(name: str) -> Any:
        if name not in home_of:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        return getattr(import_module(home_of[name]), name)

    return load, lambda: exported, exported
