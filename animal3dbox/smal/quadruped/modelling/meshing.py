"""One closed, mirror-symmetric triangle mesh of an implicit animal."""

from collections.abc import Sequence
from dataclasses import dataclass

import fast_simplification
import numpy as np
from numpy.typing import NDArray
from skimage.measure import marching_cubes

from animal3dbox.smal.quadruped.modelling.implicit import (
    Array,
    Primitive,
    surface_gradient,
    surface_value,
)

Faces = NDArray[np.int64]
_COARSE = 4  # fine cells along a coarse cell


@dataclass(frozen=True)
class HalfMesh:
    """The left half of a symmetric mesh, open at y = 0.

    Attributes:
        vertices: (H, 3) with y >= 0; the first `seam` of them have y = 0 exactly.
        faces: (F, 3), outward.
        seam: how many vertices lie on the mirror plane.
    """

    vertices: Array
    faces: Faces
    seam: int


def mesh_half(primitives: Sequence[Primitive], step: float, face_count: int) -> HalfMesh:
    """Polygonise y >= 0, decimate to about face_count faces and even the triangles out."""
    vertices, faces = _polygonise(primitives, step)
    thin_vertices, thin_faces = vertices.astype(np.float32), faces.astype(np.int32)
    while len(thin_faces) > 1.02 * face_count:
        thin_vertices, thin_faces = fast_simplification.simplify(
            thin_vertices, thin_faces, target_count=face_count, agg=3.0
        )
    half = _seam_first(
        np.asarray(thin_vertices, dtype=np.float64), np.asarray(thin_faces, dtype=np.int64)
    )
    half = _split_chords(half)
    return HalfMesh(relax(primitives, half.vertices, half, rounds=6), half.faces, half.seam)


def mirror_weld(half: HalfMesh) -> tuple[Array, Faces, NDArray[np.int64]]:
    """The whole mesh: vertices (2H - seam, 3), faces (2F, 3), and the mirror's permutation."""
    count, free = len(half.vertices), len(half.vertices) - half.seam
    mirrored = half.vertices[half.seam :] * np.array([1.0, -1.0, 1.0])
    partner = np.concatenate([np.arange(half.seam), np.arange(count, count + free)])
    symmetry = np.concatenate([partner, np.arange(half.seam, count)])
    faces = np.concatenate([half.faces, partner[half.faces][:, ::-1]])
    return np.concatenate([half.vertices, mirrored]), faces, symmetry


def project(primitives: Sequence[Primitive], vertices: Array, seam: int, rounds: int = 3) -> Array:
    """Bring vertices onto the zero set by damped Newton steps, the seam staying on the plane."""
    for _ in range(rounds):
        gradient = surface_gradient(primitives, vertices)
        squared = np.maximum((gradient**2).sum(axis=1), 0.25)
        move = (
            -(np.clip(surface_value(primitives, vertices), -0.03, 0.03) / squared)[:, None]
            * gradient
        )
        vertices = _on_its_side(vertices + move, seam)
    return vertices


def relax(
    primitives: Sequence[Primitive],
    vertices: Array,
    half: HalfMesh,
    rounds: int,
    *,
    share: float = 0.35,
) -> Array:
    """The vertices moved along the surface to their neighbours' mean, then back to the zero set."""
    average = neighbour_average(half)
    for _ in range(rounds):
        gradient = surface_gradient(primitives, vertices)
        normal = gradient / np.maximum(np.linalg.norm(gradient, axis=1, keepdims=True), 1e-9)
        pull = average(vertices) - vertices
        pull -= (pull * normal).sum(axis=1, keepdims=True) * normal
        vertices = project(
            primitives, _on_its_side(vertices + share * pull, half.seam), half.seam, rounds=1
        )
    return project(primitives, vertices, half.seam)


def untangled(
    primitives: Sequence[Primitive], vertices: Array, half: HalfMesh, rounds: int = 14
) -> Array:
    """Even out around faces that look inwards, until there are none or the rounds are over."""
    average = neighbour_average(half)
    for _ in range(rounds):
        corners = vertices[half.faces]
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        gradient = surface_gradient(primitives, corners.mean(axis=1))
        lengths = np.linalg.norm(normal, axis=1) * np.linalg.norm(gradient, axis=1)
        folded = (normal * gradient).sum(axis=1) < 0.15 * lengths
        if not folded.any():
            break
        share = np.zeros((len(vertices), 1))
        share[half.faces[folded].ravel()] = 1.0
        for _ in range(2):
            share = np.maximum(share, 0.9 * (average(share) > 0))
        loose = np.flatnonzero(share[:, 0] > 0)
        moved = _on_its_side(vertices + 0.6 * share * (average(vertices) - vertices), half.seam)
        order = np.concatenate([loose[loose < half.seam], loose[loose >= half.seam]])
        vertices = vertices.copy()
        vertices[order] = project(
            primitives, moved[order], int((loose < half.seam).sum()), rounds=2
        )
    return vertices


