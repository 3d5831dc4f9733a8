"""From a checked animal to its box and camera: axes, bounds, pose."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from animal3dbox.errors import SampleError
from animal3dbox.geometry.arrays import as_numpy
from animal3dbox.geometry.cuboid import corners_of
from animal3dbox.geometry.distortion import beyond_lens
from animal3dbox.geometry.pixel_boxes import mask_box
from animal3dbox.geometry.straightening import straightened_box, straightened_pixels
from animal3dbox.labels.axes.body_axes import BodyAxes, body_axes
from animal3dbox.labels.bounds import PAPER_MARGIN, tight_boxes
from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.observation import Observation
from animal3dbox.labels.pose.estimate import estimate_pose
from animal3dbox.labels.pose.keypoint_uncertainty import keypoint_sigma, misfit_sigma
from animal3dbox.labels.pose.problem import PoseEstimate, PoseFailure, PoseProblem
from animal3dbox.labels.types import Rejection
from animal3dbox.labels.visibility.body_in_picture import body_in_picture

Array = NDArray[np.float64]


@dataclass(frozen=True)
class LabelDraft:
    """An animal whose box and camera are known: all that its label follows from.

    Attributes:
        observation: the animal.
        pose: its camera.
        mesh_box: center (3,), rotation (3, 3) and size (3,) of its cuboid in the mesh's frame.
        flat_box: (4,) xyxy px, see CuboidLabel.box; None if there is neither a mask nor vertices.
        mask_iou: overlap of the projected mesh with the mask; None if not known or not asked for.
        surface_share: (6,) of the visible surface; None if not known or not asked for.
        orientation_rule: which rule gave the axes.
        bounds_source: "vertices" or "keypoints": what the box bounds.
        warnings: of the body and the pose, in whole sentences.
        calibration: digest of the calibration that had a part in the axes; None without.
    """

    observation: Observation
    pose: PoseEstimate
    mesh_box: tuple[Array, Array, Array]
    flat_box: Array | None
    mask_iou: float | None
    surface_share: Array | None
    orientation_rule: str
    bounds_source: str
    warnings: tuple[str, ...]
    calibration: str | None


def draft_labels(
    observations: Sequence[Observation], config: LabelConfig
) -> list[LabelDraft | Rejection]:
    """The box and the camera of each animal, or the rejection of one that gets neither.

    Section 2 up to what follows from box and camera; boxes are computed together.

    Returns:
        One outcome an observation, in their order.

    """
    outcomes: list[LabelDraft | Rejection | None] = [
        _without_points(observation, config) for observation in observations
    ]
    remaining = [i for i, rejection in enumerate(outcomes) if rejection is None]
    axes: dict[int, BodyAxes] = {}
    for i, result in zip(
        remaining, body_axes([observations[i] for i in remaining], config.axes), strict=True
    ):
        if result is None:
            outcomes[i] = Rejection(
                observations[i].sample_id,
                "no_axes",
                "the landmarks known do not fix forward and left; give a template or more of the"
                " trunk's landmarks",
            )
        else:
            axes[i] = result
    if axes:
        bounded = [_bounded_points(observations[i], config) for i in axes]
        R_boxes = np.stack([body.R_box for body in axes.values()])
        boxes = tight_boxes([points for points, *_ in bounded], R_boxes, _margin(config))
        for i, (_, source, warnings), *box in zip(axes, bounded, *boxes, strict=True):
            outcomes[i] = _draft(
                observations[i],
                (box[0], box[1], box[2]),
                axes=axes[i],
                bounds_source=source,
                warnings=(*axes[i].warnings, *warnings),
                config=config,
            )
    return [outcome for outcome in outcomes if outcome is not None]


def _without_points(observation: Observation, config: LabelConfig) -> Rejection | None:
    """The rejection, under axes "pca", of an animal with neither vertices nor landmarks."""
    body_is_empty = observation.body.vertices is None and not observation.has_landmark.any()
    if config.axes == "pca" and body_is_empty:
        return Rejection(
            observation.sample_id, "no_axes", "there are neither vertices nor landmarks"
        )
    return None


def _margin(config: LabelConfig) -> float | None:
    """The margin of boxes, see tight_cuboid."""
    if config.margin is not None:
        return config.margin
    return None if config.method == "default" else PAPER_MARGIN


def _bounded_points(
    observation: Observation, config: LabelConfig
) -> tuple[Array, str, tuple[str, ...]]:
    """The points (N, 3) that an animal's box bounds, their source, and warnings."""
    body = observation.body
    if body.vertices is None:
        warning = "no mesh: the box bounds the landmarks, which lie inside the animal's outline"
        return observation.known_landmarks, "keypoints", (warning,)
    if config.tail == "keep":
        return body.vertices, "vertices", ()
    if body.template is None:
        raise SampleError(
            observation.sample_id,
            "template",
            "is missing, but tail='drop' needs it to know which vertices are the tail's",
        )
    without_tail = np.ones(len(body.vertices), dtype=np.bool_)
    without_tail[as_numpy(body.template.tail_vertices)] = False
    return body.vertices[without_tail], "vertices", ()


