"""Accuracy of body axes: their angle to the true trunk, which studies of noise do not show."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import permutations, product

import torch
from torch import Tensor

from animal3dbox.datasets.synthetic.faults import FaultConfig
from animal3dbox.datasets.synthetic.foreign.bodies import merged_mesh
from animal3dbox.evaluate.orientation import RULES, axes_of
from animal3dbox.evaluate.subject import Annotated, Subject
from animal3dbox.evaluate.tables import Cell, Table, quantile, table_from_records
from animal3dbox.geometry.box_overlap import box_iou
from animal3dbox.geometry.rigid_transforms import rotation_angle
from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.label import label_animal
from animal3dbox.labels.types import CuboidLabel

CELL = 0.03
"""Side of the cells in which a re-meshed body's vertices are merged, as a part of its diagonal."""
NAMED = "pca of mesh, named by the truth"
"""The best of the 24 ways to name principal components forward, left and up: PCA's limit."""
REMESHED = {
    "ours, re-meshed": LabelConfig(),
    "landmarks (paper), re-meshed": LabelConfig(axes="landmarks"),
    "pca, re-meshed": LabelConfig(axes="pca"),
}


@dataclass(frozen=True)
class AccuracyRow:
    """One animal's axes by one rule.

    Attributes:
        index: of the animal.
        pose: its pose's name.
        rule: of RULES, NAMED or REMESHED.
        angle_deg: to the true trunk.
        iou3d: of the box along these axes with the true box; None where no box was made.

    Example:
        >>> row = AccuracyRow(index=0, pose="walk", rule="pca of mesh", angle_deg=180.0)
        >>> row.angle_deg, row.iou3d  # PCA cannot tell the nose from the tail
        (180.0, None)
    """

    index: int
    pose: str
    rule: str
    angle_deg: float
    iou3d: float | None = None


def remeshed(vertices: Tensor, faces: Tensor, landmarks: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Another mesh of the same body, as merged_mesh makes it, with its landmarks.

    Args:
        vertices: (V, 3).
        faces: (F, 3).
        landmarks: (J, 3), NaN where there is none.

    Returns:
        vertices (V', 3), faces (F', 3), and as landmarks (J, 3) the new vertices nearest to the old
        ones.

    """
    merged, corners = merged_mesh(vertices, faces, CELL)
    nearest = torch.cdist(landmarks.nan_to_num(), merged).argmin(1)
    moved = torch.where(torch.isfinite(landmarks), merged[nearest], landmarks)
    return merged, corners, moved


def accuracy_rows(subject: Subject) -> list[AccuracyRow]:
    """One animal's axes by every rule, from its true body."""
    annotated = subject.annotated(FaultConfig())
    truth, pose = annotated.animal.cuboid.rotation, annotated.animal.pose
    rows = []
    for rule in RULES:
        R_box = axes_of(
            annotated,
            rule,
            keypoints=annotated.annotation.keypoints_2d,
            landmarks=annotated.landmarks,
            vertices=annotated.vertices,
        )
        if R_box is None:
            continue
        rows.append(AccuracyRow(subject.index, pose, rule, _angle(R_box, truth)))
        if rule == "pca of mesh":
            rows.append(
                AccuracyRow(
                    subject.index,
                    pose,
                    NAMED,
                    float(torch.rad2deg(rotation_angle(R_box @ _namings(), truth)).amin()),
                )
            )
    return rows + _remeshed_rows(subject.index, annotated)


def _remeshed_rows(index: int, annotated: Annotated) -> list[AccuracyRow]:
    """The re-meshed body through the door, its camera known."""
    animal, annotation = annotated.animal, annotated.annotation
    vertices, faces, landmarks = remeshed(
        annotated.vertices, animal.model.faces, annotated.landmarks
    )
    rows, truth = [], animal.cuboid
    for rule, config in REMESHED.items():
        label = label_animal(
            annotation.image_hw,
            annotation.keypoints_2d,
            landmarks,
            vertices,
            faces=faces,
            K=annotation.K,
            pose=(torch.eye(3), torch.zeros(3)),
            vocabulary=annotation.vocabulary,
            sample_id=annotation.sample_id,
            config=config,
        )
        if isinstance(label, CuboidLabel):
            shared = box_iou(label.cuboid, truth)
            rows.append(
                AccuracyRow(
                    index, animal.pose, rule, _angle(label.rotation, truth.rotation), float(shared)
                )
            )
    return rows


def accuracy_table(rows: Sequence[AccuracyRow]) -> Table:
    """Every rule over all poses, and its median per pose."""
    poses = sorted({row.pose for row in rows})
    records: list[dict[str, Cell]] = []
    for rule in (*RULES, NAMED, *REMESHED):
        of_rule = [row for row in rows if row.rule == rule]
        angles = [row.angle_deg for row in of_rule]
        medians = {
            pose: quantile((row.angle_deg for row in of_rule if row.pose == pose), 0.5)
            for pose in poses
        }
        records.append(
            {
                "rule": rule,
                "animals": len(of_rule),
                "median deg": quantile(angles, 0.5),
                "p95 deg": quantile(angles, 0.95),
                "IoU3D median": quantile((row.iou3d for row in of_rule), 0.5),
                **medians,
            }
        )
    notes = (
        "Angle to the chordal mean of the true spine's rotations; the bodies are the true ones. Per"
        " pose: medians, in degrees.",
        "landmarks (paper) takes visible landmarks first, as published; the others use all that the"
        " body has.",
        f"re-meshed: vertices merged in cells of {CELL:.0%} of the body, landmarks moved to the"
        " nearest new vertex, no template.",
    )
    title = "Orientation accuracy against the true trunk"
    return table_from_records("accuracy", title, records, notes=notes)


@cache
def _namings() -> Tensor:
    """The 24 rotations (24, 3, 3) that permute and flip axes."""
    every = [
        torch.eye(3, dtype=torch.float64)[list(order)] * torch.tensor(signs)
        for order in permutations(range(3))
        for signs in product((1, -1), repeat=3)
    ]
    return torch.stack([naming for naming in every if float(torch.linalg.det(naming)) > 0])


def _angle(R_box: Tensor, truth: Tensor) -> float:
    return float(torch.rad2deg(rotation_angle(R_box, truth)))
