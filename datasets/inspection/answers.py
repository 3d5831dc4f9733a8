"""The meaning of an inspection's numbers, in whole sentences for a person who wants to label."""

from collections.abc import Iterator

from animal3dbox.datasets.inspection.result import (
    Animal3DFacts,
    CameraFit,
    Inspection,
    KeypointFacts,
    PictureFit,
    Residual,
    SideFacts,
    StoredFitFacts,
)
from animal3dbox.datasets.readers.animal3d.camera import CLOSE

CENTRED = 2.0
"""Percent of the focal length by which a camera that fits may differ from the stored one."""


def answers(inspection: Inspection) -> list[str]:
    """Sentences on what an inspection's facts mean, those on faults first."""
    sentences = []
    if inspection.faults.count:
        fields = ", ".join(
            f"{field} {count}" for field, count in inspection.faults.by_field.items()
        )
        sentences.append(f"{inspection.faults.count} samples cannot be used, by field: {fields}")
    sentences += _about_pictures(inspection)
    sentences += _about_masks(inspection)
    sentences += _about_places(inspection.keypoint_places)
    if inspection.bodies.unusable:
        sentences.append(
            f"{inspection.bodies.unusable} of {inspection.bodies.looked_at} bodies looked at cannot"
            f" be used: {inspection.bodies.examples[0]}"
        )
    if inspection.cameras.residual is not None:
        sentences.append(
            "bodies under the cameras that come with them are off their keypoints by"
            f" {_residual_phrase(inspection.cameras.residual)}"
        )
    if inspection.labelings.exchanged:
        count = sum(map(len, inspection.labelings.exchanged.values()))
        sentences.append(
            f"left and right keypoints are exchanged in {count} of"
            f" {inspection.labelings.labelled} animals: labels mend them and say so, or keep them"
            " with --labelings keep"
        )
    if inspection.stored_fits is not None:
        sentences.append(_about_stored_fits(inspection.stored_fits))
    if inspection.animal3d is not None:
        sentences += _about_animal3d(inspection.animal3d)
    return sentences


def _about_pictures(inspection: Inspection) -> Iterator[str]:
    """Sentences on picture files that are not as annotated, or may lie otherwise."""
    files = inspection.image_files
    if files.other_size or files.unreadable:
        yield (
            f"of {files.looked_at} image files looked at, {files.other_size} are of another size"
            f" than annotated and {files.unreadable} cannot be read"
        )
    if files.turned_by_exif:
        yield (
            f"of {files.looked_at} image files looked at, {files.turned_by_exif} say by EXIF that"
            " they are to be turned: pixels are taken as stored, or with --orientation apply"
            " turned; look at overlays of both"
        )


def _about_stored_fits(facts: StoredFitFacts) -> str:
    """A sentence on stored bodies that fits contradict."""
    differing = set(facts.turned) | set(facts.worse)
    if not differing:
        return f"no stored body of {facts.compared} compared is contradicted by a fit of it"
    return (
        f"{len(differing)} of {facts.compared} stored bodies compared are contradicted by fits to"
        f" the same keypoints ({len(facts.turned)} by the trunk's direction, {len(facts.worse)} by"
        " the keypoints): look at these first, or label with --body fit --model"
    )


def _residual_phrase(residual: Residual) -> str:
    """A residual as a phrase."""
    return (
        f"{residual.median_px:.2f} px (95 % within {residual.p95_px:.2f}),"
        f" {residual.median_percent:.1f} % of their extent, in {residual.animals} animals"
    )


def _about_masks(inspection: Inspection) -> Iterator[str]:
    """A sentence on the masks."""
    facts = inspection.masks
    if not facts.animals:
        yield "there are no masks"
        return
    levels = ", ".join(f"{name} in {count}" for name, count in facts.levels.items()) or "nothing"
    yield (
        f"{facts.animals} of {inspection.animals} animals have a mask; of {facts.looked_at} looked"
        f" at: {levels}; {facts.unusable} unusable. Read as the animal: all above half of the"
        " greatest level"
    )


def _about_places(facts: KeypointFacts) -> Iterator[str]:
    """A sentence on keypoints that lie beside their animal, if some do."""
    if facts.misplaced:
        yield (
            f"the keypoints of {facts.misplaced} of {facts.looked_at} animals lie beside the image,"
            " or the animal's own box or mask: these get no label, or a flag with --misplaced flag."
            f" The first: {facts.examples[0]}"
        )


