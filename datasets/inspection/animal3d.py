"""What Animal3D's files leave open, measured on a copy."""

from collections.abc import Sequence
from pathlib import Path

from animal3dbox.datasets.bodies.sources import BodySource, ParametersBody
from animal3dbox.datasets.inspection.animal3d_entries import (
    key_counts,
    key_forms,
    read_raw,
    value_counts,
    visibility_values,
)
from animal3dbox.datasets.inspection.fits import Subject, camera_fits, picture_fit
from animal3dbox.datasets.inspection.measures import spread
from animal3dbox.datasets.inspection.result import Animal3DFacts
from animal3dbox.datasets.inspection.stored_points import ANIMALS, side_facts, stored_points
from animal3dbox.datasets.readers.animal3d.entries import VOCABULARY
from animal3dbox.datasets.records import AnimalRecord
from animal3dbox.errors import SampleError


def animal3d_facts(
    path: Path, records: Sequence[AnimalRecord], bodies: BodySource | None
) -> Animal3DFacts:
    """Counts of all entries, and measurements on those that can be read."""
    raw = read_raw(path)
    entries = list(raw.entries.values())
    fitted = bodies if isinstance(bodies, ParametersBody) else None
    subjects = [
        _subject(record, raw.entries[record.sample_id], fitted)
        for record in spread(records, ANIMALS)
    ]
    cameras = camera_fits(subjects)
    best = next((fit for fit in cameras if fit.target == "keypoint_2d"), None)
    pictures = [
        fit
        for key in ("reproj_kp_2d", "joints_2d")
        if (fit := picture_fit(subjects, key)) is not None
    ]
    return Animal3DFacts(
        top_keys=raw.top_keys,
        entries=raw.counts,
        keys=key_counts(entries),
        forms=key_forms(entries),
        visibility=visibility_values(entries),
        flength=raw.flength,
        with_tail=value_counts(entries, "with_tail", {}),
        supercategories=value_counts(entries, "supercategory", raw.supercategories),
        pictures=pictures,
        cameras=cameras,
        stored_points=stored_points(subjects, VOCABULARY),
        sides=side_facts(subjects, VOCABULARY, best, None if fitted is None else fitted.model),
    )


def _subject(
    record: AnimalRecord, entry: dict[str, object], bodies: ParametersBody | None
) -> Subject:
    """An animal with its posed body, if it has one."""
    if bodies is None or record.sample_id not in bodies.parameters:
        return Subject(entry, record, None)
    try:
        return Subject(entry, record, bodies.body(record).landmarks)
    except SampleError:
        return Subject(entry, record, None)  # check and label report it
