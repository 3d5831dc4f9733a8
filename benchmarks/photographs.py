"""Fitted and rigid bodies on photographs: silhouettes, keypoints, and keypoints held out.

    OMP_NUM_THREADS=1 python benchmarks/photographs.py ../shared/photos
    OMP_NUM_THREADS=1 python benchmarks/photographs.py ../shared/photos-others/ap10k.json \
        --images ../shared/photos-others/images

Photographs have no 3D truth. What can be measured on them:

silhouette: intersection over union of the drawn body and the annotated mask. A fit that was given
the mask shows a training error; the column without mask does not.
keypoints: the median distance of the keypoints used, in % of the longer side of their box.
held out: each keypoint is left out of one of four fits (every fourth of those marked), which keep
at least LEAST_KEPT; PCK@0.1 is the part of those left out that are found within 0.1 of the root of
the mask's area, and of the box's where there is no mask.
"""

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from animal3dbox.datasets.bodies.fitted import FittedBodies
from animal3dbox.datasets.bodies.sources import preset_body
from animal3dbox.datasets.formats import read_dataset
from animal3dbox.datasets.read_options import ReadOptions
from animal3dbox.datasets.records import AnimalRecord
from animal3dbox.geometry.arrays import as_numpy
from animal3dbox.geometry.rasterizer import covered_part
from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.fit.fit import fit_animal
from animal3dbox.labels.fit.fitted_body import FittedBody
from animal3dbox.labels.label import label_animal
from animal3dbox.labels.types import CuboidLabel
from animal3dbox.labels.visibility.body_in_picture import mask_overlap
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped

Array = NDArray[np.float64]
QUARTERS, LEAST_KEPT, PCK = 4, 10, 0.1
QUICK = LabelConfig(surface_share=False, mask_iou=False)
BODIES = FittedBodies(load_quadruped())
RIGID = "dog"
TUNING = ("_10591", "_831", "_6410", "_1148", "_6483", "_2495")
"""The photographs of StanfordExtra, every other one, that constants may be chosen on; the other
seven, and those of other datasets, are reported apart."""


@dataclass(frozen=True)
class Shown:
    """A body before its camera.

    Attributes:
        vertices_cam: (V, 3).
        landmarks_cam: (J, 3); NaN where the body has none.
        faces: (F, 3).
        K: (3, 3).
    """

    vertices_cam: Array
    landmarks_cam: Array
    faces: NDArray[np.int64]
    K: Array

    @property
    def pixels(self) -> Array:
        """Where the landmarks are seen, (J, 2)."""
        scaled = self.landmarks_cam @ self.K.T
        pixels: Array = scaled[:, :2] / scaled[:, 2:]
        return pixels


Method = Callable[[AnimalRecord, NDArray[np.bool_] | None], Shown | None]


def fitted(record: AnimalRecord, mask: NDArray[np.bool_] | None) -> Shown | None:
    """The articulated fit, as `label` makes it."""
    fit = fit_animal(
        record.image_hw,
        record.keypoints_2d,
        mask=mask,
        K=record.K,
        vocabulary=record.vocabulary,
        species=BODIES.species_of(record),
        sample_id=record.sample_id,
    )
    if not isinstance(fit, FittedBody):
        return None
    return Shown(fit.vertices_cam, fit.landmarks @ fit.R.T + fit.t, fit.faces, fit.K)


def rigid(record: AnimalRecord, mask: NDArray[np.bool_] | None) -> Shown | None:
    """The standing preset, as `label --body preset` poses its camera."""
    body = preset_body(RIGID).body(record)
    label = label_animal(
        record.image_hw,
        record.keypoints_2d,
        keypoints_3d=body.landmarks,
        vertices=body.vertices,
        faces=body.faces,
        template=body.template,
        landmark_sigma=body.landmark_sigma,
        mask=mask,
        K=record.K,
        vocabulary=record.vocabulary,
        config=QUICK,
    )
    if not isinstance(label, CuboidLabel) or body.landmarks is None or body.vertices is None:
        return None
    R, t = label.R.numpy(), label.t.numpy()
    vertices, landmarks = as_numpy(body.vertices), as_numpy(body.landmarks)
    return Shown(
        vertices @ R.T + t, landmarks @ R.T + t, as_numpy(load_quadruped().faces), label.K.numpy()
    )


METHODS: dict[str, Method] = {"fit": fitted, "rigid": rigid}


@dataclass(frozen=True)
class Row:
    """What is measured of one animal and method.

    Attributes:
        with_mask: silhouette, the mask being given; NaN without a mask.
        without_mask: silhouette, from keypoints alone; likewise.
        keypoints: % of their extent.
        held_out: (N,) whether each keypoint left out is found; none if too few would be kept.
    """

    with_mask: float
    without_mask: float
    keypoints: float
    held_out: tuple[bool, ...]