class neighbour_average:  # noqa: N801
    """The function that maps values (H, C) to their mean over each vertex's neighbours.

    Vertices on the seam take the mean along the seam.
    """

    def __init__(self, half: HalfMesh) -> None:
        edges = np.concatenate(
            [half.faces[:, [0, 1]], half.faces[:, [1, 2]], half.faces[:, [2, 0]]]
        )
        edges = np.unique(np.sort(edges, axis=1), axis=0)
        pairs = np.concatenate([edges, edges[:, ::-1]])
        self._pairs = pairs[(pairs[:, 0] >= half.seam) | (pairs[:, 1] < half.seam)]
        self._count = np.maximum(np.bincount(self._pairs[:, 0], minlength=len(half.vertices)), 1)[
            :, None
        ]

    def __call__(self, values: Array) -> Array:
        """The means (H, C) of values (H, C) over each vertex's neighbours."""
        out = np.zeros_like(values)
        np.add.at(out, self._pairs[:, 0], values[self._pairs[:, 1]])
        return out / self._count


def _on_its_side(vertices: Array, seam: int) -> Array:
    y = np.concatenate([np.zeros(seam), np.maximum(vertices[seam:, 1], 2e-4)])
    return np.stack([vertices[:, 0], y, vertices[:, 2]], axis=1)


def _polygonise(primitives: Sequence[Primitive], step: float) -> tuple[Array, Faces]:
    """Marching cubes on y >= 0 with a grid plane on y = 0, fine only near the surface."""
    low, high = _bounds(primitives)
    low[1] = 0.0
    cells = np.ceil((high - low) / (step * _COARSE)).astype(int)
    coarse = surface_value(primitives, _grid(low, step * _COARSE, cells + 1)).reshape(cells + 1)
    near = np.abs(coarse) < 1.5 * step * _COARSE
    shape = cells * _COARSE + 1
    fine = np.repeat(np.repeat(np.repeat(coarse, _COARSE, 0), _COARSE, 1), _COARSE, 2)[
        : shape[0], : shape[1], : shape[2]
    ]
    near_surface = np.repeat(
        np.repeat(np.repeat(_grown(near), _COARSE, 0), _COARSE, 1), _COARSE, 2
    )[: shape[0], : shape[1], : shape[2]]
    index = np.argwhere(near_surface)
    fine[near_surface] = surface_value(primitives, low + step * index)
    vertices, faces, _, _ = marching_cubes(fine, 0.0, spacing=(step, step, step))  # type: ignore[no-untyped-call]
    vertices = np.asarray(vertices, dtype=np.float64) + low
    vertices[vertices[:, 1] < step * 1e-3, 1] = 0.0
    corners = vertices[faces[:, 0]], vertices[faces[:, 1]], vertices[faces[:, 2]]
    outward = np.einsum("fi,fi->", np.cross(corners[0], corners[1]), corners[2])
    return vertices, np.asarray(faces if outward > 0 else faces[:, ::-1], dtype=np.int64)


def _bounds(primitives: Sequence[Primitive]) -> tuple[Array, Array]:
    ends = np.stack([p.ends for p in primitives])
    reach = np.stack([p.radii for p in primitives]).max(axis=2, keepdims=True) + 0.05
    return (ends - reach).min(axis=(0, 1)), (ends + reach).max(axis=(0, 1))


def _grid(low: Array, step: float, shape: NDArray[np.int64]) -> Array:
    axes = [low[i] + step * np.arange(shape[i]) for i in range(3)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def _grown(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    out = mask.copy()
    for axis in range(3):
        for shift in (1, -1):
            out |= np.roll(out, shift, axis)
    return out


def _seam_first(vertices: Array, faces: Faces) -> HalfMesh:
    """Number the open border first and put it on the plane exactly."""
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    keys, counts = np.unique(np.sort(edges, axis=1), axis=0, return_counts=True)
    border = np.zeros(len(vertices), dtype=bool)
    border[keys[counts == 1].ravel()] = True
    order = np.concatenate([np.flatnonzero(border), np.flatnonzero(~border)])
    number = np.argsort(order)
    return HalfMesh(
        _on_its_side(vertices[order], int(border.sum())), number[faces], int(border.sum())
    )


def _split_chords(half: HalfMesh) -> HalfMesh:
    """Split inner edges that join two seam vertices: their mirror image would be the same edge."""
    vertices, faces = list(half.vertices), [tuple(int(i) for i in face) for face in half.faces]
    owners: dict[tuple[int, int], list[int]] = {}
    for f, face in enumerate(faces):
        for a, b in zip(face, face[1:] + face[:1], strict=True):
            owners.setdefault((min(a, b), max(a, b)), []).append(f)
    for (a, b), pair in owners.items():
        if len(pair) != 2 or b >= half.seam:
            continue
        vertices.append((vertices[a] + vertices[b]) / 2 + np.array([0.0, 5e-3, 0.0]))
        middle = len(vertices) - 1
        for f in list(pair):
            old = faces[f]
            faces[f] = tuple(middle if i == a else i for i in old)
            faces.append(tuple(middle if i == b else i for i in old))
            _reown(owners, old, f, len(faces) - 1, corner=b)
    return HalfMesh(np.stack(vertices), np.array(faces, dtype=np.int64), half.seam)


def _reown(
    owners: dict[tuple[int, int], list[int]],
    old: tuple[int, ...],
    first: int,
    second: int,
    *,
    corner: int,
) -> None:
    """After a face was split, its edge away from `corner` belongs to the second half."""
    for a, b in zip(old, old[1:] + old[:1], strict=True):
        if corner not in (a, b):
            key = (min(a, b), max(a, b))
            owners[key] = [second if f == first else f for f in owners[key]]
