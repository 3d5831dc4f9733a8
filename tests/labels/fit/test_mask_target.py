"""A mask's outline and the way back into it."""

import numpy as np
from numpy.typing import NDArray

from animal3dbox.labels.fit.mask_target import OUTLINE_POINTS, mask_target

CENTER = np.array([31.5, 23.5])


def disc(radius: float, center: tuple[float, float] = (30, 25)) -> NDArray[np.bool_]:
    rows, columns = np.mgrid[:48, :64]
    inside: NDArray[np.bool_] = (columns - center[0]) ** 2 + (rows - center[1]) ** 2 <= radius**2
    return inside


def test_the_outline_of_a_disc_lies_on_its_circle_and_points_outward() -> None:
    target = mask_target(disc(12.0), CENTER)
    about = target.points + CENTER - [30, 25]
    radius = np.linalg.norm(about, axis=1)
    assert len(about) == OUTLINE_POINTS
    assert np.abs(radius - 11.9).max() < 0.8
    assert ((about / radius[:, None]) * target.normals).sum(1).min() > 0.95
    assert target.counts.tolist() == [1.0] * OUTLINE_POINTS


def test_the_way_back_leads_to_the_nearest_pixel_of_the_mask() -> None:
    mask = disc(12.0)
    target = mask_target(mask, CENTER)
    rows, columns = np.nonzero(mask)
    pixels = np.stack((columns, rows), -1) - CENTER
    height, width = target.nearest.shape[:2]
    for row, column in (
        (0, 0),
        (height // 2, width - 1),
        (height - 1, 3),
        (height // 2, width // 2),
    ):
        place = target.corner + target.cell * np.array([column, row])
        least = np.linalg.norm(pixels - place, axis=1).min()
        found = float(np.linalg.norm(target.nearest[row, column] - place))
        assert least <= found + 1e-9
        assert found < least * 1.03 + 0.75


def test_points_where_the_frame_cuts_the_mask_do_not_count() -> None:
    target = mask_target(disc(12.0, (5, 25)), CENTER)
    at_border = target.points[:, 0] + CENTER[0] < 0.5  # of pixels in the first column
    assert at_border.any()
    assert target.counts[at_border].tolist() == [0.0] * int(at_border.sum())
    assert target.counts.sum() > 60


def test_a_mask_of_one_pixel_has_a_target() -> None:
    mask = np.zeros((48, 64), dtype=np.bool_)
    mask[20, 30] = True
    target = mask_target(mask, CENTER)
    assert np.abs(target.points + CENTER - [30, 20]).max() < 1
    assert np.isfinite(target.normals).all()
