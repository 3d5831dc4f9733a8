"""Many starting poses, all refined at once: batched robust Levenberg-Marquardt on the keypoints."""

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from animal3dbox.geometry.camera import look_at
from animal3dbox.geometry.rigid import cross_matrix, rotation_from_axis_angle
from animal3dbox.labels.pose_problem import PoseEstimate, PoseProblem

AZIMUTHS = 8
ELEVATIONS_DEG = (-20.0, 15.0, 50.0, 85.0)
ROUNDS = 32
INITIAL_SCALE = 0.25
"""Of the keypoints' extent: the robust loss starts this wide, so that far starts feel every keypoint, and narrows."""
CAUCHY_95 = 2.385
"""Width of the Cauchy loss in standard deviations at which it keeps 95 % of least squares' efficiency on clean data."""
RAYLEIGH_MEDIAN = 1.1774
LEAST_DEPTH = 0.05


@dataclass(frozen=True)
class Candidates:
    """Poses found, best first.

    Attributes:
        estimates: the poses.
        costs: their robust costs under one common width.
        scale: standard deviation of the residuals over the keypoints' own, at least 1; how badly the body fits.
    """

    estimates: tuple[PoseEstimate, ...]
    costs: tuple[float, ...]
    scale: float


def view_rotations(R_box: Tensor) -> Tensor:
    """R_cam_world (B, 3, 3) of cameras all round a body, its back up in the picture."""
    azimuth, elevation = torch.meshgrid(
        torch.arange(AZIMUTHS, dtype=torch.float64) * (2 * math.pi / AZIMUTHS),
        torch.deg2rad(torch.tensor(ELEVATIONS_DEG, dtype=torch.float64)),
        indexing="ij",
    )
    azimuth, elevation = azimuth.flatten(), elevation.flatten()
    eyes = torch.stack((torch.cos(elevation) * torch.cos(azimuth), torch.cos(elevation) * torch.sin(azimuth), torch.sin(elevation)), dim=-1)
    R_cam_box = look_at(eyes, torch.zeros_like(eyes), torch.tensor([0.0, 0, 1], dtype=torch.float64))[:, :3, :3]
    return R_cam_box @ R_box.mT


def weak_perspective_translation(problem: PoseProblem, R: Tensor) -> Tensor:
    """t_cam_world (B, 3) that puts rotated landmarks over the keypoints at about the right size.

    Medians and median absolute deviations, so that single wild keypoints do not decide.
    """
    turned = problem.points_world @ R.mT  # (B, N, 3)
    rays = torch.cat((problem.points_px, torch.ones_like(problem.points_px[:, :1])), dim=1) @ torch.linalg.inv(problem.K).mT
    middle_3d, middle_2d = turned[..., :2].median(-2).values, rays[:, :2].median(0).values
    spread_3d = torch.linalg.vector_norm(turned[..., :2] - middle_3d[..., None, :], dim=-1).median(-1).values
    spread_2d = torch.linalg.vector_norm(rays[:, :2] - middle_2d, dim=-1).median()
    depth = (spread_3d / spread_2d.clamp_min(1e-9)).clamp_min(1e-3) - turned[..., 2].mean(-1)
    depth = torch.maximum(depth, 4 * LEAST_DEPTH - turned[..., 2].amin(-1))
    return torch.cat((middle_2d * (depth + turned[..., 2].mean(-1))[:, None] - middle_3d, depth[:, None]), dim=-1)


