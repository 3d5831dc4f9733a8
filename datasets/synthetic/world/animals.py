"""The animals of a scene: species, shape, pose and place on the ground."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from animal3dbox.datasets.synthetic.world.config import WORLD_POSES, WorldConfig
from animal3dbox.geometry.rigid_transforms import axis_angle_from_rotation, rotation_from_axis_angle
from animal3dbox.smal.linear_blend_skinning import PosedBody
from animal3dbox.smal.quadruped.joint_limits import joint_limits
from animal3dbox.smal.quadruped.poses import ground_trans, named_pose, random_pose
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped, measure_betas, quadruped_names

MEASURE_SPREAD, VARIATION_SPREAD, BLEND = 0.45, 0.3, 0.25
"""Standard deviations of a measure and of a smaller variation, and the part of mixed species.

They hold at a spread of 1.
"""
POSE_SPREAD = 0.05
"""Standard deviation of a joint's turn at a spread of 1, in half ranges of the joint."""
FACE_AND_EARS = ("Mouth", "LEar", "REar")
"""Joints that move more than legs do."""
RAISED, TAIL_STEP, TAIL_STEPS = ("Tail1", "Tail2", "Tail3", "Tail4"), 0.2, 9
"""Joints by which a tail is raised, the radians of a step, and the greatest number of steps."""
TAIL_SINKS = 0.004
"""Length in body lengths by which a tail may reach lower than the rest of the body."""


@dataclass(frozen=True)
class StandingAnimal:
    """A posed body in the world, z up, on the ground z = 0; float64.

    Attributes:
        preset: the species.
        pose_name: of WORLD_POSES.
        betas: (S,) the shape.
        pose: (J, 3) axis-angle, the heading within the root's.
        trans: (3,) world.
        vertices: (V, 3) world.
        R_world_joint: (J, 3, 3) global rotations of the joints.
    """

    preset: str
    pose_name: str
    betas: Tensor
    pose: Tensor
    trans: Tensor
    vertices: Tensor
    R_world_joint: Tensor

    @property
    def place(self) -> Tensor:
        """Middle (2,) of the body's bounds over the ground."""
        return (self.vertices[:, :2].amax(0) + self.vertices[:, :2].amin(0)) / 2

    @property
    def reach(self) -> float:
        """Radius of the circle on the ground, about the place, that the body keeps within."""
        return float(torch.linalg.vector_norm(self.vertices[:, :2] - self.place, dim=1).amax())

    def moved(self, shift: Tensor) -> "StandingAnimal":
        """The same animal moved over the ground by a shift (2,)."""
        step = torch.cat((shift, torch.zeros_like(shift[:1])))
        return replace(self, trans=self.trans + step, vertices=self.vertices + step)


def draw_animal(rng: np.random.Generator, preset: str, config: WorldConfig) -> StandingAnimal:
    """A random animal of a species with a shape, pose and heading of its own, at (0, 0)."""
    poses = config.poses or WORLD_POSES
    pose_name = poses[int(rng.integers(len(poses)))]
    betas, pose = (
        draw_betas(rng, preset, config.shape_spread, mixed=config.mixed),
        draw_pose(rng, pose_name, config.pose_spread),
    )
    heading = torch.tensor([0.0, 0.0, rng.uniform(-np.pi, np.pi)], dtype=torch.float64)
    root = rotation_from_axis_angle(heading) @ rotation_from_axis_angle(pose[0])
    pose = torch.cat((axis_angle_from_rotation(root)[None], pose[1:]))
    pose, body = _with_tail_off_the_ground(betas, pose)
    trans = ground_trans(body.vertices[0])
    animal = StandingAnimal(
        preset=preset,
        pose_name=pose_name,
        betas=betas,
        pose=pose,
        trans=trans,
        vertices=body.vertices[0] + trans,
        R_world_joint=body.R_world_joint[0],
    )
    return animal.moved(-animal.place)


def _with_tail_off_the_ground(betas: Tensor, pose: Tensor) -> tuple[Tensor, PosedBody]:
    """The pose and its body, with a tail that would carry the animal raised until it does not."""
    model, (_, high) = load_quadruped(), joint_limits()
    tail = [model.joint_names.index(joint) for joint in RAISED]
    is_tail = torch.zeros(model.vertex_count, dtype=torch.bool)
    is_tail[model.tail_vertices] = True
    for _ in range(TAIL_STEPS):
        body = model.posed(betas[None], pose[None], torch.zeros(1, 3, dtype=torch.float64))
        z = body.vertices[0, :, 2]
        if float(z[is_tail].amin()) > float(z[~is_tail].amin()) - TAIL_SINKS:
            break
        pose = pose.clone()
        pose[tail, 1] = torch.minimum(pose[tail, 1] + TAIL_STEP, high[tail, 1])
    return pose, body


def draw_betas(
    rng: np.random.Generator, preset: str, spread: float, *, mixed: Sequence[str] = ()
) -> Tensor:
    """The shape (S,) of a species, sometimes with another one mixed in, its measures varied.

    Args:
        rng: the random numbers.
        preset: the species.
        spread: of shapes, as WorldConfig has it.
        mixed: the species that may be mixed in; none: all.

    """
    names = quadruped_names()
    others = tuple(mixed) or names.presets
    amounts = dict.fromkeys(names.columns, 0.0)
    other, is_mixed, share = (
        others[int(rng.integers(len(others)))],
        rng.random() < BLEND * spread,
        rng.uniform(0.1, 0.35),
    )
    amounts[preset] += 1 - share * is_mixed
    amounts[other] += share * is_mixed
    for column in names.columns:
        deviation = 0.0 if column in names.presets else VARIATION_SPREAD
        if column in names.measures:
            deviation = MEASURE_SPREAD
        amounts[column] += spread * deviation * float(np.clip(rng.standard_normal(), -1.5, 1.5))
    return measure_betas(amounts)


def draw_pose(rng: np.random.Generator, name: str, spread: float) -> Tensor:
    """The pose (J, 3) of a name, its joints but the root turned a little within their limits."""
    if name == "random":
        return random_pose(torch.Generator().manual_seed(int(rng.integers(1 << 62))))
    pose = _tail_up() if name == "tail_up" else named_pose(name)
    low, high = joint_limits()
    turns = torch.from_numpy(rng.standard_normal(pose.shape).clip(-2, 2))
    turns[[load_quadruped().joint_names.index(joint) for joint in FACE_AND_EARS]] *= 2
    varied = (pose + spread * POSE_SPREAD * turns * (high - low) / 2).clamp(low, high)
    return torch.cat((pose[:1], varied[1:])) if spread else pose


def _tail_up() -> Tensor:
    """The standing pose (J, 3) with the tail raised."""
    pose, joints = named_pose("stand"), load_quadruped().joint_names
    for joint, degrees in (("Tail1", 55.0), ("Tail2", 30.0), ("Tail3", 20.0), ("Tail4", 10.0)):
        pose[joints.index(joint), 1] = np.deg2rad(degrees)
    return pose
