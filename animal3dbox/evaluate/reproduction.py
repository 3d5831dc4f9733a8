"""The paper's baseline as it fails: keypoints left at (0, 0) are fed to RANSAC (section 3.2).

label_animal takes such keypoints for missing, so this goes to labels/pose/epnp_ransac.py and
labels/pose/paper_refinement.py directly.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

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
from animal3dbox.geometry.box_visibility import face_visibility
from animal3dbox.geometry.pixel_boxes import mask_box
from animal3dbox.geometry.rigid_transforms import rigid
from animal3dbox.labels.bounds import tight_cuboid
from animal3dbox.labels.pose.epnp_ransac import basic_pose
from animal3dbox.labels.pose.keypoint_uncertainty import keypoint_sigma
from animal3dbox.labels.pose.paper_refinement import refined_pose
from animal3dbox.labels.pose.problem import (
    PoseEstimate,
    PoseFailure,
    PoseProblem,
    degenerate_points,
    in_unit_scale,
    reprojection_errors,
)
from animal3dbox.labels.types import CuboidLabel

PARTS = (0.1, 0.2, 0.3)
"""Parts of the marked keypoints that are left at (0, 0)."""
NOISE_PX = 2.0
FED = ("basic", "paper (vector)", "paper (literal)")
"""Methods that get the keypoints at (0, 0) as if they were there."""
DROPPED = ("basic", "default")
"""Methods through the door, which drops those keypoints."""
DEGENERATE = 0.01
"""A projected box with less than this part of the mask's area is degenerate.

So is an animal without any pose.
"""
PUBLISHED: tuple[dict[str, Cell], ...] = tuple(
    {
        "keypoints": f"({PAPER}, Animal3D)",
        "method": method,
        "mean px": mean_px,
        "degenerate %": degenerate_percent,
    }
    for method, mean_px, degenerate_percent in (("basic", 75.28, 13.81), ("theirs", 7.56, 0.0))
)


@dataclass(frozen=True)
class ReproductionRow:
    """One animal with part of its keypoints at (0, 0), by one method.

    Attributes:
        index: of the animal.
        part: of PARTS.
        method: of METHODS.
        fed: whether the keypoints at (0, 0) were given to the method and counted in its error.
        error_px: mean distance of the landmarks from all keypoints given; None without a pose.
        placed_px: from those that are not at (0, 0).
        degenerate: see DEGENERATE.

    Example:
        >>> row = ReproductionRow(0, 0.1, "basic", True, 75.0, placed_px=12.0, degenerate=False)
        >>> row.error_px - row.placed_px  # what the keypoints at (0, 0) add to the mean
        63.0
    """

    index: int
    part: float
    method: str
    fed: bool
    error_px: float | None
    placed_px: float | None
    degenerate: bool


def reproduction_rows(subject: Subject) -> list[ReproductionRow]:
    """One animal, for every part and method; none where fewer than six keypoints are marked."""
    rows = []
    for part in PARTS:
        annotated = subject.annotated(FaultConfig(noise_px=NOISE_PX, zeros=part))
        problem = _problem_with_zeros(annotated)
        if degenerate_points(problem, METHODS["basic"].min_keypoints) is not None:
            continue
        rows += [
            _fed(subject.index, part, method, annotated=annotated, problem=problem)
            for method in FED
        ]
        rows += [_dropped(subject.index, part, method, annotated) for method in DROPPED]
    return rows


def _problem_with_zeros(annotated: Annotated) -> PoseProblem:
    """The pose problem of all marked keypoints, those at (0, 0) too."""
    annotation, landmarks = annotated.annotation, annotated.landmarks.numpy()
    marked = annotation.keypoints_2d.numpy()
    matched = (marked[:, 2] > 0) & np.isfinite(landmarks).all(1)
    keypoints = marked[matched]
    return PoseProblem(
        points_world=landmarks[matched],
        points_px=keypoints[:, :2],
        sigma_px=keypoint_sigma(keypoints, annotation.image_hw, METHODS["basic"]),
        K=annotation.K.numpy(),
        image_hw=annotation.image_hw,
        R_box=annotated.animal.cuboid.rotation.numpy(),
        vertices_world=annotated.vertices.numpy(),
        mask_box=mask_box(annotation.mask),
    )


def _fed(
    index: int, part: float, method: str, *, annotated: Annotated, problem: PoseProblem
) -> ReproductionRow:
    config = METHODS[method]

    def solve(scaled: PoseProblem) -> PoseEstimate | PoseFailure:
        start = basic_pose(scaled, config)
        return (
            start
            if method == "basic" or isinstance(start, PoseFailure)
            else refined_pose(scaled, start, config)
        )

    pose = in_unit_scale(problem, solve)
    if isinstance(pose, PoseFailure):
        return ReproductionRow(index, part, method, True, None, None, True)
    errors, _ = reprojection_errors(problem, pose.R, pose.t)
    placed = problem.points_px.any(1)
    T_cam_mesh = rigid(torch.from_numpy(pose.R), torch.from_numpy(pose.t))
    box = tight_cuboid(annotated.vertices, problem.R_box).transformed(T_cam_mesh)
    area = float(face_visibility(box, annotated.annotation.K, problem.image_hw).area.sum())
    degenerate = area < DEGENERATE * float(annotated.annotation.mask.sum())
    placed_px = float(errors[placed].mean()) if bool(placed.any()) else None
    return ReproductionRow(index, part, method, True, float(errors.mean()), placed_px, degenerate)


def _dropped(index: int, part: float, method: str, annotated: Annotated) -> ReproductionRow:
    label = annotated.labelled(METHODS[method])
    if not isinstance(label, CuboidLabel):
        return ReproductionRow(
            index, part, method, False, None, None, label.reason != "too_few_keypoints"
        )
    error = label.quality.reprojection_error_px
    return ReproductionRow(index, part, method, False, error, error, False)


def reproduction_table(rows: Sequence[ReproductionRow]) -> Table:
    """Every part and method, beside the paper's figures."""
    records = [
        _record(part, method, fed, rows)
        for part in PARTS
        for fed, methods in ((True, FED), (False, DROPPED))
        for method in methods
    ]
    notes = (
        f"Keypoints with {NOISE_PX:g} px of noise, part of them left at (0, 0) and marked as"
        " visible. mean px is over all keypoints that the method was given, those at (0, 0) too;"
        " placed ones are the others. Animals with too few keypoints for a pose are left out of the"
        " errors.",
        "degenerate: no pose is found, or the projected box has less than 1 % of the mask's area.",
        f"{PAPER}: published figures, not computed here.",
    )
    title = "The paper's camera-pose figures: keypoints at (0, 0) fed to RANSAC"
    return table_from_records("reproduction", title, [*records, *PUBLISHED], notes=notes)


def _record(
    part: float, method: str, fed: bool, rows: Sequence[ReproductionRow]
) -> dict[str, Cell]:
    """The row of the table for one part of the keypoints and one method."""
    selected = [row for row in rows if (row.part, row.method, row.fed) == (part, method, fed)]
    errors = [row.error_px for row in selected]
    return {
        "keypoints": f"{part:.0%} at (0, 0)",
        "method": method if fed else f"{method}, (0, 0) dropped",
        "animals": len(selected),
        "mean px": mean(errors),
        "median px": quantile(errors, 0.5),
        "p95 px": quantile(errors, 0.95),
        "mean px of placed ones": mean(row.placed_px for row in selected),
        "degenerate %": percent([row.degenerate for row in selected]),
    }
