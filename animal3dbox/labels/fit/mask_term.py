"""The mask's part of the cost: its outline lies on the body's rim, and no vertex lies outside.

Matched anew at every state. docs/solver.md has the formulas.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from animal3dbox.labels.fit.descent import projected
from animal3dbox.labels.fit.fit_body import FitBody, PosedJoints
from animal3dbox.labels.fit.local_fit import LocalFit
from animal3dbox.labels.fit.mask_target import MaskTarget
from animal3dbox.labels.fit.problem import FitProblem, FitState
from animal3dbox.labels.fit.surface import PosedSurface, posed_surface, surface_of, surface_slopes

Array = NDArray[np.float64]
MASK_SD = 0.012
"""Standard deviation of the outline, by the keypoints' extent."""
MASK_WIDTH = 1.5
"""Width of its Cauchy loss, in standard deviations."""
RIM_REACH = 0.05
"""By the extent: how far a match may be for a normal that is off by one radian."""
RIM_FACING = 0.35
"""Greatest cosine of a vertex's normal and the line of sight on the rim."""
TURNED = 2.0
"""How much more a match costs for facing the camera than for a normal that is off."""
EVERY = 2
"""One of so many vertices is tested for lying outside the mask."""
OUTSIDE = 64
"""How many of the vertices outside the mask count, the farthest."""


@dataclass(frozen=True)
class MaskWeights:
    """How many keypoints' coordinates a mask weighs as much as.

    Attributes:
        outline: of all outline points together.
        outside: of all vertices together, if all lay outside.
    """

    outline: float
    outside: float


@dataclass(frozen=True)
class MaskMatches:
    """What a mask says of vertices: that they lie on lines of the picture.

    Attributes:
        ids: (B, I) the vertices.
        places: (B, I, 2) points of the lines.
        normals: (B, I, 2) unit.
        weights: (B, I) of the squared distances, in units of the loss.
    """

    ids: NDArray[np.intp]
    places: Array
    normals: Array
    weights: Array


def mask_terms(
    body: FitBody,
    problem: FitProblem,
    state: FitState,
    *,
    targets: Mapping[int, MaskTarget],
    weights: MaskWeights,
    counts: tuple[int, int],
    joints: PosedJoints | None = None,
) -> LocalFit:
    """The cost of states by masks, of which each state's animal has one.

    Args:
        body: the body's tables.
        problem: of all animals.
        state: B hypotheses.
        targets: animal -> its mask.
        weights: of the mask's two parts.
        counts: how many pose and shape directions are free.
        joints: of the states, if they are at hand.

    """
    surface = surface_of(body)
    joints = joints or body.joints(state.pose, state.shape, counts[0])
    frames = joints.frames
    posed = posed_surface(surface, frames, state.shape)
    linear = problem.linear[state.animal]
    px, facing, outward = _seen(state, linear, posed, surface.normals)
    extent = problem.extent[state.animal]
    rows = [
        _matches(
            targets[animal], px[i], facing[i], outward=outward[i], extent=extent[i], weights=weights
        )
        for i, animal in enumerate(state.animal.tolist())
    ]
    matches = MaskMatches(*(np.stack(part) for part in zip(*rows, strict=True)))
    slopes = surface_slopes(
        body,
        surface,
        posed,
        frames=frames,
        turns=joints.turns,
        ids=matches.ids,
        shape_count=counts[1],
    )
    points = np.take_along_axis(posed.points, matches.ids[:, None], 2)
    seen, moves, _ = projected(state, linear, points, slopes)
    normals = matches.normals.swapaxes(1, 2)
    sd = (MASK_SD * extent)[:, None]
    r = ((seen - matches.places.swapaxes(1, 2)) * normals).sum(1) / sd
    along = (moves * normals[:, None]).sum(2) / sd[:, None]
    square = (r / MASK_WIDTH) ** 2
    cost = MASK_WIDTH**2 / 2 * (matches.weights * np.log1p(square)).sum(-1)
    factor = matches.weights / (1 + square)
    weighted = along * factor[:, None]
    return LocalFit(cost, weighted @ along.swapaxes(1, 2), (weighted @ r[..., None])[..., 0])


