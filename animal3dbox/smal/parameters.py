"""SMAL parameters as datasets store them, and the bodies that they pose.

A flat pose, betas, a translation, and the mean of a family that the betas are offsets from.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from animal3dbox.errors import ShapeError
from animal3dbox.geometry.arrays import as_numpy
from animal3dbox.geometry.checks import check_finite, check_shape
from animal3dbox.smal.linear_blend_skinning import PosedBody
from animal3dbox.smal.model import SmalModel

EARS = 2
"""How many joints SMAL's 35 have more than the 33 of 2017: LEar and REar, the last two."""


@dataclass(frozen=True)
class SmalParameters:
    """The SMAL parameters of one animal, as a dataset stores them.

    Attributes:
        pose: (3 J,) or (J, 3) axis-angle in radians, root first; J is 35 or 33, or the model's own.
        betas: (S,) shape, up to the model's columns; the rest are 0. Datasets that split them (20 +
            21) are joined first.
        trans: (3,) in the model's unit.
        family_mean: (S',) betas of the family's mean, when betas are offsets from it; None: betas
            are whole.

    Example:
        >>> from animal3dbox.smal import load_quadruped, named_pose, preset_betas
        >>> cow = SmalParameters(named_pose("graze"), preset_betas("cow"), torch.zeros(3))
        >>> posed_body(load_quadruped(), cow).R_world_joint.shape
        torch.Size([1, 35, 3, 3])
    """

    pose: Tensor
    betas: Tensor
    trans: Tensor
    family_mean: Tensor | None = None


def posed_body(model: SmalModel, parameters: SmalParameters) -> PosedBody:
    """The body (B = 1) of one animal's parameters; see posed_bodies.

    Example:
        >>> from animal3dbox.smal import load_quadruped
        >>> pose = torch.zeros(99)  # of SMAL's 33 joints of 2017: the ears stay at rest
        >>> parameters = SmalParameters(pose, torch.zeros(1), torch.tensor([0.0, 0.0, 7.0]))
        >>> body, model = posed_body(load_quadruped(), parameters), load_quadruped()
        >>> round(float((body.vertices[0] - model.v_template)[:, 2].mean()), 6)
        7.0
    """
    return posed_bodies(model, (parameters,))


def posed_bodies(
    model: SmalModel, parameters: Sequence[SmalParameters], vertices_in: torch.dtype | None = None
) -> PosedBody:
    """The bodies of animals' parameters, each in the frame that its translation is given in.

    Many posed at once cost less than one by one. The kinematic tree is the model's own. A pose of
    35 joints fits a model of 33 only if its ears are at rest, and one of 33 leaves a 35-joint
    model's ears at rest.

    Args:
        model: any SMAL-structured model.
        parameters: (B,) of one animal each.
        vertices_in: the type in which vertices are computed about the template's origin, before
            trans is added in the model's own; None: the model's. float32 takes less time, and costs
            a model in float64 less than a millionth of the body's length.

    Raises:
        ShapeError: naming the parameter that does not fit the model.

    Example:
        >>> from animal3dbox.smal import load_quadruped
        >>> animals = [SmalParameters(torch.zeros(105), torch.zeros(41), torch.zeros(3))] * 2
        >>> posed_bodies(load_quadruped(), animals).joints.shape
        torch.Size([2, 35, 3])
    """
    if not parameters:
        raise ShapeError("parameters must be of at least one animal")
    for one in parameters:
        check_shape("trans", one.trans, "3")
    dtype = as_numpy(model.v_template).dtype
    betas = np.array([_whole_betas(model, one.betas, one.family_mean) for one in parameters], dtype)
    pose = np.array([_fitted_pose(model, one.pose) for one in parameters], dtype)
    trans = np.array([as_numpy(one.trans) for one in parameters], dtype)
    for name, values in (("betas", betas), ("pose", pose), ("trans", trans)):
        check_finite(name, values)
    return model.posed_arrays(betas, pose, trans, vertices_in=vertices_in)


def _fitted_pose(model: SmalModel, pose: Tensor) -> np.ndarray:
    """A pose as (J, 3) of the model's joints, with ears at rest where only one of them has ears."""
    if pose.numel() % 3 or pose.ndim > 2 or (pose.ndim == 2 and pose.shape[1] != 3):
        raise ShapeError(f"pose must be (3 J,) or (J, 3), got {tuple(pose.shape)}")
    joints, flat = model.joint_count, as_numpy(pose).reshape(-1, 3)
    if len(flat) == joints:
        return flat
    if len(flat) == joints - EARS and joints == 35:
        return np.concatenate((flat, np.zeros((EARS, 3), dtype=flat.dtype)))
    if len(flat) == joints + EARS and joints == 33:
        if flat[joints:].any():
            raise ShapeError(
                "pose turns the ears (joints 33 and 34), but this model has none: take a model of"
                " 35 joints"
            )
        return flat[:joints]
    raise ShapeError(f"pose has {len(flat)} joints, but the model has {joints}")


def _whole_betas(model: SmalModel, betas: Tensor, family_mean: Tensor | None) -> np.ndarray:
    """The betas (S,) of the model: offsets and mean added, missing ones 0."""
    whole = np.zeros(model.beta_count)
    if family_mean is not None:
        check_finite("family_mean", family_mean)
    for name, part in (("betas", betas), ("family_mean", family_mean)):
        if part is None:
            continue
        check_shape(name, part, "S")
        if len(part) > model.beta_count:
            raise ShapeError(
                f"{name} has {len(part)} numbers, but the model has {model.beta_count} shape"
                " columns: take the model they belong to"
            )
        whole[: len(part)] += as_numpy(part)
    return whole
