"""Time of posing a body: one at a time, in batches of 64, and by the definition, on one thread.

The definition is smal/linear_blend_skinning.py; a loader's worker poses by smal/array_skinning.py,
with vertices in float32 beside a model in float64.

Run: OMP_NUM_THREADS=1 python benchmarks/lbs.py
"""

import time
from collections.abc import Callable

import torch
from torch import Tensor

from animal3dbox.smal import SmalModel, load_quadruped, preset_betas, quadruped_names, random_pose
from animal3dbox.smal.linear_blend_skinning import linear_blend_skinning

BATCH = 64
ROUNDS = 9
CONSTANTS = ("v_template", "shapedirs", "posedirs", "J_regressor", "weights", "parents")


def milliseconds(work: Callable[[], object]) -> float:
    """The median wall time of work."""
    times = []
    with torch.no_grad():
        for _ in range(ROUNDS):
            begin = time.perf_counter()
            work()
            times.append(time.perf_counter() - begin)
    return 1e3 * sorted(times)[ROUNDS // 2]


def ways(model: SmalModel, betas: Tensor, pose: Tensor) -> tuple[float, float, float]:
    """Milliseconds a body by arrays, by arrays with vertices in float32, and by the definition."""
    trans = torch.zeros(len(betas), 3, dtype=betas.dtype)
    constants = {name: getattr(model, name) for name in CONSTANTS}
    arrays = betas.numpy(), pose.numpy(), trans.numpy()
    by_arrays = milliseconds(lambda: model.posed(betas, pose, trans))
    in_float32 = milliseconds(lambda: model.posed_arrays(*arrays, vertices_in=torch.float32))
    definition = milliseconds(lambda: linear_blend_skinning(betas, pose, trans, **constants))
    return by_arrays / len(betas), in_float32 / len(betas), definition / len(betas)


def main() -> None:
    """Print the medians and their ratios, in float64 and float32."""
    torch.set_num_threads(1)
    presets, generator = quadruped_names().presets, torch.Generator().manual_seed(0)
    betas = torch.stack([preset_betas(presets[i % len(presets)]) for i in range(BATCH)])
    poses = torch.stack([random_pose(generator) for _ in range(BATCH)])
    for dtype in (torch.float64, torch.float32):
        model, b, p = load_quadruped().to(dtype), betas.to(dtype), poses.to(dtype)
        single, batch = ways(model, b[:1], p[:1]), ways(model, b, p)
        print(
            f"{model.vertex_count} vertices, {dtype}: single {single[0]:.2f} ms, in {BATCH}s"
            f" {batch[0]:.2f} ms, ratio {single[0] / batch[0]:.1f}"
        )
        for name, (by_arrays, in_float32, definition) in (("single", single), ("batch", batch)):
            print(
                f"  {name}: {100 * by_arrays / definition:.0f} % of the definition's"
                f" {definition:.2f} ms, {100 * in_float32 / definition:.0f} % with vertices in"
                " float32"
            )


if __name__ == "__main__":
    main()
