"""The things that stand before and beside the animals.

They are trunks, bushes, rocks, fences, tufts of grass, trees, and ledges to stand on.
"""

import math
from dataclasses import dataclass
from functools import cache

import numpy as np
import torch
import trimesh
from numpy.typing import NDArray

Points = NDArray[np.float64]
"""Points (N, 3) or (N, 2)."""
Faces = NDArray[np.int64]
"""Triangles (F, 3) as vertex ids."""
Color = tuple[float, float, float]
"""Red, green and blue, 0 to 1."""

LEDGE_GAP = 1e-3
"""Depth of a ledge's top below the feet on it, in body lengths, so that they do not cut."""


@dataclass(frozen=True)
class Thing:
    """A closed mesh in the world, z up.

    Attributes:
        kind: name of the kind.
        vertices: (V, 3) world.
        faces: (F, 3), counter-clockwise seen from outside.
        color: mean colour, 0 to 1.
        grain: amount by which the colour varies over the thing, and its cycles a unit.
        stem: colour below CROWN_BOTTOM; None for the same.
    """

    kind: str
    vertices: torch.Tensor
    faces: torch.Tensor
    color: Color
    grain: tuple[float, float]
    stem: Color | None = None


OCCLUDERS = ("trunk", "bush", "rock", "fence", "tuft")
"""Kinds of things that hide animals from handheld cameras."""
REACH = {"trunk": 0.15, "bush": 0.45, "rock": 0.35, "fence": 0.7, "tuft": 0.25, "tree": 0.15}
"""Radius on the ground that a thing of each kind keeps within.

A tree's crown is above the animals.
"""
CROWN_BOTTOM = 1.15
"""Height of a tree's crown over the ground, in body lengths."""
BARK = (0.36, 0.28, 0.21)
"""Colour of trunks."""
STEEPNESS = 1.0
"""Run of a ledge's sides by their rise.

It is less than a camera from below needs to see over the rim.
"""


def make_thing(rng: np.random.Generator, kind: str, place: Points) -> Thing:
    """A random thing of a kind at a place (2,) on the ground z = 0."""
    vertices, faces, color, grain = _MAKERS[kind](rng)
    turn = rng.uniform(0, 2 * math.pi)
    c, s = math.cos(turn), math.sin(turn)
    R_transposed = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    shade = float(rng.uniform(0.8, 1.15))
    return Thing(
        kind=kind,
        vertices=torch.from_numpy(vertices @ R_transposed + np.array([place[0], place[1], 0.0])),
        faces=torch.from_numpy(faces),
        color=(color[0] * shade, color[1] * shade, color[2] * shade),
        grain=grain,
        stem=BARK if kind == "tree" else None,
    )


def make_ledge(
    rng: np.random.Generator, place: Points, reach: float, bottom: float, *, color: Color
) -> Thing:
    """A knoll with a flat top for an animal to stand on.

    Args:
        rng: the random numbers.
        place: (2,) middle of the top.
        reach: radius of the top.
        bottom: z down to which the knoll widens, below 0.
        color: mean colour.

    """
    levels = (
        np.concatenate(([0.0, 0.03], np.geomspace(0.12, 1.0, 7) * -bottom))
        if -bottom > 0.12
        else np.array([0.0, 0.03, 0.1])
    )
    spread = reach + STEEPNESS * levels + 0.02 * (levels > 0)
    vertices, faces = _rings(
        rng, -levels - LEDGE_GAP, spread, 48, rough=0.06 * reach, flat_top=True
    )
    vertices[:, :2] += place
    return Thing(
        kind="ledge",
        vertices=torch.from_numpy(vertices),
        faces=torch.from_numpy(faces),
        color=color,
        grain=(0.25, 5.0),
    )


Shape = tuple[Points, Faces, Color, tuple[float, float]]
"""Vertices, faces, colour and grain of a thing about the origin."""


