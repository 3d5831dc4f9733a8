"""What detectors of oriented boxes learn: targets as numbers of a network, and the way back.

docs/detector_targets.md has the formulas. The names below are loaded when first used (PEP 562).
"""

from typing import TYPE_CHECKING

from animal3dbox.lazy_exports import lazy_exports

if TYPE_CHECKING:
    from animal3dbox.training.detector_targets.baselines import ConstantBaseline as ConstantBaseline
    from animal3dbox.training.detector_targets.baselines import (
        NearestNeighbourBaseline as NearestNeighbourBaseline,
    )
    from animal3dbox.training.detector_targets.box_coder import BoxCoder as BoxCoder
    from animal3dbox.training.detector_targets.box_coder import class_sizes as class_sizes
    from animal3dbox.training.detector_targets.crop_views import CropViews as CropViews
    from animal3dbox.training.detector_targets.crops import BoxCrops as BoxCrops
    from animal3dbox.training.detector_targets.crops import crop_boxes as crop_boxes
    from animal3dbox.training.detector_targets.direction_bins import DirectionBins as DirectionBins
    from animal3dbox.training.detector_targets.rotations import (
        allocentric_from_egocentric as allocentric_from_egocentric,
    )
    from animal3dbox.training.detector_targets.rotations import (
        egocentric_from_allocentric as egocentric_from_allocentric,
    )
    from animal3dbox.training.detector_targets.rotations import rotation_from_6d as rotation_from_6d
    from animal3dbox.training.detector_targets.rotations import rotation_to_6d as rotation_to_6d
    from animal3dbox.training.detector_targets.stored_crops import StoredCrops as StoredCrops

__getattr__, __dir__, __all__ = lazy_exports(
    __name__,
    {
        "baselines": ("ConstantBaseline", "NearestNeighbourBaseline"),
        "box_coder": ("BoxCoder", "class_sizes"),
        "crop_views": ("CropViews",),
        "crops": ("BoxCrops", "crop_boxes"),
        "direction_bins": ("DirectionBins",),
        "rotations": (
            "allocentric_from_egocentric",
            "egocentric_from_allocentric",
            "rotation_from_6d",
            "rotation_to_6d",
        ),
        "stored_crops": ("StoredCrops",),
    },
)
