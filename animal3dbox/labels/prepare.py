"""From a checked animal to its box and camera: axes, bounds, pose."""

import numpy as np
import torch
from torch import Tensor

from animal3dbox.errors import SampleError
from animal3dbox.geometry.cuboid import Cuboid
from animal3dbox.geometry.distortion import beyond_lens
from animal3dbox.labels.assemble import Prepared, mask_box
from animal3dbox.labels.axes import body_axes
from animal3dbox.labels.bounds import PAPER_MARGIN, tight_cuboid
from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.lens import straightened, straightened_box
from animal3dbox.labels.observation import Observation
from animal3dbox.labels.pose import estimate_pose
from animal3dbox.labels.pose_problem import PoseEstimate, PoseFailure, PoseProblem
from animal3dbox.labels.shown_body import shown_body
from animal3dbox.labels.types import Rejection
from animal3dbox.labels.uncertainty import keypoint_sigma, misfit_sigma


def prepare(seen: Observation, config: LabelConfig) -> Prepared | Rejection:
    """An animal's box and camera, all of section 2 up to what follows from them, or why it has none."""
    if config.axes == "pca" and seen.vertices is None and not seen.has_landmark.any():
        return Rejection(seen.sample_id, "no_axes", "there are neither vertices nor landmarks")
    axes = body_axes(seen, config.axes)
    if axes is None:
        return Rejection(
            seen.sample_id, "no_axes", "the landmarks known do not fix forward and left; give a template or more of the trunk's landmarks"
        )
    cuboid_mesh, bounds_source, warnings = _cuboid_of_body(seen, axes.R_box, config)
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
        return Rejection(seen.sample_id, "beyond_lens", "the animal or its box reaches beyond the lens's field of view, where its polynomial folds")
    shown = shown_body(seen, estimate, axes.R_box, box, config)
    return Prepared(seen, cuboid_mesh, estimate, shown, axes.rule, bounds_source, (*seen.warnings, *warnings, *estimate.warnings))


def _is_beyond(seen: Observation, cuboid_mesh: Cuboid, pose: PoseEstimate, distortion: np.ndarray) -> bool:
    corners = cuboid_mesh.corners().numpy()
    outline = corners if seen.vertices is None else np.concatenate((corners, seen.vertices))
    return bool(beyond_lens(distortion, outline @ pose.R.numpy().T + pose.t.numpy()))


def _cuboid_of_body(seen: Observation, R_box: Tensor, config: LabelConfig) -> tuple[Cuboid, str, tuple[str, ...]]:
    """The tight box in the mesh's frame, what it bounds, and warnings."""
    margin = config.margin if config.margin is not None else (None if config.method == "default" else PAPER_MARGIN)
    if seen.vertices is None:
        box = tight_cuboid(seen.known_landmarks, R_box, margin)
        return box, "keypoints", ("no mesh: the box bounds the landmarks, which lie inside the animal's outline",)
    if config.tail == "keep":
        return tight_cuboid(seen.vertices, R_box, margin), "vertices", ()
    if seen.template is None:
        raise SampleError(seen.sample_id, "template", "is missing, but tail='drop' needs it to know which vertices are the tail's")
    kept = np.ones(len(seen.vertices), dtype=np.bool_)
    kept[seen.template.tail_vertices.numpy()] = False
    return tight_cuboid(seen.vertices[kept], R_box, margin), "vertices", ()


def _pose_problem(seen: Observation, R_box: Tensor, box: Tensor | None, config: LabelConfig) -> tuple[PoseProblem, tuple[str, ...]]:
    """The visible keypoints with their landmarks and the mask's box, as a pinhole would show them, and warnings; none if either side is missing."""
    used = seen.matched
    empty = np.zeros((0, 3))  # nothing to solve for: there will be a rejection
    points = torch.from_numpy(seen.landmarks[used] if seen.landmarks is not None else empty)
    keypoints = torch.from_numpy(seen.keypoints_2d[used] if seen.keypoints_2d is not None else empty)
    sigma, misfit, K = keypoint_sigma(keypoints, seen.image_hw, config), torch.from_numpy(seen.landmark_sigma[used]), torch.from_numpy(seen.K)
    pixels, warnings = keypoints[:, :2], list[str]()
    if seen.distortion is not None:
        lens = torch.from_numpy(seen.distortion)
        pixels, stretched, found = straightened(pixels, K, lens)
        if not bool(found.all()):
            warnings = [f"{int((~found).sum())} keypoints lie where the lens shows nothing and do not count for the pose"]
        points, pixels, sigma, misfit = points[found], pixels[found], (sigma * stretched)[found], misfit[found]
        box = None if seen.mask is None else straightened_box(torch.from_numpy(seen.mask), K, lens)
    if config.method == "default" and seen.landmark_sigma.any():
        sigma = torch.hypot(sigma, misfit_sigma(points, pixels, misfit))
    vertices = None if seen.vertices is None else torch.from_numpy(seen.vertices)
    return PoseProblem(points, pixels, sigma, K, seen.image_hw, R_box, vertices, box), tuple(warnings)
