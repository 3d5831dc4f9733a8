"""Time of posing a body, one at a time against batches of 64, side by side on one thread.

Run: OMP_NUM_THREADS=1 python benchmarks/lbs.py
"""

import time

import torch
from torch import Tensor

from animal3dbox.smal.model import SmalModel
from animal3dbox.smal.quadruped.poses import random_pose
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped, preset_betas, quadruped_names

BATCH = 64
ROUNDS = 9


def seconds(model: SmalModel, betas: Tensor, poses: Tensor) -> float:
    """Wall time of posing a batch."""
    trans = torch.zeros(len(betas), 3, dtype=betas.dtype)
    begin = time.perf_counter()
    with torch.no_grad():
        model.posed(betas, poses, trans)
    return time.perf_counter() - begin


def main() -> None:
    """Print the medians and their ratio, in float64 and float32."""
    torch.set_num_threads(1)
    presets, generator = quadruped_names().presets, torch.Generator().manual_seed(0)
    betas = torch.stack([preset_betas(presets[i % len(presets)]) for i in range(BATCH)])
    poses = torch.stack([random_pose(generator) for _ in range(BATCH)])
    for dtype in (torch.float64, torch.float32):
        model, b, p = load_quadruped().to(dtype), betas.to(dtype), poses.to(dtype)
        singles, batches = [], []
        for _ in range(ROUNDS):
            singles += [seconds(model, b[i : i + 1], p[i : i + 1]) for i in range(8)]
            batches.append(seconds(model, b, p) / BATCH)
        single, batch = 1e3 * sorted(singles)[len(singles) // 2], 1e3 * sorted(batches)[ROUNDS // 2]
        print(
            f"{model.vertex_count} vertices, {dtype}: single {single:.2f} ms, in {BATCH}s"
            f" {batch:.2f} ms, ratio {single / batch:.1f}"
        )


if __name__ == "__main__":
    main()
