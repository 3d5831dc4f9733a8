"""Landmarks of a posed, shaped body, and how they move, by hand and for many bodies at once.

A landmark is a mean of vertices, so linear blend skinning makes it a short sum over joints j:

    x = sum_j Y_j,   Y_j = R_j (o_j - w_j rest_j) + w_j p_j

with w_j the weight that joint j has in it, o_j the vertices' weighted sum in the shaped template,
rest_j and p_j the joint's place in the template and on the body, R_j its global rotation. Turning
joint k by omega turns all that lies beyond it about p_k:

    dx = omega x (sum_{j beyond k} Y_j - p_k sum_{j beyond k} w_j)
    omega = R_parent J_l(theta) dtheta

docs/solver.md has the formulas. Pose correctives, which move landmarks by half a thousandth of the
body's length, are left out.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from animal3dbox.geometry.arrays import as_numpy
from animal3dbox.geometry.rigid_transforms import IDENTITY, cross_matrix, rotation_from_axis_angle
from animal3dbox.smal.array_skinning import jumps_up_the_tree
from animal3dbox.smal.keypoints.landmark_places import LandmarkPlaces
from animal3dbox.smal.keypoints.vocabulary import Vocabulary
from animal3dbox.smal.model import SPINE_JOINTS, SmalModel
from animal3dbox.smal.quadruped.rest_pose import RestAlignment

Array = NDArray[np.float64]
UNFITTED = ("Mouth", "LEar", "REar")
"""Joints that stay at rest, as the root does, whose turn is the camera's."""
TRUNK = ("pelvis", "pelvis0", "spine", "spine0", "spine1", "spine2", "spine3", "Neck", "Head")
"""Joints of the body without its legs, tail and ears."""
SMALL_ANGLE = 1e-4
"""Radians below which the factors of a rotation's derivative are taken from their series."""


@dataclass(frozen=True)
class Skeleton:
    """The moving joints of a model, and its shape directions.

    Attributes:
        joints: (N,) indices of the fitted joints.
        parents: (N,) the parent of each.
        jumps: see array_skinning.
        is_beyond: (N, J) whether a joint is the fitted one or further from the root.
        path: (J, J) 1 where a joint's place depends on a bone: its own, and those before it.
        rest: (J, 3) joints of the mean shape, about the origin.
        rest_shape: (J, 3, S) what the shape coefficients add to them.
        bones: (J, 3), from each joint's parent to it; the root's from the origin.
        bones_shape: (J, 3, S).
        origin: (3,) of the template frame that all places are about.
        alignment: of the fitted joints with the quadruped's rest pose; None: it is the same.
    """

    joints: NDArray[np.intp]
    parents: NDArray[np.intp]
    jumps: tuple[NDArray[np.intp], ...]
    is_beyond: Array
    path: Array
    rest: Array
    rest_shape: Array
    bones: Array
    bones_shape: Array
    origin: Array
    alignment: RestAlignment | None = None


@dataclass(frozen=True)
class LandmarkTables:
    """The landmarks of a vocabulary on a model with shape directions.

    Attributes:
        weights: (J, 1, L) of each joint in each landmark; all zero for one that the body lacks.
        moments: (J, 3, L) o_j - w_j rest_j of the mean shape.
        moments_shape: (S, J * 3 * L) what shape adds to them.
        beyond: (N, 1, L) weight of all that lies beyond a fitted joint.
        before: (L, J) weight by which a landmark moves with a bone.
        normals: (J, 3, L) the surface's weighted normals.
        known: (L,) which of them the body has.
        on_trunk: (L,) part of each that the spine, neck and head move.
        loose: (L,) how far each lies from the joint that is not fitted but moves it, by the
            landmarks' extent along the body.
    """

    weights: Array
    moments: Array
    moments_shape: Array
    beyond: Array
    before: Array
    normals: Array
    known: NDArray[np.bool_]
    on_trunk: Array
    loose: Array


@dataclass(frozen=True)
class JointFrames:
    """The joints of B posed bodies.

    Attributes:
        rotations: (B, J, 3, 3) global.
        places: (B, J, 3).
        rest: (B, J, 3) their places in the shaped template.
    """

    rotations: Array
    places: Array
    rest: Array