def _trunk(rng: np.random.Generator, height: float = 0.0) -> Shape:
    """A trunk of a height, a random one of 0."""
    radius, height = rng.uniform(0.05, 0.11), height or rng.uniform(1.4, 3.5)
    levels = np.linspace(0, height, 8)[::-1]
    spread = radius * (1 - 0.3 * levels / height + 0.5 * np.exp(-levels / 0.08))
    vertices, faces = _rings(
        rng, levels, np.minimum(spread, REACH["trunk"] - 0.02), 14, rough=0.008
    )
    return vertices, faces, BARK, (0.35, 14.0)


def _bush(rng: np.random.Generator) -> Shape:
    """A bush of several balls."""
    size = rng.uniform(0.22, 0.42)
    blobs = []
    for _ in range(int(rng.integers(3, 6))):
        at, radius = rng.normal(0, 0.35, 2) * size, size * rng.uniform(0.4, 0.6)
        at *= min(1.0, max(REACH["bush"] - 1.2 * radius, 0.0) / max(float(np.hypot(*at)), 1e-9))
        blobs.append((np.array([*at, radius * rng.uniform(0.5, 1.0)]), np.full(3, radius)))
    vertices, faces = _blobs(rng, blobs, 0.16, 9.0 / size)
    return vertices, faces, (0.25, 0.32, 0.17), (0.55, 22.0)


def _rock(rng: np.random.Generator) -> Shape:
    """A rock, one lumpy ball."""
    size = rng.uniform(0.12, 0.26)
    center, half = np.array([0.0, 0.0, 0.3 * size]), size * rng.uniform(0.6, 1.15, 3)
    half *= np.array([1, 1, 0.75])
    vertices, faces = _blobs(rng, [(center, half)], 0.12, 2.5 / size)
    return vertices, faces, (0.50, 0.48, 0.45), (0.25, 12.0)


def _fence(rng: np.random.Generator) -> Shape:
    """A fence of three posts and two rails."""
    half, high = REACH["fence"] - 0.08, rng.uniform(0.45, 0.7)
    parts = [
        _box((x, 0.0, high / 2 + 0.03), (0.035, 0.035, high / 2 + 0.03)) for x in (-half, 0.0, half)
    ]
    parts += [_box((0.0, 0.045, high * part), (half + 0.03, 0.008, 0.03)) for part in (0.45, 0.85)]
    vertices, faces = _joined(parts)
    return vertices, faces, (0.52, 0.43, 0.33), (0.25, 18.0)


def _tuft(rng: np.random.Generator) -> Shape:
    """A tuft of forty blades of grass."""
    parts = []
    for _ in range(40):
        foot = rng.normal(0, 0.07, 2).clip(-0.12, 0.12)
        lean = rng.normal(0, 0.05, 2).clip(-0.1, 0.1)
        high = rng.uniform(0.12, 0.34)
        angle = rng.uniform(0, 2 * math.pi) + np.arange(3) * 2 * math.pi / 3
        base = np.stack(
            (foot[0] + 0.008 * np.cos(angle), foot[1] + 0.008 * np.sin(angle), np.zeros(3)), axis=1
        )
        blade = np.concatenate((base, [[*(foot + lean), high]]))
        parts.append((blade, np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])))
    vertices, faces = _joined(parts)
    return vertices, faces, (0.45, 0.48, 0.22), (0.3, 9.0)


def _tree(rng: np.random.Generator) -> Shape:
    """A tree whose crown is over the animals."""
    crown = rng.uniform(0.45, 0.9)
    trunk, trunk_faces, _, _ = _trunk(rng, CROWN_BOTTOM + 0.3 * crown)
    blobs = []
    for _ in range(5):
        radius = crown * rng.uniform(0.4, 0.6)
        x, y = rng.normal(0, 0.4, 2) * crown
        z = CROWN_BOTTOM + 1.25 * radius + rng.uniform(0, crown)
        blobs.append((np.array([x, y, z]), np.full(3, radius)))
    vertices, faces = _joined([(trunk, trunk_faces), _blobs(rng, blobs, 0.16, 9.0 / crown)])
    return vertices, faces, (0.25, 0.34, 0.17), (0.55, 14.0)


