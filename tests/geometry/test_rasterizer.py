from math import inf, nan
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from thorough import thorough
from torch import Tensor

from animal3dbox.errors import ShapeError
from animal3dbox.geometry.rasterizer import covered_part, rasterize, silhouette

F64 = torch.float64
SIZES = [(1, 1), (7, 5), (50, 40), (96, 64), (64, 96), (480, 640), (640, 360)]


def intrinsics(image_hw: tuple[int, int], focal: float = 1.0, skew: float = 0.0) -> Tensor:
    height, width = image_hw
    f = focal * max(height, width)
    return torch.tensor(
        [[f, skew, (width - 1) / 2], [0, 0.9 * f, (height - 1) / 2], [0, 0, 1]], dtype=F64
    )


def lumpy_ball(seed: int, rings: int = 9) -> tuple[Tensor, Tensor]:
    """A closed body, faces counter-clockwise outside; triangles at the poles have no area."""
    rng = np.random.default_rng(seed)
    around = 2 * rings
    theta, phi = np.meshgrid(
        np.linspace(0, np.pi, rings + 1), np.arange(around) * 2 * np.pi / around, indexing="ij"
    )
    radius = 1 + 0.3 * rng.normal(size=theta.shape)
    radius[[0, -1]] = 1.0
    points = radius[..., None] * np.stack(
        (np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)), axis=-1
    )
    faces = []
    for i in range(rings):
        for k in range(around):
            a, b = i * around + k, i * around + (k + 1) % around
            faces += [(a, a + around, b), (b, a + around, b + around)]
    return torch.from_numpy(points.reshape(-1, 3)), torch.tensor(faces)


def soup(seed: int, n: int, spread: float = 1.0) -> tuple[Tensor, Tensor]:
    """Triangles that share no corner, some without area, some slivers, some repeated."""
    rng = np.random.default_rng(seed)
    corners = rng.normal(size=(n, 3, 3)) * spread
    corners[::7, 2] = corners[::7, 1]
    corners[1::7, 2] = 0.5 * (corners[1::7, 0] + corners[1::7, 1]) + 1e-7 * rng.normal(
        size=corners[1::7, 0].shape
    )
    faces = torch.arange(3 * n).reshape(n, 3)
    return torch.from_numpy(corners.reshape(-1, 3)), torch.cat((faces, faces[:2]))


def clipped(triangle: NDArray[np.float64], near: float) -> list[NDArray[np.float64]]:
    """The part of one triangle with z >= near, as a fan, corner by corner (Sutherland-Hodgman)."""
    polygon = []
    for a, b in zip(triangle, np.roll(triangle, -1, axis=0), strict=True):
        if a[2] >= near:
            polygon.append(a)
        if (a[2] >= near) != (b[2] >= near):
            polygon.append(a + (near - a[2]) / (b[2] - a[2]) * (b - a))
    return [np.stack((polygon[0], polygon[k], polygon[k + 1])) for k in range(1, len(polygon) - 1)]


def reference(
    vertices: Tensor, faces: Tensor, K: Tensor, image_hw: tuple[int, int], near: float
) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
    """Every pixel centre against the edge functions of every triangle, and the least depth there by
    ray and plane."""
    height, width = image_hw
    v, u = np.mgrid[:height, :width].astype(np.float64)
    rays = np.stack((u, v, np.ones_like(u)), axis=-1) @ np.linalg.inv(K.numpy()).T
    covered, depth = np.zeros(image_hw, bool), np.full(image_hw, np.inf)
    for whole in vertices.numpy()[faces.numpy()]:
        for part in clipped(whole, near):
            px = (part @ K.numpy().T)[:, :2] / part[:, 2:]
            if np.cross(np.append(px[1] - px[0], 0), np.append(px[2] - px[0], 0))[2] < 0:
                px = px[::-1]
            inside = np.ones(image_hw, bool)
            flat = True
            for a, b in zip(px, np.roll(px, -1, axis=0), strict=True):
                side = (b[0] - a[0]) * (v - a[1]) - (b[1] - a[1]) * (u - a[0])
                top_or_left = (b[1] < a[1]) or (b[1] == a[1] and b[0] > a[0])
                inside &= (side > 0) | ((side == 0) & top_or_left)
                flat = flat and bool((np.abs(side) < 1e-300).all())
            if flat:
                continue
            normal = np.cross(whole[1] - whole[0], whole[2] - whole[0])
            covered |= inside
            with np.errstate(all="ignore"):
                z = (normal @ whole[0]) / (rays @ normal)
            depth = np.where(
                inside, np.fmin(depth, np.clip(z, part[:, 2].min(), part[:, 2].max())), depth
            )
    return covered, depth


def iou(a: NDArray[np.bool_], b: NDArray[np.bool_]) -> float:
    union = int((a | b).sum())
    return int((a & b).sum()) / union if union else 1.0


