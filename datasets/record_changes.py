"""What is changed of a dataset's records, whatever their format, before anybody gets them."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

from animal3dbox.datasets.records import AnimalRecord, RecordSet
from animal3dbox.datasets.storage.records_on_demand import Change, RecordsOnDemand
from animal3dbox.errors import SampleError
from animal3dbox.geometry.camera import intrinsics


def without_places(records: RecordSet) -> RecordSet:
    """The records without where they were seen, and a note if the file says so."""
    animals = records.records
    if isinstance(animals, RecordsOnDemand):
        with_place = animals.summary.with_place
    else:
        with_place = sum(one.sighting.place is not None for one in animals)
    if not with_place:
        return records
    note = (
        f"the places of {with_place} animals are left behind (keep=('location',) or --keep location"
        " takes them into labels)"
    )
    without = _changed(animals, _without_place)
    return replace(records, records=without, notes=(*records.notes, note))


def _changed(animals: Sequence[AnimalRecord], change: Change) -> Sequence[AnimalRecord]:
    """Records as a function makes them, now or when they are asked for."""
    if isinstance(animals, RecordsOnDemand):
        return animals.changed(change)
    return tuple(map(change, animals))


def _without_place(record: AnimalRecord) -> AnimalRecord:
    return replace(record, sighting=record.sighting.without_place())


def with_focal(records: RecordSet, focal_px: float | None) -> RecordSet:
    """The records with the user's focal length where an image has no camera of its own.

    The dataset's one pose is dropped there, since it held for another camera.
    """
    if focal_px is None:
        return records
    animals = records.records
    own = 0 if isinstance(animals, RecordsOnDemand) else sum(map(_has_own_camera, animals))
    note = (
        f"the focal length given, {focal_px:g} px, is that of {len(animals) - own} of"
        f" {len(animals)} animals"
    )
    if own:
        note += "; the images of the others have cameras of their own"
    with_camera = _changed(animals, partial(_with_focal, focal_px=focal_px))
    return replace(records, records=with_camera, notes=(*records.notes, note))


def _has_own_camera(record: AnimalRecord) -> bool:
    is_own = record.K_source == "given" or record.pose is not None
    return record.K is not None and is_own


def _with_focal(record: AnimalRecord, focal_px: float) -> AnimalRecord:
    if _has_own_camera(record):
        return record
    K = intrinsics(focal_px, record.image_hw).numpy()
    return replace(record, K=K, K_source="given", stored_pose=None)


def of_unicode(records: RecordSet) -> RecordSet:
    """The records whose names are Unicode, as reports and JSON are.

    The others, of files whose names are no UTF-8, are faults.
    """
    if isinstance(records.records, RecordsOnDemand):
        return records  # their names stand in JSON, which is Unicode
    bad = [record.sample_id for record in records.records if not _is_unicode(record.sample_id)]
    if not bad and all(_is_unicode(str(fault)) for fault in records.faults):
        return records
    faults = [
        SampleError(_escaped(str(fault.sample_id)), fault.field, _escaped(str(fault.problem)))
        for fault in records.faults
    ]
    faults += [
        SampleError(_escaped(name), "sample_id", "the file's name is not UTF-8: rename it")
        for name in bad
    ]
    unicode = tuple(record for record in records.records if _is_unicode(record.sample_id))
    return replace(records, records=unicode, faults=tuple(faults))


def _is_unicode(text: str) -> bool:
    """Whether a text holds no byte of a name that is not UTF-8."""
    return text.isascii() or not any("\ud800" <= letter <= "\udfff" for letter in text)


def _escaped(text: str) -> str:
    """A text in which bytes that are no UTF-8 are spelt out."""
    return text.encode("utf-8", "backslashreplace").decode()
