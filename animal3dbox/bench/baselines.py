"""Baselines that run on a CPU: detectors without pixels, and this package's own labeller.

`constant` and `nearest` are told the 2D boxes and K of the track box, and learn from train;
`labels-fit` and `labels-preset` are told the keypoints, K and categories of the track keypoints.
"""

from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import torch

from animal3dbox.bench.editions import Baseline, Track
from animal3dbox.bench.made_files import check_pictures, keypoints_file, truth_file
from animal3dbox.bench.manifest import Manifest, usable_manifest
from animal3dbox.bench.results import ResultHead, extended_head, write_head
from animal3dbox.bench.split_files import split_paths
from animal3dbox.bench.verify import whole_splits
from animal3dbox.datasets.bodies.options import body_source
from animal3dbox.datasets.exchange.detection_writer import write_detections
from animal3dbox.datasets.labelling.label_records import label_records
from animal3dbox.datasets.labelling.label_requests import request_of_record
from animal3dbox.datasets.readers.coco.reader import read_coco
from animal3dbox.datasets.readers.cuboid_conventions import COCO, Floats
from animal3dbox.datasets.readers.elements import Matrix
from animal3dbox.datasets.readers.omni3d.reader import read_omni3d
from animal3dbox.datasets.records import AnimalRecord, CuboidRecord, CuboidSet
from animal3dbox.datasets.storage.json_files import decode_json
from animal3dbox.errors import SampleError
from animal3dbox.evaluate.comparison_metrics import metric_fields
from animal3dbox.files import user_path
from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.types import CuboidLabel, Rejection
from animal3dbox.progress import watched
from animal3dbox.training.detector_targets.baselines import (
    ConstantBaseline,
    NearestNeighbourBaseline,
)
from animal3dbox.training.detector_targets.box_coder import BoxCoder

TRACK_OF: dict[Baseline, Track] = {
    "constant": "box",
    "nearest": "box",
    "labels-fit": "keypoints",
    "labels-preset": "keypoints",
}
"""The track that each baseline is of."""
TRAIN = "train"
AT_ONCE = 16
"""Animals that are labelled together, which share the cost of posing."""


@dataclass(frozen=True)
class Answers:
    """What a baseline says of a split.

    Attributes:
        records: the boxes.
        left_out: how many animals have none, by the reason.
    """

    records: list[CuboidRecord]
    left_out: Counter[str] = field(default_factory=Counter)

    @property
    def note(self) -> str:
        """Words on the animals without a box; empty if there are none."""
        if not self.left_out:
            return ""
        reasons = ", ".join(f"{count} {reason}" for reason, count in self.left_out.most_common())
        return f"{self.left_out.total()} animals have no box ({reasons})"


Detector = Callable[[str], Answers]
"""From the name of a split to what is said of it."""


def run_baseline(
    root: Path | str, baseline: Baseline, folder: Path | str, *, splits: Sequence[str]
) -> ResultHead:
    """Write a baseline's result on some splits, as a detector's would be.

    Args:
        root: the benchmark's folder; constant and nearest need its split train.
        baseline: its name.
        folder: of the result: new, or of the same baseline, whose other splits stay in it.
        splits: names of whole splits.

    Returns:
        The content of about.json, which names every split that is there; its notes count the
        animals without a box by the reason.

    Raises:
        ConfigError: a split is not whole, or the folder holds another result.
        DatasetNotFoundError: a file is missing.
        DatasetFormatError: the truth, the keypoints or VERSION were changed, or pictures are
            missing or have another size.

    Example:
        >>> import tempfile
        >>> from dataclasses import replace
        >>> from animal3dbox.bench import bench_plan, make_bench, score_result
        >>> plan = bench_plan("small")
        >>> tiny = replace(plan, splits=(replace(plan.split("val"), images=2),))
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     root, result = Path(folder) / "bench", Path(folder) / "result"
        ...     _ = make_bench(tiny, root)
        ...     head = run_baseline(root, "labels-preset", result, splits=["val"])
        ...     _, scores = score_result(root, result, resamples=0)
        >>> head.track, scores[0].metrics["images"]
        ('keypoints', 2)
    """
    root, folder = user_path(root), user_path(folder)
    manifest = usable_manifest(root)
    names = whole_splits(root, manifest, splits)
    head = ResultHead(
        version=manifest.version,
        edition=manifest.edition,
        track=TRACK_OF[baseline],
        method=baseline,
        splits={name: manifest.splits[name].digest for name in names},
    )
    extended_head(folder, head)  # refuses a folder of another result before any work
    detector = _detector(root, manifest, baseline)
    notes: dict[str, str] = {}
    for name in names:
        truth = truth_file(root, manifest, name)
        check_pictures(root, truth)
        answers = detector(name)
        write_detections(answers.records, truth, folder / f"{name}.json")
        if answers.note:
            notes[name] = answers.note
    head = extended_head(folder, msgspec.structs.replace(head, notes=notes))
    write_head(folder, head)
    return head


