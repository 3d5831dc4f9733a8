"""The scan, the descent, the mask's term and the choice, each on its own."""

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from animal3dbox.labels.fit.choice import EXCHANGED_COST, choice_costs
from animal3dbox.labels.fit.descent import descend_fit, keypoint_terms
from animal3dbox.labels.fit.fit_body import FitBody, fit_body
from animal3dbox.labels.fit.local_fit import LocalFit
from animal3dbox.labels.fit.mask_target import mask_target
from animal3dbox.labels.fit.mask_term import MaskWeights, mask_terms
from animal3dbox.labels.fit.problem import CAMERA, FitProblem, FitState, frame_about
from animal3dbox.labels.fit.surface import posed_surface, surface_of
from animal3dbox.labels.fit.view_scan import EXCHANGED_STARTS, STARTS, even_views, scan_starts
from animal3dbox.labels.pose.choice import MOST_UP
from animal3dbox.smal.keypoints.vocabularies import VOCABULARIES
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped

Array = NDArray[np.float64]
IMAGE_HW, CENTER, FOCAL = (480, 640), np.array([319.5, 239.5]), 800.0


def body_of() -> FitBody:
    return fit_body(load_quadruped(), VOCABULARIES["animal3d26"])


def state_from(azimuth_deg: float, *, elevation_deg: float = 10.0, example: int = 0) -> FitState:
    """A named pose in the mean shape, seen from a direction round it, four lengths away."""
    body = body_of()
    azimuth, elevation = np.deg2rad([azimuth_deg, elevation_deg])
    away = np.array(
        [
            np.cos(elevation) * np.cos(azimuth),
            np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation),
        ]
    )
    down = -np.array([0.0, 0, 1]) + away * away[2]
    down /= np.linalg.norm(down)
    R = np.stack((np.cross(down, -away), down, -away))
    return FitState(
        animal=np.zeros(1, dtype=np.intp),
        R=R[None],
        aim=np.array([[0.02, -0.01]]),
        scale=np.log([4.0]),
        focal=np.zeros(1),
        pose=body.pose_prior.examples[example : example + 1],
        shape=np.zeros((1, body.sizes[1])),
        exchanged=np.zeros(1, dtype=np.bool_),
    )


def problem_of(state: FitState, marked: Array | None = None) -> FitProblem:
    """The exact keypoints of a state, those that are marked."""
    body = body_of()
    cam = state.R[0] @ body.landmarks(state.pose, state.shape)[0] + state.t[0][:, None]
    pixels = FOCAL * cam[:2] / cam[2]
    weights = np.full(pixels.shape[1], 0.25)
    if marked is not None:
        weights = weights * marked
    return FitProblem(
        pixels=pixels[None],
        weights=weights[None],
        linear=np.diag([FOCAL, FOCAL])[None],
        extent=np.array([float(np.ptp(pixels, axis=1).max())]),
        focal_sd=np.array([1e-4]),
        frame=frame_about(IMAGE_HW, CENTER)[None],
        up_weight=np.ones(1),
        down=np.full((1, 3), np.nan),
    )


def degrees_apart(R: Array, other: Array) -> Array:
    trace = np.einsum("bij,ij->b", R, other)
    angle: Array = np.degrees(np.arccos(np.clip((trace - 1) / 2, -1, 1)))
    return angle


def test_directions_of_the_scan_are_rotations_all_round() -> None:
    views = even_views(65)
    assert np.abs(views @ views.swapaxes(1, 2) - np.eye(3)).max() < 1e-12
    assert np.linalg.det(views).min() > 0.99
    assert np.linalg.norm(views[:, 2].mean(0)) < 0.05


def test_the_scan_has_a_start_near_the_true_view_and_as_many_as_it_says() -> None:
    body = body_of()
    for azimuth in (0, 50, 120, 200, 290):
        truth = state_from(azimuth)
        starts = scan_starts(body, problem_of(truth), True)
        assert len(starts) == STARTS + EXCHANGED_STARTS
        assert int(starts.exchanged.sum()) == EXCHANGED_STARTS
        assert degrees_apart(starts.R[:STARTS], truth.R[0]).min() < 25


