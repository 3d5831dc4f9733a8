"""CPU time of an unmodified kornia pipeline of geometric operations.

Kornia's AugmentationSequential against our alias of it.

Both get the same operations, seeds and pictures, 640 x 480 to 512 x 512, float32, one thread, turn
by turn in one run: once the pictures alone, once with what four cuboids need: K and corners in 3D
for the alias; kornia knows no cameras, so it gets the projected corners as keypoints.

Run: OMP_NUM_THREADS=1 python benchmarks/kornia_alias.py
"""

import argparse
import time
from collections.abc import Callable
from typing import Any

import kornia.augmentation as kornia
import torch
from torch import Tensor

from animal3dbox.geometry.camera import intrinsics, project
from animal3dbox.geometry.cuboid import Cuboid
from animal3dbox.transforms import CameraAugmentationSequential

IMAGE_HW = (480, 640)
PIPELINES: dict[str, Callable[[], list[Any]]] = {
    "flip + affine + resized crop": lambda: [
        kornia.RandomHorizontalFlip(p=0.5),
        kornia.RandomAffine(10.0, (0.05, 0.05), (0.8, 1.2), p=1.0),
        kornia.RandomResizedCrop((512, 512), (0.4, 1.0), p=1.0),
    ],
    "flip + affine + rotation + resized crop": lambda: [
        kornia.RandomHorizontalFlip(p=0.5),
        kornia.RandomAffine(10.0, (0.05, 0.05), (0.8, 1.2), p=1.0),
        kornia.RandomRotation(10.0, p=1.0),
        kornia.RandomResizedCrop((512, 512), (0.4, 1.0), p=1.0),
    ],
}


def scene(count: int) -> tuple[Tensor, Tensor, Tensor]:
    """Noise (B, 3, H, W), K (B, 3, 3) and the corners (B, 4, 8, 3) of four boxes."""
    rng = torch.Generator().manual_seed(0)
    images = torch.rand(count, 3, *IMAGE_HW, generator=rng)
    center = torch.rand(count, 4, 3, generator=rng) * 2 - 1 + torch.tensor([0.0, 0.0, 6.0])
    box = Cuboid(center, torch.eye(3).expand(count, 4, 3, 3), torch.full((count, 4, 3), 0.7))
    return images, intrinsics((700.0, 700.0), IMAGE_HW).float().expand(count, 3, 3), box.corners()


def cpu_ms(call: Callable[[], object], seed: int) -> float:
    """CPU milliseconds of one call after seeding."""
    torch.manual_seed(seed)
    start = time.process_time()
    call()
    return (time.process_time() - start) * 1000


def compare(name: str, count: int, rounds: int, *, targets: bool) -> float:
    """Print one line, and return how many times less CPU the alias takes (median over rounds)."""
    images, K, corners = scene(count)
    points = project(K[:, None], corners)[0].flatten(1, 2)
    their_keys, our_keys = (
        (["input", "keypoints"], ["input", "K", "corners_3d"])
        if targets
        else (["input"], ["input"])
    )
    their_values, our_values = (
        ((images, points), (images, K, corners)) if targets else ((images,), (images,))
    )
    theirs = kornia.AugmentationSequential(*PIPELINES[name](), data_keys=their_keys)
    ours = CameraAugmentationSequential(*PIPELINES[name](), data_keys=our_keys, allow_skew=True)
    times: list[tuple[float, float]] = []
    for seed in range(rounds + 2):
        times.append(
            (cpu_ms(lambda: theirs(*their_values), seed), cpu_ms(lambda: ours(*our_values), seed))
        )
    kornias, alias = (
        float(torch.tensor(column).median()) / count for column in zip(*times[2:], strict=True)
    )
    what = "with targets" if targets else "pictures alone"
    print(
        f"{name}, batch of {count}, {what}: kornia {kornias:.1f} ms a picture, alias {alias:.1f}"
        f" ms, ratio {kornias / alias:.2f}"
    )
    return kornias / alias


def main() -> None:
    """Print one line for each pipeline, size of batch, and with or without targets."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=15)
    rounds: int = parser.parse_args().rounds
    torch.set_num_threads(1)
    for name in PIPELINES:
        for count in (1, 8):
            for targets in (False, True):
                compare(name, count, rounds, targets=targets)


if __name__ == "__main__":
    main()
