from math import pi, sqrt

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.optimize import linprog
from scipy.spatial import ConvexHull, HalfspaceIntersection
from scipy.spatial.transform import Rotation
from thorough import thorough
from torch import Tensor

from animal3dbox.errors import ShapeError
from animal3dbox.geometry.box_overlap import box_intersection_volume, box_iou, pairwise_box_iou
from animal3dbox.geometry.cuboid import Cuboid

F64 = torch.float64
Array = NDArray[np.float64]
Boxes = tuple[Array, Array, Array]
EYE = torch.eye(3, dtype=F64)
CLOSE = 1e-9


def vector(*values: float) -> Tensor:
    return torch.tensor(values, dtype=F64)


def cuboids(*boxes: Boxes) -> list[Cuboid]:
    return [Cuboid(*(torch.from_numpy(np.ascontiguousarray(x)) for x in box)) for box in boxes]


def random_rotation(rng: np.random.Generator, n: int) -> Array:
    return np.asarray(Rotation.random(n, random_state=rng).as_matrix())


def turned(rng: np.random.Generator, rotation: Array, angle: Array | float) -> Array:
    axis = rng.normal(size=(len(rotation), 3))
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    return np.asarray(rotation @ Rotation.from_rotvec(axis * angle).as_matrix())


def iou_by_half_spaces(a: Boxes, b: Boxes) -> Array:
    """IoU (N,) one pair at a time: Chebyshev centre, half-space intersection, hull.

    In the first box's axes and half sizes.
    """
    ious = []
    for center_a, rotation_a, size_a, center_b, rotation_b, size_b in zip(*a, *b, strict=True):
        normals = np.concatenate((rotation_b.T, -rotation_b.T)) @ rotation_a * (size_a / 2)
        offsets = np.concatenate((rotation_b.T, -rotation_b.T)) @ (center_b - center_a) + np.tile(
            size_b / 2, 2
        )
        planes = np.concatenate((normals, -offsets[:, None]), axis=1) / np.linalg.norm(
            normals, axis=1, keepdims=True
        )
        planes = np.concatenate((np.eye(3, 4) - np.eye(4)[3], -np.eye(3, 4) - np.eye(4)[3], planes))
        balls = np.concatenate((planes[:, :3], np.ones((12, 1))), axis=1)
        best = linprog(
            [0, 0, 0, -1], A_ub=balls, b_ub=-planes[:, 3], bounds=[(None, None)] * 3 + [(0, None)]
        )
        volume = 0.0
        if best.x is not None and best.x[3] > 1e-10:
            corners = HalfspaceIntersection(planes, best.x[:3], qhull_options="Qt").intersections
            volume = float(ConvexHull(corners, qhull_options="Qt").volume * np.prod(size_a / 2))
        ious.append(volume / (np.prod(size_a) + np.prod(size_b) - volume))
    return np.array(ious)


def generic_pairs(kind: str, rng: np.random.Generator, n: int) -> tuple[Boxes, Boxes]:
    rotation, size_a, size_b = (
        random_rotation(rng, n),
        rng.uniform(0.3, 2, (n, 3)),
        rng.uniform(0.3, 2, (n, 3)),
    )
    shape = {
        "needle": np.array([1, 1e-3, 1e-3]),
        "finer needle": np.array([1, 1e-5, 1e-5]),
        "flat": np.array([1, 1, 1e-3]),
    }.get(kind, np.ones(3))
    shape = shape * {"tiny": 1e-9, "huge": 1e9}.get(kind, 1.0)
    size_a, size_b = size_a * shape, size_b * shape
    center = rng.normal(size=(n, 3)) * shape.max()
    shift = (rotation @ (rng.uniform(-0.45, 0.45, (n, 3)) * size_a)[..., None])[..., 0]
    rotation_b = random_rotation(rng, n)
    if shape.min() < 1e-2 * shape.max():
        rotation_b[::2] = turned(rng, rotation, 1e-3)[::2]
    if kind == "45 degrees":
        rotation_b = (
            rotation @ Rotation.from_rotvec(np.eye(3)[rng.integers(0, 3, n)] * pi / 4).as_matrix()
        )
        shift[::2], size_b[::2] = 0, size_a[::2]
    if kind == "nearly identical":
        rotation_b, shift, size_b = (
            turned(rng, rotation, 10 ** rng.uniform(-6, -2, (n, 1))),
            shift * 1e-3,
            size_a,
        )
    return (center, rotation, size_a), (center + shift, rotation_b, size_b)


