"""The camera-pose problem: what is known, and what an answer looks like."""

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from animal3dbox.geometry.camera import project

RELATIVE_FLATNESS = 1e-3
"""Points whose third principal spread is less than this part of the first count as lying in one plane."""


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
    projected, depth = project(problem.K, problem.points_world @ R.mT + t)
    distance: Tensor = torch.linalg.vector_norm(projected - problem.points_px, dim=-1)
    return distance, depth


def degenerate_points(problem: PoseProblem, min_keypoints: int) -> PoseFailure | None:
    """Why the points cannot fix a pose, if they cannot: too few, coinciding, or in one plane."""
    count = problem.points_world.shape[0]
    if count < min_keypoints:
        return PoseFailure("too_few_keypoints", f"{count} visible keypoints, but min_keypoints is {min_keypoints}")
    about = problem.points_world - problem.points_world.mean(0)
    spread = torch.linalg.svdvals(about)
    apart = torch.cdist(about, about, compute_mode="donot_use_mm_for_euclid_dist") > 1e-9 * float(spread[0])
    distinct = 1 + int(apart.tril(-1).sum(1).eq(torch.arange(count, device=apart.device))[1:].sum())
    if distinct < min_keypoints:
        return PoseFailure(
            "coplanar_keypoints",
            f"of {count} visible keypoints only {distinct} lie at different places on the body, but min_keypoints is {min_keypoints}",
        )
    if float(spread[2]) < RELATIVE_FLATNESS * float(spread[0]):
        return PoseFailure("coplanar_keypoints", f"the {count} visible keypoints lie in one plane of the body")
    if float((problem.points_px - problem.points_px[0]).abs().amax()) < 1e-6:
        return PoseFailure("coplanar_keypoints", f"all {count} visible keypoints are at the same pixel {problem.points_px[0].tolist()}")
    return None


def in_unit_scale(problem: PoseProblem, solve: Callable[[PoseProblem], PoseEstimate | PoseFailure]) -> PoseEstimate | PoseFailure:
    """Solve about the landmarks' mean and in units of their spread, so that the answer is free of the mesh's unit.

    Args:
        problem: in the mesh's frame and unit.
        solve: finds a pose of the shifted and scaled problem.

    Returns:
        The pose of the problem as it was.

    """
    middle = problem.points_world.mean(0)
    unit = float((problem.points_world - middle).pow(2).sum(-1).mean().sqrt())
    vertices = None if problem.vertices_world is None else (problem.vertices_world - middle) / unit
    found = solve(
        PoseProblem(
            (problem.points_world - middle) / unit,
            problem.points_px,
            problem.sigma_px,
            problem.K,
            problem.image_hw,
            problem.R_box,
            vertices,
            problem.mask_box,
        )
    )
    if isinstance(found, PoseFailure):
        return found
    return PoseEstimate(found.R, found.t * unit - found.R @ middle, found.hypothesis, found.warnings)
