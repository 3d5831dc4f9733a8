"""From a checked animal to its box and camera: axes, bounds, pose."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from animal3dbox.errors import SampleError
from animal3dbox.geometry.arrays import as_numpy
from animal3dbox.geometry.cuboid import corners_of
from animal3dbox.geometry.distortion import beyond_lens
from animal3dbox.geometry.mask_outline import MaskOutline, mask_outline
from animal3dbox.geometry.mask_supports import MaskSupports, even_directions, mask_supports
from animal3dbox.geometry.pixel_boxes import mask_box
from animal3dbox.geometry.straightening import straightened_box, straightened_pixels
from animal3dbox.labels.axes.body_axes import BodyAxes, body_axes
from animal3dbox.labels.bounds import PAPER_MARGIN, tight_boxes
from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.observation import Observation
from animal3dbox.labels.pose.estimate import estimate_pose, estimate_zoom
from animal3dbox.labels.pose.focal_length import common_zoom
from animal3dbox.labels.pose.keypoint_uncertainty import keypoint_sigma, misfit_sigma
from animal3dbox.labels.pose.outline_refinement import RIM_POINTS
from animal3dbox.labels.pose.problem import AS_GIVEN, PoseEstimate, PoseFailure, PoseProblem
from animal3dbox.labels.types import Rejection
from animal3dbox.labels.visibility.body_in_picture import BodyInPicture, body_in_picture
from animal3dbox.smal.keypoints.exchanges import PARTS, exchange_order

Array = NDArray[np.float64]
DIRECTIONS = even_directions(16)
"""In which the mask's supports are compared with the body's."""
LEAST_COVERAGE, LEAST_IOU = 0.5, 0.05
"""Least part of its mask that a body under a known camera covers, and least overlap of the two."""
EXCHANGED_SIDES = "left and right are exchanged in the file"
"""How the warning of a label begins that exchanged them."""


@dataclass(frozen=True)
class LabelDraft:
    """An animal whose box and camera are known: all that its label follows from.

    Attributes:
        observation: the animal.
        pose: its camera.
        mesh_box: center (3,), rotation (3, 3) and size (3,) of its cuboid in the mesh's frame.
        flat_box: (4,) xyxy px, see CuboidLabel.box; None if there is neither a mask nor vertices.
        mask_iou: overlap of the projected mesh with the mask; None if not known or not asked for.
        mask_denies_camera: whether a known camera puts the body beside its mask.
        surface_share: (6,) of the visible surface; None if not known or not asked for.
        orientation_rule: which rule gave the axes.
        bounds_source: "vertices" or "keypoints": what the box bounds.
        warnings: of the body and the pose, in whole sentences.
        method: LabelConfig.method.
        calibration: digest of the calibration that had a part in the axes or the fitted body; None
            without.
    """

    observation: Observation
    pose: PoseEstimate
    mesh_box: tuple[Array, Array, Array]
    flat_box: Array | None
    mask_iou: float | None
    mask_denies_camera: bool
    surface_share: Array | None
    orientation_rule: str
    bounds_source: str
    warnings: tuple[str, ...]
    method: str
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
        R_of = dict(zip(axes, R_boxes, strict=True))
        observations = with_focal_lengths(observations, R_of, config)
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
    without_tail = np.ones(body.template.vertex_count, dtype=np.bool_)
    without_tail[as_numpy(body.template.tail_vertices)] = False
    if observation.vertex_ids is not None:
        without_tail = without_tail[observation.vertex_ids]
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
    if pose.evidence is not None and pose.evidence.labeling != AS_GIVEN:
        observation, warning = _mended(observation, pose.evidence.labeling)
        warnings += (warning,)
    if _is_beyond_lens(observation, mesh_box, pose):
        return Rejection(
            observation.sample_id,
            "beyond_lens",
            "the animal or its box reaches beyond the lens's field of view, where its polynomial"
            " folds",
        )
    shown = body_in_picture(observation, pose, R_box=R_box, box=box, config=config)
    denied = _denied_camera(observation, shown)
    return LabelDraft(
        observation=observation,
        pose=pose,
        mesh_box=mesh_box,
        flat_box=shown.box,
        mask_iou=shown.mask_iou,
        mask_denies_camera=denied is not None,
        surface_share=shown.surface_share,
        orientation_rule=axes.rule,
        bounds_source=bounds_source,
        warnings=(*observation.warnings, *warnings, *((denied,) if denied else ())),
        method=config.method,
        calibration=axes.calibration or observation.body_calibration,
    )


def _denied_camera(observation: Observation, shown: BodyInPicture) -> str | None:
    """The warning of a known camera that puts the body beside its mask; None if all is well.

    A mask holds what is visible of an animal, which lies on the body, however much of it is hidden.
    """
    if not observation.camera_is_known or shown.mask_coverage is None or shown.mask_iou is None:
        return None
    if shown.mask_coverage >= LEAST_COVERAGE and shown.mask_iou >= LEAST_IOU:
        return None
    return (
        f"the mesh under the known camera covers {shown.mask_coverage:.0%} of the mask (IoU"
        f" {shown.mask_iou:.2f}): the camera (K, R, t) or the mesh is of another image or unit,"
        " or the mask is of another animal, or of several"
    )


def _mended(observation: Observation, part: str) -> tuple[Observation, str]:
    """The observation with left and right of a part exchanged, and what to tell of it."""
    words, keypoints = observation.vocabulary, observation.keypoints_2d
    order = list(exchange_order(words, part))
    names = [words.keypoints[j] for j in range(len(words)) if order[j] != j]
    warning = (
        f"{EXCHANGED_SIDES} ({part}: {', '.join(names)}): the label uses them the other way round"
    )
    if keypoints is None:
        return observation, warning
    return replace(observation, keypoints_2d=keypoints[order]), warning


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
    used = np.flatnonzero(matched)
    if observation.distortion is not None:
        K, lens = observation.K, observation.distortion
        pixels, stretch, shown = straightened_pixels(pixels, K, lens)
        if not shown.all():
            warnings = (
                f"{int((~shown).sum())} keypoints lie where the lens shows nothing and do not count"
                " for the pose",
            )
        points, pixels, sigma = points[shown], pixels[shown], (sigma * stretch)[shown]
        used = used[shown]
        misfit = None if misfit is None else misfit[shown]
        box = None if observation.mask is None else straightened_box(observation.mask, K, lens)
    noise = sigma
    if config.method == "default" and misfit is not None and body.landmark_sigma.any():
        sigma = np.hypot(sigma, misfit_sigma(points, pixels, misfit))
    return PoseProblem(
        points_world=points,
        points_px=pixels,
        sigma_px=sigma,
        K=observation.K,
        image_hw=observation.image_hw,
        R_box=R_box,
        vertices_world=body.vertices,
        mask_box=box,
        mask_supports=_supports(observation, config),
        exchanged=_exchanged_points(observation, used) if config.method == "default" else (),
        down_cam=observation.down_cam,
        noise_px=noise,
        log_focal_sd=observation.log_focal_sd,
        faces=None if body.faces is None else as_numpy(body.faces),
        mask_outline=_outline(observation, config),
    ), warnings


def _supports(observation: Observation, config: LabelConfig) -> MaskSupports | None:
    """How far the mask reaches; None without one, or where the method does not use it."""
    mask = observation.mask
    if mask is None or config.method != "default" or config.mask_box == "none":
        return None
    supports = mask_supports(mask, DIRECTIONS, observation.K, observation.distortion)
    return supports if len(supports.heights) else None


def _outline(observation: Observation, config: LabelConfig) -> MaskOutline | None:
    """The mask's outline; None without one, or where the method compares no mesh with it."""
    mask = observation.mask
    if mask is None or config.method != "default" or config.mask_box not in (None, "mesh"):
        return None
    return mask_outline(mask, RIM_POINTS, observation.K, observation.distortion)


