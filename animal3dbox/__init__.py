"""Oriented 3D boxes with named faces for animals in images.

The names below are loaded when first used (PEP 562), so that ``import animal3dbox`` and the command
line do not wait for torch.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from animal3dbox.geometry.cuboid import Cuboid as Cuboid
    from animal3dbox.labels.config import LabelConfig as LabelConfig
    from animal3dbox.labels.label import label_animal as label_animal
    from animal3dbox.labels.label import label_many as label_many
    from animal3dbox.labels.types import CuboidLabel as CuboidLabel
    from animal3dbox.labels.types import Rejection as Rejection

__version__ = "0.1.0"

_HOMES = {
    "Cuboid": "animal3dbox.geometry.cuboid",
    "CuboidLabel": "animal3dbox.labels.types",
    "LabelConfig": "animal3dbox.labels.config",
    "Rejection": "animal3dbox.labels.types",
    "label_animal": "animal3dbox.labels.label",
    "label_many": "animal3dbox.labels.label",
}

__all__ = [
    "Cuboid",
    "CuboidLabel",
    "LabelConfig",
    "Rejection",
    "__version__",
    "label_animal",
    "label_many",
]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'animal3dbox' has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return __all__
