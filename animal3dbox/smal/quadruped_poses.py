"""Named poses of the embedded quadruped, and random ones within the limits of its joints."""

from collections.abc import Mapping

import torch
from torch import Tensor

from animal3dbox.errors import ConfigError
from animal3dbox.smal.quadruped import load_quadruped

# Degrees about the template's axes (x roll, y pitch, z yaw). About y, positive turns what points ahead downwards and
# what points down backwards; about z, positive turns ahead to the left.
_Degrees = Mapping[str, tuple[float, float, float]]

_WALK: _Degrees = {
    "LLeg1": (0, -22, 0), "LLeg2": (0, 6, 0), "LLeg3": (0, 4, 0),
    "RLeg1": (0, 22, 0), "RLeg2": (0, -8, 0), "RLeg3": (0, 18, 0), "RFoot": (0, 14, 0),
    "LLegBack1": (0, 18, 0), "LLegBack2": (0, -2, 0), "LLegBack3": (0, -2, 0), "LFootBack": (0, 10, 0),
    "RLegBack1": (0, -22, 0), "RLegBack2": (0, 14, 0), "RLegBack3": (0, -4, 0),
    "spine0": (0, 0, 2), "spine2": (0, 0, -2), "Neck": (0, 4, 0), "Tail1": (0, 0, 6), "Tail3": (0, 0, 6),
}  # fmt: skip
_TROT: _Degrees = {
    "LLeg1": (0, -34, 0), "LLeg2": (0, -8, 0), "LLeg3": (0, 30, 0), "LFoot": (0, 10, 0),
    "RLeg1": (0, 26, 0), "RLeg2": (0, -2, 0), "RLeg3": (0, 4, 0), "RFoot": (0, 14, 0),
    "LLegBack1": (0, 26, 0), "LLegBack2": (0, -8, 0), "LLegBack3": (0, 4, 0), "LFootBack": (0, 20, 0),
    "RLegBack1": (0, -34, 0), "RLegBack2": (0, 34, 0), "RLegBack3": (0, -22, 0), "RFootBack": (0, 10, 0),
    "Neck": (0, -6, 0), "Head": (0, 4, 0), "Tail1": (0, -14, 0), "Tail3": (0, -6, 0),
}  # fmt: skip
_GRAZE: _Degrees = {
    "spine2": (0, 6, 0), "spine3": (0, 14, 0), "Neck": (0, 84, 0), "Head": (0, -40, 0), "Mouth": (0, 4, 0),
    "LLeg1": (0, -38, 0), "LLeg2": (0, -4, 0), "LLeg3": (0, 6, 0),
    "RLeg1": (0, -12, 0), "RLeg2": (0, -10, 0), "RLeg3": (0, 4, 0),
    "RLegBack1": (0, -8, 0), "RLegBack2": (0, 6, 0),
}  # fmt: skip
_SIT: _Degrees = {
    "pelvis": (0, -46, 0), "pelvis0": (0, 2, 0), "spine1": (0, 5, 0), "spine2": (0, 5, 0), "spine3": (0, 6, 0),
    "Neck": (0, 8, 0), "Head": (0, 20, 0),
    "LLeg1": (0, 24, 0), "LLeg2": (0, 4, 0), "RLeg1": (0, 24, 0), "RLeg2": (0, 4, 0),
    "LLegBack1": (8, -24, 0), "LLegBack2": (0, 62, 0), "LLegBack3": (0, -62, 0), "LFootBack": (0, 38, 0),
    "RLegBack1": (-8, -24, 0), "RLegBack2": (0, 62, 0), "RLegBack3": (0, -62, 0), "RFootBack": (0, 38, 0),
    "Tail1": (0, 38, 0), "Tail2": (0, 14, 10), "Tail3": (0, 4, 14), "Tail4": (0, 0, 14), "Tail5": (0, 0, 14),
}  # fmt: skip
_LIE: _Degrees = {
    "LLeg1": (6, 24, 0), "LLeg2": (0, -96, 0), "LLeg3": (0, -8, 0), "LFoot": (0, 4, 0),
    "RLeg1": (-6, 24, 0), "RLeg2": (0, -96, 0), "RLeg3": (0, -8, 0), "RFoot": (0, 4, 0),
    "LLegBack1": (12, -46, 0), "LLegBack2": (0, 86, 0), "LLegBack3": (0, -88, 0), "LFootBack": (0, 30, 0),
    "RLegBack1": (-12, -46, 0), "RLegBack2": (0, 86, 0), "RLegBack3": (0, -88, 0), "RFootBack": (0, 30, 0),
    "Neck": (0, -6, 0), "Head": (0, 10, 0), "Tail1": (0, 4, 14), "Tail3": (0, 0, 16), "Tail5": (0, 0, 16),
}  # fmt: skip
_HEAD_TURNED: _Degrees = {"spine3": (0, 0, 8), "Neck": (0, -4, 34), "Head": (0, 4, 30), "LEar": (0, 0, 10), "REar": (0, 0, 10)}