def skeleton_of(
    model: SmalModel,
    mean: Array,
    directions: Array,
    alignment: RestAlignment | None = None,
) -> Skeleton:
    """The skeleton of a model about the middle of its trunk.

    Args:
        model: with SMAL's joints.
        mean: (S',) betas of the mean shape.
        directions: (S', S) betas of each shape direction.
        alignment: of all joints with the quadruped's rest pose; None: it is the same.

    """
    regressor = as_numpy(model.J_regressor)
    columns = as_numpy(model.shapedirs)
    template = as_numpy(model.v_template) + columns @ mean
    rest = regressor @ template
    origin = rest[list(SPINE_JOINTS)].mean(0)
    rest_shape = np.einsum("jv,vcs->jcs", regressor, columns) @ directions
    count = model.joint_count
    path = np.eye(count)
    for j, parent in enumerate(model.parents):
        if parent >= 0:
            path[j] += path[parent]
    fitted = np.array(
        [j for j in range(1, count) if model.joint_names[j] not in UNFITTED], dtype=np.intp
    )
    bones, bones_shape = rest - origin, rest_shape.copy()
    parents = np.array(model.parents)
    bones[1:] = rest[1:] - rest[parents[1:]]
    bones_shape[1:] -= rest_shape[parents[1:]]
    return Skeleton(
        joints=fitted,
        parents=parents[fitted],
        jumps=jumps_up_the_tree(model.parents),
        is_beyond=np.ascontiguousarray(path[:, fitted].T),
        path=path,
        rest=rest - origin,
        rest_shape=rest_shape,
        bones=bones,
        bones_shape=bones_shape,
        origin=origin,
        alignment=None if alignment is None else alignment[fitted],
    )


def landmark_tables(
    model: SmalModel,
    vocabulary: Vocabulary,
    mean: Array,
    directions: Array,
    *,
    offsets: Array | None = None,
) -> LandmarkTables:
    """The tables of a vocabulary's landmarks.

    A place that is moved by an offset in the template moves with every joint by its weight there,
    so that only the moments change. Offsets grow with the shape's own trunk.

    Args:
        model: with SMAL's joints.
        vocabulary: names the L landmarks.
        mean: (S',) betas of the mean shape.
        directions: (S', S) betas of each shape direction.
        offsets: (L, 3) from the model's places, in trunk lengths; None: none.

    """
    places = LandmarkPlaces.of(
        vocabulary.places(model.landmark_groups, model.vertex_count), model.vertex_count
    )
    used, shares = places.ids, np.nan_to_num(places.parts.T)
    skeleton = skeleton_of(model, mean, directions)
    skin = as_numpy(model.weights)[used]
    columns = as_numpy(model.shapedirs)[used]
    vertices = as_numpy(model.v_template)[used] + columns @ mean - skeleton.origin
    parts = shares[:, :, None] * skin  # (L, U, J)
    weights = parts.sum(1).T  # (J, L)
    moments = np.einsum("luj,uc->jcl", parts, vertices)
    moments -= weights[:, None] * skeleton.rest[:, :, None]
    by_shape = np.einsum("luj,ucs->sjcl", parts, columns @ directions)
    by_shape -= weights[:, None] * skeleton.rest_shape.transpose(2, 0, 1)[..., None]
    if offsets is not None:
        length, length_shape = trunk_lengths(skeleton)
        moved = weights[:, None] * offsets.T
        moments += length * moved
        by_shape += length_shape[:, None, None, None] * moved
    normals = vertex_normals(model, mean)[used]
    places_at_rest = shares @ vertices
    unfitted = [j for j, name in enumerate(model.joint_names) if name in UNFITTED]
    arms = np.sqrt(((places_at_rest[:, None] - skeleton.rest[unfitted]) ** 2).sum(-1))
    return LandmarkTables(
        weights=weights[:, None],
        moments=moments,
        moments_shape=by_shape.reshape(directions.shape[1], -1),
        beyond=(skeleton.is_beyond @ weights)[:, None],
        before=weights.T @ skeleton.path,
        normals=np.einsum("luj,uc->jcl", parts, normals),
        known=np.isfinite(places.parts).all(0),
        on_trunk=weights[[j for j, name in enumerate(model.joint_names) if name in TRUNK]].sum(0),
        loose=(weights[unfitted].T * arms).sum(1) / np.ptp(places_at_rest[:, 0]),
    )