def _about_animal3d(facts: Animal3DFacts) -> Iterator[str]:
    """Sentences on the facts that only Animal3D's files have."""
    marks = [value for value in facts.visibility if value != "0"]
    yield (
        f"keypoint_2d marks with {' and '.join(marks) or 'nothing'}; all above 0 are read as"
        " visible"
    )
    without_tail = sum(count for value, count in facts.with_tail.items() if value in ("0", "False"))
    if without_tail:
        yield (
            f"{without_tail} bodies were fitted without their tail (with_tail 0): label with --tail"
            " drop"
        )
    yield from (_about_picture(fit) for fit in facts.pictures)
    yield from _about_cameras(facts)
    if facts.stored_points is not None:
        relations = ", ".join(
            f"{relation} in {count}" for relation, count in facts.stored_points.relations.items()
        )
        yield (
            f"keypoint_3d against the posed bodies, {facts.stored_points.compared} compared:"
            f" {relations}"
        )
    if facts.sides is not None:
        yield from _about_sides(facts.sides)


def _about_picture(fit: PictureFit) -> str:
    """A sentence on the picture that one key's 2D points are for."""
    if fit.relation == "none":
        return (
            f"{fit.key} is in no simple relation to keypoint_2d: as stored it is off by"
            f" {_residual_phrase(fit.residuals['as stored'])}"
        )
    residual = _residual_phrase(fit.residuals[fit.relation])
    if fit.scale is None or fit.shift_px is None:
        return f"{fit.key} lives in the image as stored, off keypoint_2d by {residual}"
    shift = (
        f" and shifted by ({fit.shift_px[0]:.1f}, {fit.shift_px[1]:.1f}) px"
        if fit.relation != "scaled"
        else ""
    )
    return (
        f"{fit.key} lives in another picture: the image scaled by {fit.scale:.3g}{shift} (medians);"
        f" brought back, it is off by {residual}"
    )


def _about_cameras(facts: Animal3DFacts) -> Iterator[str]:
    """Sentences on the best camera of each target, and whether it is the stored one."""
    for target in dict.fromkeys(fit.target for fit in facts.cameras):
        best = next(fit for fit in facts.cameras if fit.target == target)
        if best.free.median_percent > 100 * CLOSE:
            yield (
                f"no points and frame project onto {target}: the nearest, {best.points} in"
                f" {best.frame}, are off by {_residual_phrase(best.free)}"
            )
            continue
        yield (
            f"{target} is {best.points} in the camera frame {best.frame}: with the best focal"
            f" lengths and centres off by {_residual_phrase(best.free)}"
        )
        yield _about_focal(best, facts.flength)


def _about_focal(best: CameraFit, flength: float | None) -> str:
    """A sentence on the focal length that fits a target, beside the file's."""
    low, high = best.focal_range_px
    best_camera = (
        f"the focal length that fits {best.target} is {best.focal_px:.0f} px (5 to 95 %: {low:.0f}"
        f" to {high:.0f}), its centre ({best.offset_px[0]:+.1f}, {best.offset_px[1]:+.1f}) px off"
        " the image's middle"
    )
    if flength is None or best.stored is None:
        return f"{best_camera}; the file has no flength"
    near = (
        100 * abs(best.focal_px / flength - 1) < CENTRED
        and max(map(abs, best.offset_px)) < CENTRED / 100 * flength
    )
    verdict = "which is the stored camera's" if near else "which is not the stored camera's"
    return (
        f"{best_camera}, {verdict} (flength {flength:g}, centred), under which it is off by"
        f" {_residual_phrase(best.stored)}"
    )


def _about_sides(sides: SideFacts) -> Iterator[str]:
    """Sentences on left and right: on the model, in space and in the images."""
    if sides.template_wrong:
        yield (
            f"the model's {', '.join(sides.template_wrong)} lie on the wrong side of its template:"
            " its vertices are in another order, or mirrored"
        )
    if sides.left_is_left or sides.left_is_right:
        yield (
            f"keypoint_3d: the named left is the animal's left in {sides.left_is_left} animals, its"
            f" right in {sides.left_is_right}"
        )
    if sides.compared_in_image:
        yield (
            f"keypoint_2d: left and right are exchanged in {sides.swapped_in_image} of"
            f" {sides.compared_in_image} animals, by the projected points; views from the front or"
            " back tell little"
        )
