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
from animal3dbox.geometry.mask_supports import MaskSupports, even_directions
from animal3dbox.geometry.rigid_transforms import rotation_from_axis_angle
from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.pose.levenberg_marquardt import (
    CameraPoses,
    LocalModel,
    descend,
    project_with_slopes,
    small_turns,
)
from animal3dbox.labels.pose.multi_start_search import CAUCHY_95, keypoint_cost
from animal3dbox.labels.pose.problem import PoseProblem
from animal3dbox.labels.pose.robust_joint_cost import (
    joint_cost,
    joint_terms,
    outline_candidates,
    outline_is_complete,
    refine_jointly,
)

F64 = torch.float64
Array = NDArray[np.float64]
STEPS = 1e-6 * np.eye(7)
SIDES_ROUND = even_directions(12)
Cost = Callable[[CameraPoses], LocalModel]


def problem(noise_px: float = 3.0, wild: int = 0) -> PoseProblem:
    """The toy animal, about its landmarks' mean and in units of their spread, with supports of a
    mask that do not quite fit."""
    R, t = camera_round(40, 20)
    generator = torch.Generator().manual_seed(0)
    keypoints = keypoints_seen(R, t)[:, :2] + noise_px * torch.randn(
        26, 2, generator=generator, dtype=F64
    )
    keypoints[:wild] = torch.rand(wild, 2, generator=generator, dtype=F64) * 400
    landmarks, (vertices, _) = toy_landmarks(), toy_mesh()
    px, _ = project(K, vertices @ R.mT + t)
    reach = (SIDES_ROUND @ px.numpy().T).max(1) + 2 * np.cos(np.arange(12.0))
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
        mask_box=None,
        mask_supports=MaskSupports(SIDES_ROUND, reach),
    )


def poses(count: int = 3, *, zoomed: bool = False) -> CameraPoses:
    """Some before the camera."""
    generator = np.random.default_rng(0)
    R = np.stack([camera_round(40 + 20 * i, 20)[0].numpy() for i in range(count)])
    t = np.stack([0.3 * generator.standard_normal(3) + (0, 0, 7) for _ in range(count)])
    return CameraPoses(R, t, 0.2 * np.arange(count, dtype=np.float64) - 0.1 if zoomed else None)


def moved(at: CameraPoses, step: Array) -> CameraPoses:
    zoom = None if at.log_zoom is None else at.log_zoom + step[6]
    return CameraPoses(rotation_from_axis_angle(step[:3]) @ at.R, at.t + step[3:6], zoom)


@pytest.mark.parametrize("skew", [0.0, 40.0])
@pytest.mark.parametrize("zoomed", [False, True])
def test_the_slopes_of_projected_points_are_those_of_finite_differences(
    skew: float, zoomed: bool
) -> None:
    at = poses(zoomed=zoomed)
    linear = np.array([[600.0, skew], [0, 550]])
    points = np.random.default_rng(1).standard_normal((3, 10, 3))
    _, slopes, _ = project_with_slopes(points, linear, at)
    for k in range(slopes.shape[1]):
        ahead, back = (
            project_with_slopes(points, linear, moved(at, s))[0] for s in (STEPS[k], -STEPS[k])
        )
        assert np.abs((ahead - back) / 2e-6 - slopes[:, k]).max() < 1e-5 * np.abs(slopes).max()


def joint_at(given: PoseProblem, misfit: float, at: CameraPoses) -> Cost:
    """The joint cost of a problem with the outline of its body near some poses."""
    terms = joint_terms(given, misfit, misfit, config=LabelConfig())
    outline = outline_candidates(given, terms, at)
    return partial(joint_cost, given, terms=terms, outline=outline)


COSTS = ("keypoints", "joint", "joint without a mask", "joint, zoomed")


def cost_named(name: str) -> tuple[Cost, CameraPoses]:
    given, at = problem(wild=5), poses(zoomed="zoomed" in name)
    if name == "keypoints":
        return partial(keypoint_cost, given, 5.0), at
    if "without" in name:
        given = replace(given, mask_supports=None)
    return joint_at(given, 1.5, at), at


@pytest.mark.parametrize("name", COSTS)
def test_the_slope_of_each_cost_is_that_of_finite_differences(name: str) -> None:
    cost, at = cost_named(name)
    b = cost(at).b
    for k in range(b.shape[1]):
        numeric = (cost(moved(at, STEPS[k])).cost - cost(moved(at, -STEPS[k])).cost) / 2e-6
        assert np.abs(numeric - b[:, k]).max() < 1e-5 * np.abs(b).max()


