"""What a dataset would say about a synthetic animal.

Keypoints, mask, intrinsics and a fitted body, without a fault.
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


@dataclass(frozen=True, eq=False)
class Annotation:
    """One animal as a dataset describes it; float64.

    Attributes:
        sample_id: the animal.
        image_hw: height and width.
        vocabulary: the keypoints.
        keypoints_2d: (J, 3) x, y in px and 1 if marked as visible; a hidden keypoint in the frame
            keeps its place.
        mask: (H, W) bool, where the animal is seen.
        K: (3, 3) in px.
        parameters: of the body in the camera frame: its vertices need no further camera.
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
    keypoints = animal.keypoints_2d.clone()
    if hidden == "unmarked":
        keypoints[~animal.keypoint_visible, 2] = 0.0
    return Annotation(
        animal.sample_id,
        animal.image_hw,
        animal.vocabulary,
        keypoints,
        animal.mask,
        animal.K,
        camera_parameters(animal),
    )


def camera_parameters(animal: SyntheticAnimal) -> SmalParameters:
    """The parameters that pose the animal's model in the camera frame.

    The root turns the body about its own joint, which stays where the shape has it: that is what
    the translation makes up for.
    """
    betas, pose, trans = animal.parameters
    root = root_joint(animal.model, betas)
    turned = axis_angle_from_rotation(animal.R @ rotation_from_axis_angle(pose[0]))
    return SmalParameters(
        torch.cat((turned[None], pose[1:])), betas, animal.R @ (root + trans) + animal.t - root
    )


def root_joint(model: SmalModel, betas: Tensor) -> Tensor:
    """The root joint (3,) of a shape, unposed."""
    joint: Tensor = model.J_regressor[0] @ model.shaped(betas[None])[0]
    return joint
