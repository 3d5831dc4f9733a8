"""The chosen pose against the whole outline of the mask."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from animal3dbox.datasets.synthetic.faults import FaultConfig
from animal3dbox.datasets.synthetic.foreign.animals import ForeignAnimal, foreign_animal
from animal3dbox.datasets.synthetic.foreign.config import ALONE, ForeignConfig
from animal3dbox.geometry.rigid_transforms import rotation_from_axis_angle
from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.label import label_animal
from animal3dbox.labels.pose import estimate
from animal3dbox.labels.pose.outline_refinement import rim_vertices
from animal3dbox.labels.types import CuboidLabel

QUICK = LabelConfig(surface_share=False, mask_iou=False)
CONFIG = ForeignConfig(
    world=replace(ALONE, fill=(0.5, 0.8)),
    faults=FaultConfig(noise_px=2.0),
    standing=1.0,
    mask_jitter_px=1.0,
)


def clean_px(animal: ForeignAnimal, **changes: object) -> float:
    """Mean distance of the label's landmarks from the true keypoints."""
    label = label_animal(**{**animal.arguments(template=True), **changes}, config=QUICK)
    assert isinstance(label, CuboidLabel)
    cam = animal.landmarks @ label.R.mT + label.t
    px = (cam / cam[:, 2:]) @ label.K.mT
    in_frame = animal.exact[:, 2] > 0
    return float((px[in_frame, :2] - animal.exact[in_frame, :2]).norm(dim=1).mean())


def test_a_wandering_outline_averages_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its points tell more than supports, which tell more than keypoints alone."""
    animals = [foreign_animal(12, index, CONFIG) for index in range(8)]
    refined = np.mean([clean_px(animal) for animal in animals])
    monkeypatch.setattr(estimate, "refine_on_outline", lambda *args, **more: None)
    by_supports = np.mean([clean_px(animal) for animal in animals])
    assert refined < 0.8 * by_supports
    assert refined < 0.5


def test_an_occluder_that_cuts_the_mask_does_not_draw_the_pose() -> None:
    """The outline along it is far from the rim."""
    animal = foreign_animal(12, 1, CONFIG)
    columns = torch.arange(animal.mask.shape[1])
    inside = columns[animal.mask.any(0)]
    middle = float(inside.float().mean())
    band = (columns - middle).abs() < 0.08 * len(inside)
    cut = animal.mask & ~band
    assert int(cut.sum()) < int(animal.mask.sum())
    assert clean_px(animal, mask=cut) < 1.0


def test_the_rim_of_a_sphere_lies_around_it_whichever_way_its_faces_run() -> None:
    rows, columns = 24, 48
    lat = np.linspace(-np.pi / 2, np.pi / 2, rows)[:, None]
    lon = 2 * np.pi * np.arange(columns) / columns
    vertices = np.stack(
        (np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat) + 0 * lon), -1
    ).reshape(-1, 3)
    ids = np.arange(rows * columns).reshape(rows, columns)
    a, b = ids[:-1], ids[1:]
    c, d = np.roll(a, -1, 1), np.roll(b, -1, 1)
    faces = np.concatenate([np.stack(t, -1).reshape(-1, 3) for t in ((a, c, d), (a, d, b))])
    turn = rotation_from_axis_angle(torch.tensor([0.4, 0.3, 0.7], dtype=torch.float64)).numpy()
    pixels = (vertices @ turn)[:, [0, 2]].T
    one, other = (rim_vertices(vertices, ring, pixels) for ring in (faces, faces[:, ::-1]))
    poles = ids[[0, 1, -2, -1]]  # some of whose faces have no area
    one, other = np.setdiff1d(one, poles), np.setdiff1d(other, poles)
    assert np.linalg.norm(pixels[:, one], axis=0).min() > 0.95
    assert len(one) > rows
    assert np.array_equal(one, other)


def test_a_body_that_does_not_fit_keeps_the_pose_of_its_keypoints(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Its outline is not the animal's."""
    config = replace(CONFIG, faults=FaultConfig(noise_px=1.0, joint_deg=12.0))
    animal = foreign_animal(12, 2, config)
    refined = label_animal(**animal.arguments(template=True), config=QUICK)
    monkeypatch.setattr(estimate, "refine_on_outline", lambda *args, **more: None)
    plain = label_animal(**animal.arguments(template=True), config=QUICK)
    assert isinstance(refined, CuboidLabel)
    assert isinstance(plain, CuboidLabel)
    assert torch.equal(refined.rotation, plain.rotation)
