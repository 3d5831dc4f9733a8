"""Named poses of the embedded quadruped, and random ones within the limits of its joints.

Example:
    >>> list(POSES)[:4]
    ['stand', 'walk', 'trot', 'run']
"""

from collections.abc import Mapping

import torch
from torch import Tensor

from animal3dbox.errors import ConfigError
from animal3dbox.smal.quadruped.joint_limits import joint_limits
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped

# Degrees about the template's axes (x roll, y pitch, z yaw); their signs are explained in
# joint_limits.py.
_Degrees = Mapping[str, tuple[float, float, float]]

_WALK: _Degrees = {
    "LLeg1": (0, -22, 0), "LLeg2": (0, 6, 0), "LLeg3": (0, 4, 0),
    "RLeg1": (0, 20, 0), "RLeg2": (0, -14, 0), "RLeg3": (0, 30, 0), "RFoot": (0, 20, 0),
    "LLegBack1": (0, 20, 0), "LLegBack2": (0, 2, 0), "LLegBack3": (0, -4, 0),
    "LFootBack": (0, 14, 0),
    "RLegBack1": (0, -22, 0), "RLegBack2": (0, 18, 0), "RLegBack3": (0, -8, 0),
    "spine0": (0, 0, 2), "spine2": (0, 0, -2), "Neck": (0, 4, 0), "Tail1": (0, 0, 6),
    "Tail3": (0, 0, 6),
}  # fmt: skip
_TROT: _Degrees = {
    "LLeg1": (0, -34, 0), "LLeg2": (0, -16, 0), "LLeg3": (0, 42, 0), "LFoot": (0, 16, 0),
    "RLeg1": (0, 26, 0), "RLeg2": (0, -2, 0), "RLeg3": (0, 4, 0), "RFoot": (0, 16, 0),
    "LLegBack1": (0, 26, 0), "LLegBack2": (0, -4, 0), "LLegBack3": (0, 6, 0),
    "LFootBack": (0, 22, 0),
    "RLegBack1": (0, -36, 0), "RLegBack2": (0, 50, 0), "RLegBack3": (0, -40, 0),
    "RFootBack": (0, 16, 0),
    "Neck": (0, -4, 0), "Head": (0, 4, 0), "Tail1": (0, -14, 0), "Tail3": (0, -6, 0),
}  # fmt: skip
_RUN: _Degrees = {
    "pelvis": (0, -4, 0), "spine": (0, 3, 0), "spine1": (0, 3, 0), "spine3": (0, 4, 0),
    "Neck": (0, 14, 0), "Head": (0, -14, 0),
    "LLeg1": (0, -52, 0), "LLeg2": (0, -4, 0), "LLeg3": (0, 6, 0), "LFoot": (0, -6, 0),
    "RLeg1": (0, -34, 0), "RLeg2": (0, -46, 0), "RLeg3": (0, 70, 0), "RFoot": (0, 24, 0),
    "LLegBack1": (0, 40, 0), "LLegBack2": (0, -4, 0), "LLegBack3": (0, 12, 0),
    "LFootBack": (0, 34, 0),
    "RLegBack1": (0, 26, 0), "RLegBack2": (0, 18, 0), "RLegBack3": (0, -6, 0),
    "RFootBack": (0, 30, 0),
    "Tail1": (0, -22, 0), "Tail2": (0, -10, 0), "Tail4": (0, 10, 0),
}  # fmt: skip
_GRAZE: _Degrees = {
    "spine2": (0, 6, 0), "spine3": (0, 14, 0), "Neck": (0, 80, 0), "Head": (0, -36, 0),
    "Mouth": (0, 4, 0),
    "LLeg1": (0, -34, 0), "LLeg2": (0, 2, 0), "LLeg3": (0, 6, 0),
    "RLeg1": (0, -12, 0), "RLeg2": (0, -10, 0), "RLeg3": (0, 4, 0),
    "RLegBack1": (0, -8, 0), "RLegBack2": (0, 6, 0),
}  # fmt: skip
_SIT: _Degrees = {
    "pelvis": (0, -46, 0), "pelvis0": (0, 2, 0), "spine1": (0, 5, 0), "spine2": (0, 5, 0),
    "spine3": (0, 6, 0),
    "Neck": (0, 8, 0), "Head": (0, 20, 0),
    "LLeg1": (0, 24, 0), "LLeg2": (0, 4, 0), "RLeg1": (0, 24, 0), "RLeg2": (0, 4, 0),
    "LLegBack1": (10, -34, 0), "LLegBack2": (0, 84, 0), "LLegBack3": (0, -72, 0),
    "LFootBack": (0, 38, 0),
    "RLegBack1": (-10, -34, 0), "RLegBack2": (0, 84, 0), "RLegBack3": (0, -72, 0),
    "RFootBack": (0, 38, 0),
    "Tail1": (0, 34, 0), "Tail2": (0, 14, 10), "Tail3": (0, 4, 14), "Tail4": (0, 0, 14),
    "Tail5": (0, 0, 14),
}  # fmt: skip
_LIE: _Degrees = {
    "LLeg1": (6, 24, 0), "LLeg2": (0, -96, 0), "LLeg3": (0, -8, 0), "LFoot": (0, 4, 0),
    "RLeg1": (-6, 24, 0), "RLeg2": (0, -96, 0), "RLeg3": (0, -8, 0), "RFoot": (0, 4, 0),
    "LLegBack1": (16, -54, 0), "LLegBack2": (0, 108, 0), "LLegBack3": (0, -100, 0),
    "LFootBack": (0, 34, 0),
    "RLegBack1": (-16, -54, 0), "RLegBack2": (0, 108, 0), "RLegBack3": (0, -100, 0),
    "RFootBack": (0, 34, 0),
    "Neck": (0, -6, 0), "Head": (0, 10, 0), "Tail1": (0, 24, 14), "Tail3": (0, 0, 16),
    "Tail5": (0, 0, 16),
}  # fmt: skip
_REAR: _Degrees = {
    "pelvis": (0, -54, 0), "spine0": (0, 3, 0), "spine2": (0, 3, 0), "Neck": (0, 16, 0),
    "Head": (0, 14, 0),
    "LLeg1": (0, -6, 0), "LLeg2": (0, -62, 0), "LLeg3": (0, 84, 0), "LFoot": (0, 34, 0),
    "RLeg1": (0, -20, 0), "RLeg2": (0, -48, 0), "RLeg3": (0, 66, 0), "RFoot": (0, 30, 0),
    "LLegBack1": (4, 22, 0), "LLegBack2": (0, 36, 0), "LLegBack3": (0, -12, 0),
    "LFootBack": (0, 6, 0),
    "RLegBack1": (-4, 10, 0), "RLegBack2": (0, 48, 0), "RLegBack3": (0, -16, 0),
    "RFootBack": (0, 10, 0),
    "Tail1": (0, 30, 0), "Tail2": (0, 10, 0),
}  # fmt: skip
_CURL: _Degrees = {
    **_LIE, "pelvis": (0, 0, -21),
    **dict.fromkeys(("pelvis0", "spine", "spine0", "spine1", "spine2", "spine3"), (0, 0, 7)),
    "LLeg3": (0, 12, 0), "RLeg3": (0, 12, 0),
    "Neck": (0, 22, 60), "Head": (0, 6, 48),
    "Tail1": (0, 20, -32), **dict.fromkeys(("Tail2", "Tail3", "Tail4"), (0, 0, -32)),
    **dict.fromkeys(("Tail5", "Tail6"), (0, 0, -24)),
}  # fmt: skip
_HEAD_TURNED: _Degrees = {
    "spine3": (0, 0, 8),
    "Neck": (0, -4, 34),
    "Head": (0, 4, 30),
    "LEar": (0, 0, 10),
    "REar": (0, 0, 10),
}