def scene(name: str, image_hw: tuple[int, int]) -> tuple[Tensor, Tensor, Tensor]:
    ball, faces = lumpy_ball(3)
    shift = {
        "inside": (0.031, 0.017, 4.0),
        "partly outside": (1.5, 0.8, 4.0),
        "outside": (30.0, 0, 4.0),
        "larger than the frame": (0.013, 0.007, 1.6),
    }
    shift |= {
        "around the camera": (0.2, 0.1, 0.5),
        "behind": (0, 0, -4.0),
        "skewed": (0.1, 0.017, 4.0),
    }
    if name == "soup":
        vertices, faces = soup(5, 60)
        return vertices + torch.tensor([0, 0, 2.0], dtype=F64), faces, intrinsics(image_hw)
    return (
        ball + torch.tensor(shift[name], dtype=F64),
        faces,
        intrinsics(image_hw, skew=0.2 * image_hw[1] if name == "skewed" else 0.0),
    )


SCENES = [
    "inside",
    "partly outside",
    "outside",
    "larger than the frame",
    "around the camera",
    "behind",
    "skewed",
    "soup",
]


@pytest.mark.parametrize("image_hw", SIZES[:5])
@pytest.mark.parametrize("name", SCENES)
def test_silhouette_and_depth_are_those_of_every_pixel_centre_against_every_triangle(
    name: str, image_hw: tuple[int, int]
) -> None:
    vertices, faces, K = scene(name, image_hw)
    covered, depth = reference(vertices, faces, K, image_hw, near=0.05)
    raster = rasterize(vertices, faces, K, image_hw, near=0.05)
    assert iou(silhouette(vertices, faces, K, image_hw, near=0.05).numpy(), covered) >= 0.9999
    assert iou(raster.face_index.numpy() >= 0, covered) >= 0.9999
    both = covered & (raster.face_index.numpy() >= 0)
    np.testing.assert_allclose(raster.depth.numpy()[both], depth[both], rtol=1e-7)
    assert (raster.depth.numpy()[~both] == inf).all()


@pytest.mark.parametrize("image_hw", SIZES[5:])
def test_silhouette_of_a_large_image_is_that_of_every_pixel_centre(
    image_hw: tuple[int, int],
) -> None:
    vertices, faces, K = scene("partly outside", image_hw)
    covered, _ = reference(vertices, faces[::3], K, image_hw, near=0.05)
    assert iou(silhouette(vertices, faces[::3], K, image_hw, near=0.05).numpy(), covered) >= 0.9999


def test_top_and_left_centres_on_the_boundary_count_and_bottom_and_right_ones_do_not() -> None:
    K = torch.eye(3, dtype=F64)
    square = torch.tensor([[1.0, 1, 1], [4, 1, 1], [4, 3, 1], [1, 3, 1]], dtype=F64)
    expected = torch.zeros(5, 6, dtype=torch.bool)
    expected[1:3, 1:4] = True
    for faces in ([[0, 1, 2], [0, 2, 3]], [[2, 1, 0], [0, 2, 3]], [[1, 2, 3], [3, 0, 1]]):
        assert torch.equal(silhouette(square, torch.tensor(faces), K, (5, 6)), expected)
        assert torch.equal(
            rasterize(square, torch.tensor(faces), K, (5, 6)).face_index >= 0, expected
        )


def test_a_triangle_between_pixel_centres_covers_none_and_one_around_a_centre_covers_that() -> None:
    K = torch.eye(3, dtype=F64)
    small = torch.tensor([[-0.2, -0.2, 1], [0.3, -0.1, 1], [-0.1, 0.3, 1]], dtype=F64)
    faces = torch.tensor([[0, 1, 2]])
    assert silhouette(
        small + torch.tensor([2.0, 1, 0], dtype=F64), faces, K, (3, 4)
    ).nonzero().tolist() == [[1, 2]]
    assert not silhouette(small + torch.tensor([2.5, 1.5, 0], dtype=F64), faces, K, (3, 4)).any()


def folded(corners: Tensor) -> bool:
    a, b, c = corners[:, :2]
    return float((b - a)[0] * (c - a)[1] - (b - a)[1] * (c - a)[0]) <= 0