def row_of(record: AnimalRecord, method: Method) -> Row:
    """The measures of an animal under a method."""
    mask = record.mask
    alone = method(record, None)
    given = alone if mask is None else method(record, mask)
    marked = record.keypoints_2d[:, 2] > 0
    seen = record.keypoints_2d[marked, :2]
    extent = float((seen.max(0) - seen.min(0)).max())
    off = np.full(1, np.nan) if given is None else _distances(given, record)[marked]
    return Row(
        with_mask=_silhouette(given, record, mask),
        without_mask=_silhouette(alone, record, mask),
        keypoints=100 * float(np.nanmedian(off)) / extent,
        held_out=tuple(_held_out(record, method, mask)),
    )


def _distances(shown: Shown, record: AnimalRecord) -> Array:
    """Distances (J,) of landmarks from keypoints, px."""
    distances: Array = np.linalg.norm(shown.pixels - record.keypoints_2d[:, :2], axis=1)
    return distances


def _silhouette(shown: Shown | None, record: AnimalRecord, mask: NDArray[np.bool_] | None) -> float:
    if mask is None:
        return float("nan")
    if shown is None:
        return 0.0
    drawn = covered_part(
        shown.vertices_cam, torch.from_numpy(shown.faces), shown.K, record.image_hw
    )
    return mask_overlap(*drawn, mask)


def _held_out(
    record: AnimalRecord, method: Method, mask: NDArray[np.bool_] | None
) -> Iterator[bool]:
    """Whether each keypoint is found by the fit that does not know it."""
    marked = np.flatnonzero(record.keypoints_2d[:, 2] > 0)
    seen = record.keypoints_2d[marked, :2]
    area = float(np.prod(np.ptp(seen, axis=0)) if mask is None else np.count_nonzero(mask))
    for quarter in range(QUARTERS):
        left_out = marked[quarter::QUARTERS]
        if len(marked) - len(left_out) < LEAST_KEPT:
            continue
        kept = record.keypoints_2d.copy()
        kept[left_out] = 0.0
        shown = method(replace(record, keypoints_2d=kept), mask)
        if shown is None:
            yield from (False for _ in left_out)
            continue
        distances = _distances(shown, record)[left_out]
        yield from (distances[np.isfinite(distances)] < PCK * np.sqrt(area)).tolist()


def report(name: str, rows: list[Row]) -> None:
    """Print the line of a method."""
    held_out = [found for row in rows for found in row.held_out]
    with_mask, without = (
        [getattr(row, field) for row in rows] for field in ("with_mask", "without_mask")
    )
    has_mask = bool(np.isfinite(with_mask).any())
    silhouettes = (
        f"silhouette with mask {np.nanmedian(with_mask):.3f}, least {np.nanmin(with_mask):.3f};"
        f" without {np.nanmedian(without):.3f}, least {np.nanmin(without):.3f}; "
        if has_mask
        else ""
    )
    found = f"{np.mean(held_out):.3f} of {len(held_out)}" if held_out else "none"
    print(
        f"{name:6} {len(rows):3d} | {silhouettes}keypoints"
        f" {np.median([row.keypoints for row in rows]):.1f} % | held out, PCK@{PCK:g} {found}"
    )


def main() -> None:
    """Measure, and print a line an animal and a line a method."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("path", type=Path)
    parser.add_argument("--images", type=Path)
    parser.add_argument("--only", nargs="*", default=[], help="parts of sample ids")
    options = parser.parse_args()
    torch.set_num_threads(1)
    read = ReadOptions() if options.images is None else ReadOptions(images=options.images)
    dataset = read_dataset(options.path, "auto", read)
    records = [
        record
        for record in dataset.records.records
        if isinstance(record, AnimalRecord)
        and BODIES.can_fit(record)
        and (not options.only or any(part in record.sample_id for part in options.only))
    ]
    for name, method in METHODS.items():
        rows = []
        for record in records:
            rows.append(row_of(record, method))
            print(
                f"  {name:6}{record.sample_id[-40:]:42} {rows[-1].with_mask:.3f}"
                f" {rows[-1].without_mask:.3f} {rows[-1].keypoints:5.1f} %"
                f" {sum(rows[-1].held_out)} of {len(rows[-1].held_out)}",
                flush=True,
            )
        report(name, rows)
        is_tuning = [any(part in record.sample_id for part in TUNING) for record in records]
        for words, wanted in (("to tune on", True), ("the others", False)):
            part = [row for row, own in zip(rows, is_tuning, strict=True) if own == wanted]
            if any(is_tuning) and part:
                report(f"{name}, {words}", part)


if __name__ == "__main__":
    main()