def test_the_outline_candidates_support_the_body_like_all_its_points() -> None:
    at, given, config = poses(), problem(), LabelConfig()
    terms = joint_terms(given, 1.0, 1.0, config=config)
    outline = outline_candidates(given, terms, at)
    assert outline.shape[2] < terms.body.shape[1] * 0.7
    assert outline_is_complete(given, terms, at, outline=outline)
    assert not outline_is_complete(given, terms, at, outline=0.9 * outline)
    few, all_points = (
        joint_cost(given, at, terms=terms, outline=points).cost
        for points in (outline, np.stack([terms.body] * 3))
    )
    assert np.array_equal(few, all_points)


def test_a_descent_never_costs_more_and_stays_before_the_camera() -> None:
    cost_at, _ = cost_named("keypoints")
    at = poses(8)
    before = cost_at(at).cost
    for rounds in (1, 2, 5, 20):
        end, local, _ = descend(cost_at, at, rounds)
        assert (local.cost <= before * (1 + 1e-12)).all()
        assert np.allclose(local.cost, cost_at(end).cost)
        assert np.isfinite(local.cost).all()


def test_what_is_found_already_has_settled_at_once() -> None:
    cost_at, _ = cost_named("keypoints")
    found, local, settled = descend(cost_at, poses(1), 100)
    assert settled
    _, again, settled = descend(cost_at, found, 2)
    assert settled
    assert again.cost == pytest.approx(local.cost, rel=1e-9)


@pytest.mark.parametrize("wild", [0, 6])
def test_the_joint_cost_is_brought_as_low_as_by_scipy(wild: int) -> None:
    R, t = (x.numpy() for x in camera_round(40, 20))
    given = problem(wild=wild)
    assert given.vertices_world is not None
    t, vertices = t + np.array([0, 0, 3.0]), given.vertices_world
    at = CameraPoses(R[None], t[None])
    terms = joint_terms(given, 1.0, 1.0, config=LabelConfig())

    def residuals(x: Array) -> Array:
        here = moved(at, x)
        seen = [
            (points @ here.R[0].T + here.t[0]) @ K.numpy().T
            for points in (given.points_world, vertices)
        ]
        px, body_px = (cam[:, :2] / cam[:, 2:] for cam in seen)
        off = (px - given.points_px) * terms.weights[:, None]
        about_center = body_px - K.numpy()[:2, 2]
        reach = (terms.directions @ about_center.T).max(1) - terms.heights
        return np.concatenate((off.ravel(), reach * terms.support_weight))

    expected = least_squares(
        residuals, np.zeros(6), loss="cauchy", f_scale=CAUCHY_95, xtol=1e-12, ftol=1e-12, gtol=1e-12
    ).cost
    cost_of = partial(joint_cost, given, terms=terms, outline=terms.body[None])
    _, local, _ = descend(cost_of, at, 60)
    assert local.cost[0] <= expected * (1 + 1e-6)


def test_a_badly_fitting_body_hardly_feels_the_mask() -> None:
    weights = [
        joint_terms(problem(), 1.0, misfit, config=LabelConfig()).support_weight
        for misfit in (1.0, 2.0)
    ]
    assert weights[0] == pytest.approx(16 * weights[1])


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
    at = poses(1)
    given = problem()
    noise = np.random.default_rng(0).normal(size=given.points_px.shape)
    px, _ = project(given.K, given.points_world @ at.R[0].T + at.t[0])
    exact = replace(given, points_px=px + off_px * noise, vertices_world=None, mask_supports=None)
    _, local, settled = descend(joint_at(exact, 1.0, at), at, 6)
    assert settled
    assert 0 < local.cost[0] < 26 * off_px**2


def test_each_refined_pose_says_which_candidate_it_came_from() -> None:
    R, t = (x.numpy() for x in camera_round(40, 20))
    far = camera_round(80, 20)[0].numpy()
    candidates = CameraPoses(np.stack((far, R)), np.stack((t, t)))
    refined = refine_jointly(problem(), candidates, 1.0, LabelConfig())
    assert refined.ids[0] == 1
    assert (np.diff(refined.local.cost) >= 0).all()
