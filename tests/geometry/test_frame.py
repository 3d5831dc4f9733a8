"""One rule says what lies inside the frame."""

import numpy as np
import torch

from animal3dbox.geometry.frame import in_frame


def test_the_border_of_the_frame_belongs_to_it_and_nothing_beyond() -> None:
    corners = np.array([[-0.5, -0.5], [3.5, -0.5], [3.5, 2.5], [-0.5, 2.5]])
    assert in_frame(corners, (3, 4)).all()
    beyond = corners + np.sign(corners - (1.5, 1.0)) * 1e-9
    assert not in_frame(beyond, (3, 4)).any()
    assert in_frame(np.array([3.0, 2.0]), (3, 4))
    assert not in_frame(np.array([2.0, 3.0]), (3, 4))  # height comes first


def test_what_is_nowhere_is_outside() -> None:
    px = torch.tensor([[float("nan"), 1.0], [1.0, float("inf")], [1.0, 1.0]])
    assert in_frame(px, (3, 4)).tolist() == [False, False, True]
