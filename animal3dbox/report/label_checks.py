"""What a row of labels.json says about itself in words, compared with its numbers."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from animal3dbox.geometry.cuboid import FACE_NAMES
from animal3dbox.labels.types import VIEWPOINTS
from animal3dbox.report.label_files import AnimalRow

ROW_CHECKS = {
    "side": "side or surface_side is not the face of the greatest share",
    "viewpoint": (
        "azimuth_deg or elevation_deg is not where rotation and center put the camera, or viewpoint"
        " is not that eighth of a turn"
    ),
    "confidence": "confidence is not in 0 to 1",
    "scale": "scale_m_per_unit is not positive",
}
"""Checks of a row of labels.json that no target has the fields for."""

SHARE_TOLERANCE = 1e-6
ANGLE_TOLERANCE_DEG = 0.1
OVERHEAD = 1e-3
"""Part of its distance by which a camera over or under the animal is off its z axis.

Nearer to the axis, the azimuth is not compared.
"""


class RowFinding(NamedTuple):
    """What a row contradicts: the check, the field, and what is wrong."""

    check: str
    field: str
    problem: str


def row_findings(row: AnimalRow) -> Iterator[RowFinding]:
    """The contradictions within one row of labels.json.

    Arrays of a wrong shape are left to check_targets.
    """
    if len(row.face_share) == len(row.face_visible) == 6:
        yield from _side(
            "side", row.side, "face_share", row.face_share if any(row.face_visible) else None
        )
    if row.surface_share is None or len(row.surface_share) == 6:
        yield from _side(
            "surface_side",
            row.surface_side,
            "surface_share",
            row.surface_share if any(row.surface_share or ()) else None,
        )
    yield from _angles(row)
    if not 0 <= row.confidence <= 1:
        yield RowFinding("confidence", "confidence", f"must lie in 0 to 1, got {row.confidence}")
    if row.scale_m_per_unit is not None and not row.scale_m_per_unit > 0:
        yield RowFinding(
            "scale",
            "scale_m_per_unit",
            f"must be positive, or null if the scale is not known; got {row.scale_m_per_unit}",
        )


def _side(
    field: str, side: str | None, of: str, shares: Sequence[float] | None
) -> Iterator[RowFinding]:
    """The rule of CuboidLabel.side: the face of the greatest share, none if nothing is seen.

    Equal shares may name either.
    """
    greatest = None if shares is None else FACE_NAMES[int(np.argmax(shares))]
    if side == greatest or (
        side in FACE_NAMES
        and shares is not None
        and shares[FACE_NAMES.index(side)] >= max(shares) - SHARE_TOLERANCE
    ):
        return
    yield RowFinding(
        "side",
        field,
        f"is {side}, but by {of} it is {greatest}: one of them was changed after labelling",
    )


def _angles(row: AnimalRow) -> Iterator[RowFinding]:
    rotation, center = np.array(row.rotation), np.array(row.center)
    if rotation.shape != (3, 3) or center.shape != (3,):
        return
    x, y, z = -rotation.T @ center
    aside = float(np.hypot(x, y))
    azimuth, elevation = (
        float(np.degrees(np.arctan2(y, x))),
        float(np.degrees(np.arctan2(z, aside))),
    )
    known = aside > OVERHEAD * np.linalg.norm(center)
    changed = "by rotation and center: one of them was changed after labelling"
    if known and _apart(row.azimuth_deg, azimuth) > ANGLE_TOLERANCE_DEG:
        yield RowFinding(
            "viewpoint", "azimuth_deg", f"is {row.azimuth_deg:.2f}, but {azimuth:.2f} {changed}"
        )
    if abs(row.elevation_deg - elevation) > ANGLE_TOLERANCE_DEG:
        yield RowFinding(
            "viewpoint",
            "elevation_deg",
            f"is {row.elevation_deg:.2f}, but {elevation:.2f} {changed}",
        )
    if row.viewpoint not in VIEWPOINTS or (
        known
        and _apart(45.0 * VIEWPOINTS.index(row.viewpoint), azimuth) > 22.5 + ANGLE_TOLERANCE_DEG
    ):
        yield RowFinding(
            "viewpoint",
            "viewpoint",
            f"is {row.viewpoint}, but {VIEWPOINTS[round(azimuth / 45) % 8]} {changed}",
        )


def _apart(angle_deg: float, other_deg: float) -> float:
    """Angle between two directions, degrees."""
    return abs((angle_deg - other_deg + 180) % 360 - 180)
