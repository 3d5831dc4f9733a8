"""The annotation that a faultless dataset would give a synthetic animal.

It has keypoints, a mask, intrinsics and a fitted body; faults.py spoils it.
"""

from dataclasses import dataclass
from typing import Literal

import torch
from torch import Tensor

from animal3dbox.datasets.synthetic.scenes import SyntheticAnimal
from animal3dbox.geometry.rigid_transforms import axis_angle_from_rotation, rotation_from_axis_angle
from animal3dbox.smal.keypoints.vocabulary import Vocabulary
from animal3dbox.smal.model import SmalModel
from animal3dbox.smal.parameters import SmalParameters

Hidden = Literal["unmarked", "marked"]
"""Whether a dataset marks keypoints that something hides."""


@dataclass(frozen=True, eq=False)
class Annotation:
    """One animal as a dataset describes it; float64.

    Attributes:
        sample_id: name of the animal.
        image_hw: height and width of its image.
        vocabulary: names of the J keypoints.
        keypoints_2d: (J, 3) x, y in px and 1 if marked as visible; a hidden keypoint in the frame
            keeps its place.
        mask: (H, W) bool, where the animal is seen.
        K: (3, 3) in px.
        parameters: of the body in the camera frame, so that its vertices need no further pose.
    """

    sample_id: str
    image_hw: tuple[int, int]
    vocabulary: Vocabulary
    keypoints_2d: Tensor
    mask: Tensor
    K: Tensor
    parameters: SmalParameters


def annotate(animal: SyntheticAnimal, hidden: Hidden = "unmarked") -> Annotation:
    """The true annotation of an animal.

    Args:
        animal: any.
        hidden: whether keypoints in the frame that something hides, the animal itself for one, are
            marked as visible too.

    """
    return Annotation(
        sample_id=animal.sample_id,
        image_hw=animal.image_hw,
        vocabulary=animal.vocabulary,
        keypoints_2d=marked_keypoints(animal, hidden),
        mask=animal.mask,
        K=animal.K,
        parameters=camera_parameters(animal),
    )


def marked_keypoints(animal: SyntheticAnimal, hidden: Hidden = "unmarked") -> Tensor:
    """The keypoints (J, 3) of an animal: x, y in px and 1 if marked, as annotate has them."""
    keypoints = animal.keypoints_2d.clone()
    if hidden == "unmarked":
        keypoints[~animal.keypoint_visible, 2] = 0.0
    return keypoints


def camera_parameters(animal: SyntheticAnimal) -> SmalParameters:
    """The parameters that pose the animal's model in the camera frame.

    The root turns the body about its own joint, which stays where the shape has it, and the
    translation makes up for that.
    """
    betas, pose, trans = animal.parameters
    root = root_joint(animal.model, betas)
    root_pose = axis_angle_from_rotation(animal.R @ rotation_from_axis_angle(pose[0]))
    # R (x + trans) + t for a vertex x that the root turns about its joint j: R (j + trans) + t − j
    trans_cam = animal.R @ (root + trans) + animal.t - root
    return SmalParameters(torch.cat((root_pose[None], pose[1:])), betas, trans_cam)


def root_joint(model: SmalModel, betas: Tensor) -> Tensor:
    """The root joint (3,) of a model in a shape and the template pose."""
    joint: Tensor = model.J_regressor[0] @ model.shaped(betas[None])[0]
    return joint
