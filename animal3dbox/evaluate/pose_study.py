"""Camera poses over the dial of annotation faults, against keypoints and truth (section 3.2)."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from animal3dbox.datasets.synthetic.faults import FaultConfig
from animal3dbox.evaluate.config import METHODS
from animal3dbox.evaluate.subject import Annotated, Subject
from animal3dbox.evaluate.tables import (
    PAPER,
    Cell,
    Table,
    mean,
    percent,
    quantile,
    table_from_records,
)
from animal3dbox.geometry.box_overlap import box_iou
from animal3dbox.geometry.camera import project
from animal3dbox.geometry.rigid_transforms import rotation_angle
from animal3dbox.labels.types import CuboidLabel, Rejection

EVERYWHERE = {
    "2 px": FaultConfig(noise_px=2),
    "2 px, 10 % outliers": FaultConfig(noise_px=2, outliers=0.1),
}
"""Settings that every animal goes through."""
DIAL = {
    "no fault": FaultConfig(),
    "5 px": FaultConfig(noise_px=5),
    "2 px, 30 % outliers": FaultConfig(noise_px=2, outliers=0.3),
    "2 px, 30 % missing": FaultConfig(noise_px=2, missing=0.3),
    "2 px, 15 % at (0, 0)": FaultConfig(noise_px=2, zeros=0.15),
    "2 px, legs swapped": FaultConfig(noise_px=2, swap="legs"),
    "2 px, all swapped": FaultConfig(noise_px=2, swap="all"),
    "2 px, 10 % wrong flags": FaultConfig(noise_px=2, wrong_flags=0.1),
    "2 px, focal length x 0.5": FaultConfig(noise_px=2, focal_factor=0.5),
    "2 px, joints off by 5 deg": FaultConfig(noise_px=2, joint_deg=5),
    "2 px, body x 1.1": FaultConfig(noise_px=2, body_scale=1.1),
    "2 px, mask 5 px too small": FaultConfig(noise_px=2, mask_px=-5),
}
"""Settings that only every EvaluateConfig.every-th animal is tested under."""
PUBLISHED: tuple[dict[str, Cell], ...] = tuple(
    {
        "setting": "(Animal3D)",
        "method": f"{method}, {PAPER}",
        "annotated mean px": mean_px,
        "degenerate %": degenerate_percent,
    }
    for method, mean_px, degenerate_percent in (("basic", 75.28, 13.81), ("theirs", 7.56, 0.0))
)


@dataclass(frozen=True)
class PoseRow:
    """One animal under one setting by one method; errors are None where there is no label.

    Attributes:
        index: of the animal.
        setting: of EVERYWHERE or DIAL.
        method: of METHODS.
        reason: why there is no label, or None.
        annotated_px: mean distance of the projected landmarks from the keypoints that the method
            was given.
        clean_px: from the true keypoints, all those inside the frame.
        rotation_deg: of the box from the true box, in the camera frame.
        corner_percent: mean distance of corners from the true ones, in % of the true diagonal.
        iou3d: with the true box.
        behind: the animal, or a corner of its box, is put at or behind the camera where it is not.
        flipped: see depth_flip.

    Example:
        >>> row = PoseRow(0, "2 px", "basic", reason="no_pose")
        >>> row.clean_px, row.behind
        (None, False)
    """

    index: int
    setting: str
    method: str
    reason: str | None
    annotated_px: float | None = None
    clean_px: float | None = None
    rotation_deg: float | None = None
    corner_percent: float | None = None
    iou3d: float | None = None
    behind: bool = False
    flipped: bool = False


def pose_rows(subject: Subject, settings: dict[str, FaultConfig]) -> list[PoseRow]:
    """The label of an animal under each setting by every method, a row each."""
    rows = []
    for setting, faults in settings.items():
        annotated = subject.annotated(faults)
        rows += [
            _row(
                PoseRow(subject.index, setting, method, reason=None),
                annotated,
                annotated.labelled(config),
            )
            for method, config in METHODS.items()
        ]
    return rows


def depth_flip(rotation: Tensor, truth: Tensor) -> bool:
    """Whether the body axis nearest the line of sight points the other way.

    Args:
        rotation: (3, 3) R_cam_box of the label.
        truth: (3, 3) the true one, by which the axis is chosen.

    """
    axis = int(truth[2].abs().argmax())
    return bool(rotation[2, axis] * truth[2, axis] < 0)


def clean_error(label: CuboidLabel, annotated: Annotated) -> float | None:
    """Mean distance in px of the label's landmarks from the true keypoints inside the frame.

    None if there are none.
    """
    truth = annotated.animal.keypoints_2d
    in_frame = truth[:, 2] > 0
    if not bool(in_frame.any()):
        return None
    px, _ = project(label.K, annotated.landmarks[in_frame] @ label.R.mT + label.t)
    return float(torch.linalg.vector_norm(px - truth[in_frame, :2], dim=-1).mean())


def _row(blank: PoseRow, annotated: Annotated, outcome: CuboidLabel | Rejection) -> PoseRow:
    """The row of an outcome: a blank one of its animal, setting and method, filled in."""
    if isinstance(outcome, Rejection):
        return replace(blank, reason=outcome.reason, behind=outcome.reason == "behind_camera")
    truth = annotated.animal.cuboid
    corner_errors = torch.linalg.vector_norm(outcome.corners_3d - truth.corners(), dim=-1)
    shared = box_iou(outcome.cuboid, truth)
    return replace(
        blank,
        annotated_px=outcome.quality.reprojection_error_px,
        clean_px=clean_error(outcome, annotated),
        rotation_deg=float(torch.rad2deg(rotation_angle(outcome.rotation, truth.rotation))),
        corner_percent=100 * float(corner_errors.mean() / truth.diagonal),
        iou3d=float(shared),
        behind=outcome.behind_camera and bool((truth.corners()[:, 2] > 0).all()),
        flipped=depth_flip(outcome.rotation, truth.rotation),
    )


def pose_table(rows: Sequence[PoseRow]) -> Table:
    """Every setting and method, beside the paper's figures."""
    records: list[dict[str, Cell]] = []
    for setting in {**EVERYWHERE, **DIAL}:
        for method in METHODS:
            selected = [row for row in rows if (row.setting, row.method) == (setting, method)]
            if selected:
                records.append({"setting": setting, "method": method, **_statistics(selected)})
    notes = (
        (
            "annotated: against the keypoints given, all that real data has; clean: against the"
            " true ones inside the frame, hidden ones too."
        ),
        (
            "degenerate: the projected box has less than 1 % of the mask's area (the paper prints"
            " 0.01 %, i.e. 1 %). Of all animals, in %."
        ),
        (
            "behind camera: the animal or a corner is put at or behind the camera. depth flip: the"
            " body axis nearest the line of sight points the other way. Both of all animals, in %;"
            " errors are over the animals labelled."
        ),
        (
            "Keypoints at (0, 0) are taken as missing by every method here; see reproduction for"
            " what happens otherwise."
        ),
        f"{PAPER}: published figures, not computed here.",
    )
    return table_from_records(
        "pose",
        "Camera pose over the dial of annotation faults",
        [*records, *PUBLISHED],
        notes=notes,
        columns=("setting", "method", *_statistics(())),
    )


def _statistics(rows: Sequence[PoseRow]) -> dict[str, Cell]:
    """The cells of the table for one setting and one method."""
    annotated, clean = [row.annotated_px for row in rows], [row.clean_px for row in rows]
    rotation, corners = [row.rotation_deg for row in rows], [row.corner_percent for row in rows]
    return {
        "animals": len(rows),
        "labelled": sum(row.reason is None for row in rows),
        "annotated mean px": mean(annotated),
        "median px": quantile(annotated, 0.5),
        "p95 px": quantile(annotated, 0.95),
        "clean mean px": mean(clean),
        "clean median px": quantile(clean, 0.5),
        "clean p95 px": quantile(clean, 0.95),
        "degenerate %": percent([row.reason == "degenerate_box" for row in rows]),
        "behind camera %": percent([row.behind for row in rows]),
        "depth flip %": percent([row.flipped for row in rows]),
        "rotation median deg": quantile(rotation, 0.5),
        "rotation p95 deg": quantile(rotation, 0.95),
        "corners median % diag": quantile(corners, 0.5),
        "corners p95 % diag": quantile(corners, 0.95),
        "IoU3D median": quantile([row.iou3d for row in rows], 0.5),
    }
