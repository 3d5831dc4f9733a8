"""A few hundred vertices that stand for the body's surface, and how they move."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from animal3dbox.geometry.arrays import as_numpy
from animal3dbox.labels.fit.fit_body import FitBody
from animal3dbox.labels.fit.kinematics import (
    UNFITTED,
    JointFrames,
    slopes_of_parts,
    turned_bones,
    vertex_normals,
)
from animal3dbox.smal.model import SmalModel

Array = NDArray[np.float64]
SURFACE_VERTICES = 2000
EAR_SHARE = 0.3
"""Vertices that the joints that are not fitted move by more than this do not stand for the body."""


@dataclass(frozen=True)
class Surface:
    """The chosen vertices of a body.

    Attributes:
        ids: (M,) their numbers.
        weights: (M, J) skinning weights.
        vertices: (M, 3) in the mean shape, about the body's origin.
        vertices_shape: (S, M * 3) what shape adds to them.
        normals: (M, 3) unit, in the template pose.
        beyond: (N, M) weight of all that lies beyond a fitted joint.
    """

    ids: NDArray[np.intp]
    weights: Array
    vertices: Array
    vertices_shape: Array
    normals: Array
    beyond: Array


@dataclass(frozen=True)
class PosedSurface:
    """The vertices of B posed bodies.

    Attributes:
        rest: (B, M, 3) shaped, in the template pose.
        blended: (B, M, 3, 3) rotations of the skin.
        points: (B, 3, M) posed.
    """

    rest: Array
    blended: Array
    points: Array


@lru_cache(maxsize=64)
def surface_of(body: FitBody) -> Surface:
    """The surface of a body in its mean shape."""
    ids = _spread_vertices(body.model)
    prior, skeleton = body.shape_prior, body.skeleton
    columns = as_numpy(body.model.shapedirs)[ids]
    weights = as_numpy(body.model.weights)[ids]
    vertices = as_numpy(body.model.v_template)[ids] + columns @ prior.mean - skeleton.origin
    by_shape = (columns @ prior.directions).transpose(2, 0, 1).reshape(-1, 3 * len(ids))
    return Surface(
        ids=ids,
        weights=weights,
        vertices=vertices,
        vertices_shape=np.ascontiguousarray(by_shape),
        normals=vertex_normals(body.model, prior.mean)[ids],
        beyond=skeleton.is_beyond @ weights.T,
    )


@lru_cache(maxsize=16)
def _spread_vertices(model: SmalModel) -> NDArray[np.intp]:
    """Vertices as far from each other as may be: each the farthest from those before it."""
    weights = as_numpy(model.weights)
    loose = [j for j, name in enumerate(model.joint_names) if name in UNFITTED]
    free = np.flatnonzero(weights[:, loose].sum(1) < EAR_SHARE)
    places = as_numpy(model.v_template)[free]
    chosen = [0]
    nearest = ((places - places[0]) ** 2).sum(-1)
    for _ in range(min(SURFACE_VERTICES, len(free)) - 1):
        chosen.append(int(nearest.argmax()))
        nearest = np.minimum(nearest, ((places - places[chosen[-1]]) ** 2).sum(-1))
    return np.sort(free[chosen])


def posed_surface(surface: Surface, frames: JointFrames, shape: Array) -> PosedSurface:
    """The surface of bodies with shape coefficients (B, S), posed."""
    batch = len(shape)
    by_shape = (shape[:, None] @ surface.vertices_shape)[:, 0]
    rest = surface.vertices + by_shape.reshape(batch, -1, 3)
    offsets = frames.places[..., None] - frames.rotations @ frames.rest[..., None]
    transforms = np.concatenate((frames.rotations, offsets), -1).reshape(batch, -1, 12)
    blended = (surface.weights @ transforms).reshape(batch, -1, 3, 4)
    turned = np.ascontiguousarray(blended[..., :3])
    points = (turned @ rest[..., None])[..., 0] + blended[..., 3]
    return PosedSurface(rest, turned, np.ascontiguousarray(points.swapaxes(1, 2)))


def surface_slopes(
    body: FitBody,
    surface: Surface,
    posed: PosedSurface,
    *,
    frames: JointFrames,
    turns: Array,
    ids: NDArray[np.intp],
    shape_count: int,
) -> Array:
    """How some vertices move along pose and shape directions, (B, P + shape_count, 3, I).

    Args:
        body: the body's tables.
        surface: its vertices.
        posed: their places.
        frames: of the bodies.
        turns: (B, N, 3, P) see turns_of_joints.
        ids: (B, I) which of the surface's vertices.
        shape_count: how many shape directions.

    """
    batch, rows = len(ids), np.arange(len(ids))[:, None]
    weights = np.ascontiguousarray(surface.weights[ids].swapaxes(1, 2))  # (B, J, I)
    rest = posed.rest[rows, ids].swapaxes(1, 2)  # (B, 3, I)
    offsets = frames.places[..., None] - frames.rotations @ frames.rest[..., None]
    parts = frames.rotations @ np.ascontiguousarray(rest)[:, None]
    parts += offsets
    parts *= weights[:, :, None]
    beyond = surface.beyond[:, ids].swapaxes(0, 1)[:, :, None]  # (B, N, 1, I)
    by_pose = slopes_of_parts(body.skeleton, frames, parts, turns=turns, beyond=beyond)
    # d v = R_blended d rest + sum_j w_j (d p_j - R_j d rest_j)
    columns = surface.vertices_shape[:shape_count].reshape(shape_count, -1, 3)[:, ids]
    by_rest = posed.blended[rows, ids] @ columns.transpose(1, 2, 3, 0)  # (B, I, 3, S)
    bones = turned_bones(body.skeleton, frames, shape_count)  # (B, S, 3, J)
    of_rest = frames.rotations @ body.skeleton.rest_shape[None, :, :, :shape_count]
    of_joints = bones @ body.skeleton.path.T - of_rest.transpose(0, 3, 2, 1)
    by_shape = by_rest.transpose(0, 3, 2, 1) + of_joints @ weights[:, None]
    slopes: Array = np.concatenate((by_pose, by_shape.reshape(batch, shape_count, 3, -1)), 1)
    return slopes
