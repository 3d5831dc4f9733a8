"""Oriented 3D boxes with named faces for animals in images.

The names below are loaded when first used (PEP 562), so that ``import animal3dbox`` and the command
line do not wait for torch.
"""

from typing import TYPE_CHECKING

from animal3dbox.lazy_exports import lazy_exports

if TYPE_CHECKING:
    from animal3dbox.geometry.cuboid import Cuboid as Cuboid
    from animal3dbox.labels.config import LabelConfig as LabelConfig
    from animal3dbox.labels.fit.fit import fit_animal as fit_animal
    from animal3dbox.labels.fit.fitted_body import FittedBody as FittedBody
    from animal3dbox.labels.label import label_animal as label_animal
    from animal3dbox.labels.label import label_many as label_many
    from animal3dbox.labels.types import CuboidLabel as CuboidLabel
    from animal3dbox.labels.types import Rejection as Rejection

__version__ = "0.1.0"

__getattr__, __dir__, __all__ = lazy_exports(
    __name__,
    {
        "geometry.cuboid": ("Cuboid",),
        "labels.config": ("LabelConfig",),
        "labels.fit.fit": ("fit_animal",),
        "labels.fit.fitted_body": ("FittedBody",),
        "labels.label": ("label_animal", "label_many"),
        "labels.types": ("CuboidLabel", "Rejection"),
    },
    defined_here=("__version__",),
)
