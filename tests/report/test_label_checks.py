"""What rows of labels.json say in words, beside their numbers.

Labels as they are made contradict nothing.
"""

import math

import pytest
import torch

from animal3dbox import CuboidLabel, label_animal
from animal3dbox.datasets.synthetic.scenes import synthetic_animal
from animal3dbox.geometry.rigid_transforms import rotation_from_axis_angle
from animal3dbox.labels.types import VIEWPOINTS
from animal3dbox.report.label_checks import row_findings
from animal3dbox.report.label_files import AnimalRow, animal_row


@pytest.fixture(scope="module")
def label() -> CuboidLabel:
    animal = synthetic_animal(seed=0, index=2)
    label = label_animal(
        image_hw=animal.image_hw,
        keypoints_2d=animal.keypoints_2d,
        vertices=animal.vertices,
        template=animal.model,
        K=animal.K,
    )
    assert isinstance(label, CuboidLabel)
    return label


def turned(label: CuboidLabel, axis_angle: list[float]) -> CuboidLabel:
    """The label of the same box turned on the spot.

    What rows say in words follows from rotation and center.
    """
    turn = rotation_from_axis_angle(torch.tensor(axis_angle, dtype=torch.float64))
    return label.with_fields(rotation=turn @ label.rotation)


def said(row: AnimalRow) -> list[str]:
    return [finding.field for finding in row_findings(row)]


def test_labels_from_all_sides_contradict_nothing(label: CuboidLabel) -> None:
    generator = torch.Generator().manual_seed(0)
    seen = set()
    for _ in range(500):
        there = turned(label, (3 * torch.randn(3, generator=generator)).tolist())
        row = animal_row(there, image="a.jpg", animal=0, category="dog")
        assert said(row) == []
        seen.add(row.viewpoint)
    assert seen == set(VIEWPOINTS)


def test_straight_above_the_azimuth_is_anything(label: CuboidLabel) -> None:
    above = label.with_fields(
        rotation=torch.diag(torch.tensor([1.0, -1, -1], dtype=torch.float64)),
        center=torch.tensor([0.0, 0, 5], dtype=torch.float64),
    )
    row = animal_row(above, image="a.jpg", animal=0, category="dog")
    row.azimuth_deg, row.viewpoint = 77.0, "left"
    assert said(row) == []
    row.elevation_deg = -90.0
    assert said(row) == ["elevation_deg"]


def test_angles_go_round_and_a_border_of_viewpoints_is_either(label: CuboidLabel) -> None:
    for azimuth, viewpoints in ((180.0, ("back",)), (22.5, ("front", "front-left"))):
        a = math.radians(azimuth)
        eye = torch.tensor([math.cos(a), math.sin(a), 0.0], dtype=torch.float64)
        at = label.with_fields(rotation=torch.eye(3, dtype=torch.float64), center=-4 * eye)
        row = animal_row(at, image="a.jpg", animal=0, category="dog")
        for row.azimuth_deg in (azimuth, azimuth - 360):
            for row.viewpoint in viewpoints:
                assert said(row) == []
        row.viewpoint = "right"
        assert said(row) == ["viewpoint"]


def test_equal_shares_may_name_either_face_and_none_seen_no_face(label: CuboidLabel) -> None:
    row = animal_row(label, image="a.jpg", animal=0, category="dog")
    row.face_visible, row.face_share = (
        [True, False, True, False, False, False],
        [0.5, 0.0, 0.5, 0.0, 0.0, 0.0],
    )
    for row.side in ("front", "left"):
        assert said(row) == []
    for row.side in ("right", None):
        assert said(row) == ["side"]
    row.face_visible, row.face_share, row.side = [False] * 6, [0.0] * 6, None
    assert said(row) == []
    row.side = "front"
    assert said(row) == ["side"]
