"""Linear blend skinning by one formula.

Over tensors, differentiable and on any device, or over arrays, for a loader's worker.

Arrays leave out what is zero of most constants (row_tables.py), in forms that torch cannot
differentiate in all directions. Points are kept coordinate by coordinate, (B, 3, V): bounds and
projections of a body then run along memory.

Vertices may be computed in float32 where joints and places are in float64: the constants of all
vertices are megabytes, and reading them is what takes the time. About the body's own origin that
costs less than a millionth of its length, wherever the body stands.
"""

from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from typing import Any, Generic

import numpy as np
import torch
from torch import Tensor

from animal3dbox.geometry.arrays import AnyArray, as_numpy, is_plain, like, namespace
from animal3dbox.geometry.rigid_transforms import IDENTITY, rotation_from_axis_angle
from animal3dbox.smal.row_tables import row_table

BODIES_AT_ONCE = 16
"""Arrays of so many bodies at a time: more of them fall out of the processor's cache."""


@dataclass(frozen=True)
class SkinMaps(Generic[AnyArray]):
    """A model's constants, laid out for skin.

    Attributes:
        columns: (1 + S + 9 (J - 1), 3, V) coordinate by coordinate: the template, then what shape
            and bent joints add to it.
        weights: (J, 1, V).
        joints: (3 J,) of the template, joint by joint.
        joints_shape: (S, 3 J).
        bones: (J, J) 1 on the diagonal, -1 at each joint's parent: joints to bones.
        still: (J + 1, 4, 4) moves that change nothing.
        jumps: for each joint, and a last one that stands still: the ancestor 1, 2, 4, ... steps up
            the tree.

    Of arrays, columns and weights are RowTables (row_tables.py), which may be in float32 beside
    joints in float64.
    """

    columns: Any
    weights: Any
    joints: AnyArray
    joints_shape: AnyArray
    bones: AnyArray
    still: AnyArray
    jumps: tuple[np.ndarray, ...]


@torch.inference_mode(False)
def skin_maps(
    v_template: Tensor,
    shapedirs: Tensor,
    posedirs: Tensor,
    J_regressor: Tensor,
    weights: Tensor,
    parents: Sequence[int],
) -> SkinMaps[Tensor]:
    """The constants of a model as tensors, whatever torch is set to.

    See SmalModel for the arguments.
    """
    joints_shape = (
        _joints_of(J_regressor, shapedirs.flatten(1))
        .reshape(3 * len(parents), shapedirs.shape[2])
        .mT
    )
    bones = torch.eye(len(parents), dtype=weights.dtype, device=weights.device)
    for joint, parent in enumerate(parents[1:], start=1):
        bones[joint, parent] = -1
    jumps = [[parent if parent >= 0 else len(parents) for parent in (*parents, -1)]]
    while any(ancestor < len(parents) for ancestor in jumps[-1]):
        jumps.append([jumps[-1][ancestor] for ancestor in jumps[-1]])
    return SkinMaps(
        columns=torch.cat(
            [part.permute(2, 1, 0) for part in (v_template[..., None], shapedirs, posedirs)]
        ),
        weights=weights.mT[:, None].contiguous(),
        joints=_joints_of(J_regressor, v_template).flatten(),
        joints_shape=joints_shape.contiguous(),
        bones=bones,
        still=torch.eye(4, dtype=weights.dtype, device=weights.device).repeat(
            len(parents) + 1, 1, 1
        ),
        jumps=tuple(np.array(jump) for jump in jumps[:-1]),
    )


def _joints_of(J_regressor: Tensor, values: Tensor) -> Tensor:
    """The joints' (J, K) of what vertices have (V, K), not in half precision, and of plain tensors
    summed in order."""
    if is_plain(J_regressor) and is_plain(values):
        return torch.from_numpy(np.einsum("jv,vk->jk", as_numpy(J_regressor), as_numpy(values)))
    kind = values.device.type
    with (
        torch.autocast(kind, enabled=False)
        if torch.amp.is_autocast_available(kind)
        else nullcontext()
    ):
        return J_regressor @ values


