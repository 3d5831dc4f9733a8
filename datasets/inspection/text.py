"""An inspection as text."""

from collections.abc import Iterator, Mapping

from animal3dbox.datasets.inspection.result import (
    Animal3DFacts,
    CameraFit,
    Inspection,
    PictureFit,
    Residual,
)

MANY = 12
"""Longer tables of counts are cut."""


def as_text(found: Inspection) -> str:
    """Lines for a terminal."""
    return (
        "\n".join(
            [
                *_counts(found),
                *(_animal3d(found.animal3d) if found.animal3d is not None else ()),
                *_ends(found),
            ]
        )
        + "\n"
    )


def _counts(found: Inspection) -> Iterator[str]:
    yield (
        f"{found.path}: {found.format}, {found.animals} animals in {found.images} images (at most"
        f" {found.largest_group} in one)"
    )
    for name, counts in (
        ("files", found.splits),
        ("vocabulary", found.vocabularies),
        ("categories", found.categories),
    ):
        if counts:
            yield f"{name}: {_told(counts)}"
    yield (
        f"keypoints: {found.keypoints_marked:g} marked (median); confidence as read:"
        f" {_told(found.confidences)}"
    )
    files, masks, cameras = found.image_files, found.masks, found.cameras
    yield (
        f"images: of {files.looked_at} {files.other_size} of another size, {files.turned_by_exif}"
        f" turned by EXIF, {files.unreadable} unreadable"
    )
    yield from (f"  {example}" for example in files.examples)
    yield (
        f"masks: {masks.animals} animals; levels in {masks.looked_at}:"
        f" {_told(masks.levels) or 'none'}; {masks.unusable} unusable"
    )
    yield from (f"  {example}" for example in masks.examples)
    yield f"bodies of its own: {found.bodies.looked_at} looked at, {found.bodies.unusable} unusable"
    yield from (f"  {example}" for example in found.bodies.examples)
    yield (
        f"intrinsics: {_told(cameras.intrinsics)}; exact poses {cameras.exact_poses}, guessed"
        f" {cameras.stored_poses}, lenses {cameras.lenses}"
    )


def _told(counts: Mapping[str, int]) -> str:
    shown = [f"{name} {count}" for name, count in list(counts.items())[:MANY]]
    return ", ".join(shown) + (f", and {len(counts) - MANY} more" if len(counts) > MANY else "")


def _animal3d(facts: Animal3DFacts) -> Iterator[str]:
    for file, keys in facts.top_keys.items():
        yield f"{file} has {', '.join(keys)}"
    yield "keys of entries:"
    for key, count in facts.keys.items():
        yield f"  {key:<14}{count:>7}  {_told(facts.forms.get(key, {}))}"
    yield f"visibility in keypoint_2d: {_told(facts.visibility)}"
    yield (
        f"flength: {facts.flength}; with_tail: {_told(facts.with_tail)}; supercategory:"
        f" {_told(facts.supercategories)}"
    )
    yield from (_picture(fit) for fit in facts.pictures)
    if facts.cameras:
        yield "cameras (stored, and with each animal's best focal length and centre):"
    yield from (f"  {_camera(fit)}" for fit in facts.cameras)


def _short(one: Residual | None) -> str:
    return (
        "-"
        if one is None
        else f"{one.median_px:.2f} px (p95 {one.p95_px:.2f}, {one.median_percent:.1f} %)"
    )


def _picture(fit: PictureFit) -> str:
    return f"{fit.key}, off keypoint_2d: " + "; ".join(
        f"{name} {_short(one)}" for name, one in fit.residuals.items()
    )


def _camera(fit: CameraFit) -> str:
    return (
        f"{fit.target} <- {fit.points}, {fit.frame}: stored {_short(fit.stored)}; best"
        f" {_short(fit.free)} at {fit.focal_px:.0f} px"
    )


def _ends(found: Inspection) -> Iterator[str]:
    for fault in found.faults.first:
        yield f"faulty: {fault.sample_id}: {fault.field}: {fault.problem}"
    if found.faults.count > len(found.faults.first):
        yield f"... and {found.faults.count - len(found.faults.first)} more faults"
    if found.notes:
        yield "the reader says:"
        yield from (f"  {note}" for note in found.notes)
    yield "so:"
    yield from (f"  {answer}" for answer in found.answers)
