"""Checks of cuboids against their own parameters, and of their projections against the camera."""

from collections.abc import Iterator

import numpy as np

from animal3dbox.geometry.arrays import norm
from animal3dbox.geometry.box_visibility import NEAR_PER_DIAGONAL
from animal3dbox.geometry.cuboid import corners_of
from animal3dbox.training.findings import Finding
from animal3dbox.training.packed import Floats, Packed, projected
from animal3dbox.training.places import animal_findings

LENGTH_TOLERANCE = 1e-5
"""A part of a box's largest coordinate: float32 rounds by 6e-8 of it, some operations by ten times
that."""
PIXEL_TOLERANCE = (0.02, 2e-5)
"""Pixels, and a part of the pixel coordinate: float32 rounds depth and focal length, which matters
far from the centre."""
OTHER_ORDER = (
    "the points are right, but not in the order of CORNER_SIGNS: left and right, or other"
    " ends, were exchanged"
)
OTHER_BOX = "were the box and its corners transformed alike, in the camera's frame?"


def cuboid_findings(packed: Packed) -> Iterator[Finding]:
    """Faults of size, distance, corners_3d, corners_2d, corner_in_front and behind_camera."""
    floats = packed.floats
    if "size" in floats and (floats["size"] <= 0).any():
        yield from animal_findings(
            packed,
            (floats["size"] <= 0).any(1),
            check="size",
            field="size",
            problem=lambda n: f"must be positive, got {floats['size'][n].tolist()}",
        )
    if "distance" in floats and "center" in floats:
        yield from _distances(packed, floats["center"], floats["distance"])
    if "corners_3d" in floats:
        yield from _corners(packed, floats["corners_3d"])
    corners = packed.corners
    if corners is None:
        return
    yield from _in_front(packed, corners)
    if "corners_2d" in floats and packed.K is not None:
        yield from _projections(packed, projected(packed, packed.K, corners), corners[..., 2])


def _parameter_corners(floats: dict[str, Floats]) -> Floats:
    return corners_of(floats["center"], floats["rotation"], floats["size"])


def _distances(packed: Packed, center: Floats, distance: Floats) -> Iterator[Finding]:
    """Distances that are not those of the centres: distance = |center|."""
    length = norm(center)
    wrong = np.abs(distance - length) > LENGTH_TOLERANCE * length
    if wrong.any():
        yield from animal_findings(
            packed,
            wrong,
            check="distance",
            field="distance",
            problem=lambda n: (
                f"is {distance[n]:.6g}, but center lies {length[n]:.6g} from the camera: one of"
                " them is stale, or in another unit"
            ),
        )


def _corners(packed: Packed, corners: Floats) -> Iterator[Finding]:
    """Corners that are not those of center, rotation and size.

    Without these, not those of any box in the documented order.
    """
    if packed.has_box:
        expected = _parameter_corners(packed.floats)
        source = "center, rotation and size"
    else:
        # The box on three edges from corner 0: they are its axes, with their lengths in them.
        edges = corners[:, [1, 3, 4]] - corners[:, :1]  # rows along forward, left, up
        expected = corners_of(corners.mean(1), edges.mT, np.ones_like(edges[:, 0]))
        source = "a box on the edges 0-1, 0-3, 0-4"
    off = np.abs(corners - expected).max((1, 2))
    wrong = off > LENGTH_TOLERANCE * packed.reach
    if wrong.any():
        nearest = np.linalg.norm(corners[:, :, None] - expected[:, None], axis=-1).min(2)
        same_points = nearest.max(1) <= 1e-3 * packed.diagonal
        for check, rows, hint in (
            ("corner_order", wrong & same_points, OTHER_ORDER),
            ("corners_3d", wrong & ~same_points, OTHER_BOX),
        ):
            problems = [f"differ by {value:.3g} from {source}: {hint}" for value in off]
            yield from animal_findings(
                packed, rows, check=check, field="corners_3d", problem=problems.__getitem__
            )
    if not packed.has_box:
        mirrored = (np.linalg.det(edges) < 0) & ~wrong
        problem = "are those of a mirrored box: left and right were exchanged"
        yield from animal_findings(
            packed, mirrored, check="corner_order", field="corners_3d", problem=lambda _: problem
        )


def _in_front(packed: Packed, corners: Floats) -> Iterator[Finding]:
    """Flags that contradict depth > near = 1 % of the diagonal, but for what rounding decides."""
    flags, behind = packed.others.get("corner_in_front"), packed.others.get("behind_camera")
    if flags is None and behind is None:
        return
    beyond = corners[..., 2] - NEAR_PER_DIAGONAL * packed.diagonal[:, None]
    clear = np.abs(beyond) > LENGTH_TOLERANCE * packed.reach[:, None]
    if flags is not None:
        wrong = np.asarray(((beyond > 0) != flags) & clear, dtype=np.bool_)
        if wrong.any():
            yield from animal_findings(
                packed,
                wrong.any(1),
                check="corner_in_front",
                field="corner_in_front",
                problem=lambda n: (
                    f"is wrong for corners {np.flatnonzero(wrong[n]).tolist()}: in front means a"
                    " depth over 1 % of the diagonal"
                ),
            )
    if behind is not None:
        expected = np.asarray(~(beyond > 0).all(1) if flags is None else ~flags.all(1))
        wrong_flag = (behind != expected) & (clear.all(1) | (flags is not None))
        if wrong_flag.any():
            yield from animal_findings(
                packed,
                wrong_flag,
                check="behind_camera",
                field="behind_camera",
                problem=lambda n: f"is {bool(behind[n])}, but the corners say {bool(expected[n])}",
            )


def _projections(packed: Packed, px: Floats, depth: Floats) -> Iterator[Finding]:
    """corners_2d that are not the pixels (N, 8, 2) of the corners in front of the camera."""
    off = np.abs(px - packed.floats["corners_2d"])
    allowed = PIXEL_TOLERANCE[0] + PIXEL_TOLERANCE[1] * np.abs(px)
    bad = (off > allowed).any(2)
    if not bad.any():
        return
    bad &= depth > (NEAR_PER_DIAGONAL + LENGTH_TOLERANCE) * packed.diagonal[:, None]
    bad &= packed.others.get("corner_in_front", True)
    yield from animal_findings(
        packed,
        bad.any(1),
        check="projection",
        field="corners_2d",
        problem=lambda n: (
            f"differ by {(off[n] * bad[n][:, None]).max():.3g} px from the projection of the"
            " cuboid: K is not the camera of this picture any more"
        ),
    )
