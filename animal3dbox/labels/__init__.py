"""The method: from one animal's arrays to its cuboid, its camera and the faces seen.

One step of the paper a file (docs/paper.md): `axes` (which way the body points), `bounds` (the
box), `pose` (the camera), `visibility` (what the picture shows of the body); `observation` checks
what comes in, `drafts` goes from there to box and camera, `assemble` to everything that follows.
`fit` finds body and camera together where no body is known. NumPy inside; tensors are made by the
properties of CuboidLabel.

The names below are loaded when first used (PEP 562).
"""

from typing import TYPE_CHECKING

from animal3dbox.lazy_exports import lazy_exports

if TYPE_CHECKING:
    from animal3dbox.labels.axes.body_axes import torso_axes as torso_axes
    from animal3dbox.labels.axes.body_axes import trunk_axes as trunk_axes
    from animal3dbox.labels.axes.landmarks import landmark_axes as landmark_axes
    from animal3dbox.labels.axes.pca import pca_axes as pca_axes
    from animal3dbox.labels.body import Body as Body
    from animal3dbox.labels.bounds import tight_cuboid as tight_cuboid
    from animal3dbox.labels.calibration import Calibration as Calibration
    from animal3dbox.labels.calibration import ClassShape as ClassShape
    from animal3dbox.labels.calibration import KeypointPlaces as KeypointPlaces
    from animal3dbox.labels.calibration import PlacementPitch as PlacementPitch
    from animal3dbox.labels.calibration import load_calibration as load_calibration
    from animal3dbox.labels.config import LabelConfig as LabelConfig
    from animal3dbox.labels.fit.fit import fit_animal as fit_animal
    from animal3dbox.labels.fit.fit import fit_many as fit_many
    from animal3dbox.labels.fit.fitted_body import FitHypothesis as FitHypothesis
    from animal3dbox.labels.fit.fitted_body import FittedBody as FittedBody
    from animal3dbox.labels.fit.learning.rounds import learn_bodies as learn_bodies
    from animal3dbox.labels.fit_parameters import FitParameters as FitParameters
    from animal3dbox.labels.fit_parameters import fitted_vertices as fitted_vertices
    from animal3dbox.labels.label import label_animal as label_animal
    from animal3dbox.labels.label import label_many as label_many
    from animal3dbox.labels.pose.estimate import estimate_pose as estimate_pose
    from animal3dbox.labels.pose.problem import PoseEstimate as PoseEstimate
    from animal3dbox.labels.pose.problem import PoseFailure as PoseFailure
    from animal3dbox.labels.pose.problem import PoseProblem as PoseProblem
    from animal3dbox.labels.types import REASONS as REASONS
    from animal3dbox.labels.types import VIEWPOINTS as VIEWPOINTS
    from animal3dbox.labels.types import CuboidLabel as CuboidLabel
    from animal3dbox.labels.types import Quality as Quality
    from animal3dbox.labels.types import Rejection as Rejection
    from animal3dbox.labels.visibility.superimposed_mask import (
        superimposed_mask as superimposed_mask,
    )
    from animal3dbox.labels.visibility.visible_keypoints import (
        visible_keypoints as visible_keypoints,
    )

__getattr__, __dir__, __all__ = lazy_exports(
    __name__,
    {
        "axes.body_axes": (
            "torso_axes",
            "trunk_axes",
        ),
        "axes.landmarks": ("landmark_axes",),
        "axes.pca": ("pca_axes",),
        "body": ("Body",),
        "bounds": ("tight_cuboid",),
        "calibration": (
            "Calibration",
            "ClassShape",
            "KeypointPlaces",
            "PlacementPitch",
            "load_calibration",
        ),
        "config": ("LabelConfig",),
        "fit.fit": (
            "fit_animal",
            "fit_many",
        ),
        "fit.fitted_body": (
            "FitHypothesis",
            "FittedBody",
        ),
        "fit_parameters": (
            "FitParameters",
            "fitted_vertices",
        ),
        "fit.learning.rounds": ("learn_bodies",),
        "label": (
            "label_animal",
            "label_many",
        ),
        "pose.estimate": ("estimate_pose",),
        "pose.problem": (
            "PoseEstimate",
            "PoseFailure",
            "PoseProblem",
        ),
        "types": (
            "CuboidLabel",
            "Quality",
            "REASONS",
            "Rejection",
            "VIEWPOINTS",
        ),
        "visibility.superimposed_mask": ("superimposed_mask",),
        "visibility.visible_keypoints": ("visible_keypoints",),
    },
)
