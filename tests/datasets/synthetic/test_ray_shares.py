"""Shares of a box's faces, counted by rays."""

import pytest
import torch
from torch.testing import assert_close

from animal3dbox.datasets.synthetic.ray_shares import face_shares_by_rays
from animal3dbox.datasets.synthetic.scenes import synthetic_scene
from animal3dbox.datasets.synthetic.world.config import WorldConfig
from animal3dbox.geometry.box_visibility import face_visibility
from animal3dbox.geometry.camera import intrinsics
from animal3dbox.geometry.cuboid import FACE_NAMES, Cuboid

F64 = torch.float64
HW = (60, 80)


def box(center: list[float], columns: list[list[float]], size: float = 1.0) -> Cuboid:
    return Cuboid(
        torch.tensor(center, dtype=F64),
        torch.tensor(columns, dtype=F64).T.contiguous(),
        torch.full((3,), size, dtype=F64),
    )


@pytest.mark.parametrize(
    ("forward", "left", "up", "seen"),
    [
        ([0.0, 0, -1], [1.0, 0, 0], [0.0, -1, 0], "front"),
        ([0.0, 0, 1], [-1.0, 0, 0], [0.0, -1, 0], "back"),
        ([-1.0, 0, 0], [0.0, 0, -1], [0.0, -1, 0], "left"),
        ([1.0, 0, 0], [0.0, 0, 1], [0.0, -1, 0], "right"),
        ([1.0, 0, 0], [0.0, -1, 0], [0.0, 0, -1], "top"),
        ([1.0, 0, 0], [0.0, 1, 0], [0.0, 0, 1], "bottom"),
    ],
)
def test_a_box_seen_straight_on_shows_one_face(
    forward: list[float], left: list[float], up: list[float], seen: str
) -> None:
    shares = face_shares_by_rays(box([0, 0, 4], [forward, left, up]), intrinsics(60.0, HW), HW)
    assert shares.tolist() == [1.0 if name == seen else 0.0 for name in FACE_NAMES]


def test_no_ray_meets_a_box_beside_the_frame_behind_the_camera_or_around_it() -> None:
    axes = [[0.0, 0, -1], [1.0, 0, 0], [0.0, -1, 0]]
    for center in ([50.0, 0, 4], [0.0, 0, -4], [0.0, 0, 0]):
        assert not face_shares_by_rays(box(center, axes), intrinsics(60.0, HW), HW).any()


def test_counted_shares_are_those_computed_from_the_areas_inside_the_frame() -> None:
    config = WorldConfig(
        image_hw=(96, 128), focal_px=(100.0, 600.0), truncated=0.5, fill=(0.4, 0.95)
    )
    worst = cut = 0.0
    for index in range(6):
        animal = synthetic_scene(8, index, config).animals[0]
        counted = face_shares_by_rays(animal.cuboid, animal.K, animal.image_hw, rays_per_pixel=4)
        assert_close(counted.sum(), torch.tensor(1.0, dtype=F64))
        seen = face_visibility(animal.cuboid, animal.K, animal.image_hw)
        worst = max(worst, float((counted - seen.share_in_image).abs().amax()))
        cut += float(seen.truncation > 0.1)
    assert worst < 0.01
    assert cut >= 2
