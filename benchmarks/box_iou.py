"""Box IoU against SciPy's half-space intersection, and its time a pair.

On 10,000 pairs of every awkward kind.

Run: OMP_NUM_THREADS=1 python benchmarks/box_iou.py
"""

import argparse
import time
from collections.abc import Callable

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.optimize import linprog
from scipy.spatial import ConvexHull, HalfspaceIntersection
from scipy.spatial.transform import Rotation

from animal3dbox.geometry import Cuboid, box_iou

Array = NDArray[np.float64]
Boxes = tuple[Array, Array, Array]


def cuboid(boxes: Boxes) -> Cuboid:
    """The package's boxes of center, rotation and size."""
    center, rotation, size = (torch.from_numpy(x) for x in boxes)
    return Cuboid(center, rotation, size)


def half_spaces(center: Array, rotation: Array, size: Array) -> Array:
    """(6, 4) rows n, -b of n . x <= b."""
    normals = np.concatenate((rotation.T, -rotation.T))
    return np.concatenate((normals, -(normals @ center + np.tile(size / 2, 2))[:, None]), axis=1)


def reference_volume(a: Boxes, b: Boxes) -> float:
    """The volume of the intersection by SciPy: Chebyshev centre, half-space intersection, hull.

    In the axes and half sizes of the first box: Qhull's own tolerances spoil needles otherwise. 0
    where the intersection is thinner than 1e-10.
    """
    center = a[1].T @ (b[0] - a[0]) / (a[2] / 2)
    planes = half_spaces(np.zeros(3), np.eye(3), np.full(3, 2.0))
    normals = np.concatenate((b[1].T, -b[1].T)) @ a[1] * (a[2] / 2)
    offsets = normals @ center + np.tile(b[2] / 2, 2)
    length = np.linalg.norm(normals, axis=1)
    planes = np.concatenate(
        (planes, np.concatenate((normals, -offsets[:, None]), axis=1) / length[:, None])
    )
    result = linprog(
        [0, 0, 0, -1],
        A_ub=np.concatenate((planes[:, :3], np.ones((12, 1))), axis=1),
        b_ub=-planes[:, 3],
        bounds=[(None, None)] * 3 + [(0, None)],
    )
    if result.x is None or result.x[3] < 1e-10:
        return 0.0
    corners = HalfspaceIntersection(planes, result.x[:3], qhull_options="Qt").intersections
    return float(
        ConvexHull(corners, qhull_options="QJ Pp" if result.x[3] < 1e-6 else "Qt").volume
        * np.prod(a[2] / 2)
    )


def random_boxes(rng: np.random.Generator, n: int, spread: float = 0.5) -> Boxes:
    """Generic boxes."""
    return (
        rng.normal(size=(n, 3)) * spread,
        Rotation.random(n, random_state=rng).as_matrix(),
        rng.uniform(0.3, 2, (n, 3)),
    )


def along(rotation: Array, shift: Array) -> Array:
    """Shifts (N, 3) along the axes of rotations (N, 3, 3), in the common frame."""
    return np.asarray((rotation @ shift[..., None])[..., 0])


TOUCHING = {"face": 1, "edge": 2, "corner": 3}
"""Along how many axes boxes that touch so lie beside each other."""
THIN = {
    "needle": np.array([1, 1e-3, 1e-3]),
    "thinner needle": np.array([1, 1e-5, 1e-5]),
    "flat": np.array([1, 1, 1e-3]),
}
"""Factors of the sizes of thin boxes."""
UNIT = {"tiny": 1e-9, "huge": 1e9}
"""Factors of all lengths."""


def pairs(kind: str, rng: np.random.Generator, n: int) -> tuple[Boxes, Boxes]:
    """N pairs of one kind."""
    box, other = random_boxes(rng, n), random_boxes(rng, n)
    side = rng.choice([-1.0, 1.0], (n, 3))
    (center, rotation, size), size_b = box, other[2]
    if kind == "identical":
        return box, box
    if kind in (*TOUCHING, "coplanar"):
        return box, box_in_a_plane_of(kind, rng, box, size_b, side)
    if kind == "contained":
        small = size_b * size.min(axis=1, keepdims=True) * 0.2
        return box, (center + 0.01 * other[0], other[1], small)
    if kind == "turned 45":
        turn = Rotation.from_rotvec(np.eye(3)[rng.integers(0, 3, n)] * np.pi / 4).as_matrix()
        return box, (center, rotation @ turn, np.where(rng.random((n, 1)) < 0.5, size, size_b))
    if kind == "axis-aligned":
        upright = np.tile(np.eye(3), (n, 1, 1))
        return (center, upright, size), (other[0], upright, size_b)
    if kind == "nearly identical":
        vectors = rng.normal(size=(n, 3)) * 10.0 ** rng.uniform(-6, -2, (n, 1))
        return box, (center, rotation @ Rotation.from_rotvec(vectors).as_matrix(), size)
    return overlapping_pairs(kind, rng, box, other)


