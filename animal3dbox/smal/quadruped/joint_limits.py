"""The range in which each joint of the embedded quadruped may turn from the standing template."""

from collections.abc import Mapping

import torch
from torch import Tensor

from animal3dbox.smal.quadruped.preset_bodies import load_quadruped

Range = tuple[float, float]
Ranges = tuple[Range, Range, Range]

_STILL: Range = (0.0, 0.0)


def _even(x: float, y: float, z: float) -> Ranges:
    """Ranges that are as wide to either side."""
    return (-x, x), (-y, y), (-z, z)


_VERTEBRA: Ranges = ((-6.0, 6.0), (-10.0, 16.0), (-12.0, 12.0))
_TAIL: Ranges = (_STILL, (-40.0, 40.0), (-40.0, 40.0))

# Degrees about the template's axes, (least, greatest) about x (roll), y (pitch) and z (yaw), as the
# entries of an axis-angle vector. About y, positive turns what points ahead downwards and what
# points down backwards; about z, positive turns ahead to the left; about x, positive turns what
# points down to the left. The table is of the left side; the right side is its mirror image. The
# root's range is that of the named poses: where an animal heads is the scene's business.
_LEFT_DEG: Mapping[str, Ranges] = {
    "pelvis": ((-10.0, 10.0), (-75.0, 30.0), (-40.0, 40.0)),
    **dict.fromkeys(("pelvis0", "spine", "spine0", "spine1", "spine2", "spine3"), _VERTEBRA),
    "Neck": ((-25.0, 25.0), (-40.0, 90.0), (-60.0, 60.0)),
    "Head": ((-30.0, 30.0), (-50.0, 45.0), (-50.0, 50.0)),
    "Mouth": (_STILL, (-4.0, 20.0), _STILL),
    "LEar": _even(30.0, 30.0, 30.0),
    "LLeg1": ((-8.0, 16.0), (-60.0, 45.0), (-8.0, 8.0)),
    "LLeg2": ((-4.0, 4.0), (-115.0, 20.0), (-4.0, 4.0)),
    "LLeg3": ((-4.0, 4.0), (-12.0, 110.0), (-4.0, 4.0)),
    "LFoot": ((-6.0, 6.0), (-35.0, 60.0), (-4.0, 4.0)),
    "LLegBack1": ((-8.0, 26.0), (-70.0, 50.0), (-8.0, 8.0)),
    "LLegBack2": ((-4.0, 4.0), (-20.0, 118.0), (-4.0, 4.0)),
    "LLegBack3": ((-4.0, 4.0), (-112.0, 30.0), (-4.0, 4.0)),
    "LFootBack": ((-6.0, 6.0), (-35.0, 60.0), (-4.0, 4.0)),
    "Tail1": (_STILL, (-50.0, 60.0), (-40.0, 40.0)),
    **{f"Tail{i}": _TAIL for i in range(2, 8)},
}


def _mirrored(ranges: Ranges) -> Ranges:
    """The ranges of the joint's mirror image: a mirror in y turns about x and z the other way."""
    x, y, z = ranges
    return (-x[1], -x[0]), y, (-z[1], -z[0])


JOINT_LIMITS_DEG: Mapping[str, Ranges] = {
    **_LEFT_DEG,
    **{
        "R" + name[1:]: _mirrored(ranges)
        for name, ranges in _LEFT_DEG.items()
        if name.startswith("L")
    },
}
"""Joint -> its ranges in degrees about x, y and z."""


def joint_limits() -> tuple[Tensor, Tensor]:
    """The least and the greatest axis-angle entries of a pose that the quadruped can take.

    Returns:
        (J, 3) each, in radians, float64; the template pose is within them.

    Example:
        >>> least, greatest = joint_limits()
        >>> mouth = load_quadruped().joint_names.index("Mouth")
        >>> torch.rad2deg(greatest[mouth]).round().tolist()  # it opens downwards, about y
        [0.0, 20.0, 0.0]
    """
    table = torch.tensor(
        [JOINT_LIMITS_DEG[name] for name in load_quadruped().joint_names], dtype=torch.float64
    )
    low, high = torch.deg2rad(table).unbind(dim=-1)
    return low, high
