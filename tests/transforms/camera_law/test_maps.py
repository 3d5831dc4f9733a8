"""Maps of pixels as matrices."""

import numpy as np
import pytest

from animal3dbox.transforms.camera_law.maps import inverse_map, rolling


def test_the_inverse_of_a_map_undoes_it() -> None:
    rng = np.random.default_rng(0)
    for _ in range(200):
        H = np.array([[1.0, 0, 300], [0, 1, 200], [0, 0, 1]]) + rng.normal(size=(3, 3)) * (
            [0.3, 0.3, 100],
            [0.3, 0.3, 100],
            [1e-4, 1e-4, 0.1],
        )
        assert np.abs(inverse_map(H) @ H - np.eye(3)).max() < 1e-10
        H[2, :2] = 0
        assert (inverse_map(H)[2, :2] == 0).all()  # exactly: an affine map is read as one


def test_a_map_without_an_inverse_has_none() -> None:
    with pytest.raises(np.linalg.LinAlgError):
        inverse_map(np.array([[1.0, 2, 3], [2, 4, 6], [0, 0, 1]]))


def test_a_roll_is_the_intrinsics_times_a_turn_times_their_inverse() -> None:
    K = np.array([[700.0, 3, 320], [0, 600, 240], [0, 0, 1]])
    turn = rolling(None, 20.0)
    expected = K[:2, :2] @ turn @ np.linalg.inv(K[:2, :2])
    assert np.abs(rolling(K, 20.0) - expected).max() < 1e-14
