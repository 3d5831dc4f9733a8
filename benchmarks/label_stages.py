"""The cost of labels beside the JPEG decode that every training loader pays, on one thread.

Each call comes right after a decode, as in a loader: the processor's caches are then full of other
things, which makes short calls several times slower than in a loop of their own. Processor time, so
that a busy machine counts little; batches are timed whole, and given per animal.

Run: OMP_NUM_THREADS=1 python benchmarks/label_stages.py
"""

import io
import time
from collections.abc import Callable

import cv2
import numpy as np
import torch
from PIL import Image

from animal3dbox.datasets.bodies.sources import ParametersBody
from animal3dbox.datasets.synthetic.faults import FaultConfig
from animal3dbox.datasets.synthetic.synthetic_set import SyntheticSet, record_of
from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.label import label_animal, label_many
from animal3dbox.labels.types import CuboidLabel, Rejection

SCENES = 24
ROUNDS = 24
QUICK = LabelConfig(surface_share=False, mask_iou=False)
COLD = LabelConfig(surface_share=False)
SOUGHT = LabelConfig(surface_share=False, focal="estimate")
STILL = np.eye(3), np.zeros(3)


class Loader:
    """A synthetic dataset, keypoints with 2 px of noise, as a training loader holds it."""

    def __init__(self) -> None:
        dataset = SyntheticSet(0, SCENES, faults=FaultConfig(noise_px=2.0))
        samples = [
            sample for sample in dataset.samples() if sample.animal is sample.scene.animals[0]
        ]
        self.bodies = dataset.bodies()
        self.records = [record_of(sample) for sample in samples]
        self.masks = [record.mask for record in self.records]
        self.jpegs = [self._jpeg(sample.scene.image.numpy()) for sample in samples]
        self.posed = [self.bodies.body(record) for record in self.records]
        self.float64 = ParametersBody(self.bodies.model, self.bodies.parameters, torch.float64)

    @staticmethod
    def _jpeg(image: np.ndarray) -> bytes:
        file = io.BytesIO()
        Image.fromarray(image).save(file, "JPEG", quality=95)
        return file.getvalue()

    def decode(self, i: int) -> None:
        """Decode a JPEG, which every loader must do: the floor."""
        np.asarray(Image.open(io.BytesIO(self.jpegs[i])).convert("RGB"))

    def arguments(self, i: int, **more: object) -> dict[str, object]:
        """The arguments of label_animal for an animal whose body is posed already."""
        record, body = self.records[i], self.posed[i]
        known = {
            "image_hw": record.image_hw,
            "keypoints_2d": record.keypoints_2d,
            "K": record.K,
            "vocabulary": record.vocabulary,
        }
        return (
            known
            | {
                "keypoints_3d": body.landmarks,
                "vertices": body.vertices,
                "faces": body.faces,
                "template": body.template,
            }
            | more
        )

    def label(self, i: int, config: LabelConfig, **more: object) -> CuboidLabel | Rejection:
        """One label of a posed body."""
        return label_animal(config=config, **self.arguments(i, **more))  # type: ignore[arg-type]

    def with_posing(self, i: int, bodies: ParametersBody) -> CuboidLabel | Rejection:
        """One label of a known camera from SMAL parameters."""
        body = bodies.body(self.records[i])
        return self.label(
            i,
            QUICK,
            keypoints_3d=body.landmarks,
            vertices=body.vertices,
            template=body.template,
            pose=STILL,
        )

    def batch(self, size: int, masks: bool = False) -> list[CuboidLabel | Rejection]:
        """Labels of known cameras from SMAL parameters, many at once."""
        ids = [i % len(self.records) for i in range(size)]
        known = [{"mask": self.masks[i]} if masks else {} for i in ids]
        posed = zip(ids, known, self.bodies.bodies([self.records[i] for i in ids]), strict=True)
        return label_many(
            (
                self.arguments(i, keypoints_3d=b.landmarks, vertices=b.vertices, pose=STILL, **more)
                for i, more, b in posed
            ),
            QUICK,
        )


def stages_of(load: Loader) -> dict[str, tuple[int, Callable[[int], object]]]:
    """Name -> how many animals a stage takes at once, and the stage by an animal's number."""
    return {
        "decode a JPEG": (1, load.decode),
        "pose a body, read its landmarks": (1, lambda i: load.bodies.body(load.records[i])),
        "  the same in float64": (1, lambda i: load.float64.body(load.records[i])),
        "label, known camera": (1, lambda i: load.label(i, QUICK, pose=STILL)),
        "label, known camera and mask": (
            1,
            lambda i: load.label(i, QUICK, pose=STILL, mask=load.masks[i]),
        ),
        "pose and label, known camera": (1, lambda i: load.with_posing(i, load.bodies)),
        "  the same, posed in float64": (1, lambda i: load.with_posing(i, load.float64)),
        "pose and label, 16 at once": (16, lambda i: load.batch(16)),
        "pose and label, 64 at once": (64, lambda i: load.batch(64)),
        "  the same, with their masks": (64, lambda i: load.batch(64, masks=True)),
        "surface share": (
            1,
            lambda i: load.label(i, LabelConfig(mask_iou=False), pose=STILL, mask=load.masks[i]),
        ),
        "mask overlap": (1, lambda i: load.label(i, COLD, pose=STILL, mask=load.masks[i])),
        "cold label, no mask": (1, lambda i: load.label(i, COLD)),
        "cold label with mask overlap": (1, lambda i: load.label(i, COLD, mask=load.masks[i])),
        "  the same, focal length sought": (
            1,
            lambda i: load.label(i, SOUGHT, mask=load.masks[i], K=None),
        ),
    }


def main() -> None:
    """Print medians and means, and their ratios to the decode's median.

    Means count what is dear for a few animals alone: a grid of views, exchanged sides.
    """
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    load = Loader()
    stages = stages_of(load)
    times: dict[str, list[float]] = {name: [] for name in stages}
    for turn in range(ROUNDS * 4):
        for name, (count, stage) in stages.items():
            is_dear = count > 1 or "cold" in name or "sought" in name
            if turn % 4 and is_dear:
                continue
            animal = (turn // 4 if is_dear else turn) % len(load.records)
            load.decode(animal)
            begin = time.process_time()
            stage(animal)
            times[name].append((time.process_time() - begin) / count)
    floor = float(np.median(times["decode a JPEG"]))
    for name, seconds in times.items():
        median, mean = float(np.median(seconds)), float(np.mean(seconds))
        print(
            f"{name:36s} {1e3 * median:8.2f} ms {median / floor:7.2f} decodes,"
            f" mean {mean / floor:7.2f}"
        )


if __name__ == "__main__":
    main()
