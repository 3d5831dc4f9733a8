"""Checks of intrinsics, rotations and maps of pixels."""

from collections.abc import Iterator, Sequence

import numpy as np

from animal3dbox.training.findings import Finding
from animal3dbox.training.frames import outside_frame
from animal3dbox.training.packed import Floats, Packed
from animal3dbox.training.places import animal_findings, image_findings

ROTATION_TOLERANCE = 1e-4
"""Of R R^T - 1: float32 leaves about 1e-7."""
IDENTITY = np.eye(3)
FIXED, CORNER = np.array([0.0, 0, 0, 1, 0, 0, 1, 1, 1]), np.array([0.0, 0, 0, 0, 0, 0, 0, 0, 1])
"""Which entries of a K, read row by row, have one value, and that value."""
NEXT, LAST = np.array([1, 2, 0]), np.array([2, 0, 1])

NO_ROTATION = "is no rotation: R R^T differs from the identity by {:.2g}"
MIRRORED_FRAME = (
    "has determinant -1: a mirrored picture was taken for a mirrored frame; animal3dbox.transforms"
    " renames left and right instead"
)


def camera_findings(packed: Packed) -> Iterator[Finding]:
    """What is wrong with K, rotation, R and H_out_in."""
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
            "orthogonal",
            "R",
            lambda b: NO_ROTATION.format(off[b]),
        )
        yield from image_findings(packed, mirrored, "handedness", "R", lambda _: MIRRORED_FRAME)
    if "H_out_in" in packed.per_image:
        yield from _maps(packed, packed.per_image["H_out_in"])


def _intrinsics(packed: Packed, K: Floats) -> Iterator[Finding]:
    flat = K.reshape(-1, 9)
    wrong = np.abs(flat * FIXED - CORNER) > 1e-6
    wrong[:, 0:5:4] = flat[:, 0:5:4] <= 0
    if wrong.any():
        asked = "must be upper triangular with positive focal lengths and K[2, 2] = 1, got"
        yield from image_findings(
            packed, wrong.any(1), "K", "K", lambda b: f"{asked} {K[b].tolist()}"
        )
    if packed.far_corners is not None and "H_out_in" not in packed.per_image:
        outside = outside_frame(K[:, :2, 2], packed.far_corners)
        hw = packed.image_hw
        if outside.any():
            reason = "has its principal point outside the image: is K that of"
            yield from image_findings(
                packed,
                outside,
                "principal_point",
                "K",
                lambda b: f"{reason} {hw[b].tolist() if hw is not None else hw} pixels?",
            )


def _rotations(packed: Packed, names: Sequence[str], R: Floats) -> Iterator[Finding]:
    """Rotations of several fields, one below the other."""
    off, mirrored = _no_rotations(R)
    if not (off > ROTATION_TOLERANCE).any() and not mirrored.any():
        return
    for number, name in enumerate(names):
        start = number * packed.count
        mine = slice(start, start + packed.count)
        far = [NO_ROTATION.format(value) for value in off[mine]]
        yield from animal_findings(
            packed, off[mine] > ROTATION_TOLERANCE, "orthogonal", name, far.__getitem__
        )
        yield from animal_findings(
            packed, mirrored[mine], "handedness", name, lambda _: MIRRORED_FRAME
        )


def _no_rotations(R: Floats) -> tuple[Floats, np.ndarray]:
    """How far matrices (M, 3, 3) are from orthogonal, and which of the orthogonal ones have
    determinant -1."""
    off = np.abs(R @ R.swapaxes(1, 2) - IDENTITY).max((1, 2))
    x, y, z = R[:, 0], R[:, 1], R[:, 2]
    volume = (x[:, NEXT] * (y[:, LAST] * z - y * z[:, LAST])).sum(1)
    return off, (volume < 0) & (off <= ROTATION_TOLERANCE)


def _maps(packed: Packed, H: Floats) -> Iterator[Finding]:
    det = np.linalg.det(H)
    singular = np.abs(det) <= 1e-12 * np.abs(H).max((1, 2)) ** 3
    if singular.any():
        yield from image_findings(
            packed,
            singular,
            "H_out_in",
            "H_out_in",
            lambda b: f"is not invertible: {H[b].tolist()}",
        )
    known = np.array(["mirrored" in target for target in packed.targets])
    if not known.any():
        return
    said = np.array([bool(target.get("mirrored", False)) for target in packed.targets])
    wrong = ((det < 0) != said) & ~singular & known
    if wrong.any():
        stale = "but H_out_in says otherwise by its determinant: one of them is stale"
        yield from image_findings(
            packed,
            wrong,
            "mirrored",
            "mirrored",
            lambda b: f"is {bool(said[b])}, {stale} ({det[b]:.3g})",
        )
