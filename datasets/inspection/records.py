"""Counts and measurements on any dataset by its records: files, masks, bodies, cameras."""

from collections import Counter
from collections.abc import Iterable, Sequence

import numpy as np
import torch
from numpy.typing import NDArray

from animal3dbox.datasets.bodies.sources import BodySource
from animal3dbox.datasets.images.exif import PhotoFacts
from animal3dbox.datasets.images.masks import mask_levels
from animal3dbox.datasets.images.photos import header_facts, stored_size
from animal3dbox.datasets.inspection.measures import residual, spread
from animal3dbox.datasets.inspection.result import (
    BodyFacts,
    CameraFacts,
    FaultFacts,
    FaultLine,
    ImageFacts,
    KeypointFacts,
    MaskFacts,
)
from animal3dbox.datasets.labelling.keypoint_places import keypoints_problem
from animal3dbox.datasets.labelling.label_requests import request_of_record
from animal3dbox.datasets.records import AnimalRecord, RecordSet
from animal3dbox.errors import SampleError
from animal3dbox.geometry.camera import project
from animal3dbox.progress import watched

IMAGES, MASKS, BODIES, PLACES = 200, 100, 60, 1000
"""Numbers of images, masks, bodies and places of keypoints that are looked at."""
FIRST = 20
"""Number of faults that are listed."""


def image_facts(records: Sequence[AnimalRecord]) -> ImageFacts:
    """Counts of image files of another size than annotated, turned by EXIF, or unreadable."""
    by_file = {record.image_path: record for record in records if record.image_path is not None}
    counts, examples = Counter[str](), []
    looked_at = spread(list(by_file.items()), IMAGES)
    for path, record in watched(looked_at, "looking at pictures", unit="picture"):
        try:
            size = stored_size(path, record.sample_id, upright=record.upright)
            orientation = header_facts(path, record.sample_id).orientation
        except SampleError as error:
            counts["unreadable"] += 1
            examples.append(str(error))
            continue
        counts["turned"] += orientation != 1
        if size != record.image_hw:
            counts["other"] += 1
            examples.append(
                f"{record.sample_id}: is {size[1]} x {size[0]}, annotated {record.image_hw[1]} x"
                f" {record.image_hw[0]}"
            )
    return ImageFacts(
        looked_at=len(looked_at),
        other_size=counts["other"],
        turned_by_exif=counts["turned"],
        unreadable=counts["unreadable"],
        examples=examples[:5],
    )


def mask_facts(records: Sequence[AnimalRecord]) -> MaskFacts:
    """Counts of the levels that masks hold, and of masks that cannot be used."""
    with_mask = [
        record for record in records if record.mask_path is not None or record.mask_runs is not None
    ]
    levels, unusable, examples = Counter[str](), 0, []
    looked_at = spread(with_mask, MASKS)
    for record in watched(looked_at, "looking at masks", unit="mask"):
        try:
            levels[_levels(record)] += 1
        except SampleError as error:
            unusable += 1
            examples.append(str(error))
    return MaskFacts(
        animals=len(with_mask),
        looked_at=len(looked_at),
        levels=dict(levels.most_common()),
        unusable=unusable,
        examples=examples[:5],
    )


def _levels(record: AnimalRecord) -> str:
    """A phrase for the levels of a record's mask; raises SampleError if it cannot be read."""
    if record.mask_path is None:
        return "run lengths"
    levels = mask_levels(
        record.mask_path, record.sample_id, record.image_hw, upright=record.upright
    )
    values = np.unique(levels)
    if len(values) == 1:
        return f"only {values[0]}"
    if len(values) == 2 and values[0] == 0:
        return f"0 and {values[1]}"
    return f"{len(values)} levels from {values[0]} to {values[-1]}"


def keypoint_facts(records: Sequence[AnimalRecord]) -> KeypointFacts:
    """Counts of animals whose keypoints lie beside the frame, their box or their mask."""
    looked_at, misplaced, examples = spread(list(records), PLACES), 0, []
    for record in watched(looked_at, "looking at keypoints", unit="animal"):
        if problem := keypoints_problem(record, _usable_mask(record)):
            misplaced += 1
            examples.append(f"{record.sample_id}: keypoints_2d {problem}")
    return KeypointFacts(len(looked_at), misplaced, examples[:5])