_MAKERS = {
    "trunk": _trunk,
    "bush": _bush,
    "rock": _rock,
    "fence": _fence,
    "tuft": _tuft,
    "tree": _tree,
}
"""Kind -> the function that makes a random one about the origin."""


@cache
def _sphere(subdivisions: int) -> tuple[Points, Faces]:
    """A sphere of radius 1 about the origin."""
    ball = trimesh.creation.icosphere(subdivisions=subdivisions, radius=1.0)
    return np.array(ball.vertices), np.array(ball.faces, dtype=np.int64)


def _blobs(
    rng: np.random.Generator, blobs: list[tuple[Points, Points]], rough: float, cycles: float
) -> tuple[Points, Faces]:
    """Lumpy balls as one mesh.

    Args:
        rng: the random numbers.
        blobs: centre (3,) and half sizes (3,) of each.
        rough: height of the lumps, by the ball's size.
        cycles: lumps a unit.

    """
    ball, faces = _sphere(3)
    parts = []
    for center, half in blobs:
        points = ball * half
        phases = points @ rng.normal(0, cycles, (3, 5)) + rng.uniform(0, 2 * math.pi, 5)
        waves = np.sin(phases).sum(1) / 5
        parts.append((center + points * (1 + rough * waves[:, None]), faces))
    return _joined(parts)


def _joined(parts: list[tuple[Points, Faces]]) -> tuple[Points, Faces]:
    """Several meshes as one."""
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in parts)])
    faces = [f + start for (_, f), start in zip(parts, starts[:-1], strict=True)]
    return np.concatenate([v for v, _ in parts]), np.concatenate(faces)


def _box(
    center: tuple[float, float, float], half: tuple[float, float, float]
) -> tuple[Points, Faces]:
    """An upright box of a centre and half sizes."""
    box = trimesh.creation.box(extents=2 * np.array(half))
    return np.array(box.vertices) + center, np.array(box.faces, dtype=np.int64)


def _rings(
    rng: np.random.Generator,
    levels: Points,
    radii: Points,
    count: int,
    *,
    rough: float,
    flat_top: bool = False,
) -> tuple[Points, Faces]:
    """A closed upright body of L rings of corners.

    Args:
        rng: the random numbers.
        levels: (L,) heights of the rings, from top to bottom.
        radii: (L,) of the rings.
        count: number of corners in a ring.
        rough: greatest roughness of a ring, in units.
        flat_top: whether the uppermost ring is round and even.

    """
    angle = np.arange(count) * 2 * math.pi / count
    uneven = 1 + rough / radii[:, None] * rng.standard_normal((len(levels), count)).clip(-1, 1)
    if flat_top:
        uneven[0] = 1.0
    r = radii[:, None] * uneven
    body = np.stack(
        (r * np.cos(angle), r * np.sin(angle), np.broadcast_to(levels[:, None], r.shape)), axis=-1
    ).reshape(-1, 3)
    n, last = len(body), len(body) - count
    # The underside has corners of its own, so that its edge is sharp.
    ends = [[0.0, 0.0, levels[0]], [0.0, 0.0, levels[-1]]]
    vertices = np.concatenate((body, body[last:], ends))
    i = np.arange(count)
    j = (i + 1) % count
    faces = [
        np.stack((np.full(count, n + count), i, j), axis=1),
        np.stack((np.full(count, n + count + 1), n + j, n + i), axis=1),
    ]
    for level in range(len(levels) - 1):
        a, b = level * count, (level + 1) * count
        faces += [np.stack((a + i, b + i, b + j), axis=1), np.stack((a + i, b + j, a + j), axis=1)]
    return vertices, np.concatenate(faces).astype(np.int64)
