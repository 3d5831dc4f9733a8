"""The flank that is seen: left, right or undecided, and how probable."""

import math

import numpy as np
import pytest
from animals import IMAGE_HW, K, camera_round, keypoints_seen, toy_landmarks, toy_mesh
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation
from scipy.stats import norm

from animal3dbox import CuboidLabel, LabelConfig, label_animal
from animal3dbox.labels.config import Axes
from animal3dbox.labels.flank import (
    AXES_SD_RAD,
    FLANKS,
    UNKNOWN_SD_RAD,
    FlankModel,
    decided_flanks,
    flank_model,
    lateral_angle,
)

MESH, FACES = toy_mesh()
MODEL = FlankModel(lateral=1.5, surface=0.4, lateral_alone=2.5, slip=0.02, decided_from=0.9)
NOT_MEASURED = np.full((1, 6), -1.0)


def label_from(azimuth: float, *, known: bool = True, axes: Axes = "default") -> CuboidLabel:
    view = camera_round(azimuth, 12)
    outcome = label_animal(
        IMAGE_HW,
        None if known else keypoints_seen(*view),
        keypoints_3d=toy_landmarks(),
        vertices=MESH,
        faces=FACES,
        K=K,
        pose=view if known else None,
        config=LabelConfig(axes=axes),
    )
    assert isinstance(outcome, CuboidLabel)
    return outcome


@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize(
    ("azimuth", "flank"),
    [
        (90, "left"),
        (-90, "right"),
        (45, "left"),
        (-135, "right"),
        (0, "undecided"),
        (180, "undecided"),
    ],
)
def test_the_flank_is_the_animals_own_and_undecided_from_ahead_and_behind(
    azimuth: float, flank: str, known: bool
) -> None:
    label = label_from(azimuth, known=known)
    assert label.flank == flank
    assert 0.5 <= label.flank_confidence <= 1
    assert (label.flank_confidence > 0.9) == (flank != "undecided")


def test_a_known_camera_leaves_only_the_axes_to_be_wrong() -> None:
    theta = np.radians([4.0])
    _, confidence = decided_flanks(theta, NOT_MEASURED, np.zeros(1), known_camera=np.array([True]))
    assert_allclose(confidence, norm.cdf(math.radians(4) / AXES_SD_RAD), rtol=1e-12)


def test_the_probability_of_left_is_the_documented_formula() -> None:
    shares = np.array([[0.1, 0, 0.5, 0.2, 0.2, 0]])
    left = MODEL.left(np.array([0.05]), shares, np.array([0.4]))
    evidence = (1.5 * 0.05 + 0.4 * (0.5 - 0.2)) / math.hypot(0.4, AXES_SD_RAD)
    assert_allclose(left, 0.01 + 0.98 * norm.cdf(evidence), rtol=1e-12)
    alone = MODEL.left(np.array([0.05]), NOT_MEASURED, np.zeros(1))
    assert_allclose(alone, 0.01 + 0.98 * norm.cdf(2.5 * 0.05 / AXES_SD_RAD), rtol=1e-12)


def test_a_mirrored_view_has_the_other_flank_with_the_same_probability() -> None:
    rng = np.random.default_rng(0)
    theta, sigma = rng.normal(0, 0.5, 200), rng.uniform(0, 0.3, 200)
    shares = rng.dirichlet(np.ones(6), 200)
    left = MODEL.left(theta, shares, sigma)
    mirrored = MODEL.left(-theta, shares[:, [0, 1, 3, 2, 4, 5]], sigma)
    assert_allclose(left, 1 - mirrored, atol=1e-12)


def test_an_uncertain_pose_makes_the_flank_less_probable() -> None:
    sure, unsure = (
        MODEL.left(np.array([0.2]), NOT_MEASURED, np.array([sigma])) for sigma in (0.0, 0.5)
    )
    assert 0.5 < unsure[0] < sure[0]


def test_axes_whose_signs_are_chance_decide_nothing() -> None:
    label = label_from(90, axes="pca")
    assert (label.flank, label.flank_confidence) == ("undecided", 0.5)


def test_the_lateral_angle_is_that_from_the_plane_of_symmetry() -> None:
    R_cam_box = Rotation.from_rotvec([0.3, -1.2, 0.7]).as_matrix()
    for azimuth, expected in ((90, 90.0), (-30, -30.0), (150, 30.0), (180, 0.0)):
        camera_box = 4 * np.array([np.cos(np.radians(azimuth)), np.sin(np.radians(azimuth)), 0])
        angle = lateral_angle((-R_cam_box @ camera_box)[None], R_cam_box[None])
        assert_allclose(np.degrees(angle), expected, atol=1e-5)


def test_the_shipped_numbers_decide_a_clear_view_and_not_a_doubtful_one() -> None:
    model = flank_model()
    assert 0.5 < model.decided_from < 1
    assert model.slip < 2 * (1 - model.decided_from)
    theta = np.radians([30.0, -30.0, 0.5])
    flank, _ = decided_flanks(
        theta,
        np.full((3, 6), -1.0),
        np.full(3, UNKNOWN_SD_RAD),
        known_camera=np.zeros(3, dtype=np.bool_),
    )
    assert [FLANKS[number] for number in flank] == ["left", "right", "undecided"]