@pytest.mark.parametrize(
    "kind",
    ["generic", "needle", "finer needle", "flat", "tiny", "huge", "45 degrees", "nearly identical"],
)
def test_iou_is_that_of_half_space_intersection(kind: str) -> None:  # 2,400 pairs
    a, b = generic_pairs(kind, np.random.default_rng(1), 300)
    expected = iou_by_half_spaces(a, b)
    assert (expected > 0).mean() > 0.3
    np.testing.assert_allclose(box_iou(*cuboids(a, b)).numpy(), expected, rtol=0, atol=CLOSE)


def parallel_pairs(
    kind: str, rng: np.random.Generator, n: int
) -> tuple[Array, Array, Array, Array]:
    """Least and greatest corners of two axis-aligned boxes."""
    low_a, size_a, size_b = (
        rng.normal(size=(n, 3)),
        rng.uniform(0.3, 2, (n, 3)),
        rng.uniform(0.3, 2, (n, 3)),
    )
    shift = rng.uniform(-0.9, 0.9, (n, 3)) * np.minimum(size_a, size_b)
    touching = {"face touching": 1, "edge touching": 2, "corner touching": 3}.get(kind, 0)
    shift[:, :touching] = size_a[:, :touching]
    if kind == "contained":
        size_b, shift = size_a * 0.3, size_a * rng.uniform(0, 0.7, (n, 3))
    if kind == "identical":
        size_b, shift = size_a, np.zeros((n, 3))
    if kind == "coplanar faces":
        shift[:, :2], size_b[:, 1] = 0, size_a[:, 1]
    if kind == "thin":
        scale = 10 ** rng.uniform(-6, 0, (n, 3))
        size_a, size_b, shift = size_a * scale, size_b * scale, shift * scale
    return low_a, low_a + size_a, low_a + shift, low_a + shift + size_b


PARALLEL = [
    "generic",
    "face touching",
    "edge touching",
    "corner touching",
    "contained",
    "identical",
    "coplanar faces",
    "thin",
]


@pytest.mark.parametrize("kind", PARALLEL)
@pytest.mark.parametrize("rotated", [False, True])
def test_iou_of_parallel_boxes_is_that_of_their_overlapping_intervals(
    kind: str, rotated: bool
) -> None:  # 16 x 500 pairs
    rng = np.random.default_rng(2)
    low_a, high_a, low_b, high_b = parallel_pairs(kind, rng, 500)
    common = np.clip(np.minimum(high_a, high_b) - np.maximum(low_a, low_b), 0, None).prod(axis=1)
    expected = common / ((high_a - low_a).prod(axis=1) + (high_b - low_b).prod(axis=1) - common)
    rotation = random_rotation(rng, 500) if rotated else np.tile(np.eye(3), (500, 1, 1))
    centers = [
        (rotation @ ((low + high) / 2)[..., None])[..., 0]
        for low, high in ((low_a, high_a), (low_b, high_b))
    ]
    # One box may be named by other axes: a quarter turn about x, its sizes swapped
    quarter = rotation @ np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    ious = box_iou(
        *cuboids(
            (centers[0], rotation, high_a - low_a),
            (centers[1], quarter, (high_b - low_b)[:, [0, 2, 1]]),
        )
    )
    np.testing.assert_allclose(ious.numpy(), expected, rtol=0, atol=CLOSE)


