"""How often the mask denies an exact camera, and how often a wrong one: `known_cameras.py SEEDS`.

Animals of the synthetic world, 20 images a seed, half of them partly hidden; about 10 s a seed.
"""

import sys
from collections import defaultdict
from typing import Any

import numpy as np
import torch

from animal3dbox.datasets import SyntheticSet
from animal3dbox.datasets.synthetic import WorldConfig
from animal3dbox.geometry.rasterizer import covered_part
from animal3dbox.labels.drafts import LEAST_COVERAGE, LEAST_IOU
from animal3dbox.labels.visibility.body_in_picture import mask_coverage, mask_overlap

WORLD = WorldConfig(image_hw=(240, 320), focal_px=(250.0, 2500.0))


def is_denied(record: Any, body: Any, R: Any, t: Any, K: Any) -> bool:
    """Whether a label under this camera would be flagged off_mask."""
    vertices_cam = np.asarray(body.vertices, dtype=np.float64) @ R.T + t
    if not (vertices_cam[:, 2] > 0).any():
        return True
    drawn = covered_part(vertices_cam, body.faces, K, record.image_hw)
    mask = record.mask
    return mask_coverage(*drawn, mask) < LEAST_COVERAGE or mask_overlap(*drawn, mask) < LEAST_IOU


def wrong_cameras(record: Any, body: Any, other: Any) -> dict[str, tuple[Any, Any, Any]]:
    """R, t and K of cameras that are not the record's; other is another animal's place."""
    R, t = record.stored_pose
    center = np.asarray(body.vertices).mean(0) @ R.T + t
    half, opengl = record.K.copy(), np.diag([1.0, -1.0, -1.0])
    half[:2] /= 2
    around = np.diag([-1.0, 1.0, -1.0])
    return {
        "10 times as far": (R, t + 9 * center, record.K),
        "twice as far": (R, t + center, record.K),
        "half as far": (R, t - 0.5 * center, record.K),
        "turned round": (around @ R, around @ (t - center) + center, record.K),
        "another animal's place": (R, t - center + other, record.K),
        "K of half the picture": (R, t, half),
        "OpenGL's axes": (opengl @ R, opengl @ t, record.K),
    }


def main(seeds: int) -> None:
    """Print the part of labels that would be flagged, under exact cameras and wrong ones."""
    torch.set_num_threads(1)
    denied: defaultdict[str, list[bool]] = defaultdict(list)
    other, count = np.array([0.0, 0.0, 1.0]), 0
    for seed in range(1000, 1000 + seeds):
        world = SyntheticSet(seed=seed, images=20, config=WORLD)
        bodies = world.bodies()
        for record in world.records(stored_pose=True).records:
            if record.stored_pose is None or record.mask is None or not record.mask.any():
                continue
            body, (R, t) = bodies.body(record), record.stored_pose
            denied["exact"].append(is_denied(record, body, R, t, record.K))
            count += 1
            if count % 4 == 0:
                for name, camera in wrong_cameras(record, body, other).items():
                    denied[name].append(is_denied(record, body, *camera))
                other = np.asarray(body.vertices).mean(0) @ R.T + t
    for name, flags in denied.items():
        print(f"{name}: {sum(flags)} of {len(flags)} flagged ({np.mean(flags):.1%})")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 25)