POSES: Mapping[str, _Degrees] = {
    "stand": {}, "walk": _WALK, "trot": _TROT, "graze": _GRAZE, "sit": _SIT, "lie": _LIE, "head_turned": _HEAD_TURNED,
}  # fmt: skip

# How far from the template a random pose may turn each joint, degrees about x, y, z; the root keeps its direction.
_LIMITS_DEG: _Degrees = {
    **dict.fromkeys(("pelvis0", "spine", "spine0", "spine1", "spine2", "spine3"), (4, 5, 6)),
    **{f"{side}Leg{i}": limits for side in "LR" for i, limits in ((1, (8, 30, 4)), (2, (2, 18, 2)), (3, (2, 22, 2)))},
    **{f"{side}LegBack{i}": limits for side in "LR" for i, limits in ((1, (8, 28, 4)), (2, (2, 20, 2)), (3, (2, 18, 2)))},
    **dict.fromkeys(("LFoot", "RFoot", "LFootBack", "RFootBack"), (2, 16, 2)),
    **{f"Tail{i}": (0, 12, 14) for i in range(1, 8)},
    "Neck": (10, 32, 32), "Head": (14, 22, 28), "Mouth": (0, 8, 0), "LEar": (14, 14, 14), "REar": (14, 14, 14),
}  # fmt: skip


def named_pose(name: str) -> Tensor:
    """A pose (J, 3), axis-angle in radians, float64, root first; for any preset.

    Raises:
        ConfigError: naming the poses there are.

    """
    if name not in POSES:
        raise ConfigError(f"pose must be one of {', '.join(POSES)}, got {name!r}")
    return _radians(POSES[name])


def random_pose(generator: torch.Generator) -> Tensor:
    """A plausible pose (J, 3), axis-angle in radians, float64: a named gait or stance, varied within each joint's limits.

    The root is not turned: where an animal heads is the scene's business.
    """
    base = [named_pose(name) for name in ("stand", "walk", "trot", "graze", "head_turned")]
    pick = int(torch.randint(len(base), (1,), generator=generator))
    share = float(torch.rand(1, generator=generator))
    draw = torch.randn(load_quadruped().joint_count, 3, generator=generator, dtype=torch.float64).clamp(-2, 2)
    return share * base[pick] + 0.4 * draw * _radians(_LIMITS_DEG)


def _radians(degrees: _Degrees) -> Tensor:
    names = load_quadruped().joint_names
    pose = torch.zeros(len(names), 3, dtype=torch.float64)
    for name, angles in degrees.items():
        pose[names.index(name)] = torch.deg2rad(torch.tensor(angles, dtype=torch.float64))
    return pose


def ground_trans(vertices: Tensor) -> Tensor:
    """The translation (..., 3) that puts the lowest of vertices (..., V, 3) on the ground, z = 0."""
    lowest = vertices[..., 2].amin(dim=-1)
    return torch.stack([torch.zeros_like(lowest), torch.zeros_like(lowest), -lowest], dim=-1)