def test_a_cube_and_itself_turned_by_45_degrees_share_an_octagonal_prism() -> None:
    half = sqrt(0.5)
    turn = torch.tensor([[half, -half, 0], [half, half, 0], [0, 0, 1]], dtype=F64)
    volume = box_intersection_volume(
        Cuboid(vector(0, 0, 0), EYE, vector(1, 1, 1)),
        Cuboid(vector(0, 0, 0), turn, vector(1, 1, 1)),
    )
    assert volume.item() == pytest.approx(2 * (sqrt(2) - 1), abs=1e-14)


def test_boxes_shifted_by_half_share_half() -> None:
    size = vector(2, 1, 3)
    boxes = Cuboid(vector(0, 0, 0), EYE, size), Cuboid(vector(1, 0, 0), EYE, size)
    assert box_intersection_volume(*boxes).item() == pytest.approx(3.0, abs=1e-14)
    assert box_iou(*boxes).item() == pytest.approx(1 / 3, abs=1e-14)


@thorough(60)
@given(seed=st.integers(0, 2**31), exponent=st.floats(-16, 0))
def test_iou_is_symmetric_and_the_same_wherever_the_pair_is_put(seed: int, exponent: float) -> None:
    rng = np.random.default_rng(seed)
    rotation, motion = random_rotation(rng, 8), random_rotation(rng, 1)
    center, size = rng.normal(size=(8, 3)), 10 ** rng.uniform(-3, 0, (8, 3))
    a = (center, rotation, size)
    b = (
        center + size.min(axis=1, keepdims=True) * 10**exponent * rng.normal(size=(8, 3)),
        turned(rng, rotation, 10**exponent),
        size,
    )
    moved = [((motion @ c[..., None])[..., 0] * 3 + 1, motion @ r, s * 3) for c, r, s in (a, b)]
    iou = box_iou(*cuboids(a, b))
    assert float((iou - box_iou(*cuboids(b, a))).abs().max()) < 1e-12
    assert float((iou - box_iou(*cuboids(moved[0], moved[1]))).abs().max()) < 1e-9
    assert 0 <= float(iou.min()) <= float(iou.max()) <= 1


def by_rotation_vector(
    center_a: Tensor,
    turn_a: Tensor,
    size_a: Tensor,
    center_b: Tensor,
    turn_b: Tensor,
    size_b: Tensor,
) -> Tensor:
    def matrix(turn: Tensor) -> Tensor:
        x, y, z = turn.unbind(-1)
        o = torch.zeros_like(x)
        rotation: Tensor = torch.linalg.matrix_exp(
            torch.stack((o, -z, y, z, o, -x, -y, x, o), dim=-1).reshape(-1, 3, 3)
        )
        return rotation

    return box_iou(
        Cuboid(center_a, matrix(turn_a), size_a), Cuboid(center_b, matrix(turn_b), size_b)
    )


def test_gradients_are_those_of_finite_differences_at_generic_positions() -> None:
    generator = torch.Generator().manual_seed(3)
    near, turn = (torch.rand(2, 3, 3, generator=generator, dtype=F64) for _ in range(2))
    size = torch.rand(2, 3, 3, generator=generator, dtype=F64) + 0.7
    arguments = [
        x.clone().requires_grad_() for k in range(2) for x in (near[k] * 0.4, turn[k], size[k])
    ]
    assert float(by_rotation_vector(*arguments).detach().min()) > 0.05
    assert torch.autograd.gradcheck(by_rotation_vector, arguments, atol=1e-7)