def box_in_a_plane_of(
    kind: str, rng: np.random.Generator, box: Boxes, size_b: Array, side: Array
) -> Boxes:
    """Boxes of the same axes that touch others, or have a face in the plane of one of theirs."""
    center, rotation, size = box
    shift = rng.uniform(-0.3, 0.3, size.shape)
    axes = TOUCHING.get(kind, 1)
    gap = size - size_b if kind == "coplanar" else size + size_b
    shift[:, :axes] = (side * gap / 2)[:, :axes]
    return center + along(rotation, shift), rotation, size_b


def overlapping_pairs(
    kind: str, rng: np.random.Generator, box: Boxes, other: Boxes
) -> tuple[Boxes, Boxes]:
    """Generic, thin, tiny or huge boxes, the second somewhere within the first."""
    (center, rotation, size), (_, rotation_b, size_b) = box, other
    n, scale, thin = len(size), UNIT.get(kind, 1.0), THIN.get(kind, np.ones(3))
    size, size_b = size * thin * scale, size_b * thin * scale
    center_b = center * scale + along(rotation, size * rng.uniform(-0.4, 0.4, (n, 3)))
    if kind in THIN:
        small = Rotation.from_rotvec(rng.normal(size=(n, 3)) * 1e-3).as_matrix()
        rotation_b = np.where(rng.random((n, 1, 1)) < 0.5, rotation @ small, rotation_b)
    return (center * scale, rotation, size), (center_b, rotation_b, size_b)


KINDS = (
    *("identical", "face", "edge", "corner", "contained", "coplanar", "turned 45", "axis-aligned"),
    *("nearly identical", "needle", "thinner needle", "flat", "generic", "tiny", "huge"),
)


def compare(kind: str, rng: np.random.Generator, n: int) -> tuple[Array, Array]:
    """IoU (N,) of N pairs by box_iou and by the reference."""
    a, b = pairs(kind, rng, n)
    ours = box_iou(cuboid(a), cuboid(b)).numpy()
    volume = np.array(
        [
            reference_volume((a[0][k], a[1][k], a[2][k]), (b[0][k], b[1][k], b[2][k]))
            for k in range(n)
        ]
    )
    return ours, volume / (a[2].prod(axis=1) + b[2].prod(axis=1) - volume)


def microseconds(work: Callable[[], object], n: int) -> float:
    """Best time a pair of five calls."""
    times = []
    for _ in range(5):
        begin = time.perf_counter()
        work()
        times.append(time.perf_counter() - begin)
    return 1e6 * min(times) / n


def main() -> None:
    """Print the greatest difference of every kind, and the times."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pairs", type=int, default=10_005)
    n = parser.parse_args().pairs // len(KINDS)
    torch.set_num_threads(1)
    rng = np.random.default_rng(0)
    worst = 0.0
    for kind in KINDS:
        ours, theirs = compare(kind, rng, n)
        worst = max(worst, float(np.abs(ours - theirs).max()))
        print(
            f"{kind:18s} {n} pairs, mean IoU {ours.mean():.3f}, greatest difference"
            f" {np.abs(ours - theirs).max():.1e}"
        )
    print(f"greatest difference of {n * len(KINDS)} pairs: {worst:.1e}")
    a, b = (cuboid(boxes) for boxes in pairs("generic", rng, 4096))
    apart = Cuboid(b.center + 100.0, b.rotation, b.size)
    print(
        f"{microseconds(lambda: box_iou(a, b), 4096):.1f} us a pair,"
        f" {microseconds(lambda: box_iou(a, apart), 4096):.2f} us a pair far apart"
    )


if __name__ == "__main__":
    main()