POSES: Mapping[str, _Degrees] = {
    "stand": {}, "walk": _WALK, "trot": _TROT, "run": _RUN, "graze": _GRAZE, "sit": _SIT,
    "lie": _LIE, "rear": _REAR, "curl": _CURL,
    "head_turned": _HEAD_TURNED,
}  # fmt: skip
"""Pose -> joint -> degrees about x, y and z; joints that are not named are at rest."""
_VARIED = ("stand", "walk", "trot", "run", "graze", "head_turned")
_SPREAD = 0.15  # standard deviation of a random turn, in half ranges of its joint


def named_pose(name: str) -> Tensor:
    """The pose (J, 3) of a name, axis-angle in radians, float64, root first; for any preset.

    Raises:
        ConfigError: naming the poses there are.

    Example:
        >>> named_pose("stand").abs().max().item()
        0.0
    """
    if name not in POSES:
        raise ConfigError(f"pose must be one of {', '.join(POSES)}, got {name!r}")
    return _radians(POSES[name])


def random_pose(generator: torch.Generator) -> Tensor:
    """A plausible pose (J, 3): a named gait or stance, varied within the joints' limits.

    Axis-angle in radians, float64. The root is not turned: where an animal heads is the scene's
    business.

    Example:
        >>> pose = random_pose(torch.Generator().manual_seed(0))
        >>> pose.shape, pose[0].tolist()
        (torch.Size([35, 3]), [0.0, 0.0, 0.0])
    """
    low, high = joint_limits()
    pick = int(torch.randint(len(_VARIED), (1,), generator=generator))
    share = float(torch.rand(1, generator=generator))
    draw = torch.randn(low.shape, generator=generator, dtype=torch.float64).clamp(-2, 2)
    pose = (share * named_pose(_VARIED[pick]) + _SPREAD * draw * (high - low) / 2).clamp(low, high)
    return torch.cat([torch.zeros_like(pose[:1]), pose[1:]])


def _radians(degrees: _Degrees) -> Tensor:
    """A pose (J, 3) in radians of a table's degrees."""
    names = load_quadruped().joint_names
    pose = torch.zeros(len(names), 3, dtype=torch.float64)
    for name, angles in degrees.items():
        pose[names.index(name)] = torch.deg2rad(torch.tensor(angles, dtype=torch.float64))
    return pose


def ground_trans(vertices: Tensor) -> Tensor:
    """The translation (..., 3) that puts the lowest of vertices (..., V, 3) on the ground, z = 0.

    Example:
        >>> ground_trans(torch.tensor([[0.0, 0.0, -0.5], [1.0, 0.0, 2.0]])).tolist()
        [0.0, 0.0, 0.5]
    """
    lowest = vertices[..., 2].amin(dim=-1)
    return torch.stack([torch.zeros_like(lowest), torch.zeros_like(lowest), -lowest], dim=-1)
