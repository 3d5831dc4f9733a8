"""How fast scenes of the synthetic world are drawn and rendered, and what is in them.

Run: OMP_NUM_THREADS=1 python benchmarks/world.py [--scenes N]
"""

import argparse
import time
from collections import Counter

import torch

from animal3dbox.datasets.synthetic.scenes import synthetic_scene
from animal3dbox.datasets.synthetic.world.config import WorldConfig
from animal3dbox.datasets.synthetic.world.render import render_scene
from animal3dbox.datasets.synthetic.world.scene import plan_scene


def main() -> None:
    """Print how fast scenes are planned and rendered, and how many animals are hidden or cut."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", type=int, default=60)
    scenes = parser.parse_args().scenes
    torch.set_num_threads(1)
    config, seconds = (
        WorldConfig(),
        dict.fromkeys(("planning", "rendering", "the whole scene"), 0.0),
    )
    counts: Counter[str] = Counter()
    render_scene(plan_scene(0, 0, config))  # loads the body
    for index in range(scenes):
        begin = time.perf_counter()
        plan = plan_scene(0, index, config)
        middle = time.perf_counter()
        render_scene(plan)
        end = time.perf_counter()
        scene = synthetic_scene(0, index, config)
        seconds["planning"] += middle - begin
        seconds["rendering"] += end - middle
        seconds["the whole scene"] += time.perf_counter() - end
        first = scene.animals[0]
        counts["animals"] += len(scene.animals)
        counts["images with several"] += len(scene.animals) > 1
        counts["first animals partly hidden by others or things"] += first.visible_part < 0.99
        counts["first animals cut by the frame"] += float(first.faces_seen.truncation) > 0.01
    height, width = config.image_hw
    print(f"{scenes} scenes of {width} x {height}, one core")
    for name, total in seconds.items():
        print(f"{name:16} {1e3 * total / scenes:6.1f} ms, {scenes / total:5.1f} a second")
    for name, count in counts.items():
        print(f"{name}: {count}")


if __name__ == "__main__":
    main()
