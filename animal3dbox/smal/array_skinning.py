"""Linear blend skinning over arrays, for a loader's worker: the fast way beside the definition.

linear_blend_skinning.py defines what is computed here, and a test holds both equal to 1e-12 of the
body's length in float64. It pays in benchmarks/lbs.py, where the lines "of the definition's" give
its share of the time (a third for one body, a tenth with vertices in float32), and in
benchmarks/label_stages.py, line "pose a body, read its landmarks".

What it does otherwise: most constants leave out what is zero (row_tables.py); points are kept
coordinate by coordinate, (B, 3, V), so that bounds and projections of a body run along memory; the
kinematic chain is composed by doubling, in 4 steps for 35 joints. Vertices may be computed in
float32 where joints and places are in float64: the constants of all vertices are megabytes, and
reading them is what takes the time. About the body's own origin that costs less than a millionth
of its length, wherever the body stands.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from animal3dbox.geometry.rigid_transforms import IDENTITY, rotation_from_axis_angle
from animal3dbox.smal.row_tables import RowTable, row_table

BODIES_AT_ONCE = 16
"""How many bodies are posed at a time: more of them fall out of the processor's cache."""


@dataclass(frozen=True)
class SkinningTables:
    """A model's constants, laid out for pose_arrays.

    Attributes:
        columns: of (1 + S + 9 (J - 1), 3, V) coordinate by coordinate: the template, then what
            shape and bent joints add to it.
        weights: of (J, 1, V).
        joints: (3 J,) of the template, joint by joint.
        joints_shape: (S, 3 J) what shape adds to them.
        bones: (J, J) 1 on the diagonal, -1 at each joint's parent: joints to bones.
        identities: (J + 1, 4, 4) rigid transforms that change nothing.
        jumps: for each joint, and a last one that stands still: the ancestor 1, 2, 4, ... steps up
            the tree.

    Columns and weights may be in float32 beside joints in float64.
    """

    columns: RowTable
    weights: RowTable
    joints: np.ndarray
    joints_shape: np.ndarray
    bones: np.ndarray
    identities: np.ndarray
    jumps: tuple[np.ndarray, ...]


def skinning_tables(
    v_template: np.ndarray,
    *,
    shapedirs: np.ndarray,
    posedirs: np.ndarray,
    J_regressor: np.ndarray,
    weights: np.ndarray,
    parents: Sequence[int],
    vertices_in: np.dtype,
) -> SkinningTables:
    """The tables of a model's constants, see SmalModel; those of all vertices in a type."""
    columns = np.concatenate(
        [part.transpose(2, 1, 0) for part in (v_template[..., None], shapedirs, posedirs)]
    )
    # Summed in order, by no product of matrices: the same bits in any process
    joints = np.einsum("jv,vk->jk", J_regressor, v_template).reshape(-1)
    joints_shape = np.einsum("jv,vk->jk", J_regressor, shapedirs.reshape(len(v_template), -1))
    bones = np.eye(len(parents), dtype=weights.dtype)
    for joint, parent in enumerate(parents[1:], start=1):
        bones[joint, parent] = -1
    return SkinningTables(
        columns=row_table(np.ascontiguousarray(columns, vertices_in), BODIES_AT_ONCE),
        weights=row_table(
            np.ascontiguousarray(weights.T[:, None], vertices_in), 12 * BODIES_AT_ONCE
        ),
        joints=joints,
        joints_shape=np.ascontiguousarray(
            joints_shape.reshape(3 * len(parents), shapedirs.shape[2]).T
        ),
        bones=bones,
        identities=np.tile(np.eye(4, dtype=weights.dtype), (len(parents) + 1, 1, 1)),
        jumps=jumps_up_the_tree(parents),
    )


