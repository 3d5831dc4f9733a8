"""From a checked animal to its box and camera: axes, bounds, pose."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from animal3dbox.errors import SampleError
from animal3dbox.geometry.cuboid import Cuboid
from animal3dbox.geometry.distortion import beyond_lens
from animal3dbox.labels.assemble import Prepared, mask_box
from animal3dbox.labels.axes.body_axes import bodies_axes
from animal3dbox.labels.axes.landmarks import BodyAxes
from animal3dbox.labels.bounds import PAPER_MARGIN, tight_cuboids
from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.observation import Array, Observation
from animal3dbox.labels.pose.estimate import estimate_pose
from animal3dbox.labels.pose.keypoint_uncertainty import keypoint_sigma, misfit_sigma
from animal3dbox.labels.pose.lens import straightened, straightened_box
from animal3dbox.labels.pose.problem import PoseEstimate, PoseFailure, PoseProblem
from animal3dbox.labels.types import Rejection
from animal3dbox.labels.visibility.body_in_picture import shown_body


class _Bounded(NamedTuple):
    """What a box bounds: points (N, 3) in the mesh's frame, what they are, and warnings."""

    points: Array
    source: str
    warnings: tuple[str, ...] = ()


def prepare(animals: Sequence[Observation], config: LabelConfig) -> list[Prepared | Rejection]:
    """Animals' boxes and cameras, all of section 2 up to what follows from them, or why they have
    none; boxes are found together."""
    found: list[Prepared | Rejection | None] = [_without_axes(seen, config) for seen in animals]
    ready = [i for i, rejection in enumerate(found) if rejection is None]
    known: dict[int, BodyAxes] = {}
    for i, axes in zip(ready, bodies_axes([animals[i] for i in ready], config.axes), strict=True):
        if axes is None:
            problem = (
                "the landmarks known do not fix forward and left; give a template or more of the"
                " trunk's landmarks"
            )
            found[i] = Rejection(animals[i].sample_id, "no_axes", problem)
        else:
            known[i] = axes
    if known:
        bounded = [_bounded(animals[i], config) for i in known]
        cuboids = tight_cuboids(
            [body.points for body in bounded],
            torch.stack([axes.R_box for axes in known.values()]).numpy(),
            _margin(config),
        )
        for place, ((i, axes), body) in enumerate(zip(known.items(), bounded, strict=True)):
            found[i] = _prepared(animals[i], axes, cuboids[place], body, config)
    return [one for one in found if one is not None]


def _without_axes(seen: Observation, config: LabelConfig) -> Rejection | None:
    """The rejection of an animal of which nothing is known that has principal components."""
    if config.axes == "pca" and seen.vertices is None and not seen.has_landmark.any():
        return Rejection(seen.sample_id, "no_axes", "there are neither vertices nor landmarks")
    return None


def _prepared(
    seen: Observation, axes: BodyAxes, cuboid_mesh: Cuboid, bounded: _Bounded, config: LabelConfig
) -> Prepared | Rejection:
    """One animal whose box is known: its camera, and what the picture shows of it."""
    warnings = bounded.warnings
    box = None if seen.mask is None else mask_box(seen.mask)
    estimate: PoseEstimate | PoseFailure
    if seen.pose is not None:
        estimate = seen.pose
    else:
        problem, lens_warnings = _pose_problem(seen, axes.R_box, box, config)
        estimate = estimate_pose(problem, config, seen.hypotheses)
        warnings += lens_warnings
    if isinstance(estimate, PoseFailure):
        return Rejection(seen.sample_id, estimate.reason, estimate.detail)
    if seen.distortion is not None and _is_beyond(seen, cuboid_mesh, estimate, seen.distortion):
        return Rejection(
            seen.sample_id,
            "beyond_lens",
            "the animal or its box reaches beyond the lens's field of view, where its polynomial"
            " folds",
        )
    shown = shown_body(seen, estimate, axes.R_box, box, config)
    return Prepared(
        seen,
        cuboid_mesh,
        estimate,
        shown,
        axes.rule,
        bounded.source,
        (*seen.warnings, *warnings, *estimate.warnings),
    )


def _is_beyond(
    seen: Observation, cuboid_mesh: Cuboid, pose: PoseEstimate, distortion: np.ndarray
) -> bool:
    corners = cuboid_mesh.corners().numpy()
    outline = corners if seen.vertices is None else np.concatenate((corners, seen.vertices))
    return bool(beyond_lens(distortion, outline @ pose.R.numpy().T + pose.t.numpy()))


def _margin(config: LabelConfig) -> float | None:
    """The margin of boxes, see tight_cuboid."""
    return (
        config.margin
        if config.margin is not None
        else (None if config.method == "default" else PAPER_MARGIN)
    )


def _bounded(seen: Observation, config: LabelConfig) -> _Bounded:
    """What an animal's box bounds."""
    if seen.vertices is None:
        return _Bounded(
            seen.known_landmarks,
            "keypoints",
            ("no mesh: the box bounds the landmarks, which lie inside the animal's outline",),
        )
    if config.tail == "keep":
        return _Bounded(seen.vertices, "vertices")
    if seen.template is None:
        raise SampleError(
            seen.sample_id,
            "template",
            "is missing, but tail='drop' needs it to know which vertices are the tail's",
        )
    kept = np.ones(len(seen.vertices), dtype=np.bool_)
    kept[seen.template.tail_vertices.numpy()] = False
    return _Bounded(seen.vertices[kept], "vertices")


def _pose_problem(
    seen: Observation, R_box: Tensor, box: Tensor | None, config: LabelConfig
) -> tuple[PoseProblem, tuple[str, ...]]:
    """The visible keypoints with their landmarks and the mask's box, as a pinhole would show them,
    and warnings; none if either side is missing."""
    used = seen.matched
    empty = np.zeros((0, 3))  # nothing to solve for: there will be a rejection
    points = torch.from_numpy(seen.landmarks[used] if seen.landmarks is not None else empty)
    keypoints = torch.from_numpy(
        seen.keypoints_2d[used] if seen.keypoints_2d is not None else empty
    )
    sigma, misfit, K = (
        keypoint_sigma(keypoints, seen.image_hw, config),
        torch.from_numpy(seen.landmark_sigma[used]),
        torch.from_numpy(seen.K),
    )
    pixels, warnings = keypoints[:, :2], list[str]()
    if seen.distortion is not None:
        lens = torch.from_numpy(seen.distortion)
        pixels, stretched, found = straightened(pixels, K, lens)
        if not bool(found.all()):
            warnings = [
                f"{int((~found).sum())} keypoints lie where the lens shows nothing and do not count"
                " for the pose"
            ]
        points, pixels, sigma, misfit = (
            points[found],
            pixels[found],
            (sigma * stretched)[found],
            misfit[found],
        )
        box = None if seen.mask is None else straightened_box(torch.from_numpy(seen.mask), K, lens)
    if config.method == "default" and seen.landmark_sigma.any():
        sigma = torch.hypot(sigma, misfit_sigma(points, pixels, misfit))
    vertices = None if seen.vertices is None else torch.from_numpy(seen.vertices)
    return PoseProblem(points, pixels, sigma, K, seen.image_hw, R_box, vertices, box), tuple(
        warnings
    )
