from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
import torch
from animals import IMAGE_HW, K, camera_round, toy_landmarks
from numpy.typing import NDArray

from animal3dbox.geometry.camera import project
from animal3dbox.geometry.rigid_transforms import rotation_angle
from animal3dbox.labels.pose import multi_start_search as pose_search
from animal3dbox.labels.pose.epnp_ransac import sqpnp_pose
from animal3dbox.labels.pose.multi_start_search import search_poses
from animal3dbox.labels.pose.problem import PoseEstimate, PoseProblem

F64 = torch.float64
Array = NDArray[np.float64]


def problem(
    azimuth: float, noise_px: float = 1.0, sigma_px: float = 2.0
) -> tuple[PoseProblem, torch.Tensor]:
    """The toy animal, about its mean and in units of its spread, and its true R."""
    points = toy_landmarks()
    points = (points - points.mean(0)) / (points - points.mean(0)).pow(2).sum(-1).mean().sqrt()
    R, _ = camera_round(azimuth, 15.0, 6.0)
    noise = (
        torch.from_numpy(np.random.default_rng(int(azimuth)).normal(size=(len(points), 2)))
        * noise_px
    )
    pixels = project(K, points @ R.mT + torch.tensor([0.1, 0.0, 6.0], dtype=F64))[0] + noise
    return PoseProblem(
        points_world=points.numpy(),
        points_px=pixels.numpy(),
        sigma_px=np.full(len(points), sigma_px),
        K=K.numpy(),
        image_hw=IMAGE_HW,
        R_box=np.eye(3),
        vertices_world=None,
        mask_box=None,
    ), R


def start_of(seen: PoseProblem) -> list[PoseEstimate]:
    found = sqpnp_pose(seen)
    assert isinstance(found, PoseEstimate)
    return [found]


@pytest.mark.parametrize("azimuth", [10.0, 75.0, 160.0, 250.0, 340.0])
def test_a_start_that_explains_everything_is_what_the_views_find_too(
    azimuth: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen, R = problem(azimuth)
    sure, _ = search_poses(seen, start_of(seen))
    monkeypatch.setattr(pose_search, "SURE_KEYPOINTS", 1000)
    searched, _ = search_poses(seen, start_of(seen))
    assert [pose.hypothesis for pose in sure] == ["sqpnp"]
    assert len(searched) >= 1
    sure_R, searched_R = (torch.from_numpy(poses[0].R) for poses in (sure, searched))
    assert float(rotation_angle(sure_R, searched_R)) < 1e-3
    assert float(rotation_angle(sure_R, R)) < 0.1


@pytest.mark.parametrize("wild_px", [0.0, 90.0])
def test_views_are_tried_where_one_keypoint_is_wild_or_the_animal_is_small(
    wild_px: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen, R = problem(40.0)
    starts, tried = start_of(seen), list[int]()
    wild = seen.points_px.copy()
    wild[3] += wild_px
    place = pose_search.weak_perspective_translation

    def noted(problem: PoseProblem, R_views: Array) -> Array:
        tried.append(len(R_views))
        return place(problem, R_views)

    monkeypatch.setattr(pose_search, "weak_perspective_translation", noted)
    candidates, _ = search_poses(
        replace(seen, points_px=wild, sigma_px=seen.sigma_px if wild_px else 20 * seen.sigma_px),
        starts,
    )
    assert tried
    assert float(rotation_angle(torch.from_numpy(candidates[0].R), R)) < 0.1


def test_no_start_is_asked_for_after_one_beyond_doubt() -> None:
    seen, _ = problem(40.0)

    def starts() -> Iterator[PoseEstimate]:
        yield replace(start_of(seen)[0], R=np.eye(3), hypothesis="far off")
        yield from start_of(seen)
        pytest.fail("asked for another start")

    assert [pose.hypothesis for pose in search_poses(seen, starts())[0]] == ["sqpnp"]