@pytest.mark.parametrize("shift", [0.0, 1e-16, 1e-14, 1e-9, 0.5, 1.0, 1.0 + 1e-15, 1.5, 9.0])
@pytest.mark.parametrize("angle", [0.0, 1e-15, 1e-13, 1e-8, pi / 4, pi / 2])
def test_gradients_are_finite_where_boxes_coincide_or_touch(shift: float, angle: float) -> None:
    turn = torch.from_numpy(Rotation.from_rotvec([0, 0, angle]).as_matrix())
    arguments = [
        vector(0, 0, 0),
        EYE.clone(),
        vector(1, 1, 1),
        vector(shift, 0, 0),
        turn,
        vector(1, 1, 1),
    ]
    for argument in arguments:
        argument.requires_grad_()
    iou = box_iou(Cuboid(*arguments[:3]), Cuboid(*arguments[3:]))
    for gradient in torch.autograd.grad(iou, arguments):
        assert bool(torch.isfinite(gradient).all())
        assert float(gradient.abs().max()) < 10


def test_pairwise_iou_is_that_of_each_pair() -> None:
    a, b = generic_pairs("generic", np.random.default_rng(4), 7)
    b = (b[0][:4], b[1][:4], b[2][:4])
    ious = pairwise_box_iou(*cuboids(a, b))
    assert ious.shape == (7, 4)
    for i in range(7):
        for k in range(4):
            single = box_iou(*cuboids((a[0][i], a[1][i], a[2][i]), (b[0][k], b[1][k], b[2][k])))
            assert ious[i, k].item() == pytest.approx(single.item(), abs=1e-15)
    assert pairwise_box_iou(*cuboids((a[0][:0], a[1][:0], a[2][:0]), b)).shape == (0, 4)


def test_batches_broadcast_and_float32_comes_back_as_float32_and_exact_for_equal_boxes() -> None:
    a, _ = generic_pairs("generic", np.random.default_rng(5), 6)
    (exact,) = cuboids(a)
    fields = [x.float() for x in (exact.center, exact.rotation, exact.size)]
    single = Cuboid(*fields)
    ious = box_iou(single, single)
    assert ious.dtype == torch.float32
    assert torch.equal(ious, torch.ones(6))
    assert box_iou(single, exact).dtype == torch.float64
    grid = box_iou(Cuboid(*(x.reshape(2, 3, *x.shape[1:]) for x in fields)), single[0])
    assert grid.shape == (2, 3)
    assert grid[0, 0].item() == 1.0


@pytest.mark.parametrize("which", ["a", "b"])
def test_a_box_without_volume_is_refused_by_name(which: str) -> None:
    box, flat = (Cuboid(vector(0, 0, 0), EYE, vector(1, y, 1)) for y in (1, 0))
    pair = (flat, box) if which == "a" else (box, flat)
    for function in (box_iou, box_intersection_volume):
        with pytest.raises(ShapeError, match=f"the size of {which} must be positive, got 0"):
            function(*pair)


def test_batches_that_do_not_broadcast_are_refused() -> None:
    two, four = (
        Cuboid(torch.zeros(n, 3), torch.eye(3).expand(n, 3, 3), torch.ones(n, 3)) for n in (2, 4)
    )
    with pytest.raises(ShapeError, match="must broadcast"):
        box_iou(two, four)


def test_pairwise_iou_of_one_box_asks_for_a_batch() -> None:
    one = Cuboid(vector(0, 0, 0), EYE, vector(1, 1, 1))
    with pytest.raises(ShapeError, match=r"b must be a batch \(N,\) of boxes, got centers \(3,\)"):
        pairwise_box_iou(Cuboid(one.center[None], EYE[None], one.size[None]), one)


def test_a_rotation_stored_in_float32_costs_no_accuracy() -> None:
    a, b = generic_pairs("generic", np.random.default_rng(6), 50)
    rounded = tuple((c, r.astype(np.float32).astype(np.float64), s) for c, r, s in (a, b))
    np.testing.assert_allclose(
        box_iou(*cuboids(*rounded)).numpy(), iou_by_half_spaces(a, b), rtol=0, atol=1e-6
    )
