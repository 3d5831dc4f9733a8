"""Overlays of small animals, and the front of a box without its colour."""

import math
from itertools import product

import cv2
import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from animal3dbox.geometry.camera import project
from animal3dbox.geometry.cuboid import FACES, Cuboid
from animal3dbox.geometry.rigid_transforms import rotation_from_axis_angle
from animal3dbox.report.cuboid_pen import BACK, EDGE, FRONT, line_widths, region_of
from animal3dbox.report.inset import Picture, Region, is_small
from animal3dbox.report.overlay import (
    DrawnCuboid,
    cuboid_in_picture,
    cuboids_in_picture,
    draw_cuboid,
)
from animal3dbox.report.prediction_overlay import draw_predictions

F64 = torch.float64
HW = (600, 900)
K = torch.tensor([[800.0, 0, 449.5], [0, 800, 299.5], [0, 0, 1]], dtype=F64)
UPRIGHT = torch.tensor([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]], dtype=F64)
"""The box looks to the picture's right, its back up."""


def box(
    azimuth_deg: float = 0, *, at: tuple[float, float] = (0, 0), distance: float = 20
) -> Cuboid:
    """A box that shows its left side at azimuth 180, and its front at 90."""
    turn = rotation_from_axis_angle(torch.tensor([0, math.radians(azimuth_deg), 0], dtype=F64))
    center = torch.tensor([*at, distance], dtype=F64)
    return Cuboid(center, turn @ UPRIGHT, torch.tensor([2.0, 0.6, 1.2], dtype=F64))


def grey() -> Picture:
    return np.full((*HW, 3), 128, dtype=np.uint8)


def pixels_within(region: Region) -> tuple[slice, slice]:
    """Rows and columns of the pixels whose middles lie in a region."""
    sides = ((region.y1, region.y2), (region.x1, region.x2))
    rows, columns = (slice(math.ceil(first), int(last)) for first, last in sides)
    return rows, columns


def pixels_of(picture: Picture, color: tuple[int, int, int]) -> NDArray[np.bool_]:
    """Which pixels have a colour."""
    return np.asarray(np.abs(picture.astype(int) - color).max(-1) <= 2)


def without_colour(picture: Picture) -> Picture:
    """What is left of a picture for whoever sees no colours at all."""
    return np.asarray(cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY))


def test_a_regions_sides_are_those_of_the_projected_box_and_end_at_the_frame() -> None:
    near = box(distance=20)
    region = region_of(near, K, HW)
    assert region is not None
    half = 800 / 19.7  # the near side is 19.7 away, and 1 to each side
    assert (region.x1, region.x2) == pytest.approx((449.5 - half, 449.5 + half))
    cut = region_of(box(at=(11, 0)), K, HW)
    assert cut is not None
    assert cut.x2 == HW[1] - 0.5
    assert region_of(box(at=(40, 0)), K, HW) is None
    assert region_of(box(distance=-5), K, HW) is None
    assert region_of(box(90, at=(3, 0), distance=0), K, HW) is None  # half of it is behind
    inside = region_of(box(distance=0.1), K, HW)
    assert inside == Region(-0.5, -0.5, HW[1] - 0.5, HW[0] - 0.5)


def test_lines_are_thinner_on_small_animals_and_never_thicker_than_the_picture_asks() -> None:
    canvas = np.zeros((3000, 4320, 3), dtype=np.uint8)
    widths = [line_widths(canvas, Region(0, 0, n, 9), 1.0) for n in (20, 100, 400, 1000, 4000)]
    assert [(w.thin, w.strong, w.dot) for w in widths] == [
        (1, 1, 1),
        (1, 2, 2),
        (2, 4, 6),
        (4, 8, 12),
        (6, 12, 18),
    ]
    assert line_widths(canvas, None, 1.0).strong == 1


def test_lines_cover_no_more_than_half_of_a_tiny_animal() -> None:
    canvas = np.full((1500, 4320, 3), 128, dtype=np.uint8)
    wide = K * torch.tensor([[1, 1, 4.8], [1, 1, 2.5], [1, 1, 1]], dtype=F64)
    tiny = box(30, distance=40)
    region = region_of(tiny, wide, (1500, 4320))
    assert region is not None
    assert 30 < region.longer < 60
    draw_cuboid(canvas, tiny, wide, heading_known=False)
    y, x = pixels_within(region)
    assert 0.05 < (canvas[y, x] != 128).any(-1).mean() < 0.5


