"""Linear blend skinning by one formula: over tensors, differentiable and on any device, or over arrays, for a loader's worker.

Arrays keep what is mostly zeros (pose columns, weights) as sparse matrices, which torch cannot differentiate in all directions.
Points are kept coordinate by coordinate, (B, 3, V): bounds and projections of a body then run along memory.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Generic

import numpy as np
import torch
from scipy.sparse import csr_array
from torch import Tensor

from animal3dbox.geometry.arrays import AnyArray, as_numpy, contiguous, large_product, like, namespace
from animal3dbox.geometry.rigid import IDENTITY, rotation_from_axis_angle

STILL = ((1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 0.0, 1.0))
SPARSE_BELOW = 0.3
"""Share of entries that are not zero up to which a sparse matrix is the faster one."""
BODIES_AT_ONCE = 12
"""Arrays of so many bodies at a time: more of them fall out of the processor's cache."""


@dataclass(frozen=True)
class SkinMaps(Generic[AnyArray]):
    """A model's constants, laid out for skin; Any stands for an array, or a sparse matrix that multiplies like one.

    Attributes:
        template: (3 V,) coordinate by coordinate.
        shape: (S, 3 V).
        pose: (3 V, 9 (J - 1)), or sparse.
        weights: (V, J), or sparse.
        joints: (3 J,) of the template, joint by joint.
        joints_shape: (S, 3 J).
        bones: (J, J) 1 on the diagonal, -1 at each joint's parent: joints to bones.
        jumps: for each joint, and a last one that stands still: the ancestor 1, 2, 4, ... steps up the tree.
    """

    template: AnyArray
    shape: AnyArray
    pose: Any
    weights: Any
    joints: AnyArray
    joints_shape: AnyArray
    bones: AnyArray
    jumps: tuple[np.ndarray, ...]


def skin_maps(
    v_template: Tensor, shapedirs: Tensor, posedirs: Tensor, J_regressor: Tensor, weights: Tensor, parents: Sequence[int]
) -> SkinMaps[Tensor]:
    """The constants of a model as tensors; see SmalModel for the arguments."""
    joints_shape = (J_regressor @ shapedirs.flatten(1)).reshape(-1, shapedirs.shape[2]).mT
    bones = torch.eye(len(parents), dtype=weights.dtype, device=weights.device)
    for joint, parent in enumerate(parents[1:], start=1):
        bones[joint, parent] = -1
    jumps = [[parent if parent >= 0 else len(parents) for parent in (*parents, -1)]]
    while any(ancestor < len(parents) for ancestor in jumps[-1]):
        jumps.append([jumps[-1][ancestor] for ancestor in jumps[-1]])
    return SkinMaps(
        template=v_template.mT.flatten(),
        shape=shapedirs.permute(2, 1, 0).flatten(1).contiguous(),
        pose=posedirs.permute(1, 0, 2).flatten(0, 1).contiguous(),
        weights=weights,
        joints=(J_regressor @ v_template).flatten(),
        joints_shape=joints_shape.contiguous(),
        bones=bones,
        jumps=tuple(np.array(jump) for jump in jumps[:-1]),
    )


def array_maps(maps: SkinMaps[Tensor]) -> SkinMaps[np.ndarray]:
    """The same constants as arrays, sparse where that is faster."""
    pose, weights = (_maybe_sparse(as_numpy(values)) for values in (maps.pose, maps.weights))
    template, shape, joints, joints_shape, bones = (as_numpy(x) for x in (maps.template, maps.shape, maps.joints, maps.joints_shape, maps.bones))
    return SkinMaps(template, shape, pose, weights, joints, joints_shape, bones, maps.jumps)


def _maybe_sparse(values: np.ndarray) -> Any:
    few = np.count_nonzero(values) < SPARSE_BELOW * values.size
    return csr_array(values) if few else values


def skin(maps: SkinMaps[AnyArray], betas: AnyArray, pose: AnyArray, trans: AnyArray) -> tuple[AnyArray, AnyArray, AnyArray]:
    """Bodies in some pose.

    Args:
        maps: the model's.
        betas: (B, at most S); the rest are 0.
        pose: (B, J, 3) axis-angle in radians, root first.
        trans: (B, 3) added at the end.

    Returns:
        Vertices (B, 3, V), joints (B, J, 3) and the joints' global rotations (B, J, 3, 3).

    """
    xp = namespace(betas)
    batch, joint_count = pose.shape[:2]
    used = betas.shape[1]
    joints_rest = (maps.joints + betas @ maps.joints_shape[:used]).reshape(batch, joint_count, 3)
    rotations = rotation_from_axis_angle(pose)
    feature = (rotations[:, 1:] - like(pose, IDENTITY)).reshape(batch, -1)
    v_posed = large_product(betas, maps.shape[:used])
    v_posed += maps.template
    v_posed += (maps.pose @ feature.mT).mT
    v_posed = v_posed.reshape(batch, 1, 3, -1)
    moved = _along_the_tree(maps, xp.concatenate((rotations, (maps.bones @ joints_rest)[..., None]), -1))
    R_world_joint, joints = moved[..., :3], moved[..., 3]
    offsets = joints[..., None] - R_world_joint @ joints_rest[..., None]
    moves = xp.concatenate((R_world_joint, offsets), -1).reshape(batch, joint_count, 12)  # of each joint: 3 rows of 4
    blended = maps.weights @ xp.swapaxes(moves, 0, 1).reshape(joint_count, batch * 12)
    rows = contiguous(blended.T).reshape(batch, 3, 4, -1)
    vertices = rows[:, :, 3] + trans[..., None]
    for axis in range(3):
        vertices += rows[:, :, axis] * v_posed[:, :, axis]
    return vertices, joints + trans[:, None], R_world_joint


def _along_the_tree(maps: SkinMaps[AnyArray], local: AnyArray) -> AnyArray:
    """Compose the joints' moves (B, J, 3, 4) from the root outwards, by doubling the way up that each has behind it."""
    xp = namespace(local)
    last_row = xp.zeros_like(local[:, :, :1]) + like(local, [0.0, 0.0, 0.0, 1.0])
    still = xp.zeros_like(local[:, :1, :1]) + like(local, STILL)
    moves = xp.concatenate((xp.concatenate((local, last_row), 2), still), 1)
    for jump in maps.jumps:
        moves = moves[:, jump] @ moves
    composed: AnyArray = moves[:, :-1, :3]
    return composed
