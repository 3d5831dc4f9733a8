"""The outline of masks: points, directions, several parts, the frame, a lens."""

import numpy as np
import pytest
from numpy.typing import NDArray

from animal3dbox.geometry.mask_outline import mask_outline


def disc(radius: float, center: tuple[float, float]) -> NDArray[np.bool_]:
    y, x = np.mgrid[:120, :160]
    inside: NDArray[np.bool_] = (x - center[0]) ** 2 + (y - center[1]) ** 2 <= radius**2
    return inside


@pytest.mark.parametrize("radius", [5.3, 20.7, 41.2])
def test_the_outline_of_a_disc_is_its_circle(radius: float) -> None:
    center = np.array([70.2, 60.6])
    outline = mask_outline(disc(radius, (70.2, 60.6)), 96)
    offsets = outline.points - center
    reach = np.linalg.norm(offsets, axis=1)
    assert abs(float(reach.mean()) - radius) < 0.15
    assert np.abs(reach - radius).max() < 0.8
    assert ((offsets / reach[:, None]) * outline.normals).sum(1).min() > 0.97


def test_points_spread_over_all_parts_and_holes_have_none() -> None:
    mask = disc(20, (40, 60)) | disc(10, (120, 60))
    mask &= ~disc(5, (40, 60))
    outline = mask_outline(mask, 90)
    is_left = outline.points[:, 0] < 80
    assert 85 <= len(outline.points) <= 95
    assert 1.6 < is_left.sum() / (~is_left).sum() < 2.4
    assert np.linalg.norm(outline.points[is_left] - [40, 60], axis=1).min() > 15


def test_where_the_frame_cuts_a_mask_it_has_no_outline() -> None:
    outline = mask_outline(disc(30, (10, 60)), 96)
    assert len(outline.points) == 96
    assert 0 < outline.is_whole.sum() < 96
    assert outline.points[outline.is_whole, 0].min() > 0.5
    assert not mask_outline(np.ones((20, 20), dtype=bool), 96).is_whole.any()
    assert not len(mask_outline(np.zeros((20, 20), dtype=bool), 96).points)


def test_specks_tell_no_direction() -> None:
    mask = disc(20, (40, 60))
    mask[10, 100] = True
    assert mask_outline(mask, 96).points[:, 0].max() < 70


def test_a_lens_is_taken_out() -> None:
    K = np.array([[100.0, 0, 79.5], [0, 100, 59.5], [0, 0, 1]])
    bent = mask_outline(disc(30, (110, 60)), 96, K, np.array([-0.2, 0, 0, 0.0]))
    plain = mask_outline(disc(30, (110, 60)), 96)
    assert bent.points[:, 0].max() > plain.points[:, 0].max() + 1  # barrel distortion drew it in
    assert np.allclose(np.linalg.norm(bent.normals, axis=1), 1)
