"""The camera-pose problem: what is known, and what an answer looks like."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from animal3dbox.geometry.arrays import norm
from animal3dbox.geometry.camera import project

RELATIVE_FLATNESS = 1e-3
"""Points whose third principal spread is less than this part of the first count as lying in one
plane."""


@dataclass(frozen=True)
class PoseProblem:
    """What the camera pose is estimated from; all float64, world is the mesh's frame.

    Attributes:
        points_world: (N, 3) the visible landmarks on the body.
        points_px: (N, 2) where they are seen.
        sigma_px: (N,) their standard deviations.
        K: (3, 3).
        image_hw: height and width.
        R_box: (3, 3) the body's axes, to look at it from named sides.
        vertices_world: (V, 3) the body's surface, or None.
        mask_box: (4,) xyxy px of the mask, pixels from min - 0.5 to max + 0.5, or None.
    """

    points_world: Tensor
    points_px: Tensor
    sigma_px: Tensor
    K: Tensor
    image_hw: tuple[int, int]
    R_box: Tensor
    vertices_world: Tensor | None
    mask_box: Tensor | None

    @property
    def is_cut(self) -> bool:
        """Whether the mask touches the border of the image, so that its box is not the animal's."""
        if self.mask_box is None:
            return False
        height, width = self.image_hw
        left, top, right, bottom = self.mask_box.tolist()
        return bool(left <= -0.5 or top <= -0.5 or right >= width - 0.5 or bottom >= height - 0.5)


@dataclass(frozen=True)
class PoseEstimate:
    """A camera pose.

    Attributes:
        R: (3, 3) R_cam_world.
        t: (3,) t_cam_world.
        hypothesis: the start it came from.
        warnings: whole sentences.
    """

    R: Tensor
    t: Tensor
    hypothesis: str
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True)
class PoseFailure:
    """Why no pose was found: a reason of REASONS, and what was seen."""

    reason: str
    detail: str


def reprojection_errors(problem: PoseProblem, R: Tensor, t: Tensor) -> tuple[Tensor, Tensor]:
    """Distance (N,) in px of each landmark's projection from its keypoint, and depth (N,)."""
    projected, depth = project(
        problem.K.numpy(), problem.points_world.numpy() @ R.numpy().T + t.numpy()
    )
    return torch.from_numpy(norm(projected - problem.points_px.numpy())), torch.from_numpy(depth)


def degenerate_points(problem: PoseProblem, min_keypoints: int) -> PoseFailure | None:
    """Why the points cannot fix a pose, if they cannot: too few, coinciding, or in one plane."""
    points, pixels = problem.points_world.numpy(), problem.points_px.numpy()
    count = len(points)
    if count < min_keypoints:
        return PoseFailure(
            "too_few_keypoints", f"{count} visible keypoints, but min_keypoints is {min_keypoints}"
        )
    spread = np.linalg.svd(points - points.mean(0), compute_uv=False)
    offsets = points[:, None] - points[None]
    apart = (offsets * offsets).sum(-1) > (1e-9 * spread[0]) ** 2
    distinct = count
    if np.count_nonzero(apart) < count * (count - 1):
        distinct = 1 + int((np.tril(apart, -1).sum(1)[1:] == np.arange(1, count)).sum())
    if distinct < min_keypoints:
        return PoseFailure(
            "coplanar_keypoints",
            f"of {count} visible keypoints only {distinct} lie at different places on the body, but"
            f" min_keypoints is {min_keypoints}",
        )
    if spread[2] < RELATIVE_FLATNESS * spread[0]:
        return PoseFailure(
            "coplanar_keypoints", f"the {count} visible keypoints lie in one plane of the body"
        )
    if np.abs(pixels - pixels[0]).max() < 1e-6:
        return PoseFailure(
            "coplanar_keypoints",
            f"all {count} visible keypoints are at the same pixel {pixels[0].tolist()}",
        )
    return None


def landmark_frame(problem: PoseProblem) -> tuple[Tensor, float]:
    """The landmarks' mean (3,) and their root mean square distance from it."""
    points = problem.points_world.numpy()
    middle = points.mean(0)
    return torch.from_numpy(middle), float(np.sqrt(((points - middle) ** 2).sum(-1).mean()))


def in_unit_scale(
    problem: PoseProblem, solve: Callable[[PoseProblem], PoseEstimate | PoseFailure]
) -> PoseEstimate | PoseFailure:
    """Solve about the landmarks' mean and in units of their spread, so that the answer is free of the mesh's unit.

    Args:
        problem: in the mesh's frame and unit.
        solve: finds a pose of the shifted and scaled problem.

    Returns:
        The pose of the problem as it was.

    """
    middle, unit = landmark_frame(problem)
    vertices = None
    if problem.vertices_world is not None:  # in NumPy, a third of torch's time
        scaled = problem.vertices_world.numpy() - middle.numpy()
        scaled /= unit
        vertices = torch.from_numpy(scaled)
    found = solve(
        replace(
            problem, points_world=(problem.points_world - middle) / unit, vertices_world=vertices
        )
    )
    if isinstance(found, PoseFailure):
        return found
    return PoseEstimate(
        found.R, found.t * unit - found.R @ middle, found.hypothesis, found.warnings
    )