@thorough(40)
@given(seed=st.integers(0, 2**31), lattice=st.booleans())
def test_triangles_that_tile_a_region_cover_each_of_its_pixels_once(
    seed: int, lattice: bool
) -> None:
    rng = np.random.default_rng(seed)
    grid = np.stack(np.meshgrid(np.arange(7.0), np.arange(6.0)), axis=-1) * 5 - 3
    grid[1:-1, 1:-1] += rng.integers(-2, 3, (4, 5, 2)) if lattice else rng.uniform(-2, 2, (4, 5, 2))
    K = torch.eye(3, dtype=F64)
    vertices = torch.from_numpy(np.concatenate((grid.reshape(-1, 2), np.ones((42, 1))), axis=1))
    faces = []
    for i in range(5):
        for k in range(6):
            a, b, c, d = i * 7 + k, i * 7 + k + 1, i * 7 + k + 7, i * 7 + k + 8
            faces += [[a, b, c], [b, d, c]]
    count = torch.stack(
        [silhouette(vertices, torch.tensor([face]), K, (24, 30)) for face in faces]
    ).sum(dim=0, dtype=torch.int32)
    expected = torch.zeros(24, 30, dtype=torch.int32)
    expected[:22, :27] = 1  # from -3 to 22 and to 27, of which the last ones do not count
    if not any(folded(vertices[torch.tensor(face)]) for face in faces):
        assert torch.equal(count, expected)
    assert torch.equal(silhouette(vertices, torch.tensor(faces), K, (24, 30)), count > 0)
    assert torch.equal(
        rasterize(vertices, torch.tensor(faces), K, (24, 30)).face_index >= 0, count > 0
    )


@thorough(40)
@given(
    seed=st.integers(0, 2**31),
    z=st.floats(-1, 6),
    height=st.integers(1, 70),
    width=st.integers(1, 70),
    cull=st.booleans(),
)
def test_silhouette_is_where_rasterize_sees_a_face(
    seed: int, z: float, height: int, width: int, cull: bool
) -> None:
    for vertices, faces in (lumpy_ball(seed), soup(seed, 40)):
        moved = vertices + torch.tensor([0.1, -0.2, z], dtype=F64)
        K = intrinsics((height, width))
        seen = rasterize(moved, faces, K, (height, width), cull_backfaces=cull).face_index >= 0
        assert torch.equal(silhouette(moved, faces, K, (height, width), cull_backfaces=cull), seen)


@pytest.mark.parametrize("name", ["inside", "around the camera", "soup"])
def test_barycentric_weights_of_the_whole_face_give_the_point_on_the_ray(name: str) -> None:
    vertices, faces, K = scene(name, (50, 40))
    raster = rasterize(vertices, faces, K, (50, 40), near=0.05)
    v, u = torch.nonzero(raster.face_index >= 0).T
    assert len(v) > 100
    weights, corners = raster.barycentric[v, u], vertices[faces[raster.face_index[v, u]]]
    points = (weights[:, None] @ corners)[:, 0]
    normals = torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    fat = normals.norm(dim=1) > 1e-3
    px = (points @ K.T)[:, :2] / points[:, 2:]
    assert float((px - torch.stack((u, v), dim=1))[fat].abs().max()) < 1e-8
    assert float((points[:, 2] - raster.depth[v, u])[fat].abs().max()) < 1e-9
    assert float((weights.sum(dim=1) - 1).abs().max()) < 1e-12
    assert float(weights.min()) >= 0
    assert torch.equal(
        raster.barycentric[raster.face_index < 0],
        torch.zeros(int((raster.face_index < 0).sum()), 3, dtype=F64),
    )


def test_the_lowest_of_equal_faces_and_the_nearest_of_others_is_seen() -> None:
    near, far = [[-9.0, -9, 2], [9, -9, 2], [0, 9, 2]], [[-9.0, -9, 3], [9, -9, 3], [0, 9, 3]]
    vertices = torch.tensor(far + near, dtype=F64)
    faces = torch.tensor([[0, 1, 2], [3, 4, 5], [3, 4, 5], [0, 1, 2]])
    assert rasterize(vertices, faces, intrinsics((8, 8)), (8, 8)).face_index[4, 4] == 1
    assert rasterize(vertices, faces.flip(0), intrinsics((8, 8)), (8, 8)).face_index[4, 4] == 1
    assert rasterize(vertices, faces[[0, 3]], intrinsics((8, 8)), (8, 8)).face_index[4, 4] == 0


def test_culling_drops_exactly_the_faces_seen_from_behind() -> None:
    vertices, faces = lumpy_ball(0)
    vertices = vertices + torch.tensor([0, 0, 4.0], dtype=F64)
    K = intrinsics((60, 60))
    assert torch.equal(
        silhouette(vertices, faces, K, (60, 60), cull_backfaces=True),
        silhouette(vertices, faces, K, (60, 60)),
    )
    one = torch.tensor(
        [[-1.0, -1, 4], [1, -1, 4], [0, 1, 4]], dtype=F64
    )  # clockwise on the screen: the normal points away
    assert not silhouette(one, torch.tensor([[0, 1, 2]]), K, (60, 60), cull_backfaces=True).any()
    assert silhouette(one, torch.tensor([[0, 2, 1]]), K, (60, 60), cull_backfaces=True).any()


