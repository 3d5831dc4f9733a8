"""What poses are likely: one Gaussian over joint angles, made of the quadruped's own named poses.

Parts of the named poses and of their mirror images are put together at random, weakened, turned a
little within the joints' limits, and their principal components taken, each angle weighted by how
far it moves the body. The ground's direction, which the root's turn in a named pose tells, is
regressed on the same components: a sitting animal's trunk is steep, and the prior knows.

Example:
    >>> prior = pose_prior(load_quadruped().joint_names)
    >>> prior.directions.shape[2]
    40
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
import torch
from numpy.typing import NDArray

from animal3dbox.geometry.arrays import as_numpy
from animal3dbox.geometry.rigid_transforms import rotation_from_axis_angle
from animal3dbox.labels.fit.kinematics import UNFITTED
from animal3dbox.smal.quadruped.joint_limits import joint_limits
from animal3dbox.smal.quadruped.poses import POSES, named_pose
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped
from animal3dbox.smal.quadruped.rest_pose import RestAlignment

Array = NDArray[np.float64]
POSE_DIRECTIONS = 40
POSE_SAMPLES, POSE_SEED = 4000, 15
PART_SWAP = 0.35
"""Probability that a part of the body is taken from another pose."""
WHOLE_SHARE, LEAST_SHARE = 0.6, 0.2
"""Part of the poses that are taken in full, and the least share of the others."""
JOINT_NOISE = 0.12
"""Standard deviation of a joint's own turn, in half ranges of the joint."""
REST_SD_DEG = 3.0
"""Standard deviation of each joint's angles at rest, by which one body differs from another."""
PARTS = {
    "spine": ("pelvis0", "spine"),
    "left fore": ("LLeg1", "LLeg2", "LLeg3", "LFoot"),
    "right fore": ("RLeg1", "RLeg2", "RLeg3", "RFoot"),
    "left hind": ("LLegBack", "LFootBack"),
    "right hind": ("RLegBack", "RFootBack"),
    "head": ("Neck", "Head"),
    "tail": ("Tail",),
}
"""Part -> beginnings of the names of its joints."""
TAIL_UP_DEG = {"Tail1": 55.0, "Tail2": 30.0, "Tail3": 20.0, "Tail4": 10.0}


@dataclass(frozen=True)
class PosePrior:
    """A Gaussian over the angles of the fitted joints, whitened.

    theta = mean + directions c, with c standard normal.

    Attributes:
        mean: (N, 3) axis-angle, radians.
        directions: (N, 3, P) per unit of each coefficient, the greatest first.
        whitening: (P, 3 N) theta - mean to the coefficients nearest to it.
        low: (N, 3) the joints' limits.
        high: (N, 3).
        up: (3,) the ground's normal in the root's frame, at the mean.
        up_slopes: (P, 3) what the coefficients add to it.
        examples: (M, P) coefficients of the named poses and their mirror images.
    """

    mean: Array
    directions: Array
    whitening: Array
    low: Array
    high: Array
    up: Array
    up_slopes: Array
    examples: Array

    def coefficients(self, theta: Array) -> Array:
        """The coefficients (B, P) nearest to angles (B, N, 3)."""
        nearest: Array = (theta - self.mean).reshape(len(theta), -1) @ self.whitening.T
        return nearest


@cache
def pose_prior(joint_names: tuple[str, ...]) -> PosePrior:
    """The prior of a skeleton with the quadruped's joints, which are found by their names."""
    whole = load_quadruped()
    samples, ups = _samples()
    fitted = [j for j, name in enumerate(joint_names) if j > 0 and name not in UNFITTED]
    columns = [whole.joint_names.index(joint_names[j]) for j in fitted]
    low, high = (as_numpy(limit)[columns] for limit in joint_limits())
    flat = samples[:, columns].reshape(len(samples), -1)
    reach = np.repeat(_reach()[columns], 3)
    mean = flat.mean(0)
    scaled = (flat - mean) * reach
    values, vectors = np.linalg.eigh(scaled.T @ scaled / len(scaled))
    order = np.argsort(-values, kind="stable")[:POSE_DIRECTIONS]
    root, vectors = np.sqrt(values[order]), vectors[:, order]
    vectors = vectors * np.sign(vectors[np.abs(vectors).argmax(0), range(len(order))])
    directions = vectors * root / reach[:, None]
    whitening = (vectors / root * reach[:, None]).T
    c = (flat - mean) @ whitening.T
    up = ups.mean(0)
    up_slopes = c.T @ (ups - up) / len(c)
    examples, _ = _example_poses()
    theta = examples[:, columns].reshape(len(examples), -1)
    shape = (len(columns), 3)
    return PosePrior(
        mean=mean.reshape(shape),
        directions=directions.reshape(*shape, -1),
        whitening=whitening,
        low=low,
        high=high,
        up=up,
        up_slopes=up_slopes,
        examples=(theta - mean) @ whitening.T,
    )


