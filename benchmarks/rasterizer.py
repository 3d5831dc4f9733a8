"""Time of a silhouette against a Python loop over cv2.fillConvexPoly, side by side on one thread.

Run: OMP_NUM_THREADS=1 python benchmarks/rasterizer.py
"""

import argparse
import time
from collections.abc import Callable

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from animal3dbox.geometry.rasterizer import rasterize, silhouette

SHIFT = 6  # fractional bits that fillConvexPoly is given


def blob(n_around: int, n_along: int) -> tuple[Tensor, Tensor]:
    """A closed, lumpy body with four legs and a head.

    Vertices (V, 3) of about unit size, faces (F, 3) outward.
    """
    azimuth = torch.arange(n_around, dtype=torch.float64) * (2 * torch.pi / n_around)
    polar = torch.linspace(0, torch.pi, n_along + 2, dtype=torch.float64)[1:-1]
    phi, theta = torch.meshgrid(azimuth, polar, indexing="ij")
    ring = (
        torch.stack((theta.cos(), theta.sin() * phi.cos(), theta.sin() * phi.sin()), dim=-1)
        .permute(1, 0, 2)
        .reshape(-1, 3)
    )
    directions = torch.cat((ring, torch.tensor([[1.0, 0, 0], [-1.0, 0, 0]], dtype=torch.float64)))
    lumps = torch.tensor(
        [
            [0.6, 0.35, -0.7],
            [0.6, -0.35, -0.7],
            [-0.6, 0.35, -0.7],
            [-0.6, -0.35, -0.7],
            [0.8, 0, 0.6],
        ],
        dtype=torch.float64,
    )
    lumps = lumps / lumps.norm(dim=1, keepdim=True)
    radius = 0.5 + 0.7 * torch.exp(-25 * (1 - directions @ lumps.T)).sum(dim=1, keepdim=True)
    i, k = (
        x.reshape(-1)
        for x in torch.meshgrid(torch.arange(n_along - 1), torch.arange(n_around), indexing="ij")
    )
    a, b = i * n_around + k, i * n_around + (k + 1) % n_around
    c, d = a + n_around, b + n_around
    around = torch.arange(n_around)
    tip, tail = len(ring), len(ring) + 1
    last = (n_along - 1) * n_around
    front = torch.stack((torch.full_like(around, tip), around, (around + 1) % n_around), dim=1)
    back = torch.stack(
        (torch.full_like(around, tail), last + (around + 1) % n_around, last + around), dim=1
    )
    return directions * radius, torch.cat(
        (torch.stack((a, c, b), dim=1), torch.stack((b, c, d), dim=1), front, back)
    )


def fill_by_loop(
    points_px: NDArray[np.float64], faces: NDArray[np.int64], image_hw: tuple[int, int]
) -> NDArray[np.uint8]:
    """The silhouette as a loop over triangles draws it."""
    mask = np.zeros(image_hw, np.uint8)
    corners = np.round(points_px[faces] * 2**SHIFT).astype(np.int32)
    for triangle in corners:
        cv2.fillConvexPoly(mask, triangle, 1, cv2.LINE_8, SHIFT)
    return mask


def fill_by_whole_pixel_loop(
    points_px: NDArray[np.float64], faces: NDArray[np.int64], image_hw: tuple[int, int]
) -> NDArray[np.uint8]:
    """The same with corners rounded to whole pixels, the fastest that the loop can be."""
    mask = np.zeros(image_hw, np.uint8)
    corners = np.round(points_px[faces]).astype(np.int32)
    fill = cv2.fillConvexPoly
    for triangle in corners:
        fill(mask, triangle, 1)
    return mask


def fill_by_plain_loop(
    points_px: NDArray[np.float64], faces: NDArray[np.int64], image_hw: tuple[int, int]
) -> NDArray[np.uint8]:
    """The loop as it is commonly written, rounding the corners of one triangle at a time."""
    mask = np.zeros(image_hw, np.uint8)
    for face in faces:
        cv2.fillConvexPoly(mask, np.round(points_px[face]).astype(np.int32), 1)
    return mask


def seconds(work: Callable[[], object]) -> float:
    """Wall time of one call."""
    begin = time.perf_counter()
    work()
    return time.perf_counter() - begin


def scene(image_hw: tuple[int, int]) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Vertices (V, 3) of a body in the camera frame, its faces (F, 3), and K."""
    height, width = image_hw
    vertices, faces = blob(60, 58)
    K = torch.tensor(
        [[600.0, 0, (width - 1) / 2], [0, 600.0, (height - 1) / 2], [0, 0, 1]], dtype=torch.float64
    )
    turn = torch.tensor([[1.0, 0, 0], [0, 0.25, -1.0], [0.1, 1.0, 0.25]], dtype=torch.float64)
    vertices_cam = vertices @ turn.T + torch.tensor([-0.05, -0.1, 2.0], dtype=torch.float64)
    return vertices_cam, faces, K


def times_of(ways: dict[str, Callable[[], object]], repeats: int) -> dict[str, list[float]]:
    """Wall times of calls, five after one of their own in each round.

    The ways take turns, so that a busy machine slows all of them.
    """
    times: dict[str, list[float]] = {name: [] for name in ways}
    for _ in range(repeats):
        for name, work in ways.items():
            work()
            times[name] += [seconds(work) for _ in range(5)]
    return times


def main() -> None:
    """Print the medians, the ratio and the agreement."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=21)
    repeats = parser.parse_args().repeats
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    height, width = image_hw = (480, 640)
    vertices_cam, faces, K = scene(image_hw)
    points_px = ((vertices_cam @ K.T)[:, :2] / vertices_cam[:, 2:]).numpy()
    drawing = (points_px, faces.numpy(), image_hw)
    ways: dict[str, Callable[[], object]] = {
        "silhouette float64": lambda: silhouette(vertices_cam, faces, K, image_hw),
        "silhouette float32": lambda: silhouette(vertices_cam.float(), faces, K.float(), image_hw),
        "fillConvexPoly loop, subpixel": lambda: fill_by_loop(*drawing),
        "fillConvexPoly loop, whole pixels": lambda: fill_by_whole_pixel_loop(*drawing),
        "fillConvexPoly loop, plain": lambda: fill_by_plain_loop(*drawing),
    }
    times = times_of(ways, repeats)
    slow = [seconds(lambda: rasterize(vertices_cam, faces, K, image_hw)) for _ in range(5)]
    mask = silhouette(vertices_cam, faces, K, image_hw)
    print(
        f"{len(faces)} triangles, {width} x {height}, {100 * float(mask.double().mean()):.0f} %"
        f" covered, median of {5 * repeats} calls"
    )
    medians = {name: float(np.median(values)) for name, values in times.items()}
    medians["rasterize"] = float(np.median(slow))
    for name, median in medians.items():
        ratio = median / medians["silhouette float64"]
        print(f"{name:36s} {1e3 * median:8.2f} ms   {ratio:6.1f} x silhouette")
    drawn = torch.from_numpy(fill_by_loop(*drawing)).bool()
    visible = rasterize(vertices_cam, faces, K, image_hw).face_index >= 0
    for name, other in (("fillConvexPoly loop", drawn), ("rasterize", visible)):
        print(f"IoU with {name}: {float((mask & other).sum()) / float((mask | other).sum()):.6f}")


if __name__ == "__main__":
    main()
