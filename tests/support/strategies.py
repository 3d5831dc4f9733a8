"""Random scenes for the laws: boxes, cameras and clouds of points, in float64."""

import torch
from hypothesis import strategies as st
from torch import Tensor

from animal3dbox.geometry.camera import intrinsics
from animal3dbox.geometry.cuboid import Cuboid
from animal3dbox.geometry.rigid_transforms import rotation_from_axis_angle


def vector(low: float, high: float, n: int = 3) -> st.SearchStrategy[Tensor]:
    return st.lists(st.floats(low, high, allow_subnormal=False), min_size=n, max_size=n).map(
        lambda v: torch.tensor(v, dtype=torch.float64)
    )


def rotations() -> st.SearchStrategy[Tensor]:
    return vector(-3, 3).map(rotation_from_axis_angle)


@st.composite
def cuboids_in_front(draw: st.DrawFn) -> Cuboid:
    """A box whose every corner is well in front of the camera."""
    size = draw(vector(0.1, 3))
    center = draw(vector(-2, 2))
    center[2] = center[2] + 3 + float(size.norm())
    return Cuboid(center, draw(rotations()), size)


@st.composite
def cuboids_anywhere(draw: st.DrawFn) -> Cuboid:
    """A box before, behind or around the camera."""
    return Cuboid(draw(vector(-3, 3)), draw(rotations()), draw(vector(0.1, 3)))


@st.composite
def cameras(draw: st.DrawFn) -> tuple[Tensor, tuple[int, int]]:
    """Intrinsics with an off-centre principal point, unequal focal lengths; an image size."""
    height, width = draw(st.integers(20, 900)), draw(st.integers(20, 900))
    K = intrinsics((draw(st.floats(100, 3000)), draw(st.floats(100, 3000))), (height, width))
    K[0, 2] += draw(st.floats(-100, 100))
    K[1, 2] += draw(st.floats(-100, 100))
    return K, (height, width)
