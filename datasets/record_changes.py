"""What is changed of a dataset's records, whatever their format, before anybody gets them."""

from dataclasses import replace

from animal3dbox.datasets.records import RecordSet
from animal3dbox.errors import SampleError
from animal3dbox.geometry.camera import intrinsics


def without_places(records: RecordSet) -> RecordSet:
    """The records without where they were seen, and a note if the file says so."""
    with_place = sum(one.sighting.place is not None for one in records.records)
    if not with_place:
        return records
    note = (
        f"the places of {with_place} animals are left behind (keep=('location',) or --keep location"
        " takes them into labels)"
    )
    without = tuple(replace(one, sighting=one.sighting.without_place()) for one in records.records)
    return replace(records, records=without, notes=(*records.notes, note))


def with_focal(records: RecordSet, focal_px: float | None) -> RecordSet:
    """The records with the user's focal length where an image has no camera of its own.

    The dataset's one pose is dropped there, since it held for another camera.
    """
    if focal_px is None:
        return records
    own = {
        id(record)
        for record in records.records
        if record.K is not None and (record.K_source == "given" or record.pose is not None)
    }
    changed = (
        (
            record
            if id(record) in own
            else replace(
                record,
                K=intrinsics(focal_px, record.image_hw).numpy(),
                K_source="given",
                stored_pose=None,
            )
        )
        for record in records.records
    )
    note = (
        f"the focal length given, {focal_px:g} px, is that of {len(records.records) - len(own)} of"
        f" {len(records.records)} animals"
    )
    if own:
        note += "; the images of the others have cameras of their own"
    return replace(records, records=tuple(changed), notes=(*records.notes, note))


def of_unicode(records: RecordSet) -> RecordSet:
    """The records whose names are Unicode, as reports and JSON are.

    The others, of files whose names are no UTF-8, are faults.
    """
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
