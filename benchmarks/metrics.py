"""The time of the metrics on 1,000 images, and their AP beside that of pycocotools' COCOeval.

COCOeval is given the IoU of the cuboids, AP3D's thresholds and, in place of areas, depths; the
worlds have two classes, crowds, boxes twice on one animal and false alarms.

Run: OMP_NUM_THREADS=1 python benchmarks/metrics.py (pip install pycocotools for the comparison)
"""

import argparse
import contextlib
import io
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parent.parent / "tests" / "support"))

from scenes import scene

from animal3dbox.training.metrics import BoxMetrics
from animal3dbox.training.metrics.evaluation import DEPTHS_M, IOU_THRESHOLDS

Target = dict[str, Any]
BATCH = 16


def world(images: int, truths: int, detections: int, seed: int) -> list[tuple[Target, Target]]:
    """Predictions and targets of images: most detections about some animal, one in ten anywhere."""
    rng = np.random.default_rng(seed)
    pairs = []
    for number in range(images):
        target = scene(truths, seed=1000 * seed + number, dtype=torch.float32)
        target["center"] = target["center"] * float(rng.choice((1, 2, 6)))  # near, medium, far
        target["labels"] = torch.from_numpy(rng.integers(0, 2, truths))
        target["iscrowd"] = torch.from_numpy((rng.random(truths) < 0.05).astype(np.int64))
        target["scale_known"] = torch.ones(truths, dtype=torch.bool)
        which = torch.from_numpy(rng.integers(0, truths, detections))
        anywhere = torch.from_numpy(rng.random((detections, 1)) < 0.1)
        offset = torch.from_numpy(rng.normal(0, 0.12, (detections, 3))).float()
        grown = torch.from_numpy(rng.uniform(0.8, 1.25, (detections, 3))).float()
        prediction = {
            "center": target["center"][which] + torch.where(anywhere, 10 * offset, offset),
            "rotation": target["rotation"][which],
            "size": target["size"][which] * grown,
            "labels": target["labels"][which],
            "scores": torch.from_numpy(rng.random(detections)),
        }
        pairs.append((prediction, target))
    return pairs


def measured(pairs: Sequence[tuple[Target, Target]], **options: Any) -> tuple[Any, float, float]:
    """The result, and the seconds of all updates and of compute."""
    metrics = BoxMetrics(**options)
    begin = time.perf_counter()
    for start in range(0, len(pairs), BATCH):
        part = pairs[start : start + BATCH]
        metrics.update([prediction for prediction, _ in part], [target for _, target in part])
    middle = time.perf_counter()
    result = metrics.compute()
    return result, middle - begin, time.perf_counter() - middle


def annotations_of(pairs: Sequence[tuple[Target, Target]], side: int) -> list[Target]:
    """COCO's annotations as ExactIou takes them: ids from 1, the depth for the area."""
    rows: list[Target] = []
    for image, pair in enumerate(pairs, start=1):
        boxes = pair[side]
        for k in range(len(boxes["center"])):
            row = {
                "id": len(rows) + 1,
                "image_id": image,
                "category_id": int(boxes["labels"][k]) + 1,
                "bbox": [0.0, 0.0, 1.0, 1.0],
                "iscrowd": int(pair[1]["iscrowd"][k]) if side else 0,
                "area": float(boxes["center"][k, 2]),
                "center_cam": boxes["center"][k].tolist(),
                "R_cam": boxes["rotation"][k].tolist(),
                "dimensions": boxes["size"][k].flip(0).tolist(),
            }
            rows.append(row | ({} if side else {"score": float(boxes["scores"][k])}))
    return rows


def coco_precisions(pairs: Sequence[tuple[Target, Target]]) -> dict[str, float]:
    """AP3D of COCOeval, of all depths and of each range; SystemExit without pycocotools."""
    from omni3d_self_ap import ExactIou
    from pycocotools.coco import COCO

    content = {
        "images": [{"id": number} for number in range(1, len(pairs) + 1)],
        "categories": [{"id": 1, "name": "0"}, {"id": 2, "name": "1"}],
    }
    with contextlib.redirect_stdout(io.StringIO()):
        sides = []
        for side in (1, 0):
            coco = COCO()
            coco.dataset = {**content, "annotations": annotations_of(pairs, side)}
            coco.createIndex()
            sides.append(coco)
        evaluation = ExactIou(*sides, "bbox")
        evaluation.params.iouThrs = np.array(IOU_THRESHOLDS)
        evaluation.params.areaRng = [[-1e9, 1e9], *([*bounds] for bounds in DEPTHS_M.values())]
        evaluation.params.areaRngLbl = ["all", *DEPTHS_M]
        evaluation.evaluate()
        evaluation.accumulate()
    precision = evaluation.eval["precision"][..., -1]  # (T, 101, C, ranges) of 100 detections
    names = ("ap_3d", *(f"ap_3d_{name}" for name in DEPTHS_M))
    return {
        name: float(precision[..., k][precision[..., k] > -1].mean())
        for k, name in enumerate(names)
    }


def main() -> None:
    """Print the times, and the greatest difference to COCOeval over some worlds."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--images", type=int, default=1000)
    parser.add_argument("--worlds", type=int, default=5)
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    pairs = world(arguments.images, 3, 10, seed=0)
    cases: dict[str, dict[str, Any]] = {
        "AP and errors": {"resamples": 0, "relative": False},
        "with intervals": {"relative": False},
        "with intervals and Rel-AP3D": {},
    }
    for name, options in cases.items():
        result, update, compute = measured(pairs, **options)
        print(
            f"{arguments.images} images x 3 truths x 10 boxes, {name}: update {update:.2f} s,"
            f" compute {compute:.2f} s, AP3D {result['ap_3d']:.4f}"
        )
    worst = 0.0
    for seed in range(1, arguments.worlds + 1):
        pairs = world(60, 4, 12, seed)
        theirs, (ours, _, _) = coco_precisions(pairs), measured(pairs, resamples=0, relative=False)
        worst = max(worst, *(abs(ours[name] - value) for name, value in theirs.items()))
        print(f"world {seed}: " + ", ".join(f"{k} {v:.4f}" for k, v in theirs.items()))
    print(f"greatest difference to COCOeval: {worst:.1e}")


if __name__ == "__main__":
    main()
