"""Checks of intrinsics, rotations and maps of pixels."""

from collections.abc import Iterator, Sequence

import numpy as np

from animal3dbox.geometry.arrays import LAST, NEXT
from animal3dbox.training.findings import Finding
from animal3dbox.training.frames import outside_frame
from animal3dbox.training.packed import Floats, Packed
from animal3dbox.training.places import animal_findings, image_findings

ROTATION_TOLERANCE = 1e-4
"""The greatest entry of R R^T - 1 that rounding explains: float32 leaves about 1e-7."""
IDENTITY = np.eye(3)
FIXED, CORNER = np.array([0.0, 0, 0, 1, 0, 0, 1, 1, 1]), np.array([0.0, 0, 0, 0, 0, 0, 0, 0, 1])
"""The entries of a K, read row by row, that have one value in every K, and that value."""

NO_ROTATION = "is no rotation: R R^T differs from the identity by {:.2g}"
MIRRORED_FRAME = (
    "has determinant -1: a mirrored picture was taken for a mirrored frame; animal3dbox.transforms"
    " renames left and right instead"
)


def camera_findings(packed: Packed) -> Iterator[Finding]:
    """Faults of K, rotation, R, H_out_in and mirrored."""
    if "K" in packed.per_image:
        yield from _intrinsics(packed, packed.per_image["K"])
    names = [name for name in ("rotation", "R") if name in packed.floats]
    if names:
        yield from _rotations(
            packed, names, np.concatenate([packed.floats[name] for name in names])
        )
    if "R" in packed.per_image:
        off, mirrored = _no_rotations(packed.per_image["R"])
        yield from image_findings(
            packed,
            off > ROTATION_TOLERANCE,
            check="orthogonal",
            field="R",
            problem=lambda b: NO_ROTATION.format(off[b]),
        )
        yield from image_findings(
            packed, mirrored, check="handedness", field="R", problem=lambda _: MIRRORED_FRAME
        )
    if "H_out_in" in packed.per_image:
        yield from _maps(packed, packed.per_image["H_out_in"])


def _intrinsics(packed: Packed, K: Floats) -> Iterator[Finding]:
    """Intrinsics (B, 3, 3) that no camera has, and principal points outside their image."""
    flat = K.reshape(-1, 9)
    wrong = np.abs(flat * FIXED - CORNER) > 1e-6
    wrong[:, 0:5:4] = flat[:, 0:5:4] <= 0
    if wrong.any():
        rule = "must be upper triangular with positive focal lengths and K[2, 2] = 1, got"
        yield from image_findings(
            packed, wrong.any(1), check="K", field="K", problem=lambda b: f"{rule} {K[b].tolist()}"
        )
    hw = packed.image_hw
    if hw is None or packed.far_corners is None or "H_out_in" in packed.per_image:
        return  # of an augmented picture the principal point may lie anywhere
    outside = outside_frame(K[:, :2, 2], packed.far_corners)
    if outside.any():
        yield from image_findings(
            packed,
            outside,
            check="principal_point",
            field="K",
            problem=lambda b: (
                f"has its principal point outside the image: is K that of {hw[b].tolist()} pixels?"
            ),
        )


def _rotations(packed: Packed, names: Sequence[str], R: Floats) -> Iterator[Finding]:
    """Faults in the rotations of several fields, which lie one below the other in R."""
    off, mirrored = _no_rotations(R)
    if not (off > ROTATION_TOLERANCE).any() and not mirrored.any():
        return
    for number, name in enumerate(names):
        start = number * packed.count
        rows = slice(start, start + packed.count)
        problems = [NO_ROTATION.format(value) for value in off[rows]]
        yield from animal_findings(
            packed,
            off[rows] > ROTATION_TOLERANCE,
            check="orthogonal",
            field=name,
            problem=problems.__getitem__,
        )
        yield from animal_findings(
            packed, mirrored[rows], check="handedness", field=name, problem=lambda _: MIRRORED_FRAME
        )


def _no_rotations(R: Floats) -> tuple[Floats, np.ndarray]:
    """How far matrices (M, 3, 3) are from orthogonal, and which orthogonal ones mirror.

    Returns:
        (M,) the greatest entry of R R^T - 1, and (M,) whether det R = -1.
    """
    off = np.abs(R @ R.swapaxes(1, 2) - IDENTITY).max((1, 2))
    # det R = x . (y x z), with the cross product's cycle shifted by one to save a gather.
    x, y, z = R[:, 0], R[:, 1], R[:, 2]
    volume = (x[:, NEXT] * (y[:, LAST] * z - y * z[:, LAST])).sum(1)
    return off, (volume < 0) & (off <= ROTATION_TOLERANCE)


def _maps(packed: Packed, H: Floats) -> Iterator[Finding]:
    """Maps of pixels (B, 3, 3) without an inverse, and mirrors that they contradict."""
    det = np.linalg.det(H)
    singular = np.abs(det) <= 1e-12 * np.abs(H).max((1, 2)) ** 3
    if singular.any():
        yield from image_findings(
            packed,
            singular,
            check="H_out_in",
            field="H_out_in",
            problem=lambda b: f"is not invertible: {H[b].tolist()}",
        )
    has_flag = np.array(["mirrored" in target for target in packed.targets])
    if not has_flag.any():
        return
    mirrored = np.array([bool(target.get("mirrored", False)) for target in packed.targets])
    wrong = ((det < 0) != mirrored) & ~singular & has_flag
    if wrong.any():
        stale = "but H_out_in says otherwise by its determinant: one of them is stale"
        yield from image_findings(
            packed,
            wrong,
            check="mirrored",
            field="mirrored",
            problem=lambda b: f"is {bool(mirrored[b])}, {stale} ({det[b]:.3g})",
        )
