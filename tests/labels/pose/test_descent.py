"""The batched descent: its derivatives, and that it finds what SciPy finds."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
import torch
from animals import IMAGE_HW, K, camera_round, keypoints_seen, toy_landmarks, toy_mesh
from numpy.typing import NDArray
from scipy.optimize import least_squares

from animal3dbox.geometry.camera import project
from animal3dbox.geometry.rigid_transforms import rotation_from_axis_angle
from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.pose.levenberg_marquardt import (
    LocalModel,
    descend,
    project_with_slopes,
    small_turns,
)
from animal3dbox.labels.pose.multi_start_search import CAUCHY_95, keypoint_cost
from animal3dbox.labels.pose.problem import PoseEstimate, PoseProblem
from animal3dbox.labels.pose.robust_joint_cost import (
    MASK_SLACK_PX,
    SIDES,
    bounded_points,
    joint_cost,
    joint_residuals,
    joint_terms,
    outline_candidates,
    outline_is_complete,
    refine_jointly,
)

F64 = torch.float64
Array = NDArray[np.float64]
STEPS = 1e-6 * np.eye(6)


def problem(noise_px: float = 3.0, wild: int = 0) -> PoseProblem:
    """The toy animal, about its landmarks' mean and in units of their spread, with a mask box that
    does not quite fit."""
    R, t = camera_round(40, 20)
    generator = torch.Generator().manual_seed(0)
    keypoints = keypoints_seen(R, t)[:, :2] + noise_px * torch.randn(
        26, 2, generator=generator, dtype=F64
    )
    keypoints[:wild] = torch.rand(wild, 2, generator=generator, dtype=F64) * 400
    landmarks, (vertices, _) = toy_landmarks(), toy_mesh()
    px, _ = project(K, vertices @ R.mT + t)
    box = torch.cat((px.amin(0), px.amax(0))) + torch.tensor([3.0, -4, -5, 6], dtype=F64)
    middle = landmarks.mean(0)
    unit = (landmarks - middle).pow(2).sum(-1).mean().sqrt()
    points = (landmarks - middle) / unit
    return PoseProblem(
        points_world=points.numpy(),
        points_px=keypoints.numpy(),
        sigma_px=np.full(26, 2.0),
        K=K.numpy(),
        image_hw=IMAGE_HW,
        R_box=np.eye(3),
        vertices_world=((vertices - middle) / unit).numpy(),
        mask_box=box.numpy(),
    )


def poses(count: int = 3) -> tuple[Array, Array]:
    """Some before the camera."""
    generator = np.random.default_rng(0)
    R = np.stack([camera_round(40 + 20 * i, 20)[0].numpy() for i in range(count)])
    return R, np.stack([0.3 * generator.standard_normal(3) + (0, 0, 7) for _ in range(count)])


def moved(R: Array, t: Array, step: Array) -> tuple[Array, Array]:
    return rotation_from_axis_angle(step[:3]) @ R, t + step[3:]


@pytest.mark.parametrize("skew", [0.0, 40.0])
def test_the_slopes_of_projected_points_are_those_of_finite_differences(skew: float) -> None:
    R, t = poses()
    linear = np.array([[600.0, skew], [0, 550]])
    points = np.random.default_rng(1).standard_normal((3, 10, 3))
    _, slopes, _ = project_with_slopes(points, linear, R, t)
    for k, step in enumerate(STEPS):
        ahead, back = (
            project_with_slopes(points, linear, *moved(R, t, s))[0] for s in (step, -step)
        )
        assert np.abs((ahead - back) / 2e-6 - slopes[:, k]).max() < 1e-5 * np.abs(slopes).max()


def joint_at(
    given: PoseProblem, misfit: float, R: Array, t: Array
) -> Callable[[Array, Array], LocalModel]:
    """The joint cost of a problem with the outline of its body near some poses."""
    config = LabelConfig()
    targets, weights = joint_terms(given, misfit, config)
    outline = outline_candidates(given, bounded_points(given, config), R, t)
    return partial(joint_cost, given, targets=targets, weights=weights, outline=outline)


def costs() -> list[Callable[[Array, Array], LocalModel]]:
    given = problem(wild=5)
    return [
        partial(keypoint_cost, given, 5.0),
        joint_at(given, 1.5, *poses()),
        joint_at(replace(given, mask_box=None), 1.5, *poses()),
    ]


@pytest.mark.parametrize("which", [0, 1, 2])
def test_the_slope_of_each_cost_is_that_of_finite_differences(which: int) -> None:
    cost, (R, t) = costs()[which], poses()
    b = cost(R, t).b
    for k, step in enumerate(STEPS):
        numeric = (cost(*moved(R, t, step)).cost - cost(*moved(R, t, -step)).cost) / 2e-6
        assert np.abs(numeric - b[:, k]).max() < 1e-5 * np.abs(b).max()


def test_the_outline_candidates_bound_the_body_like_all_its_points() -> None:
    (R, t), given, config = poses(), problem(), LabelConfig()
    body = bounded_points(given, config)
    outline = outline_candidates(given, body, R, t)
    assert outline.shape[2] < body.shape[1] / 2
    assert outline_is_complete(given, body, R, t, outline=outline)
    assert not outline_is_complete(given, body, R, t, outline=0.9 * outline)
    targets, weights = joint_terms(given, 1.0, config)
    few, all_points = (
        joint_cost(given, R, t, targets=targets, weights=weights, outline=points).cost
        for points in (outline, np.stack([body] * 3))
    )
    assert np.array_equal(few, all_points)


def test_a_descent_never_costs_more_and_stays_before_the_camera() -> None:
    cost_at, (R, t) = costs()[0], poses(8)
    before = cost_at(R, t).cost
    for rounds in (1, 2, 5, 20):
        R_end, t_end, cost, _ = descend(cost_at, R, t, rounds)
        assert (cost <= before * (1 + 1e-12)).all()
        assert np.allclose(cost, cost_at(R_end, t_end).cost)
        assert np.isfinite(cost).all()


def test_what_is_found_already_has_settled_at_once() -> None:
    cost_at, (R, t) = costs()[0], poses(1)
    R, t, cost, settled = descend(cost_at, R, t, 100)
    assert settled
    *_, again, settled = descend(cost_at, R, t, 2)
    assert settled
    assert again == pytest.approx(cost, rel=1e-9)


@pytest.mark.parametrize("wild", [0, 6])
def test_the_joint_cost_is_brought_as_low_as_by_scipy(wild: int) -> None:
    R, t = (x.numpy()[None] for x in camera_round(40, 20))
    given = problem(wild=wild)
    assert given.vertices_world is not None
    assert given.mask_box is not None
    t, vertices, mask_box = (
        t + np.array([0, 0, 3.0]),
        given.vertices_world,
        given.mask_box,
    )
    targets, weights = joint_terms(given, 1.0, LabelConfig())
    body_points = bounded_points(given, LabelConfig())

    def residuals(x: Array) -> Array:
        R_here, t_here = moved(R[0], t[0], x)
        cam = given.points_world @ R_here.T + t_here
        px = (cam @ K.numpy().T)[:, :2] / cam[:, 2:]
        off = (px - given.points_px) * weights[:, : len(px)].T
        body = vertices @ R_here.T + t_here
        body_px = (body @ K.numpy().T)[:, :2] / body[:, 2:]
        beyond = np.concatenate((body_px.min(0), body_px.max(0))) - mask_box
        return np.concatenate(
            (
                off.ravel(),
                (beyond - beyond.clip(-MASK_SLACK_PX, MASK_SLACK_PX)) * weights[0, -2],
            )
        )

    expected = least_squares(
        residuals, np.zeros(6), loss="cauchy", f_scale=CAUCHY_95, xtol=1e-12, ftol=1e-12, gtol=1e-12
    ).cost
    cost_of = partial(
        joint_cost, given, targets=targets, weights=weights, outline=body_points[None]
    )
    *_, cost, _ = descend(cost_of, R, t, 60)
    assert cost[0] <= expected * (1 + 1e-6)


@pytest.mark.parametrize(("off_px", "costs"), [(0.4, False), (0.9, False), (1.5, True)])
def test_bounds_that_differ_by_less_than_a_mask_can_tell_cost_nothing(
    off_px: float, costs: bool
) -> None:
    R, t = poses(1)
    given = problem()
    assert given.vertices_world is not None
    px, _ = project(given.K, given.vertices_world @ R[0].T + t[0])
    box = np.concatenate((px.min(0), px.max(0))) + off_px * np.array([1.0, -1, 1, -1])
    boxed, config = replace(given, mask_box=box), LabelConfig()
    targets, weights = joint_terms(boxed, 1.0, config)
    outline = outline_candidates(boxed, bounded_points(boxed, config), R, t)
    off, by_step, _ = joint_residuals(
        boxed, R, t, targets=targets, weights=weights, outline=outline
    )
    beyond, slopes = (x.reshape(-1, 2, 30)[:, SIDES, 26 + np.arange(4)] for x in (off, by_step[0]))
    assert (bool(beyond.all()), bool(slopes.any())) == (costs, costs)
    assert bool(beyond.any()) == costs


def test_small_turns_are_rotations_and_those_by_their_vectors_to_first_order() -> None:
    w = np.random.default_rng(0).normal(size=(5, 3))
    turns = small_turns(w)
    assert np.abs(turns @ turns.swapaxes(-1, -2) - np.eye(3)).max() < 1e-14
    assert np.allclose(np.linalg.det(turns), 1, atol=1e-14)
    axis = w / np.linalg.norm(w, axis=-1, keepdims=True)
    by_angle = rotation_from_axis_angle(
        axis * 2 * np.arctan(np.linalg.norm(w, axis=-1, keepdims=True) / 2)
    )
    assert np.abs(turns - by_angle).max() < 1e-14
    assert np.abs(small_turns(1e-5 * w) - rotation_from_axis_angle(1e-5 * w)).max() < 1e-14


@pytest.mark.parametrize("off_px", [1e-5, 1e-6, 1e-7])
def test_keypoints_that_are_exact_but_for_rounding_are_settled_at_once(off_px: float) -> None:
    R, t = poses(1)
    given = problem()
    noise = np.random.default_rng(0).normal(size=given.points_px.shape)
    px, _ = project(given.K, given.points_world @ R[0].T + t[0])
    exact = replace(given, points_px=px + off_px * noise, vertices_world=None, mask_box=None)
    *_, cost, settled = descend(joint_at(exact, 1.0, R, t), R, t, 6)
    assert settled
    assert 0 < cost[0] < 26 * off_px**2


def test_the_name_of_a_start_follows_its_pose_when_another_gets_cheaper() -> None:
    R, t = (x.numpy() for x in camera_round(40, 20))
    given = problem()
    far = PoseEstimate(camera_round(80, 20)[0].numpy(), t, "far off")
    refined = refine_jointly(given, [far, PoseEstimate(R, t, "near")], 1.0, LabelConfig())
    assert refined[0].hypothesis == "near"