def mirrored_pose(pose: Array, joint_names: Sequence[str]) -> Array:
    """The mirror images of poses (..., J, 3), left and right joints exchanged."""
    twin = {"L": "R", "R": "L"}
    order = [
        joint_names.index(twin[name[0]] + name[1:]) if name[0] in twin else j
        for j, name in enumerate(joint_names)
    ]
    image: Array = pose[..., order, :] * np.array([-1.0, 1.0, -1.0])
    return image


@cache
def _example_poses() -> tuple[Array, tuple[str, ...]]:
    """The named poses (M, J, 3), a raised tail, and mirror images of those that have one."""
    names = load_quadruped().joint_names
    poses = {name: as_numpy(named_pose(name)) for name in POSES}
    raised = np.zeros_like(poses["stand"])
    for joint, degrees in TAIL_UP_DEG.items():
        raised[names.index(joint), 1] = np.deg2rad(degrees)
    poses["tail_up"] = raised
    for name, pose in list(poses.items()):
        image = mirrored_pose(pose, names)
        if not np.allclose(image, pose):
            poses[f"{name} mirrored"] = image
    return np.stack(list(poses.values())), tuple(poses)


@cache
def _samples() -> tuple[Array, Array]:
    """Random poses (M, J, 3), and the ground's normals (M, 3) in their roots' frames."""
    rng = np.random.Generator(np.random.PCG64(POSE_SEED))
    named, _ = _example_poses()
    names = load_quadruped().joint_names
    base = rng.integers(len(named), size=POSE_SAMPLES)
    poses = named[base]
    for beginnings in PARTS.values():
        part = np.array([j for j, name in enumerate(names) if name.startswith(beginnings)])
        other = named[rng.integers(len(named), size=POSE_SAMPLES)]
        swapped = rng.random(POSE_SAMPLES) < PART_SWAP
        poses[:, part] = np.where(swapped[:, None, None], other[:, part], poses[:, part])
    share = rng.uniform(LEAST_SHARE, 1.0, POSE_SAMPLES)
    poses *= np.where(rng.random(POSE_SAMPLES) < WHOLE_SHARE, 1.0, share)[:, None, None]
    root = poses[:, 0].copy()
    low, high = (as_numpy(limit) for limit in joint_limits())
    noise = rng.standard_normal(poses.shape).clip(-2, 2) * JOINT_NOISE * (high - low) / 2
    poses = np.clip(poses + noise, low, high)
    poses += rng.standard_normal(poses.shape) * np.deg2rad(REST_SD_DEG)
    poses[:, 0] = root
    mirrored = np.arange(POSE_SAMPLES) % 2 == 1
    poses[mirrored] = mirrored_pose(poses[mirrored], names)
    roots = rotation_from_axis_angle(poses[:, 0])
    return poses, np.ascontiguousarray(roots[:, 2])  # R_root^T z is its last row


@cache
def _reach() -> Array:
    """How far a turn of each joint (J,) moves the body: root mean square over all vertices."""
    model = load_quadruped()
    shares = as_numpy(model.weights).copy()
    for j in range(model.joint_count - 1, 0, -1):
        shares[:, model.parents[j]] += shares[:, j]
    joints = as_numpy(model.J_regressor @ model.v_template)
    apart = as_numpy(model.v_template)[:, None] - joints
    reach: Array = np.sqrt((shares**2 * (apart * apart).sum(-1)).mean(0))
    return reach


def ground_normals(prior: PosePrior, coefficients: Array) -> Array:
    """Unit normals (B, 3) of the ground in the root's frame, of pose coefficients (B, P)."""
    up = prior.up + (coefficients[:, None] @ prior.up_slopes)[:, 0]
    unit: Array = up / np.sqrt((up * up).sum(-1, keepdims=True))
    return unit


def axis_angles(prior: PosePrior, coefficients: Array) -> Array:
    """The angles (B, N, 3) of coefficients (B, at most P)."""
    count = coefficients.shape[1]
    flat = prior.directions.reshape(-1, prior.directions.shape[2])[:, :count]
    theta: Array = (coefficients[:, None] @ flat.T)[:, 0]
    return prior.mean + theta.reshape(len(theta), *prior.mean.shape)


def whole_pose(
    joint_names: tuple[str, ...], theta: Array, alignment: RestAlignment | None = None
) -> torch.Tensor:
    """The pose (J, 3) of a model, of the angles (N, 3) of its fitted joints; the others at rest.

    Args:
        joint_names: the model's.
        theta: (N, 3) as the quadruped's would be.
        alignment: of the fitted joints with the quadruped's rest pose; None: it is the same.

    """
    theta = theta if alignment is None else alignment.angles(theta)
    pose = np.zeros((len(joint_names), 3))
    pose[[j for j, name in enumerate(joint_names) if j > 0 and name not in UNFITTED]] = theta
    return torch.from_numpy(pose)