def jumps_up_the_tree(parents: Sequence[int]) -> tuple[np.ndarray, ...]:
    """The ancestors of each joint 1, 2, 4, ... steps up; J for those beyond the root."""
    jumps = [[parent if parent >= 0 else len(parents) for parent in (*parents, -1)]]
    while any(ancestor < len(parents) for ancestor in jumps[-1]):
        jumps.append([jumps[-1][ancestor] for ancestor in jumps[-1]])
    return tuple(np.array(jump) for jump in jumps[:-1])


def pose_arrays(
    tables: SkinningTables, betas: np.ndarray, pose: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pose bodies about the template's origin.

    Args:
        tables: the model's.
        betas: (B, at most S); the rest are 0.
        pose: (B, J, 3) axis-angle in radians, root first.

    Returns:
        Vertices (B, 3, V), in the type of the tables', joints (B, J, 3) and the joints' global
        rotations (B, J, 3, 3).

    """
    batch, joint_count = pose.shape[:2]
    joints_rest = tables.joints + (betas[:, None] @ tables.joints_shape[: betas.shape[1]])[:, 0]
    joints_rest = joints_rest.reshape(batch, joint_count, 3)
    rotations = rotation_from_axis_angle(pose)
    R_world_joint, joints = _along_the_tree(tables, rotations, tables.bones @ joints_rest)
    offsets = joints[..., None] - R_world_joint @ joints_rest[..., None]
    transforms = np.concatenate((R_world_joint, offsets), -1)
    v_posed = _unskinned_vertices(tables, betas, rotations)
    return _blended(tables, transforms, v_posed), joints, R_world_joint


def _unskinned_vertices(
    tables: SkinningTables, betas: np.ndarray, rotations: np.ndarray
) -> np.ndarray:
    """The vertices (B, 3, V) after shape blend and pose blend, in one sum over the columns.

    Args:
        tables: the model's.
        betas: (B, at most S).
        rotations: (B, J, 3, 3) of each joint against its parent.

    """
    one = np.ones_like(rotations[:, 0, :1, 0])
    missing_betas = [np.zeros_like(one)] * (len(tables.joints_shape) - betas.shape[1])
    bends = (rotations[:, 1:] - np.array(IDENTITY, rotations.dtype)).reshape(
        len(betas), 9 * (rotations.shape[1] - 1)
    )
    return tables.columns.sums(np.concatenate((one, betas, *missing_betas, bends), 1))


def _blended(tables: SkinningTables, transforms: np.ndarray, v_posed: np.ndarray) -> np.ndarray:
    """The vertices (B, 3, V) moved by the weighted mean of the joints' transforms (B, J, 3, 4)."""
    batch, joint_count = transforms.shape[:2]
    entries = transforms.reshape(batch, joint_count, 12).swapaxes(1, 2)
    blended = tables.weights.sums(entries.reshape(batch * 12, joint_count))
    rows = blended.reshape(batch, 3, 4, blended.shape[2])
    # v = t + R[:, 0] x + R[:, 1] y + R[:, 2] z
    vertices: np.ndarray = rows[:, :, 3] + rows[:, :, 0] * v_posed[:, None, 0]
    for axis in (1, 2):
        vertices += rows[:, :, axis] * v_posed[:, None, axis]
    return vertices


def _along_the_tree(
    tables: SkinningTables, rotations: np.ndarray, bones: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The global rotations (B, J, 3, 3) and places (B, J, 3) of joints.

    Each step doubles the length of the way up that a joint's transform has behind it.

    Args:
        tables: the model's.
        rotations: (B, J, 3, 3) of each joint against its parent.
        bones: (B, J, 3) from each joint's parent to it, in the template pose.

    """
    transforms = tables.identities + np.zeros_like(bones[:, :1, :1, None])
    transforms[:, :-1, :3, :3], transforms[:, :-1, :3, 3] = rotations, bones
    for jump in tables.jumps:
        transforms = transforms[:, jump] @ transforms
    return transforms[:, :-1, :3, :3], transforms[:, :-1, :3, 3]
