"""The outcome of an inspection as lines of text for a terminal."""

from collections.abc import Iterator, Mapping

from animal3dbox.datasets.inspection.result import (
    Animal3DFacts,
    CameraFit,
    Inspection,
    PictureFit,
    Residual,
)
from animal3dbox.plurals import counted

MANY = 12
"""Number of counts after which a line of them is cut."""


def as_text(inspection: Inspection) -> str:
    """The text of an inspection: counts, measurements, faults, and what follows from them."""
    measurements = () if inspection.animal3d is None else _animal3d(inspection.animal3d)
    lines = [
        *_counts(inspection),
        *_labelings(inspection),
        *_stored_fits(inspection),
        *measurements,
        *_ends(inspection),
    ]
    return "\n".join(lines) + "\n"


def _counts(inspection: Inspection) -> Iterator[str]:
    """Lines on the facts that every format has."""
    yield (
        f"{inspection.path}: {inspection.format}, {counted(inspection.animals, 'animal')} in"
        f" {counted(inspection.images, 'image')} (at most {inspection.largest_group} in one)"
    )
    for name, counts in (
        ("files", inspection.splits),
        ("vocabulary", inspection.vocabularies),
        ("categories", inspection.categories),
    ):
        if counts:
            yield f"{name}: {_counts_phrase(counts)}"
    yield (
        f"keypoints: {inspection.keypoints_marked:g} marked (median); confidence as read:"
        f" {_counts_phrase(inspection.confidences)}"
    )
    files, masks, cameras = inspection.image_files, inspection.masks, inspection.cameras
    yield (
        f"images: of {files.looked_at} {files.other_size} of another size, {files.turned_by_exif}"
        f" turned by EXIF, {files.unreadable} unreadable"
    )
    yield from (f"  {example}" for example in files.examples)
    yield (
        f"masks: {masks.animals} animals; levels in {masks.looked_at}:"
        f" {_counts_phrase(masks.levels) or 'none'}; {masks.unusable} unusable"
    )
    yield from (f"  {example}" for example in masks.examples)
    places = inspection.keypoint_places
    yield f"keypoints beside their animal: {places.misplaced} of {places.looked_at} animals"
    yield from (f"  {example}" for example in places.examples)
    yield (
        f"bodies of its own: {inspection.bodies.looked_at} looked at,"
        f" {inspection.bodies.unusable} unusable"
    )
    yield from (f"  {example}" for example in inspection.bodies.examples)
    yield (
        f"intrinsics: {_counts_phrase(cameras.intrinsics)}; exact poses {cameras.exact_poses},"
        f" guessed {cameras.stored_poses}, lenses {cameras.lenses}"
    )


def _labelings(inspection: Inspection) -> Iterator[str]:
    """Lines on animals whose left and right are exchanged, by the labels they would get."""
    facts = inspection.labelings
    counts = {part: len(samples) for part, samples in facts.exchanged.items()}
    yield (
        f"left and right exchanged, of {facts.labelled} animals labelled:"
        f" {_counts_phrase(counts) or 'none'}"
    )
    for part, samples in facts.exchanged.items():
        yield f"  {part}: {', '.join(samples[:MANY])}" + (", ..." if len(samples) > MANY else "")


def _stored_fits(inspection: Inspection) -> Iterator[str]:
    """Lines on stored bodies that fits contradict, if they were compared."""
    facts = inspection.stored_fits
    if facts is None:
        return
    yield (
        f"stored bodies beside fits: {facts.compared} compared, {len(facts.turned)} with another"
        f" trunk, {len(facts.worse)} with worse keypoints; {facts.unsure} fits are unsure"
    )
    yield from (f"  {example}" for example in facts.examples[:MANY])
    if len(facts.examples) > MANY:
        yield f"  ... and {len(facts.examples) - MANY} more (--json)"


def _counts_phrase(counts: Mapping[str, int]) -> str:
    """Counts by name as a phrase, at most MANY of them."""
    first = [f"{name} {count}" for name, count in list(counts.items())[:MANY]]
    return ", ".join(first) + (f", and {len(counts) - MANY} more" if len(counts) > MANY else "")


def _animal3d(facts: Animal3DFacts) -> Iterator[str]:
    """Lines on the facts that only Animal3D's files have."""
    for file, keys in facts.top_keys.items():
        yield f"{file} has {', '.join(keys)}"
    yield "keys of entries:"
    for key, count in facts.keys.items():
        yield f"  {key:<14}{count:>7}  {_counts_phrase(facts.forms.get(key, {}))}"
    yield f"visibility in keypoint_2d: {_counts_phrase(facts.visibility)}"
    yield (
        f"flength: {facts.flength}; with_tail: {_counts_phrase(facts.with_tail)}; supercategory:"
        f" {_counts_phrase(facts.supercategories)}"
    )
    yield from (_picture(fit) for fit in facts.pictures)
    if facts.cameras:
        yield "cameras (stored, and with each animal's best focal length and centre):"
    yield from (f"  {_camera(fit)}" for fit in facts.cameras)


def _residual_phrase(residual: Residual | None) -> str:
    """A residual as a phrase; "-" if there is none."""
    if residual is None:
        return "-"
    return (
        f"{residual.median_px:.2f} px (p95 {residual.p95_px:.2f}, {residual.median_percent:.1f} %)"
    )


def _picture(fit: PictureFit) -> str:
    """A line on one key's 2D points."""
    return f"{fit.key}, off keypoint_2d: " + "; ".join(
        f"{name} {_residual_phrase(residual)}" for name, residual in fit.residuals.items()
    )


def _camera(fit: CameraFit) -> str:
    """A line on one fitted camera."""
    return (
        f"{fit.target} <- {fit.points}, {fit.frame}: stored {_residual_phrase(fit.stored)}; best"
        f" {_residual_phrase(fit.free)} at {fit.focal_px:.0f} px"
    )


def _ends(inspection: Inspection) -> Iterator[str]:
    """Lines on faults, the reader's notes, and what follows from it all."""
    for fault in inspection.faults.first:
        yield f"faulty: {fault.sample_id}: {fault.field}: {fault.problem}"
    if inspection.faults.count > len(inspection.faults.first):
        yield f"... and {inspection.faults.count - len(inspection.faults.first)} more faults"
    if inspection.notes:
        yield "the reader says:"
        yield from (f"  {note}" for note in inspection.notes)
    yield "so:"
    yield from (f"  {answer}" for answer in inspection.answers)