def _draft(
    observation: Observation,
    mesh_box: tuple[Array, Array, Array],
    *,
    axes: BodyAxes,
    bounds_source: str,
    warnings: tuple[str, ...],
    config: LabelConfig,
) -> LabelDraft | Rejection:
    """One animal whose box is known: its camera, and what the picture shows of it."""
    R_box = mesh_box[1]
    box = None if observation.mask is None else mask_box(observation.mask)
    pose: PoseEstimate | PoseFailure
    if observation.pose is not None:
        pose = observation.pose
    else:
        problem, lens_warnings = _pose_problem(observation, R_box, box, config)
        pose = estimate_pose(problem, config, observation.hypotheses)
        warnings += lens_warnings
    if isinstance(pose, PoseFailure):
        return Rejection(observation.sample_id, pose.reason, pose.detail)
    if _is_beyond_lens(observation, mesh_box, pose):
        return Rejection(
            observation.sample_id,
            "beyond_lens",
            "the animal or its box reaches beyond the lens's field of view, where its polynomial"
            " folds",
        )
    flat_box, mask_iou, surface_share = body_in_picture(
        observation, pose, R_box=R_box, box=box, config=config
    )
    return LabelDraft(
        observation=observation,
        pose=pose,
        mesh_box=mesh_box,
        flat_box=flat_box,
        mask_iou=mask_iou,
        surface_share=surface_share,
        orientation_rule=axes.rule,
        bounds_source=bounds_source,
        warnings=(*observation.warnings, *warnings),
        calibration=axes.calibration,
    )


def _is_beyond_lens(
    observation: Observation, mesh_box: tuple[Array, Array, Array], pose: PoseEstimate
) -> bool:
    """Whether the body or a corner of its box lies behind the camera or outside the lens's view."""
    if observation.distortion is None:
        return False
    outline = corners_of(*mesh_box)
    if observation.body.vertices is not None:
        outline = np.concatenate((outline, observation.body.vertices))
    return bool(beyond_lens(observation.distortion, outline @ pose.R.T + pose.t))


def _pose_problem(
    observation: Observation, R_box: Array, box: Array | None, config: LabelConfig
) -> tuple[PoseProblem, tuple[str, ...]]:
    """The visible keypoints with their landmarks and the mask's box, as a pinhole would show them.

    Without keypoints or landmarks there is nothing to solve for: the problem has no points, and
    will be rejected.

    Returns:
        The problem, and warnings.

    """
    matched, body = observation.matched, observation.body
    nothing = np.zeros((0, 3))
    points = nothing if body.landmarks is None else body.landmarks[matched]
    keypoints = nothing if observation.keypoints_2d is None else observation.keypoints_2d[matched]
    sigma = keypoint_sigma(keypoints, observation.image_hw, config)
    misfit = None if body.landmark_sigma is None else body.landmark_sigma[matched]
    pixels, warnings = keypoints[:, :2], tuple[str, ...]()
    if observation.distortion is not None:
        K, lens = observation.K, observation.distortion
        pixels, stretch, shown = straightened_pixels(pixels, K, lens)
        if not shown.all():
            warnings = (
                f"{int((~shown).sum())} keypoints lie where the lens shows nothing and do not count"
                " for the pose",
            )
        points, pixels, sigma = points[shown], pixels[shown], (sigma * stretch)[shown]
        misfit = None if misfit is None else misfit[shown]
        box = None if observation.mask is None else straightened_box(observation.mask, K, lens)
    if config.method == "default" and misfit is not None and body.landmark_sigma.any():
        sigma = np.hypot(sigma, misfit_sigma(points, pixels, misfit))
    problem = PoseProblem(
        points_world=points,
        points_px=pixels,
        sigma_px=sigma,
        K=observation.K,
        image_hw=observation.image_hw,
        R_box=R_box,
        vertices_world=body.vertices,
        mask_box=box,
    )
    return problem, warnings