def _usable_mask(record: AnimalRecord) -> NDArray[np.bool_] | None:
    """A record's mask (H, W); None without one that can be read, which mask_facts counts."""
    try:
        return request_of_record(record, None, PhotoFacts()).mask
    except SampleError:
        return None


def body_facts(records: Sequence[AnimalRecord], bodies: BodySource | None) -> BodyFacts:
    """Counts of the animals' own bodies that can and cannot be made, on a sample."""
    looked_at = spread(list(records), BODIES) if bodies is not None else []
    examples = []
    for record in watched(looked_at, "making bodies", unit="animal"):
        try:
            if bodies is not None:
                bodies.body(record)
        except SampleError as error:
            examples.append(str(error))
    return BodyFacts(len(looked_at), len(examples), examples[:5])


def camera_facts(records: Sequence[AnimalRecord], bodies: BodySource | None) -> CameraFacts:
    """Counts of intrinsics and poses, and how well bodies project onto their keypoints."""
    sources = Counter("unknown" if record.K is None else record.K_source for record in records)
    with_pose = [
        record
        for record in records
        if record.K is not None and (record.pose or record.stored_pose) is not None
    ]
    pairs = () if bodies is None else _projected(spread(with_pose, BODIES), bodies)
    return CameraFacts(
        intrinsics=dict(sources.most_common()),
        exact_poses=sum(record.pose is not None for record in records),
        stored_poses=sum(record.stored_pose is not None for record in records),
        lenses=sum(record.distortion is not None for record in records),
        residual=residual(pairs),
    )


def _projected(
    records: Iterable[AnimalRecord], bodies: BodySource
) -> Iterable[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Projected landmarks (N, 2) and their marked keypoints (N, 2), of each animal.

    Animals with fewer than four such keypoints are left out.
    """
    for record in records:
        pose = record.pose or record.stored_pose
        if record.K is None or pose is None:
            continue
        try:
            landmarks = torch.as_tensor(bodies.body(record).landmarks)
        except SampleError:
            continue  # body_facts counts it
        R, t, K = (
            torch.from_numpy(np.asarray(part, dtype=np.float64)) for part in (*pose, record.K)
        )
        lens = None if record.distortion is None else torch.from_numpy(record.distortion)
        px, depth = project(K, landmarks @ R.mT + t, lens)
        marked = (record.keypoints_2d[:, 2] > 0) & torch.isfinite(px).all(1).numpy()
        if int(marked.sum()) >= 4 and bool((depth[torch.from_numpy(marked)] > 0).all()):
            yield px.numpy()[marked], record.keypoints_2d[marked, :2]


def fault_facts(records: RecordSet) -> FaultFacts:
    """Counts of faults by field, and the first of them."""
    lines = [
        FaultLine(fault.sample_id or "", fault.field, fault.problem) for fault in records.faults
    ]
    return FaultFacts(
        len(lines), dict(Counter(line.field for line in lines).most_common()), lines[:FIRST]
    )


def confidences(records: Sequence[AnimalRecord]) -> dict[str, int]:
    """Confidence -> number of keypoints; of more than five values, by tenths."""
    values = Counter(float(value) for record in records for value in record.keypoints_2d[:, 2])
    if len(values) > 5:
        tenths = Counter[str]()
        for value, count in values.items():
            tenths["0" if value == 0 else f"up to {np.ceil(10 * value) / 10:g}"] += count
        return dict(sorted(tenths.items()))
    return {f"{value:g}": count for value, count in sorted(values.items())}


def marked_median(records: Sequence[AnimalRecord]) -> float:
    """Number of marked keypoints of the median animal; 0 without any animal."""
    if not records:
        return 0.0
    return float(np.median([int((record.keypoints_2d[:, 2] > 0).sum()) for record in records]))
