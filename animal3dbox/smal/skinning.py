"""Linear blend skinning by one formula: over tensors, differentiable and on any device, or over arrays, for a loader's worker.

Arrays keep what is mostly zeros (pose columns, weights) as sparse matrices, which torch cannot differentiate in all directions.
Points are kept coordinate by coordinate, (B, 3, V): bounds and projections of a body then run along memory.

Vertices may be computed in float32 where joints and places are in float64: the constants of all vertices are megabytes, and reading
them is what takes the time. About the body's own origin that costs less than a millionth of its length, wherever the body stands.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Generic

import numpy as np
import torch
from scipy.sparse import csr_array
from torch import Tensor

from animal3dbox.geometry.arrays import AnyArray, as_numpy, as_type_of, large_product, like, namespace, transposed
from animal3dbox.geometry.rigid import IDENTITY, rotation_from_axis_angle

SPARSE_BELOW = 0.3
"""Share of a pose's columns that is not zero up to which a sparse matrix is the faster one."""
BODIES_AT_ONCE = 12
"""Arrays of so many bodies at a time: more of them fall out of the processor's cache."""


@dataclass(frozen=True)
class SkinMaps(Generic[AnyArray]):
    """A model's constants, laid out for skin; Any stands for an array, or a sparse matrix that multiplies like one.

    Attributes:
        template: (3 V,) coordinate by coordinate.
        shape: (S, 3 V).
        pose: (9 (J - 1), 3 V), or its transpose, sparse.
        weights: (V, J); of arrays sparse.
        joints: (3 J,) of the template, joint by joint.
        joints_shape: (S, 3 J).
        bones: (J, J) 1 on the diagonal, -1 at each joint's parent: joints to bones.
        still: (J + 1, 4, 4) moves that change nothing.
        jumps: for each joint, and a last one that stands still: the ancestor 1, 2, 4, ... steps up the tree.

    template, shape, pose and weights may be in float32 beside joints in float64.
    """

    template: AnyArray
    shape: AnyArray
    pose: Any
    weights: Any
    joints: AnyArray
    joints_shape: AnyArray
    bones: AnyArray
    still: AnyArray
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
        pose=posedirs.permute(2, 1, 0).flatten(1).contiguous(),
        weights=weights,
        joints=(J_regressor @ v_template).flatten(),
        joints_shape=joints_shape.contiguous(),
        bones=bones,
        still=torch.eye(4, dtype=weights.dtype, device=weights.device).repeat(len(parents) + 1, 1, 1),
        jumps=tuple(np.array(jump) for jump in jumps[:-1]),
    )


def array_maps(maps: SkinMaps[Tensor], dtype: torch.dtype) -> SkinMaps[np.ndarray]:
    """The same constants as arrays, sparse where that is faster; those of all vertices in a floating-point type."""
    template, shape, pose, weights = (as_numpy(x.to(dtype)) for x in (maps.template, maps.shape, maps.pose, maps.weights))
    joints, joints_shape, bones, still = (as_numpy(x) for x in (maps.joints, maps.joints_shape, maps.bones, maps.still))
    few = np.count_nonzero(pose) < SPARSE_BELOW * pose.size
    return SkinMaps(template, shape, csr_array(pose.T) if few else pose, csr_array(weights), joints, joints_shape, bones, still, maps.jumps)


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
    batch, joint_count = pose.shape[:2]
    used = betas.shape[1]
    joints_rest = (maps.joints + (betas[:, None] @ maps.joints_shape[:used])[:, 0]).reshape(batch, joint_count, 3)
    rotations = rotation_from_axis_angle(pose)
    feature = (rotations[:, 1:] - like(pose, IDENTITY)).reshape(batch, -1)
    v_posed = large_product(as_type_of(betas, maps.shape), maps.shape[:used])
    v_posed += maps.template
    v_posed += _pose_offsets(maps, as_type_of(feature, maps.shape))
    R_world_joint, joints = _along_the_tree(maps, rotations, maps.bones @ joints_rest)
    offsets = joints[..., None] - R_world_joint @ joints_rest[..., None]
    moves = namespace(betas).concatenate((R_world_joint, offsets), -1)  # of each joint: 3 rows of 4
    vertices = _blended(maps, as_type_of(moves, maps.shape), v_posed.reshape(batch, 1, 3, -1)) + trans[..., None]
    return vertices, joints + trans[:, None], R_world_joint


def _pose_offsets(maps: SkinMaps[AnyArray], feature: AnyArray) -> AnyArray:
    """What bent joints' features (B, 9 (J - 1)) add to the vertices (B, 3 V)."""
    product: Any = (maps.pose @ feature.T).T if isinstance(maps.pose, csr_array) else large_product(feature, maps.pose)
    offsets: AnyArray = product
    return offsets


def _blended(maps: SkinMaps[AnyArray], moves: AnyArray, v_posed: AnyArray) -> AnyArray:
    """Vertices (B, 1, 3, V) moved by the weighted mean of the joints' moves (B, J, 3, 4), (B, 3, V)."""
    batch, joint_count = moves.shape[:2]
    blended = maps.weights @ namespace(moves).swapaxes(moves, 0, 1).reshape(joint_count, batch * 12)
    rows = transposed(blended).reshape(batch, 3, 4, -1)
    vertices: AnyArray = rows[:, :, 3] + rows[:, :, 0] * v_posed[:, :, 0]
    for axis in (1, 2):
        vertices += rows[:, :, axis] * v_posed[:, :, axis]
    return vertices


def _along_the_tree(maps: SkinMaps[AnyArray], rotations: AnyArray, bones: AnyArray) -> tuple[AnyArray, AnyArray]:
    """Compose the joints' turns (B, J, 3, 3) and steps (B, J, 3) from the root outwards, by doubling the way up that each has behind it."""
    moves = maps.still + namespace(bones).zeros_like(bones[:, :1, :1, None])
    moves[:, :-1, :3, :3], moves[:, :-1, :3, 3] = rotations, bones
    for jump in maps.jumps:
        moves = moves[:, jump] @ moves
    return moves[:, :-1, :3, :3], moves[:, :-1, :3, 3]
