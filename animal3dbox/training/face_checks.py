"""Checks of the fields about the six faces of a box, and the flank that is seen."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from animal3dbox.geometry.cuboid import FACE_NAMES
from animal3dbox.training.cuboid_checks import LENGTH_TOLERANCE
from animal3dbox.training.findings import Finding
from animal3dbox.training.packed import Floats, Packed
from animal3dbox.training.places import animal_findings

SHARES = ("face_share", "face_share_in_image", "surface_share")
SHARE_TOLERANCE = 1e-4
FLANK_SLACK = 0.35
"""Sine of the angle by which a camera may stand on the other side of the plane of symmetry."""
AREA_TOLERANCE = (0.5, 2e-4)
"""Pixels squared, and a part of the visible area; besides, float32 coordinates round by 1e-7 of
themselves along the outline."""


def face_findings(packed: Packed) -> Iterator[Finding]:
    """Faults of face_visible, face_area, the shares and the flank."""
    visible = packed.others.get("face_visible")
    if visible is not None:
        both = visible[:, 0::2] & visible[:, 1::2]
        if both.any():
            problem = "says that two opposite faces are seen at once"
            yield from animal_findings(
                packed,
                both.any(1),
                check="opposite_faces",
                field="face_visible",
                problem=lambda _: problem,
            )
        if packed.has_box:
            yield from _visibility(packed, visible)
    names = [name for name in SHARES if name in packed.floats]
    if names:
        yield from _shares(packed, names, visible)
    if "face_area" in packed.floats:
        yield from _areas(packed, packed.floats["face_area"], visible)
    if "flank" in packed.others:
        yield from _flanks(packed, packed.others["flank"])


def _flanks(packed: Packed, flank: NDArray[np.int64]) -> Iterator[Finding]:
    """Flanks (N,) that are no number of one, or that the camera cannot see.

    What the picture shows of the surface may decide near the plane of symmetry, and no farther from
    it than FLANK_SLACK.
    """
    no_flank = (flank < 0) | (flank > 2)
    hidden = np.zeros_like(no_flank)
    if packed.has_box:
        camera_box = -(packed.floats["center"][:, None] @ packed.floats["rotation"])[:, 0]
        leftward = camera_box[:, 1] / np.maximum(np.linalg.norm(camera_box, axis=1), 1e-12)
        hidden = np.where(flank == 1, -leftward, np.where(flank == 2, leftward, 0)) > FLANK_SLACK
    if not (no_flank | hidden).any():
        return

    def problem(n: int) -> str:
        if no_flank[n]:
            return f"must be 0 (undecided), 1 (left) or 2 (right), got {flank[n]}"
        named, other = ("left", "right") if flank[n] == 1 else ("right", "left")
        return (
            f"is {named}, but the camera stands on the {other}: a mirror must exchange the flanks"
            " with the box"
        )

    yield from animal_findings(
        packed, no_flank | hidden, check="flank", field="flank", problem=problem
    )


def _visibility(packed: Packed, visible: NDArray[np.bool_]) -> Iterator[Finding]:
    """Faces whose flag contradicts where the camera stands.

    A face is seen if the camera stands beyond its plane: in the box's own axes, if a coordinate of
    the camera's centre exceeds half the size along that axis.
    """
    camera_box = -(packed.floats["center"][:, None] @ packed.floats["rotation"])[:, 0]
    half = packed.floats["size"] / 2
    beyond = np.stack((camera_box - half, -camera_box - half), axis=2).reshape(-1, 6)
    wrong = ((beyond > 0) != visible) & (np.abs(beyond) > LENGTH_TOLERANCE * packed.reach[:, None])
    if not wrong.any():
        return

    def problem(n: int) -> str:
        """The faces that are wrong, by their names, and the usual reason."""
        names = ", ".join(name for name, bad in zip(FACE_NAMES, wrong[n], strict=True) if bad)
        hint = (
            ": a mirror must exchange left and right of boxes and of faces together"
            if names == "left, right"
            else ""
        )
        return f"is wrong for {names}, by where the camera stands{hint}"

    yield from animal_findings(
        packed, wrong.any(1), check="face_visible", field="face_visible", problem=problem
    )


def _shares(
    packed: Packed, names: list[str], visible: NDArray[np.bool_] | None
) -> Iterator[Finding]:
    """Shares that are negative, of hidden faces, or do not add to 1."""
    shares = np.stack([packed.floats[name] for name in names])  # (fields, N, 6)
    total = shares.sum(2)
    wrong = ((np.abs(total - 1) > SHARE_TOLERANCE) & (total != 0)) | (shares < 0).any(2)
    if visible is not None:
        of_boxes = sum(name != "surface_share" for name in names)
        wrong[:of_boxes] |= ((shares[:of_boxes] > SHARE_TOLERANCE) & ~visible).any(2)
    if not wrong.any():
        return
    rule = "must be 0 for hidden faces and add to 1 (or 0 if nothing is seen), got"
    for number, name in enumerate(names):
        problems = [f"{rule} {row}" for row in shares[number].round(4).tolist()]
        yield from animal_findings(
            packed, wrong[number], check="shares", field=name, problem=problems.__getitem__
        )


def _areas(packed: Packed, area: Floats, visible: NDArray[np.bool_] | None) -> Iterator[Finding]:
    """Areas (N, 6) that contradict face_share, face_visible, or the projected faces."""
    total = area.sum(1)
    allowed = AREA_TOLERANCE[0] + AREA_TOLERANCE[1] * total
    if "face_share" in packed.floats:
        wrong = np.abs(packed.floats["face_share"] * total[:, None] - area) > allowed[:, None]
        if wrong.any():
            yield from animal_findings(
                packed,
                wrong.any(1),
                check="share_of_area",
                field="face_share",
                problem=lambda _: "is not face_area over its sum: one of them is stale",
            )
    if visible is not None:
        yield from _areas_of_faces(packed, area, visible, allowed)


def _areas_of_faces(
    packed: Packed, area: Floats, visible: NDArray[np.bool_], allowed: Floats
) -> Iterator[Finding]:
    """Areas (N, 6) of hidden faces, and those that differ from the projected faces'."""
    hidden = ((area > 0) & ~visible) | (area < 0)
    if hidden.any():
        yield from animal_findings(
            packed,
            hidden.any(1),
            check="hidden_area",
            field="face_area",
            problem=lambda n: f"must be 0 for hidden faces, got {area[n].tolist()}",
        )
    if packed.all_in_front is None or packed.quad_areas is None:
        return
    off = np.abs(packed.quad_areas * visible - area)
    wrong = (off > allowed[:, None]) & packed.all_in_front[:, None] & ~hidden
    if wrong.any():
        extent = np.abs(packed.floats["corners_2d"]).reshape(-1, 16).max(1, keepdims=True)
        wrong &= off > allowed[:, None] + 1e-6 * extent * extent
        stale = "px^2 from the projected faces: areas go with K and with the picture's size"
        yield from animal_findings(
            packed,
            wrong.any(1),
            check="face_area",
            field="face_area",
            problem=lambda n: f"differs by {off[n].max():.3g} {stale}",
        )
