"""Boxes exported to Omni3D, found again by pycocotools' COCOeval: their AP with themselves is 1.

COCOeval matches by upright boxes in the picture; the exact IoU of the cuboids stands in for it
here, as the trainer's own evaluator does with PyTorch3D's. A perfect detector then has an AP of
1.0000, of one export and of two that are joined, unless an id collides or is 0, which COCOeval
takes for "unmatched". The last line shows that: the same file with ids that begin at 0.

Run: pip install pycocotools; OMP_NUM_THREADS=1 python benchmarks/omni3d_self_ap.py
"""

import argparse
import contextlib
import io
import json
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import torch

from animal3dbox.datasets import CuboidRecord, CuboidSet, write_omni3d
from animal3dbox.geometry import Cuboid, pairwise_box_iou

try:
    from pycocotools.coco import COCO
    from pycocotools.cocoeval import COCOeval
except ImportError as error:
    raise SystemExit("pip install pycocotools, which this benchmark alone needs") from error

Content = dict[str, Any]
NAMES = ("cat", "dog", "okapi")
K = np.array([[700.0, 0, 319.5], [0, 700, 239.5], [0, 0, 1]])


def random_boxes(count: int, seed: int) -> CuboidSet:
    """Boxes of random places, turns and sizes in view, three an image, of two categories."""
    rng = np.random.default_rng(seed)
    records = []
    for number in range(count):
        Q, R = np.linalg.qr(rng.normal(size=(3, 3)))
        Q = Q * np.sign(np.diag(R))
        image_id = f"{seed}/{number // 3:03d}.jpg"
        record = CuboidRecord(
            sample_id=f"{image_id}#{number % 3}" if number % 3 else image_id,
            image_id=image_id,
            image_path=None,
            image_hw=(480, 640),
            category=NAMES[seed % 2 + number % 2],
            K=K,
            center=rng.uniform((-2, -1.2, 6), (2, 1.2, 12)),
            rotation=Q * np.linalg.det(Q),
            size=rng.uniform(0.4, 1.6, 3),
        )
        records.append(record)
    return CuboidSet("random", tuple(records), ())


def as_cuboids(annotations: list[Content]) -> Cuboid:
    """The boxes of annotations; Omni3D's own axes do for IoU, which knows no names of sides."""
    fields = [
        torch.tensor([one[key] for one in annotations], dtype=torch.float64)
        for key in ("center_cam", "R_cam", "dimensions")
    ]
    return Cuboid(fields[0], fields[1], fields[2].flip(-1))  # W, H, L lie along z, y, x


class ExactIou(COCOeval):  # type: ignore[misc]
    """COCOeval that matches by the IoU of cuboids."""

    def computeIoU(self, imgId: int, catId: int) -> Any:
        """The IoU (D, G) of an image's detections, best first, with its boxes."""
        found = sorted(self._dts[imgId, catId], key=lambda one: -one["score"])
        there = self._gts[imgId, catId]
        if not found or not there:
            return []
        return pairwise_box_iou(as_cuboids(found), as_cuboids(there)).numpy()


def self_ap(content: Content) -> float:
    """AP over IoU 0.5 to 0.95 of a file's boxes as detections of themselves."""
    rng = np.random.default_rng(0)
    for annotation in content["annotations"]:
        x1, y1, x2, y2 = annotation["bbox2D_trunc"]
        annotation |= {"bbox": [x1, y1, x2 - x1, y2 - y1], "area": (x2 - x1) * (y2 - y1)}
        annotation["iscrowd"] = 0
    with contextlib.redirect_stdout(io.StringIO()):
        there = COCO()
        there.dataset = content
        there.createIndex()
        found = [{**one, "score": rng.uniform(0.2, 1)} for one in content["annotations"]]
        detections = there.loadRes(found)
        evaluation = ExactIou(there, detections, "bbox")
        evaluation.evaluate()
        evaluation.accumulate()
        evaluation.summarize()
    return float(evaluation.stats[0])


def joined(first: Content, second: Content) -> Content:
    """Two files as one, as trainers join them: lists one after the other."""
    return {
        **first,
        "images": first["images"] + second["images"],
        "annotations": first["annotations"] + second["annotations"],
    }


def from_zero(content: Content) -> Content:
    """A file whose annotations' ids begin at 0."""
    shifted = [{**one, "id": one["id"] - 1} for one in content["annotations"]]
    return {**content, "annotations": shifted}


def main() -> None:
    """Print the AP of one export, of two joined, and of ids that begin at 0."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--boxes", type=int, default=91)
    count = parser.parse_args().boxes
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        first = write_omni3d(random_boxes(count, 0), folder / "a.json", categories=NAMES)
        second = random_boxes(count, 1)
        options: Content = {"first_id": first.next_id, "dataset_id": 1}
        write_omni3d(second, folder / "b.json", categories=NAMES, **options)
        files = [json.loads((folder / f"{name}.json").read_text()) for name in "ab"]
    print(f"{count} boxes, one export: self-AP {self_ap(files[0]):.4f}")
    print(f"{2 * count} boxes, two exports joined: self-AP {self_ap(joined(*files)):.4f}")
    print(f"{count} boxes, ids from 0: self-AP {self_ap(from_zero(files[0])):.4f}")


if __name__ == "__main__":
    main()
