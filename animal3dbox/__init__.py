"""Oriented 3D boxes with named faces for animals in images.

The names below are loaded when first used (PEP 562), so that ``import animal3dbox`` and the command line do not
wait for torch.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from animal3dbox.geometry.cuboid import Cuboid as Cuboid

__version__ = "0.1.0"

_HOMES = {
    "Cuboid": "animal3dbox.geometry.cuboid",
}

__all__ = ["Cuboid", "__version__"]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'animal3dbox' has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return __all__
