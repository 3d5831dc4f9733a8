"""Axes from sections across a trunk, on bodies whose trunk is known."""

import numpy as np
import pytest
from foreign_capture import capture_animal
from numpy.typing import NDArray

from animal3dbox.datasets.synthetic.foreign.animals import ForeignAnimal
from animal3dbox.labels.axes.section_axes import mirror_roll, section_axes
from animal3dbox.labels.axes.trunk_line import pitched, trunk_ends
from animal3dbox.labels.axes.trunk_sections import BACK, BELLY, LEFT, PARTS, trunk_sections
from animal3dbox.labels.label import label_animal
from animal3dbox.labels.types import CuboidLabel

Array = NDArray[np.float64]


def tube(height: float, width: float, turns: int = 48) -> tuple[Array, NDArray[np.int64]]:
    """An elliptic tube along x from -1 to 1, open at its ends."""
    angles = np.arange(turns) * 2 * np.pi / turns
    ring = np.stack((0 * angles, width * np.sin(angles), height * np.cos(angles)), axis=1)
    vertices = np.concatenate([ring + np.array([x, 0, 0]) for x in (-1.0, 1.0)])
    i = np.arange(turns)
    j = (i + 1) % turns
    faces = np.concatenate([np.stack((i, j, i + turns), 1), np.stack((j, j + turns, i + turns), 1)])
    return vertices, faces


def rolled(angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1.0, 0, 0], [0, c, -s], [0, s, c]])


def off_deg(a: Array, b: Array) -> float:
    return float(np.rad2deg(2 * np.arcsin(min(1.0, np.linalg.norm(a - b) / np.sqrt(8)))))


def test_sections_of_a_tube_are_its_half_axes() -> None:
    vertices, faces = tube(height=0.4, width=0.2)
    sections = trunk_sections(
        vertices, faces, R_box=np.eye(3), rear=np.array([-1.0, 0, 0]), length=2.0
    )
    assert np.allclose(sections.positions, 2 * PARTS)
    assert np.allclose(sections.centers, 0, atol=1e-9)
    assert np.allclose(sections.radii[:, [BACK, BELLY]], 0.4)
    assert np.allclose(sections.radii[:, LEFT], 0.2)


@pytest.mark.parametrize("angle", [-0.1, 0.05, 0.15])
def test_the_roll_of_a_tube_is_found(angle: float) -> None:
    vertices, faces = tube(height=0.3, width=0.2)
    vertices = vertices @ rolled(angle).T
    sections = trunk_sections(
        vertices, faces, R_box=np.eye(3), rear=np.array([-1.0, 0, 0]), length=2.0
    )
    assert mirror_roll(sections) == pytest.approx(angle, abs=0.03)


def mesh_of(animal: ForeignAnimal) -> tuple[Array, NDArray[np.int64], dict[str, Array]]:
    vertices, landmarks = animal.fitted
    names = [name for (name,) in animal.vocabulary.landmarks]
    places = dict(zip(names, landmarks.numpy(), strict=True))
    return vertices.numpy(), animal.model.faces.numpy(), places


def test_sections_find_a_trunk_from_axes_that_are_far_off() -> None:
    errors = []
    for index in range(10):
        animal = capture_animal(index)
        vertices, faces, places = mesh_of(animal)
        ends, trunk = trunk_ends(places), animal.trunk.numpy()
        assert ends is not None
        start = pitched(trunk, 15.0) @ rolled(0.2)
        R_box = section_axes(vertices, faces, start=start, ends=ends)
        assert R_box is not None
        errors.append(off_deg(R_box, trunk))
    assert float(np.median(errors)) < 4
    assert max(errors) < 12


def test_section_axes_turn_and_grow_with_the_body() -> None:
    animal = capture_animal(3)
    vertices, faces, places = mesh_of(animal)
    ends, trunk = trunk_ends(places), animal.trunk.numpy()
    assert ends is not None
    here = section_axes(vertices, faces, start=trunk, ends=ends)
    R = pitched(np.eye(3), 50.0) @ rolled(1.0)
    moved = 3 * vertices @ R.T + [5.0, -2.0, 1.0]
    rear, front = (3 * end @ R.T + [5.0, -2.0, 1.0] for end in ends)
    there = section_axes(moved, faces, start=R @ trunk, ends=(rear, front))
    assert here is not None
    assert there is not None
    assert np.allclose(there, R @ here, atol=1e-6)


def test_a_surface_that_is_no_trunk_tells_nothing() -> None:
    flat = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    ends = np.array([-1.0, 0, 0]), np.array([1.0, 0, 0])
    assert section_axes(flat, faces, start=np.eye(3), ends=ends) is None


def test_a_label_warns_where_surface_and_landmarks_disagree() -> None:
    animal = capture_animal(0)
    given = animal.arguments()
    given["pose"] = (np.eye(3), np.array([0.0, 0.0, 5.0]))
    good = label_animal(**given)
    lifted = given["keypoints_3d"].clone()
    for name in ("left_shoulder", "right_shoulder"):
        lifted[animal.vocabulary.keypoints.index(name)] += 0.3 * animal.trunk[:, 2]
    wrong = label_animal(**{**given, "keypoints_3d": lifted})
    assert isinstance(good, CuboidLabel)
    assert isinstance(wrong, CuboidLabel)
    assert not any("disagree" in warning for warning in good.quality.warnings)
    assert any("disagree" in warning for warning in wrong.quality.warnings)