@pytest.mark.parametrize("at", [*product((-9, 0, 9), (-6, 0, 6))])
def test_a_small_animal_is_enlarged_in_a_corner_that_hides_neither_it_nor_its_keypoints(
    at: tuple[float, float],
) -> None:
    small = box(30, at=at)
    region = region_of(small, K, HW)
    assert is_small(region, HW)
    assert region is not None
    plain = grey()
    draw_cuboid(plain, small, K)
    drawn = cuboid_in_picture(grey(), small, K)
    y, x = pixels_within(region)
    assert np.array_equal(drawn[y, x], plain[y, x])  # the animal is as it is without an inset
    away = (drawn != plain).any(-1)
    away[max(y.start - 40, 0) : y.stop + 40, max(x.start - 40, 0) : x.stop + 40] = False  # a frame
    rows, columns = np.nonzero(away)
    assert 200 < np.ptp(columns) + 1 < HW[1] / 2.5
    assert np.ptp(rows) + 1 < HW[0] / 2
    assert min(columns.min(), HW[1] - 1 - columns.max()) < 12
    assert min(rows.min(), HW[0] - 1 - rows.max()) < 12
    assert pixels_of(drawn, EDGE)[away].sum() > 100  # with its box
    assert pixels_of(drawn, FRONT)[away].sum() > 100


def test_the_inset_keeps_clear_of_keypoints_and_of_other_animals() -> None:
    small = box(30)
    corners = {(0, 0), (0, 1), (1, 0), (1, 1)}

    def corner(drawn: Picture, before: Picture) -> tuple[int, int]:
        changed = (drawn != before).any(-1)
        quarters = {
            (i, j): changed[i * 300 : i * 300 + 200, j * 600 : j * 600 + 300].sum()
            for i, j in corners
        }
        return max(quarters, key=lambda key: quarters[key])

    def lively(*places: tuple[int, int]) -> Picture:
        """A picture with stripes in some corners."""
        picture = grey()
        for i, j in places:
            picture[i * 300 : i * 300 + 300 : 2, j * 600 : j * 600 + 300] = 60
        return picture

    for free in corners:
        others = corners - {free}
        picture = lively(*others)
        assert corner(cuboid_in_picture(picture, small, K), picture) == free
        picture = lively(free)
        points = [[100 + 700 * j, 80 + 440 * i, 2.0] for i, j in others]
        drawn = cuboid_in_picture(picture, small, K, keypoints=torch.tensor(points, dtype=F64))
        assert corner(drawn, picture) == free
    there = box(30, at=(-9, -6))
    picture = lively(*corners - {(0, 0)})
    assert corner(cuboid_in_picture(picture, there, K), picture) != (0, 0)


def test_a_large_animal_one_that_is_not_there_and_strips_have_no_inset() -> None:
    def differs(cuboid: Cuboid, hw: tuple[int, int] = HW) -> bool:
        picture = np.full((*hw, 3), 128, dtype=np.uint8)
        plain = picture.copy()
        draw_cuboid(plain, cuboid, K)
        return not np.array_equal(cuboid_in_picture(picture, cuboid, K), plain)

    region = region_of(box(distance=11), K, HW)
    assert region is not None
    assert region.longer == pytest.approx(HW[1] / 6, rel=0.03)
    assert differs(box(distance=11.5))
    assert not differs(box(distance=10.5))
    assert not differs(box(at=(40, 0)))
    above = box(at=(0, -7.4))  # within the first rows of the picture
    assert region_of(above, K, (30, 900)) is not None
    assert not differs(above, (30, 900))  # a strip has no room to enlarge anything


