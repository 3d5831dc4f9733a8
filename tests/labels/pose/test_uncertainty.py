import numpy as np
from torch.testing import assert_close

from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.pose.keypoint_uncertainty import keypoint_sigma, misfit_sigma

CONFIG = LabelConfig(
    sigma_visible_px=2.0,
    sigma_occluded_px=6.0,
    edge_band=0.1,
    edge_gain=4.0,
    confidence_floor=0.1,
    occluded_below=0.5,
)


def sigma_of(x: float, y: float, confidence: float) -> float:
    return float(keypoint_sigma(np.array([[x, y, confidence]]), (100, 200), CONFIG)[0])


def test_a_plain_keypoint_in_the_middle_has_the_base_deviation() -> None:
    assert sigma_of(100, 50, 1.0) == 2.0


def test_variance_is_base_times_edge_times_confidence_factor() -> None:
    # at the very border edge_factor is 4; confidence 0.5 gives conf_factor 2: sigma = sqrt(2^2 * 4
    # * 2)
    assert_close(sigma_of(-0.5, 50, 0.5), (4.0 * 4 * 2) ** 0.5)
    # half-way through the band of 10 px edge_factor is 2.5
    assert_close(sigma_of(100, 4.5, 1.0), (4.0 * 2.5) ** 0.5)


def test_a_doubtful_keypoint_counts_as_occluded_and_confidence_has_a_floor() -> None:
    assert_close(sigma_of(100, 50, 0.4), (36 / 0.4) ** 0.5)
    assert_close(sigma_of(100, 50, 0.001), (36 / 0.1) ** 0.5)


def test_outside_the_image_the_edge_factor_stays_at_its_most() -> None:
    assert_close(sigma_of(-500, 50, 1.0), (4.0 * 4) ** 0.5)


def test_an_uncertain_landmark_is_worth_its_length_in_pixels_on_average_over_views() -> None:
    ball = np.random.default_rng(0).standard_normal((4000, 3))
    ball /= np.linalg.norm(ball, axis=-1, keepdims=True)
    seen = 250 * ball[:, :2] + 40  # 250 px a unit, from any side
    assert np.allclose(misfit_sigma(ball, seen, np.array([0.0, 0.1])), [0, 25], rtol=0.03, atol=0)


def test_without_keypoints_there_is_nothing_to_be_uncertain_of() -> None:
    nothing = np.zeros((0, 3))
    assert len(misfit_sigma(nothing, nothing[:, :2], nothing[:, 0])) == 0
