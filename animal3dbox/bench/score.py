"""Scoring a result: the metrics of detection on each of its splits, with intervals."""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch

from animal3dbox.bench.made_files import truth_file
from animal3dbox.bench.manifest import usable_manifest
from animal3dbox.bench.results import ResultHead, checked_splits, read_head, read_split
from animal3dbox.datasets.readers.omni3d.reader import read_omni3d
from animal3dbox.datasets.readers.visible_boxes import visible_boxes
from animal3dbox.datasets.records import CuboidRecord, CuboidSet
from animal3dbox.evaluate.comparison_metrics import metric_fields
from animal3dbox.evaluate.files import Evaluation
from animal3dbox.evaluate.tables import Table, table_from_records
from animal3dbox.files import user_path
from animal3dbox.progress import watched
from animal3dbox.training.metrics.box_metrics import BoxMetrics, Metrics

PairedBy = Literal["bbox", "projection"]
"""The 2D boxes whose overlap makes the pairs that errors are taken of."""
IN_BRIEF = (
    *("ap_3d", "ap_3d_h30", "ap_3d_h45", "rel_ap_3d", "heading_median_deg", "flip_rate"),
    *("flank_accuracy", "corner_error", "distance_error"),
)
"""Metrics of the short table, each with its interval."""
COUNTS = ("images", "truths", "predictions", "pairs", "heading_count", "flank_count")
"""Counts of the short table."""
NOTES = (
    "ap_3d: mean average precision over 3D IoU of 0.05 to 0.5; ap_3d_h30, h45: headings within 30,"
    " 45 degrees too; rel_ap_3d: at the best one scale. low to high: 95 %, by resampling images.",
    "Categories do not count. Average precision matches cuboids; errors are of pairs whose 2D boxes"
    " overlap by 0.5 or more, so that a wrong depth does not hide a heading: of the boxes that the"
    " result states (bbox), or else of the projections in the frame (paired_by).",
)


@dataclass(frozen=True)
class SplitScore:
    """The metrics of a result on one split.

    Attributes:
        split: its name.
        paired_by: whose overlap makes the pairs that errors are taken of: "bbox" if the result
            states a 2D box with every cuboid, else the cuboids' "projection".
        metrics: by the keys of docs/metrics.md; None where one is unknown.

    Example:
        >>> SplitScore("test-id", "bbox", {"ap_3d": 1.0}).metrics["ap_3d"]
        1.0
    """

    split: str
    paired_by: PairedBy
    metrics: Metrics


def score_result(
    root: Path | str, folder: Path | str, *, splits: Sequence[str] = (), resamples: int = 200
) -> tuple[ResultHead, list[SplitScore]]:
    """Score a result against a benchmark's truth, or refuse it; pictures need not be there.

    Args:
        root: the benchmark's folder.
        folder: the result's, see docs/bench.md.
        splits: names; none: all of the result.
        resamples: of the images, for the intervals; 0: none.

    Raises:
        DatasetNotFoundError: a file is missing.
        DatasetFormatError: the result is of another version, edition or pixels, is in another
            layout, lacks an image, or has a box that cannot be used; or the truth or VERSION was
            changed.

    Example:
        >>> import tempfile
        >>> from dataclasses import replace
        >>> from animal3dbox.bench import ResultHead, bench_plan, make_bench, write_head
        >>> from animal3dbox.datasets import read_omni3d, write_detections
        >>> plan = bench_plan("small")
        >>> tiny = replace(plan, splits=(replace(plan.split("val"), images=1),))
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     root, result = Path(folder) / "bench", Path(folder) / "result"
        ...     manifest = make_bench(tiny, root)
        ...     truth = root / "truth" / "val.json"
        ...     write_detections(read_omni3d(truth).records, truth, result / "val.json")
        ...     digests = {"val": manifest.splits["val"].digest}
        ...     write_head(
        ...         result,
        ...         ResultHead(
        ...             version="bench-v1",
        ...             edition="small",
        ...             track="image",
        ...             method="truth",
        ...             splits=digests,
        ...         ),
        ...     )
        ...     _, scores = score_result(root, result)
        >>> scores[0].metrics["ap_3d"], scores[0].metrics["flip_rate"]
        (1.0, 0.0)
    """
    root, folder = user_path(root), user_path(folder)
    manifest, head = usable_manifest(root), read_head(folder)
    scores = []
    for name in checked_splits(head, manifest, splits):
        truth = truth_file(root, manifest, name)
        boxes = read_split(folder, name, truth)
        stated = bool(boxes.records) and all(one.box is not None for one in boxes.records)
        paired_by: PairedBy = "bbox" if stated else "projection"
        metrics = _metrics(read_omni3d(truth, look_for_images=False), boxes, paired_by, resamples)
        scores.append(SplitScore(name, paired_by, metrics))
    return head, scores


