import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from animal3dbox.geometry.frame import frame_box
from animal3dbox.geometry.mesh_bounds import bounds_in_frame

FRAME = frame_box((3, 5))
ONE = torch.tensor([[0, 1, 2]])


@pytest.mark.parametrize(
    ("triangle", "expected"),
    [
        ([(0, 0), (2, 0), (0, 2)], (0, 0, 2, 2)),  # inside
        ([(-4, 1), (2, 0), (2, 2)], (-0.5, 0, 2, 2)),  # reaches out to the left
        (
            [(2, 1), (4, -3), (6, 1)],
            (2, -0.5, 4.5, 1),
        ),  # over the top and the right, round a corner of the frame
        ([(-50, -50), (99, -50), (-50, 99)], (-0.5, -0.5, 4.5, 2.5)),  # covers all of it
        ([(-9, 1), (1, -9), (-9, -9)], None),  # its own box meets the frame, it does not
        ([(-9, -0.5), (-8, -0.5), (-7, -0.5)], None),  # flat, in line with the frame's top
        ([(9, 9), (8, 9), (9, 8)], None),
    ],
)
def test_the_bounds_of_a_triangle_in_the_frame(
    triangle: list[tuple[float, float]], expected: tuple[float, ...] | None
) -> None:
    found = bounds_in_frame(np.array(triangle, dtype=float).T, ONE, FRAME)
    assert (None if found is None else found.tolist()) == (
        None if expected is None else list(expected)
    )


def test_vertices_of_no_face_do_not_count() -> None:
    px = np.array([[0.0, 1, 0, 4], [0, 0, 1, 2]])
    found = bounds_in_frame(px, ONE, FRAME)
    assert found is not None
    assert found.tolist() == [0, 0, 1, 1]


def clipped(polygon: NDArray[np.float64]) -> NDArray[np.float64]:
    """A convex polygon (N, 2) cut by the frame's sides one after the other: the slow, plain way."""
    for side in range(4):
        axis, sign = side % 2, 1 if side < 2 else -1
        depth = sign * (polygon[:, axis] - FRAME[side])
        corners: list[NDArray[np.float64]] = []
        for i, here in enumerate(polygon):
            j = (i + 1) % len(polygon)
            corners += [here] if depth[i] >= 0 else []
            if (depth[i] >= 0) != (depth[j] >= 0):
                corners.append(here + depth[i] / (depth[i] - depth[j]) * (polygon[j] - here))
        polygon = np.array(corners).reshape(-1, 2)
    return polygon


@given(arrays(np.float64, (4, 3, 2), elements=st.integers(-40, 60).map(lambda x: x / 7)))
def test_the_bounds_are_those_of_all_triangles_cut_one_by_one(
    triangles: NDArray[np.float64],
) -> None:
    left = np.concatenate([clipped(triangle) for triangle in triangles])
    found = bounds_in_frame(triangles.reshape(-1, 2).T, torch.arange(12).reshape(4, 3), FRAME)
    if found is None:
        assert not len(left)
    elif len(left):
        assert np.abs(found - np.concatenate((left.min(0), left.max(0)))).max() < 1e-9