def _detector(root: Path, manifest: Manifest, baseline: Baseline) -> Detector:
    """A baseline, which has learned from train if it learns."""
    if baseline in ("constant", "nearest"):
        whole_splits(root, manifest, [TRAIN])
        train = read_omni3d(truth_file(root, manifest, TRAIN), look_for_images=False)
        model = _fitted_to(train, baseline)
        return lambda split: _without_pixels(
            model, read_omni3d(root / split_paths(split)[0], look_for_images=False)
        )
    body = baseline.removeprefix("labels-")
    return lambda split: _labelled(keypoints_file(root, manifest, split), root, body)


def _fitted_to(train: CuboidSet, baseline: Baseline) -> ConstantBaseline | NearestNeighbourBaseline:
    """A baseline without pixels, fitted to the boxes of train, whatever their species."""
    targets = [target for _, target in _targets(train)]
    kind = ConstantBaseline if baseline == "constant" else NearestNeighbourBaseline
    return kind.fit(BoxCoder(virtual_focal_px=float(train.images[0].image_hw[1])), targets)


def _targets(boxes: CuboidSet) -> Iterator[tuple[list[CuboidRecord], dict[str, Any]]]:
    """The boxes of each image that has one, and what a baseline without pixels is told of them."""
    of_image: defaultdict[str, list[CuboidRecord]] = defaultdict(list)
    for record in boxes.records:
        of_image[record.image_id].append(record)
    for image_id, records in of_image.items():
        fields = metric_fields(records, tuple({one.category for one in records}))
        boxes_2d = torch.from_numpy(np.stack([_box(record) for record in records]))
        names = ("center", "rotation", "size", "K")
        yield (
            records,
            {**{name: fields[name] for name in names}, "boxes": boxes_2d, "image_id": image_id},
        )


def _box(record: CuboidRecord) -> Floats:
    """The 2D box (4,) round a true animal's visible pixels; raises SampleError without one."""
    if record.box is None:
        raise SampleError(record.sample_id, "bbox2D_tight", "is missing: make the split again")
    return record.box


def _without_pixels(
    model: ConstantBaseline | NearestNeighbourBaseline, truth: CuboidSet
) -> Answers:
    """What a baseline says of the 2D boxes of a split."""
    detections = []
    for records, target in watched(_targets(truth), "detecting", unit="image"):
        inputs = {name: target[name] for name in ("boxes", "K", "image_id")}
        boxes = {name: value.numpy() for name, value in model.predict(inputs).items()}
        detections += [
            replace(
                record,
                center=boxes["center"][number],
                rotation=boxes["rotation"][number],
                size=boxes["size"][number],
                score=float(boxes["scores"][number]),
            )
            for number, record in enumerate(records)
        ]
    return Answers(detections)


class _ImageWithK(msgspec.Struct):
    """The part of an image's element in keypoints/SPLIT.json that readers of COCO do not know."""

    file_name: str
    K: Matrix


class _FileWithK(msgspec.Struct):
    images: list[_ImageWithK]


def _labelled(keypoints: Path, root: Path, body: str) -> Answers:
    """The labels that are made of a split's keypoints; an animal without a label has no box."""
    answers = Answers([])
    file: _FileWithK = decode_json(keypoints, _FileWithK)
    K_of = {image.file_name: COCO.K_in(np.array(image.K)) for image in file.images}
    bodies, config = body_source(body), LabelConfig(surface_share=False, mask_iou=False)
    animals = [
        replace(record, K=K_of[record.image_id]) for record in read_coco(keypoints, root).records
    ]
    starts = range(0, len(animals), AT_ONCE)
    for start in watched(starts, "labelling", unit=f"{AT_ONCE} animals"):
        some: list[AnimalRecord] = []
        requests = []
        for record in animals[start : start + AT_ONCE]:
            try:
                requests.append(request_of_record(record, bodies))
            except SampleError as error:
                answers.left_out[error.field] += 1
                continue
            some.append(record)
        outcomes = label_records(requests, config, misplaced="flag")
        for record, outcome in zip(some, outcomes, strict=True):
            if isinstance(outcome, CuboidLabel):
                answers.records.append(_record(record, outcome, K_of[record.image_id]))
            else:
                reason = outcome.reason if isinstance(outcome, Rejection) else outcome.field
                answers.left_out[reason] += 1
    return answers


def _record(animal: AnimalRecord, label: CuboidLabel, K: Floats) -> CuboidRecord:
    """A label as a detection in the camera K (3, 3), whose score is its confidence."""
    return CuboidRecord(
        sample_id=animal.sample_id,
        image_id=animal.image_id,
        image_path=animal.image_path,
        image_hw=animal.image_hw,
        category=animal.category,
        K=K,
        center=label.center.numpy(),
        rotation=label.rotation.numpy(),
        size=label.size.numpy(),
        metric=False,
        box=animal.box,
        score=label.quality.confidence,
    )