def _seen(
    state: FitState, linear: Array, posed: PosedSurface, normals: Array
) -> tuple[Array, Array, Array]:
    """Where vertices are seen, (B, 2, M), how far they face the camera (B, M), and which way out.

    The last, (B, 2, M), are their normals' unit directions in the picture.
    """
    cam = state.R @ posed.points + state.t[..., None]
    inverse = np.exp(state.focal)[:, None] / np.maximum(cam[:, 2], 1e-9)
    px = linear @ (cam[:, :2] * inverse[:, None])
    skin = (posed.blended @ normals[..., None])[..., 0]
    turned = state.R @ skin.swapaxes(1, 2)
    sight = cam / np.sqrt((cam * cam).sum(1, keepdims=True))
    facing = -(turned * sight).sum(1)
    flat = turned[:, :2]
    return px, facing, flat / np.maximum(np.sqrt((flat * flat).sum(1, keepdims=True)), 1e-9)


def _matches(
    target: MaskTarget,
    px: Array,
    facing: Array,
    *,
    outward: Array,
    extent: float,
    weights: MaskWeights,
) -> tuple[NDArray[np.intp], Array, Array, Array]:
    """The matches of one state, see MaskMatches.

    Args:
        target: the mask.
        px: (2, M) where the vertices are seen.
        facing: (M,) cosines of their normals and the line of sight.
        outward: (2, M) their normals' directions in the picture.
        extent: of the keypoints, px.
        weights: of the mask's two parts.

    """
    nearest = _rim_vertices(target, px, facing, outward=outward, extent=extent)
    count = max(float(target.counts.sum()), 1.0)
    far, back, unit, is_out = _outside_vertices(target, px)
    return (
        np.concatenate((nearest, far)),
        np.concatenate((target.points, back)),
        np.concatenate((target.normals, unit)),
        np.concatenate(
            (
                weights.outline / count * target.counts,
                weights.outside * EVERY / px.shape[1] * is_out,
            )
        ),
    )


def _rim_vertices(
    target: MaskTarget, px: Array, facing: Array, *, outward: Array, extent: float
) -> NDArray[np.intp]:
    """The vertex on the rim that is nearest to each point of the outline; see _matches."""
    reach = RIM_REACH * extent
    rim = np.flatnonzero(np.abs(facing) < RIM_FACING)
    rim = rim if len(rim) else np.arange(len(facing))
    own, out = px[:, rim], outward[:, rim]
    # |q - x|^2 + reach^2 ((TURNED facing)^2 + 2 (1 - m . n)), without what all vertices share
    left = np.concatenate((-2 * target.points, -2 * reach**2 * target.normals), 1)
    alone = (own * own).sum(0) + (TURNED * reach * facing[rim]) ** 2
    nearest: NDArray[np.intp] = rim[(left @ np.concatenate((own, out)) + alone).argmin(1)]
    return nearest


def _outside_vertices(
    target: MaskTarget, px: Array
) -> tuple[NDArray[np.intp], Array, Array, Array]:
    """OUTSIDE vertices outside the mask, the farthest: their numbers, and their ways back.

    Returns:
        ids (OUTSIDE,), the mask's points nearest to them (OUTSIDE, 2), the directions from there
        (OUTSIDE, 2), and 1, or 0 of a vertex that fills up because fewer are outside, (OUTSIDE,).

    """
    tested = px[:, ::EVERY].T
    height, width = target.nearest.shape[:2]
    cells = np.clip((tested - target.corner) / target.cell, 0, [width - 1, height - 1])
    column, row = np.rint(cells).astype(np.intp).T
    away = tested - target.nearest[row, column]
    distance = np.sqrt((away * away).sum(-1))
    u0, v0, u1, v1 = target.frame
    in_frame = (tested > [u0, v0]).all(1) & (tested < [u1, v1]).all(1)
    out = np.flatnonzero(in_frame & (distance > 2 * target.cell))
    out = out[np.argsort(-distance[out], kind="stable")[:OUTSIDE]]
    far = np.zeros(OUTSIDE, dtype=np.intp)
    far[: len(out)] = out
    unit = away[far] / np.maximum(distance[far], 1e-9)[:, None]
    is_out = (np.arange(OUTSIDE) < len(out)).astype(np.float64)
    return EVERY * far, target.nearest[row[far], column[far]], unit, is_out