def score_tables(head: ResultHead, scores: Sequence[SplitScore]) -> Evaluation:
    """The tables of a scored result: in brief, a row a split, and every metric with its interval.

    Example:
        >>> head = ResultHead(
        ...     version="bench-v1", edition="small", track="K", method="ours", splits={})
        >>> tables = score_tables(head, [SplitScore("val", "bbox", {"ap_3d": 0.5})]).tables
        >>> tables[0].rows[0][:2]
        ('val', 0.5)
    """
    about = {
        name: getattr(head, name) for name in ("version", "edition", "track", "method", "note")
    }
    about["notes"] = "; ".join(f"{split}: {note}" for split, note in head.notes.items())
    brief = table_from_records(
        "brief",
        f"{head.method} on {head.version} ({head.edition}), track {head.track}",
        [
            {
                "split": one.split,
                **{name: one.metrics.get(name) for name in (*IN_BRIEF, *COUNTS)},
                "paired_by": one.paired_by,
            }
            for one in scores
        ],
        notes=NOTES,
    )
    rows = tuple(row for one in scores for row in _rows(one))
    columns = ("split", "metric", "value", "low", "high")
    every = Table("metrics", "Every metric", (), columns, rows)
    return Evaluation(brief.title, about, (brief, every))


def _rows(score: SplitScore) -> Iterator[tuple[str, str, float | None, float | None, float | None]]:
    """The rows of a split in the table of every metric."""
    values = score.metrics
    ends = {f"{name}{end}" for name in values for end in ("_low", "_high")}
    for name, value in values.items():
        if name not in ends:
            low, high = (values.get(f"{name}{end}") for end in ("_low", "_high"))
            yield score.split, name, value, low, high


def _metrics(truth: CuboidSet, boxes: CuboidSet, paired_by: PairedBy, resamples: int) -> Metrics:
    """The metrics of boxes in the images of a truth, also in those without any."""
    metrics = BoxMetrics(class_agnostic=True, pair_by="boxes", resamples=resamples)
    of_image = [_by_image(one.records) for one in (boxes, truth)]
    for image in watched(truth.images, "scoring", unit="image"):
        predictions, targets = (_fields(one.get(image.image_id, ()), paired_by) for one in of_image)
        K = torch.from_numpy(image.K)
        metrics.update([predictions], [{**targets, "K": K, "image_id": image.image_id}])
    return metrics.compute()


def _by_image(records: Sequence[CuboidRecord]) -> dict[str, list[CuboidRecord]]:
    """The boxes of each image that has one."""
    of_image: defaultdict[str, list[CuboidRecord]] = defaultdict(list)
    for record in records:
        of_image[record.image_id].append(record)
    return of_image


def _fields(records: Sequence[CuboidRecord], paired_by: PairedBy) -> dict[str, Any]:
    """The boxes of an image as BoxMetrics takes them, with the 2D boxes by which they pair."""
    classes = tuple(sorted({record.category.strip().lower() for record in records}))
    if paired_by == "bbox":
        unknown = np.full(4, np.nan)
        boxes = np.array([unknown if one.box is None else one.box for one in records])
    else:
        boxes = visible_boxes(records).in_frame
    return {
        **metric_fields(records, classes),
        "boxes": torch.from_numpy(boxes.reshape(-1, 4)),
    }