def array_maps(maps: SkinMaps[Tensor], dtype: torch.dtype) -> SkinMaps[np.ndarray]:
    """The same constants as arrays; those of all vertices in a floating-point type."""
    columns = row_table(as_numpy(maps.columns.to(dtype)), BODIES_AT_ONCE)
    weights = row_table(as_numpy(maps.weights.to(dtype)), 12 * BODIES_AT_ONCE)
    joints, joints_shape, bones, still = (
        as_numpy(x) for x in (maps.joints, maps.joints_shape, maps.bones, maps.still)
    )
    return SkinMaps(columns, weights, joints, joints_shape, bones, still, maps.jumps)


def skin(
    maps: SkinMaps[AnyArray], betas: AnyArray, pose: AnyArray
) -> tuple[AnyArray, AnyArray, AnyArray]:
    """Bodies in some pose, about the template's origin.

    Args:
        maps: the model's.
        betas: (B, at most S); the rest are 0.
        pose: (B, J, 3) axis-angle in radians, root first.

    Returns:
        Vertices (B, 3, V), in the type of the maps', joints (B, J, 3) and the joints' global
        rotations (B, J, 3, 3).

    """
    batch, joint_count = pose.shape[:2]
    joints_rest = (
        maps.joints + (betas[:, None] @ maps.joints_shape[: betas.shape[1]])[:, 0]
    ).reshape(batch, joint_count, 3)
    rotations = rotation_from_axis_angle(pose)
    R_world_joint, joints = _along_the_tree(maps, rotations, maps.bones @ joints_rest)
    offsets = joints[..., None] - R_world_joint @ joints_rest[..., None]
    moves = namespace(betas).concatenate((R_world_joint, offsets), -1)  # of each joint: 3 rows of 4
    return _blended(maps, moves, _before_turning(maps, betas, rotations)), joints, R_world_joint


def _before_turning(maps: SkinMaps[AnyArray], betas: AnyArray, rotations: AnyArray) -> AnyArray:
    """The template in a shape (B, at most S) with what bent joints (B, J, 3, 3) add to it, (B, 3,
    V)."""
    xp, one = namespace(betas), namespace(betas).ones_like(rotations[:, 0, :1, 0])
    left_out: list[AnyArray] = [
        xp.zeros_like(one) for _ in range(betas.shape[1], maps.joints_shape.shape[0])
    ]
    bent = (rotations[:, 1:] - like(rotations, IDENTITY)).reshape(
        len(betas), 9 * (rotations.shape[1] - 1)
    )
    weights: AnyArray = xp.concatenate((one, betas, *left_out, bent), 1)
    return _sums(maps.columns, weights)


def _blended(maps: SkinMaps[AnyArray], moves: AnyArray, v_posed: AnyArray) -> AnyArray:
    """Vertices (B, 3, V) moved by the weighted mean of the joints' moves (B, J, 3, 4), (B, 3, V)."""
    batch, joint_count = moves.shape[:2]
    of_entries = (
        namespace(moves)
        .swapaxes(moves.reshape(batch, joint_count, 12), 1, 2)
        .reshape(batch * 12, joint_count)
    )
    blended = _sums(maps.weights, of_entries)
    rows = blended.reshape(batch, 3, 4, blended.shape[2])
    vertices: AnyArray = rows[:, :, 3] + rows[:, :, 0] * v_posed[:, None, 0]
    for axis in (1, 2):
        vertices += rows[:, :, axis] * v_posed[:, None, axis]
    return vertices


def _sums(rows: Any, weights: AnyArray) -> AnyArray:
    """Weighted sums (N, C, V) of a map's rows (K, C, V) by weights (N, K)."""
    sums: AnyArray = (
        torch.tensordot(weights, rows, 1) if isinstance(weights, Tensor) else rows.sums(weights)
    )
    return sums


def _along_the_tree(
    maps: SkinMaps[AnyArray], rotations: AnyArray, bones: AnyArray
) -> tuple[AnyArray, AnyArray]:
    """Compose the joints' turns (B, J, 3, 3) and steps (B, J, 3) from the root outwards, by
    doubling the way up that each has behind it."""
    moves = maps.still + namespace(bones).zeros_like(bones[:, :1, :1, None])
    moves[:, :-1, :3, :3], moves[:, :-1, :3, 3] = rotations, bones
    for jump in maps.jumps:
        moves = moves[:, jump] @ moves
    return moves[:, :-1, :3, :3], moves[:, :-1, :3, 3]
