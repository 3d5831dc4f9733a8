"""SMAL parameters as datasets store them.

Flat pose, betas, translation, and the mean of a family.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from animal3dbox.errors import ShapeError
from animal3dbox.geometry.arrays import as_numpy
from animal3dbox.geometry.checks import check_finite, check_shape
from animal3dbox.smal.model import PosedBody, SmalModel

EARS = 2
"""Joints by which SMAL's 35 differ from the 33 of 2017: LEar and REar, the last two."""


@dataclass(frozen=True)
class SmalParameters:
    """One animal's parameters.

    Attributes:
        pose: (3 J,) or (J, 3) axis-angle in radians, root first; J is 35 or 33, or the model's own.
        betas: (S,) shape, up to the model's columns; the rest are 0. Datasets that split them (20 +
            21) are joined first.
        trans: (3,) in the model's unit.
        family_mean: (S',) betas of the family's mean, when betas are offsets from it; None: betas
            are whole.
    """

    pose: Tensor
    betas: Tensor
    trans: Tensor
    family_mean: Tensor | None = None


def posed_body(model: SmalModel, parameters: SmalParameters) -> PosedBody:
    """The body (B = 1) of one animal's parameters; see posed_bodies."""
    return posed_bodies(model, (parameters,))


def posed_bodies(
    model: SmalModel, parameters: Sequence[SmalParameters], vertices_in: torch.dtype | None = None
) -> PosedBody:
    """The bodies of animals' parameters, each in the frame that its translation is given in.

    Many at once cost less than one by one.

    The kinematic tree is the model's own. A pose of 35 joints fits a model of 33 only if its ears
    are at rest, and one of 33 leaves a 35-joint model's ears at rest.

    Args:
        model: any SMAL-structured model.
        parameters: (B,) of one animal each.
        vertices_in: the type in which vertices are computed about the template's origin, before
            trans is added in the model's own; None: the model's. float32 takes less time, and costs
            a model in float64 less than a millionth of the body's length.

    Raises:
        ShapeError: naming the parameter that does not fit the model.

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
    return model.posed_arrays(betas, pose, trans, vertices_in)


def fitted_pose(model: SmalModel, pose: Tensor) -> Tensor:
    """A pose as (J, 3) of the model's joints; see posed_bodies."""
    check_finite("pose", pose)
    return torch.from_numpy(_fitted_pose(model, pose)).to(model.v_template)


def _fitted_pose(model: SmalModel, pose: Tensor) -> np.ndarray:
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


def whole_betas(model: SmalModel, betas: Tensor, family_mean: Tensor | None) -> Tensor:
    """Betas (S,) of the model: offsets and mean added, missing ones 0."""
    check_finite("betas", betas)
    return torch.from_numpy(_whole_betas(model, betas, family_mean)).to(model.v_template)


def _whole_betas(model: SmalModel, betas: Tensor, family_mean: Tensor | None) -> np.ndarray:
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