def trunk_lengths(skeleton: Skeleton) -> tuple[float, Array]:
    """The mean shape's trunk along x, from its first joint to its last, and its slopes (S,)."""
    first, last = SPINE_JOINTS[0], SPINE_JOINTS[-1]
    length = float(skeleton.rest[last, 0] - skeleton.rest[first, 0])
    return length, skeleton.rest_shape[last, 0] - skeleton.rest_shape[first, 0]


def vertex_normals(model: SmalModel, betas: Array) -> Array:
    """Unit normals (V, 3) of a shape's vertices in the template pose, outward."""
    vertices = as_numpy(model.v_template) + as_numpy(model.shapedirs) @ betas
    faces = as_numpy(model.faces)
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    across = np.cross(b - a, c - a)
    normals = np.zeros_like(vertices)
    for i in range(3):
        np.add.at(normals, faces[:, i], across)
    length = np.sqrt((normals * normals).sum(-1, keepdims=True))
    unit: Array = normals / np.maximum(length, 1e-12)
    return unit


def joint_frames(skeleton: Skeleton, theta: Array, shape: Array) -> JointFrames:
    """The joints of bodies.

    Args:
        skeleton: the model's.
        theta: (B, N, 3) axis-angle of the fitted joints, radians, as the quadruped's would be.
        shape: (B, S) coefficients of the shape directions.

    """
    batch, count = len(theta), len(skeleton.rest)
    by_shape = (shape[:, None] @ skeleton.bones_shape.reshape(3 * count, -1).T)[:, 0]
    transforms = np.zeros((batch, count + 1, 4, 4))
    transforms[:, :, range(4), range(4)] = 1.0
    transforms[:, skeleton.joints, :3, :3] = (
        rotation_from_axis_angle(theta)
        if skeleton.alignment is None
        else skeleton.alignment.turns(theta)
    )
    transforms[:, :-1, :3, 3] = skeleton.bones + by_shape.reshape(batch, count, 3)
    for jump in skeleton.jumps:
        transforms = transforms[:, jump] @ transforms
    rest = (shape[:, None] @ skeleton.rest_shape.reshape(3 * count, -1).T)[:, 0]
    return JointFrames(
        np.ascontiguousarray(transforms[:, :-1, :3, :3]),
        np.ascontiguousarray(transforms[:, :-1, :3, 3]),
        skeleton.rest + rest.reshape(batch, count, 3),
    )


def turns_of_joints(
    skeleton: Skeleton, frames: JointFrames, theta: Array, directions: Array
) -> Array:
    """The angular velocities (B, N, 3, P) of joints along pose directions, in the root's frame.

    Args:
        skeleton: the model's.
        frames: of the bodies.
        theta: (B, N, 3).
        directions: (N, 3, P) of theta.

    """
    before = frames.rotations[:, skeleton.parents]
    if skeleton.alignment is not None:
        before = before @ skeleton.alignment.before
    turned: Array = before @ left_jacobian(theta) @ directions[None]
    return turned


def left_jacobian(theta: Array) -> Array:
    """The matrices J_l (..., 3, 3) for which d exp(theta) = [J_l dtheta]x exp(theta).

    J_l = I + (1 - cos a) / a^2 [theta]x + (a - sin a) / a^3 [theta]x^2, with a the angle.
    """
    square = (theta * theta).sum(-1)[..., None, None]
    angle = np.sqrt(square)
    small = angle < SMALL_ANGLE
    safe = np.where(small, 1.0, angle)
    first = np.where(small, 0.5 - square / 24, (1 - np.cos(safe)) / safe**2)
    second = np.where(small, 1 / 6 - square / 120, (safe - np.sin(safe)) / safe**3)
    skew = cross_matrix(theta)
    jacobian: Array = np.array(IDENTITY) + first * skew + second * (skew @ skew)
    return jacobian


