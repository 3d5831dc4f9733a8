"""Measurements on a copy of Animal3D of everything that its files leave open."""

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
from animal3dbox.progress import watched


def animal3d_facts(
    path: Path, records: Sequence[AnimalRecord], bodies: BodySource | None
) -> Animal3DFacts:
    """Counts of all entries of a copy, and measurements on those that can be read.

    Args:
        path: of the dataset.
        records: the animals that can be read.
        bodies: the animals' own; None without a model.

    """
    raw = read_raw(path)
    entries = list(raw.entries.values())
    own_bodies = bodies if isinstance(bodies, ParametersBody) else None
    subjects = [
        _subject(record, raw.entries[record.sample_id], own_bodies)
        for record in watched(spread(records, ANIMALS), "reading parameters", unit="animal")
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
        sides=side_facts(
            subjects, VOCABULARY, best, None if own_bodies is None else own_bodies.model
        ),
    )


def _subject(
    record: AnimalRecord, entry: dict[str, object], bodies: ParametersBody | None
) -> Subject:
    """An animal with its entry and its posed landmarks, if it has a body."""
    if bodies is None or record.sample_id not in bodies.parameters:
        return Subject(entry, record, None)
    try:
        return Subject(entry, record, bodies.body(record).landmarks)
    except SampleError:
        return Subject(entry, record, None)  # body_facts counts it