@pytest.mark.parametrize("layers", [150, 40_000])
def test_more_layers_than_one_byte_or_two_can_count_are_still_covered(layers: int) -> None:
    vertices = torch.tensor([[-9.0, -9, 2], [9, -9, 2], [0, 9, 2]], dtype=F64).repeat(layers, 1)
    mask = silhouette(
        vertices, torch.arange(3 * layers).reshape(layers, 3), intrinsics((9, 9)), (9, 9)
    )
    assert mask.dtype == torch.bool
    assert torch.equal(
        mask, silhouette(vertices, torch.tensor([[0, 1, 2]]), intrinsics((9, 9)), (9, 9))
    )
    assert mask.any()


def test_small_chunks_give_the_same_raster(monkeypatch: pytest.MonkeyPatch) -> None:
    vertices, faces, K = scene("soup", (50, 40))
    whole, mask = rasterize(vertices, faces, K, (50, 40)), silhouette(vertices, faces, K, (50, 40))
    monkeypatch.setattr("animal3dbox.geometry.rasterizer.ROWS_AT_ONCE", 37)
    parts = rasterize(vertices, faces, K, (50, 40))
    assert torch.equal(parts.face_index, whole.face_index)
    assert torch.equal(parts.depth, whole.depth)
    assert torch.equal(silhouette(vertices, faces, K, (50, 40)), mask)


@pytest.mark.parametrize("shift", [(0.0, 0.0), (-2.5, 0.5), (2.0, -1.5), (30.0, 0.0)])
def test_the_covered_part_is_the_silhouette_at_its_place(shift: tuple[float, float]) -> None:
    vertices, faces = lumpy_ball(0)
    vertices, K = vertices + torch.tensor([*shift, 4.0], dtype=F64), intrinsics((60, 80))
    part, place = covered_part(vertices.numpy(), faces, K.numpy(), (60, 80))
    frame = np.zeros((60, 80), dtype=np.bool_)
    frame[place] = part
    pixels = np.nonzero(silhouette(vertices, faces, K, (60, 80)).numpy())
    assert np.array_equal(np.nonzero(frame), pixels)
    assert part.any() == (shift[0] < 30)
    if shift == (0, 0):
        assert part.shape == tuple(
            at.max() - at.min() + 1 for at in pixels
        )  # of a ball inside the frame no more than needed


@pytest.mark.parametrize("n_vertices", [0, 5])
def test_no_faces_cover_nothing(n_vertices: int) -> None:
    vertices, faces = torch.ones(n_vertices, 3, dtype=F64), torch.zeros(0, 3, dtype=torch.int64)
    assert not silhouette(vertices, faces, intrinsics((4, 6)), (4, 6)).any()
    assert (rasterize(vertices, faces, intrinsics((4, 6)), (4, 6)).face_index == -1).all()


def test_float32_is_kept_and_the_arguments_are_left_as_they_were() -> None:
    vertices, faces, K = scene("around the camera", (20, 30))
    vertices = vertices.float()
    before = (vertices.clone(), faces.clone(), K.clone())
    raster = rasterize(vertices, faces, K.float(), (20, 30))
    silhouette(vertices, faces, K, (20, 30))
    assert raster.depth.dtype == raster.barycentric.dtype == torch.float32
    assert raster.face_index.dtype == torch.int64
    assert all(torch.equal(a, b) for a, b in zip(before, (vertices, faces, K), strict=True))


BAD: dict[str, list[Any]] = {
    "vertices_cam": [torch.tensor([[0.0, 0, nan]] * 3), torch.zeros(3, 2)],
    "faces": [
        torch.tensor([[0, 1, 3]]),
        torch.tensor([[-1, 0, 1]]),
        torch.zeros(1, 4, dtype=torch.int64),
        torch.tensor([[0.0, 1, 2]]),
    ],
    "K": [torch.eye(4), torch.full((3, 3), nan), torch.diag(torch.tensor([1.0, 1.0, 2.0]))],
    "image_hw": [(0, 4), (4, -1), (4, 2.5)],
    "near": [0.0, -1.0, nan],
}


@pytest.mark.parametrize(
    ("name", "k"), [(name, k) for name, values in BAD.items() for k in range(len(values))]
)
def test_a_bad_argument_is_refused_by_name(name: str, k: int) -> None:
    arguments: dict[str, Any] = {
        "vertices_cam": torch.ones(3, 3),
        "faces": torch.tensor([[0, 1, 2]]),
        "K": torch.eye(3),
        "image_hw": (4, 4),
        "near": 0.1,
    }
    arguments[name] = BAD[name][k]
    for draw in (silhouette, rasterize):
        with pytest.raises(ShapeError, match=f"^{name} "):
            draw(**arguments)