def framed_places(picture: Picture, plain: Picture) -> list[tuple[int, int, int, int]]:
    """The rectangles (x, y, width, height) round what insets and frames changed."""
    changed = cv2.dilate((picture != plain).any(-1).astype(np.uint8), np.ones((5, 5)))
    outlines, _ = cv2.findContours(changed, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    return sorted((x, y, w, h) for x, y, w, h in map(cv2.boundingRect, outlines))


def drawn_and_plain(*cuboids: DrawnCuboid) -> tuple[Picture, Picture]:
    """A picture with several cuboids, and the same without insets."""
    plain = grey()
    for one in cuboids:
        draw_cuboid(plain, one.cuboid_cam, K, dashed=one.dashed)
    return cuboids_in_picture(grey(), cuboids), plain


def test_a_detection_beside_its_label_is_enlarged_with_it() -> None:
    label, detection = DrawnCuboid(box(30), K), DrawnCuboid(box(40, at=(0.8, 0)), K, dashed=True)
    drawn, plain = drawn_and_plain(label, detection)
    frame, (x, y, _, _) = framed_places(drawn, plain)
    regions = [region_of(one.cuboid_cam, K, HW) for one in (label, detection)]
    for region in regions:
        assert region is not None
        assert frame[0] < region.x1 < region.x2 < frame[0] + frame[2]
    alone, _ = drawn_and_plain(label)
    assert (drawn[y:, x:] != alone[y:, x:]).any()  # the detection is in the inset
    target, answer = (
        {
            "center": one.cuboid_cam.center[None],
            "rotation": one.cuboid_cam.rotation[None],
            "size": one.cuboid_cam.size[None],
        }
        for one in (label, detection)
    )
    scores = torch.ones(1, dtype=F64)
    picture = draw_predictions(grey(), {**target, "K": K}, {**answer, "scores": scores})
    assert np.array_equal(picture[: HW[0]], drawn)


def test_of_small_animals_far_apart_two_are_enlarged_in_corners_of_their_own() -> None:
    places = [(-7.0, 0.0), (0.0, 0.0), (7.0, 0.0)]
    drawn, plain = drawn_and_plain(*(DrawnCuboid(box(30, at=at), K) for at in places))
    assert len(framed_places(drawn, plain)) == 4
    for at, is_framed in zip(places, (True, True, False), strict=True):
        region = region_of(box(30, at=at), K, HW)
        assert region is not None
        y, x = pixels_within(region)
        assert np.array_equal(drawn[y, x], plain[y, x])
        around = (slice(y.start - 26, y.stop + 26), slice(x.start - 26, x.stop + 26))
        assert (drawn[around] != plain[around]).any() == is_framed


def test_no_inset_hides_another_box() -> None:
    for distance, is_enlarged in ((2.2, False), (8, True)):  # it fills the picture, or its middle
        drawn, plain = drawn_and_plain(
            DrawnCuboid(box(distance=distance), K), DrawnCuboid(box(30, at=(9, 0)), K)
        )
        assert np.array_equal(drawn, plain) != is_enlarged


@pytest.mark.parametrize("azimuth_deg", [0, 30, 60, 90, 135, 200, 270, 315])
def test_a_box_and_the_same_turned_about_differ_without_any_colour(azimuth_deg: float) -> None:
    """The lines of both boxes are the same: only front and back are exchanged."""
    ways = []
    for turn in (0, 180):
        canvas = grey()
        draw_cuboid(canvas, box(azimuth_deg + turn, distance=5), K)
        ways.append(without_colour(canvas).astype(int))
    assert (np.abs(ways[0] - ways[1]) > 60).sum() > 100


def test_the_front_alone_is_crossed() -> None:
    """On its diagonals, a quarter and three quarters along them."""
    for azimuth_deg, color, crossed in ((60, FRONT, True), (240, BACK, False)):
        canvas, cuboid = grey(), box(azimuth_deg, distance=5)
        draw_cuboid(canvas, cuboid, K)
        corners = cuboid.corners()[list(FACES["front" if crossed else "back"])]
        for first, last in ((0, 2), (1, 3)):
            for part in (0.25, 0.75):
                point = corners[first] + part * (corners[last] - corners[first])
                ((u, v),), _ = project(K, point[None])
                around = canvas[int(v) - 3 : int(v) + 4, int(u) - 3 : int(u) + 4]
                assert pixels_of(around, color).any() == crossed


def test_the_arrow_points_to_the_front_and_lies_in_the_box() -> None:
    for azimuth_deg, to_the_right in ((0, True), (180, False)):
        ends = []
        for heading_known in (True, False):
            canvas = grey()
            draw_cuboid(canvas, box(azimuth_deg, distance=5), K, heading_known=heading_known)
            ends.append(canvas)
        region = region_of(box(azimuth_deg, distance=5), K, HW)
        assert region is not None
        white = (ends[0] >= 250).all(-1) & (ends[1] < 250).any(-1)
        columns = np.nonzero(white)[1]
        assert len(columns) > 50
        middle = (region.x1 + region.x2) / 2
        assert (columns.mean() > middle) == to_the_right
        assert region.x1 <= columns.min()
        assert columns.max() <= region.x2
        # the head is at the front's end of the shaft: more white pixels there
        half = np.median((columns.min(), columns.max()))
        assert ((columns > half).sum() > (columns < half).sum()) == to_the_right