def landmark_parts(tables: LandmarkTables, frames: JointFrames, shape: Array) -> Array:
    """The parts Y (B, J, 3, L) of landmarks by joint; their sum over joints are the landmarks."""
    batch = len(shape)
    by_shape = (shape[:, None] @ tables.moments_shape)[:, 0]
    moments = tables.moments + by_shape.reshape(batch, *tables.moments.shape)
    parts: Array = frames.rotations @ moments
    parts += frames.places[..., None] * tables.weights
    return parts


def blended_rotations(tables: LandmarkTables, rotations: Array) -> Array:
    """The rotations (B, 3, 3, L) of landmarks' skin: of joints (B, J, 3, 3), by their weights."""
    batch, joints = rotations.shape[:2]
    flat = rotations.reshape(batch, joints, 9).swapaxes(1, 2) @ tables.weights[:, 0]
    blended: Array = flat.reshape(batch, 3, 3, -1)
    return blended


def slopes_of_parts(
    skeleton: Skeleton, frames: JointFrames, parts: Array, *, turns: Array, beyond: Array
) -> Array:
    """How landmarks move along pose directions, (B, P, 3, L).

    Args:
        skeleton: the model's.
        frames: of the bodies.
        parts: (B, J, 3, L) see landmark_parts.
        turns: (B, N, 3, P) see turns_of_joints.
        beyond: (N, 1, L), or (B, N, 1, L), see LandmarkTables.

    """
    batch, _, _, count = parts.shape
    arms = (skeleton.is_beyond @ parts.reshape(batch, len(skeleton.rest), -1)).reshape(
        batch, -1, 3, count
    )
    arms -= frames.places[:, skeleton.joints, :, None] * beyond
    return _turned(turns, arms)


def _turned(turns: Array, arms: Array) -> Array:
    """The sums over joints n of turns (B, N, 3, P) x arms (B, N, 3, L), as (B, P, 3, L)."""
    w, r = turns.transpose(2, 0, 3, 1), arms.transpose(2, 0, 1, 3)  # (3, B, P, N), (3, B, N, L)
    w, r = np.ascontiguousarray(w), np.ascontiguousarray(r)
    slopes = np.empty((turns.shape[0], turns.shape[3], 3, arms.shape[3]))
    for x, y, z in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        slopes[:, :, x] = w[y] @ r[z] - w[z] @ r[y]
    return slopes


def slopes_by_shape(
    skeleton: Skeleton, tables: LandmarkTables, frames: JointFrames, count: int
) -> Array:
    """How landmarks move along the first shape directions, (B, count, 3, L).

    Args:
        skeleton: the model's.
        tables: the landmarks'.
        frames: of the bodies.
        count: of the directions.

    """
    batch, joints = frames.places.shape[:2]
    landmarks = tables.weights.shape[-1]
    # sum_j R_j dq_j, as one product over joints and coordinates
    by_moment = tables.moments_shape[:count].reshape(count, 3 * joints, landmarks)
    flat = frames.rotations.transpose(0, 2, 1, 3).reshape(batch, 1, 3, 3 * joints)
    slopes: Array = flat @ by_moment[None]
    bones = turned_bones(skeleton, frames, count)  # (B, count, 3, J)
    slopes += bones @ tables.before.T
    return slopes


def turned_bones(skeleton: Skeleton, frames: JointFrames, count: int) -> Array:
    """How bones change along the first shape directions, turned as they are, (B, count, 3, J)."""
    parents = skeleton.jumps[0][:-1].copy()
    is_root = parents == len(parents)
    parents[is_root] = 0
    rotations = frames.rotations[:, parents]
    rotations[:, is_root] = np.array(IDENTITY)
    turned = rotations @ skeleton.bones_shape[None, :, :, :count]
    return np.ascontiguousarray(turned.transpose(0, 3, 2, 1))