def search_poses(problem: PoseProblem, starts: list[PoseEstimate]) -> Candidates:
    """Refine the given starts and a grid of views; robust, keypoints only.

    Args:
        problem: about its own mean, in units of its own spread.
        starts: poses worth trying.

    Returns:
        The different poses found, best first.

    """
    R_views = view_rotations(problem.R_box)
    names = [start.hypothesis for start in starts] + [f"view_{i}" for i in range(len(R_views))]
    R = torch.cat([start.R[None] for start in starts] + [R_views])
    t = torch.cat([start.t[None] for start in starts] + [weak_perspective_translation(problem, R_views)])
    extent_px = float((problem.points_px.amax(0) - problem.points_px.amin(0)).amax())
    widest = max(INITIAL_SCALE * extent_px / float(problem.sigma_px.median()), CAUCHY_95)
    R, t = _refine(problem, R, t, widest, CAUCHY_95, ROUNDS)
    distances, _ = _residuals(problem, R, t)
    medians = distances.median(-1).values
    scale = max(1.0, float(medians.amin()) / RAYLEIGH_MEDIAN)
    R, t = _refine(problem, R, t, CAUCHY_95 * scale, CAUCHY_95 * scale, ROUNDS // 2)
    costs = _cost(_residuals(problem, R, t)[0], CAUCHY_95 * scale)
    order = torch.argsort(costs, stable=True).tolist()
    kept: list[int] = []
    for i in order:
        if all(float((R[i] - R[j]).norm()) > 0.05 for j in kept):
            kept.append(i)
    return Candidates(tuple(PoseEstimate(R[i], t[i], names[i]) for i in kept), tuple(float(costs[i]) for i in kept), scale)


def _residuals(problem: PoseProblem, R: Tensor, t: Tensor) -> tuple[Tensor, Tensor]:
    """Mahalanobis distances (B, N) and depths (B, N)."""
    cam = problem.points_world @ R.mT + t[:, None]
    px = (cam @ problem.K.mT)[..., :2] / cam[..., 2:].clamp_min(1e-9)
    distances: Tensor = torch.linalg.vector_norm((px - problem.points_px) / problem.sigma_px[:, None], dim=-1)
    return distances, cam[..., 2]


def _cost(distances: Tensor, width: float) -> Tensor:
    """Cauchy loss summed over keypoints, (B,)."""
    return (width**2 / 2 * torch.log1p((distances / width) ** 2)).sum(-1)


def _normal_equations(problem: PoseProblem, R: Tensor, t: Tensor, width: float) -> tuple[Tensor, Tensor]:
    """Reweighted J^T J (B, 6, 6) and J^T r (B, 6) for a turn from the left and a shift."""
    turned = problem.points_world @ R.mT
    cam = turned + t[:, None]
    z = cam[..., 2:].clamp_min(1e-9)
    px = (cam @ problem.K.mT)[..., :2] / z
    by_cam = torch.empty((*cam.shape[:-1], 2, 3), dtype=cam.dtype)
    by_cam[..., :2] = problem.K[:2, :2] / z[..., None]
    by_cam[..., 2] = -(px - problem.K[:2, 2]) / z
    jacobian = torch.cat((by_cam @ -cross_matrix(turned), by_cam), dim=-1) / problem.sigma_px[:, None, None]
    residual = (px - problem.points_px) / problem.sigma_px[:, None]
    weight = 1 / (1 + residual.pow(2).sum(-1) / width**2)
    weighted = jacobian * weight[..., None, None]
    return torch.einsum("bnki,bnkj->bij", weighted, jacobian), torch.einsum("bnki,bnk->bi", weighted, residual)


def _refine(problem: PoseProblem, R: Tensor, t: Tensor, widest: float, narrowest: float, rounds: int) -> tuple[Tensor, Tensor]:
    """Levenberg-Marquardt on every start at once while the loss narrows; a step that does not help, or goes behind the camera, is not taken."""
    damping = torch.full((len(R),), 1e-3, dtype=torch.float64)
    for i in range(rounds):
        width = max(widest * (narrowest / widest) ** (2 * i / rounds), narrowest)
        cost = _cost(_residuals(problem, R, t)[0], width)
        A, b = _normal_equations(problem, R, t, width)
        diagonal = A.diagonal(dim1=-2, dim2=-1)
        damped = A + torch.diag_embed(damping[:, None] * diagonal + 1e-12 * diagonal.amax(-1, keepdim=True) + 1e-300)
        step = -torch.linalg.solve(damped, b)
        R_new, t_new = rotation_from_axis_angle(step[:, :3]) @ R, t + step[:, 3:]
        distances, depth = _residuals(problem, R_new, t_new)
        better = (_cost(distances, width) <= cost) & (depth.amin(-1) > LEAST_DEPTH)
        R, t = torch.where(better[:, None, None], R_new, R), torch.where(better[:, None], t_new, t)
        damping = torch.where(better, damping * 0.2, damping * 8).clamp(1e-12, 1e8)
    return R, t
