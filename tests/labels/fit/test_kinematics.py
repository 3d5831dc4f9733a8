"""The fit's kinematics: linear blend skinning, and its derivatives against finite differences."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from animal3dbox.geometry.arrays import as_numpy
from animal3dbox.labels.fit.descent import keypoint_terms, projected
from animal3dbox.labels.fit.fit_body import FitBody, fit_body
from animal3dbox.labels.fit.kinematics import (
    landmark_parts,
    left_jacobian,
    slopes_by_shape,
    slopes_of_parts,
    turns_of_joints,
)
from animal3dbox.labels.fit.pose_prior import whole_pose
from animal3dbox.labels.fit.problem import CAMERA, FitProblem, FitState
from animal3dbox.labels.fit.surface import posed_surface, surface_of, surface_slopes
from animal3dbox.smal.keypoints.vocabularies import VOCABULARIES
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped

Array = NDArray[np.float64]
STEP = 1e-6


def body_of(vocabulary: str = "animal3d26") -> FitBody:
    return fit_body(load_quadruped(), VOCABULARIES[vocabulary])


def coefficients(body: FitBody, count: int = 3) -> tuple[Array, Array]:
    rng = np.random.default_rng(5)
    P, S = body.sizes
    return rng.standard_normal((count, P)), rng.standard_normal((count, S))


def test_landmarks_are_those_of_linear_blend_skinning_without_correctives() -> None:
    body = body_of()
    pose, shape = coefficients(body)
    theta, _ = body.frames(pose, shape)
    model = replace(body.model, posedirs=torch.zeros_like(body.model.posedirs))
    betas = torch.from_numpy(body.shape_prior.mean + shape @ body.shape_prior.directions.T)
    poses = torch.stack([whole_pose(model.joint_names, one) for one in theta])
    vertices = model.posed(betas, poses, torch.zeros(3, 3, dtype=torch.float64)).vertices
    expected = as_numpy(model.read_keypoints(body.vocabulary, vertices)) - body.skeleton.origin
    assert np.abs(body.landmarks(pose, shape).swapaxes(1, 2) - expected).max() < 1e-12
    _, frames = body.frames(pose, shape)
    surface = surface_of(body)
    points = posed_surface(surface, frames, shape).points.swapaxes(1, 2)
    assert np.abs(points - (as_numpy(vertices)[:, surface.ids] - body.skeleton.origin)).max() < 1e-9


@pytest.mark.parametrize("vocabulary", ["animal3d26", "ap10k17"])
def test_slopes_of_landmarks_are_their_finite_differences(vocabulary: str) -> None:
    body = body_of(vocabulary)
    pose, shape = coefficients(body)
    theta, frames = body.frames(pose, shape)
    parts = landmark_parts(body.tables, frames, shape)
    turns = turns_of_joints(body.skeleton, frames, theta, body.pose_prior.directions)
    by_pose = slopes_of_parts(body.skeleton, frames, parts, turns=turns, beyond=body.tables.beyond)
    by_shape = slopes_by_shape(body.skeleton, body.tables, frames, body.sizes[1])
    for slopes, values, place in ((by_pose, pose, 0), (by_shape, shape, 1)):
        for k in range(values.shape[1]):
            step = STEP * np.eye(values.shape[1])[k]
            ahead, behind = ([pose, shape], [pose, shape])
            ahead[place], behind[place] = values + step, values - step
            numeric = (body.landmarks(*ahead) - body.landmarks(*behind)) / (2 * STEP)
            assert np.abs(slopes[:, k] - numeric).max() < 1e-5


def test_slopes_of_surface_vertices_are_their_finite_differences() -> None:
    body = body_of()
    surface = surface_of(body)
    pose, shape = coefficients(body)
    ids = np.random.default_rng(1).integers(len(surface.ids), size=(3, 20))
    theta, frames = body.frames(pose, shape)
    posed = posed_surface(surface, frames, shape)
    turns = turns_of_joints(body.skeleton, frames, theta, body.pose_prior.directions)
    slopes = surface_slopes(
        body, surface, posed, frames=frames, turns=turns, ids=ids, shape_count=body.sizes[1]
    )

    def points(values: Array) -> Array:
        own_pose, own_shape = values[:, : body.sizes[0]], values[:, body.sizes[0] :]
        _, own = body.frames(own_pose, own_shape)
        places = posed_surface(surface, own, own_shape).points
        return np.take_along_axis(places, ids[:, None], 2)

    values = np.concatenate((pose, shape), 1)
    for k in range(values.shape[1]):
        step = STEP * np.eye(values.shape[1])[k]
        numeric = (points(values + step) - points(values - step)) / (2 * STEP)
        assert np.abs(slopes[:, k] - numeric).max() < 1e-5


def test_the_left_jacobian_keeps_its_digits_at_small_angles() -> None:
    for size in (0.0, 1e-9, 0.99e-4, 1.01e-4, 1.0, 3.0):
        theta = size * np.array([0.6, -0.48, 0.64])
        expected = np.eye(3) * 0.0
        # J_l(theta) = integral over s from 0 to 1 of exp(s theta)
        nodes, weights = np.polynomial.legendre.leggauss(20)
        skew = np.array(
            [[0, -theta[2], theta[1]], [theta[2], 0, -theta[0]], [-theta[1], theta[0], 0]]
        )
        for node, weight in zip((nodes + 1) / 2, weights / 2, strict=True):
            term, power = np.eye(3), np.eye(3)
            for n in range(1, 40):
                power = power @ skew * node / n
                term = term + power
            expected = expected + weight * term
        assert np.abs(left_jacobian(theta) - expected).max() < 1e-9


def states(
    body: FitBody, count: int = 3, down: tuple[float, float, float] | None = None
) -> tuple[FitProblem, FitState]:
    rng = np.random.default_rng(2)
    pose, shape = coefficients(body, count)
    turns, _ = np.linalg.qr(rng.standard_normal((count, 3, 3)))
    turns *= np.sign(np.linalg.det(turns))[:, None, None]
    landmarks = len(body.vocabulary)
    linear = np.array([[500.0, 3.0], [0.0, 520.0]])
    problem = FitProblem(
        pixels=rng.uniform(-100, 100, (1, 2, landmarks)),
        weights=np.full((1, landmarks), 0.1),
        linear=linear[None],
        extent=np.array([200.0]),
        focal_sd=np.array([0.7]),
        frame=np.array([[-320.0, -240.0, 320.0, 240.0]]),
        up_weight=np.ones(1),
        down=np.full((1, 3), np.nan) if down is None else np.array([down]),
    )
    state = FitState(
        animal=np.zeros(count, dtype=np.intp),
        R=turns,
        aim=rng.uniform(-0.2, 0.2, (count, 2)),
        scale=rng.uniform(0.8, 1.2, count),
        focal=rng.uniform(-0.3, 0.3, count),
        pose=pose,
        shape=shape,
        exchanged=np.array([False, True, False][:count]),
    )
    return problem, state


@pytest.mark.parametrize("skew", [0.0, 3.0])
def test_slopes_of_pixels_are_their_finite_differences(skew: float) -> None:
    body = body_of()
    problem, state = states(body)
    linear = np.repeat(problem.linear, 3, axis=0)
    linear[:, 0, 1] = skew

    def pixels(moved: FitState) -> Array:
        points = body.landmarks(moved.pose, moved.shape)
        px, _, _ = projected(moved, linear, points, np.zeros((3, 0, 3, points.shape[2])))
        return px

    points = body.landmarks(state.pose, state.shape)
    _, moves, _ = projected(state, linear, points, np.zeros((3, 0, 3, points.shape[2])))
    total = CAMERA + sum(body.sizes)
    for k in range(CAMERA):
        step = STEP * np.broadcast_to(np.eye(total)[k], (3, total))
        ahead, behind = state.moved(step, body.sizes[0]), state.moved(-step, body.sizes[0])
        numeric = (pixels(ahead) - pixels(behind)) / (2 * STEP)
        assert np.abs(moves[:, k] - numeric).max() < 1e-5 * np.abs(numeric).max()


@pytest.mark.parametrize(
    ("by_kind", "down"), [(False, None), (True, None), (True, (0.48, 0.6, -0.64))]
)
def test_the_gradient_of_the_cost_is_its_finite_difference(
    by_kind: bool, down: tuple[float, float, float] | None
) -> None:
    body = body_of()
    problem, state = states(body, down=down)
    width = np.array([3.0, 10.0, 40.0])

    def cost(moved: FitState) -> Array:
        return keypoint_terms(
            body, problem, moved, width=width, counts=body.sizes, by_kind=by_kind
        ).cost

    local = keypoint_terms(body, problem, state, width=width, counts=body.sizes, by_kind=by_kind)
    total = local.b.shape[1]
    for k in range(total):
        step = STEP * np.broadcast_to(np.eye(total)[k], (3, total))
        ahead, behind = state.moved(step, body.sizes[0]), state.moved(-step, body.sizes[0])
        numeric = (cost(ahead) - cost(behind)) / (2 * STEP)
        assert np.abs(local.b[:, k] - numeric).max() < 1e-5 * max(1.0, np.abs(numeric).max())
