"""The robust joint cost of method "default": keypoints and the body's bounds against the mask's, batched over poses."""

from dataclasses import dataclass, replace

import numpy as np

from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.descent import LEAST_DEPTH, NOTHING, Array, Local, descend, project_with_slopes
from animal3dbox.labels.pose_problem import PoseProblem
from animal3dbox.labels.pose_search import CAUCHY_95, Candidates

MASK_SLACK_PX = 1.0
"""A mask's border is that of pixel centres, and tips thinner than a pixel fall between them: up to 0.8 px (benchmarks/masks_and_visibility.py)."""
ROUNDS = (2, 14, 24)
BEHIND = 1.5
"""Times the least cost: what a pose may cost more and still be refined further."""
BAND = 0.06
"""Of the body's extent in the picture: points so near to its bounds are watched while the pose moves."""
LEAST_CURVATURE = 0.05
"""Of a residual's weight: the Cauchy loss bends down beyond its width, which a descent must not follow."""
SIDES = (0, 1, 0, 1)
"""Which coordinate left, top, right and bottom are."""


@dataclass(frozen=True)
class Joint:
    """Keypoints and bounds; every coordinate's residual has its own Cauchy loss of width CAUCHY_95.

    Attributes:
        points: (N, 3) landmarks, about their mean, in units of their spread.
        pixels: (2, N) about the principal point.
        by_keypoint: (N,) 1 / px: what their residuals are multiplied by.
        linear: (2, 2) K's upper left.
        cloud: (V, 3) the points whose bounds are compared with the mask's; V = 0 without that term.
        watched: (B, M) those of them that may bound the body near each pose.
        mask_box: (4,) xyxy px about the principal point.
        by_bound: 1 / px likewise.
    """

    points: Array
    pixels: Array
    by_keypoint: Array
    linear: Array
    cloud: Array
    watched: np.ndarray
    mask_box: Array
    by_bound: float

    def local(self, R: Array, t: Array) -> Local:
        """The cost of poses and its derivatives."""
        px, slopes, depth = project_with_slopes(self.points, self.linear, R, t)
        off = ((px - self.pixels) * self.by_keypoint).reshape(len(R), -1)
        slopes = (slopes * self.by_keypoint).reshape(len(R), 6, -1)
        allowed = depth.min(-1) > LEAST_DEPTH
        if len(self.cloud):
            beyond, by_step = self._bounds(R, t)
            off, slopes = np.concatenate((off, beyond), -1), np.concatenate((slopes, by_step), -1)
        square = (off / CAUCHY_95) ** 2
        weight = 1 / (1 + square)
        curvature = weight * np.maximum((1 - square) * weight, LEAST_CURVATURE)
        cost = CAUCHY_95**2 / 2 * np.log1p(square).sum(-1)
        A, b = (slopes * curvature[:, None]) @ slopes.mT, (slopes @ (weight * off)[..., None])[..., 0]
        return Local(np.where(allowed, cost, np.inf), A, b)

    def _bounds(self, R: Array, t: Array) -> tuple[Array, Array]:
        """How far the watched points' bounds are beyond the mask's, as the paper's d_bbox, (B, 4), and by a step (B, 6, 4)."""
        near = self.cloud[self.watched]
        cam = R @ near.mT + t[..., None]
        flat = self.linear @ (cam[:, :2] / np.maximum(cam[:, 2:], 1e-9))
        outermost = np.concatenate((flat.argmin(-1), flat.argmax(-1)), -1)  # (B, 4)
        px, slopes, _ = project_with_slopes(near[np.arange(len(R))[:, None], outermost], self.linear, R, t)
        off = px[:, SIDES, range(4)] - self.mask_box
        beyond = np.sign(off) * np.maximum(np.abs(off) - MASK_SLACK_PX, 0)
        return self.by_bound * beyond, self.by_bound * slopes[:, :, SIDES, range(4)] * (beyond != 0)[:, None]

    def watching(self, R: Array, t: Array) -> "Joint":
        """The same, watching the points that bound the body near other poses."""
        if not len(self.cloud):
            return self
        cam = R @ self.cloud.T + t[..., None]
        flat = self.linear @ (cam[:, :2] / np.maximum(cam[:, 2:], 1e-9))  # (B, 2, V)
        least, greatest = flat.min(-1)[..., None], flat.max(-1)[..., None]
        band = BAND * (greatest - least)
        outer = ((flat < least + band) | (flat > greatest - band)).any(1)
        ids = [np.flatnonzero(row) for row in outer]
        most = max(map(len, ids))
        return replace(self, watched=np.stack([np.resize(one, most) for one in ids]))  # shorter ones say some twice


def joint_of(problem: PoseProblem, scale: float, config: LabelConfig) -> Joint:
    """The joint cost of a problem about its own mean, in units of its own spread.

    Args:
        problem: without the mask term if the mask touches the border of the image.
        scale: how badly the body fits, see Candidates.
        config: lambda, and what is compared with the mask: by default the mesh.

    """
    K, sigma, points = problem.K.numpy(), problem.sigma_px.numpy(), problem.points_world.numpy()
    extent = "none" if problem.is_cut or problem.mask_box is None else config.mask_box or "mesh"
    cloud, box = np.zeros((0, 3)), np.zeros(4)
    if problem.mask_box is not None and extent != "none":
        cloud = points if extent == "keypoints" or problem.vertices_world is None else problem.vertices_world.numpy()
        box = problem.mask_box.numpy() - K[SIDES, 2]
    by_bound = float(np.sqrt(1 - config.lambda_keypoints) / (scale * np.median(sigma)))
    by_keypoint = np.sqrt(config.lambda_keypoints) / (scale * sigma)
    return Joint(points, problem.points_px.numpy().T - K[:2, 2:], by_keypoint, K[:2, :2], cloud, np.zeros((1, 0), int), box, by_bound)


def refine_jointly(problem: PoseProblem, candidates: Candidates, count: int, config: LabelConfig) -> tuple[Array, Array, Array]:
    """The first candidates refined by the joint cost; those that fall far behind the best are left on the way.

    Returns:
        R (B, 3, 3), t (B, 3) and costs (B,) of what is left, cheapest first; B is at least 1.

    """
    joint = joint_of(problem, candidates.scale, config)
    R, t = candidates.R[:count], candidates.t[:count]
    for rounds in ROUNDS if len(R) > 1 else ROUNDS[1:]:
        near = joint.watching(R, t)
        R, t, cost, settled = descend(near.local, R, t, rounds)
        order = np.argsort(cost, kind="stable")
        order = order[cost[order] <= BEHIND * cost[order[0]] + NOTHING]
        R, t, cost = R[order], t[order], cost[order]
        if settled and (not len(joint.cloud) or np.allclose(joint.watching(R, t).local(R, t).cost, cost, rtol=1e-9, atol=NOTHING)):
            break
    return R, t, cost