def test_the_descent_finds_exact_keypoints_again() -> None:
    body = body_of()
    truth = state_from(60, example=1)
    problem = problem_of(truth)
    start = replace(truth, aim=truth.aim + 0.02, scale=truth.scale + 0.1, pose=0.5 * truth.pose)
    width = np.full(1, 30.0)

    def local(state: FitState) -> LocalFit:
        return keypoint_terms(body, problem, state, width=width, counts=body.sizes)

    before = keypoint_terms(body, problem, start, width=width, counts=body.sizes).cost
    state, after = descend_fit(local, start, 12, body.sizes[0])
    at_truth = keypoint_terms(body, problem, truth, width=width, counts=body.sizes).cost
    assert after.cost[0] < before[0]
    assert after.cost[0] <= at_truth[0] + 1e-6  # the prior draws it a little towards the mean
    assert degrees_apart(state.R, truth.R[0])[0] < 4


def test_keypoints_behind_the_camera_cost_infinitely_much() -> None:
    body = body_of()
    truth = state_from(60)
    near = replace(truth, scale=np.log([0.1]))
    cost = keypoint_terms(
        body, problem_of(truth), near, width=np.full(1, 3.0), counts=body.sizes
    ).cost
    assert np.isinf(cost[0])


def silhouette_of(state: FitState) -> NDArray[np.bool_]:
    """A filled outline of the body's vertices, by discs."""
    body = body_of()
    _, frames = body.frames(state.pose, state.shape)
    points = posed_surface(surface_of(body), frames, state.shape).points[0]
    cam = state.R[0] @ points + state.t[0][:, None]
    px = (FOCAL * cam[:2] / cam[2]).T + CENTER
    canvas = np.zeros(IMAGE_HW, dtype=np.uint8)
    for x, y in np.rint(px).astype(int).tolist():
        cv2.circle(canvas, (x, y), 4, 1, -1)
    return canvas > 0


def test_the_mask_costs_least_at_the_true_scale_and_place() -> None:
    body, truth = body_of(), state_from(70)
    targets = {0: mask_target(silhouette_of(truth), CENTER)}
    problem = problem_of(truth)

    def cost(state: FitState) -> float:
        return float(
            mask_terms(
                body,
                problem,
                state,
                targets=targets,
                weights=MaskWeights(40.0, 80.0),
                counts=body.sizes,
            ).cost[0]
        )

    at_truth = cost(truth)
    for other in (
        replace(truth, scale=truth.scale + 0.15),
        replace(truth, scale=truth.scale - 0.15),
        replace(truth, aim=truth.aim + np.array([[0.03, 0.0]])),
        replace(truth, aim=truth.aim + np.array([[0.0, -0.03]])),
    ):
        assert cost(other) > at_truth + 3


def test_exchanged_sides_cost_what_they_say() -> None:
    body, truth = body_of(), state_from(0)
    other = replace(truth, exchanged=np.ones(1, dtype=np.bool_))
    costs = [choice_costs(body, problem_of(truth), state).exchange[0] for state in (truth, other)]
    assert costs == [0.0, EXCHANGED_COST]


def test_keypoints_of_one_side_alone_tell_which_side_is_seen() -> None:
    body = body_of()
    sides = np.array([side != "right" for side in body.vocabulary.sides], dtype=np.float64)
    from_left, from_right = state_from(90), state_from(-90)
    costs = [
        choice_costs(body, problem_of(state, sides), state).facing[0]
        for state in (from_left, from_right)
    ]
    assert costs[0] < 1
    assert costs[1] > 6


def test_a_camera_under_the_ground_and_a_rolled_one_cost_more() -> None:
    body = body_of()

    def up(state: FitState) -> float:
        return float(choice_costs(body, problem_of(state), state).up[0])

    assert up(state_from(60)) < 0.3
    assert up(state_from(60, elevation_deg=-30)) > 1.5
    upright = state_from(60)
    rolled = replace(upright, R=np.diag([-1.0, -1.0, 1.0]) @ upright.R)
    assert up(rolled) == MOST_UP


def test_a_step_into_nowhere_leaves_a_camera_of_numbers() -> None:
    one = np.ones(1)
    state = FitState(
        animal=np.zeros(1, dtype=np.intp),
        R=np.eye(3)[None],
        aim=np.zeros((1, 2)),
        scale=one,
        focal=one,
        pose=np.zeros((1, 2)),
        shape=np.zeros((1, 2)),
        exchanged=np.zeros(1, dtype=bool),
    )
    step = np.zeros((1, CAMERA + 4))
    step[:, 5:7] = 1e4
    with np.errstate(all="raise"):
        assert np.isfinite(state.moved(step, 2).t).all()