def _exchanged_points(
    observation: Observation, used: NDArray[np.intp]
) -> tuple[tuple[str, Array], ...]:
    """The landmarks (N, 3) of the keypoints in use, for each part with left and right exchanged.

    Parts that come to the same are named once, by the first; those of which the body lacks a
    landmark, or of which no keypoint is in use, are left out.
    """
    landmarks, words = observation.body.landmarks, observation.vocabulary
    if landmarks is None:
        return ()
    known: dict[bytes, tuple[str, Array]] = {}
    given = np.arange(len(words))[used].tobytes()
    for part in PARTS:
        order = np.array(exchange_order(words, part))[used]
        points = landmarks[order]
        if order.tobytes() != given and np.isfinite(points).all():
            known.setdefault(order.tobytes(), (part, points))
    return tuple(known.values())


def with_focal_lengths(
    observations: Sequence[Observation], axes: Mapping[int, Array], config: LabelConfig
) -> list[Observation]:
    """The animals, with focal lengths estimated where only a guess is known.

    Those of one image share one.

    Args:
        observations: the animals.
        axes: index of an animal -> its R_world_box (3, 3); the others have no pose.
        config: the method; basic, paper and focal="guess" leave the guess.

    """
    if config.method != "default" or config.focal == "guess":
        return list(observations)
    images: dict[str | int, list[int]] = {}
    for i in axes:
        one = observations[i]
        if one.K_source == "guessed" and one.pose is None and one.distortion is None:
            images.setdefault(i if one.image is None else one.image, []).append(i)
    finished = list(observations)
    for members in images.values():
        problems = [_pose_problem(observations[i], axes[i], None, config)[0] for i in members]
        zooms = [zoom for one in problems if (zoom := estimate_zoom(one, config)) is not None]
        if not zooms:
            continue
        zoom = common_zoom(zooms)
        for i in members:
            K = observations[i].K.copy()
            K[:2, :2] *= math.exp(zoom.log)
            finished[i] = replace(observations[i], K=K, K_source="estimated", log_focal_sd=zoom.sd)
    return finished
