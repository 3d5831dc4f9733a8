"""What an inspection's numbers mean, in whole sentences."""

from collections.abc import Iterator

from animal3dbox.datasets.inspection.result import (
    Animal3DFacts,
    CameraFit,
    Inspection,
    PictureFit,
    Residual,
    SideFacts,
)
from animal3dbox.datasets.readers.animal3d.camera import CLOSE

CENTRED = 2.0
"""Percent of the focal length by which a fitted camera may differ from the stored one."""


def answers(found: Inspection) -> list[str]:
    """The sentences, those on faults first."""
    said = []
    if found.faults.count:
        fields = ", ".join(f"{field} {count}" for field, count in found.faults.by_field.items())
        said.append(f"{found.faults.count} samples cannot be used, by field: {fields}")
    if found.image_files.other_size or found.image_files.unreadable:
        said.append(
            f"of {found.image_files.looked_at} image files looked at,"
            f" {found.image_files.other_size} are of another size than annotated and"
            f" {found.image_files.unreadable} cannot be read"
        )
    said += _about_masks(found)
    if found.bodies.unusable:
        said.append(
            f"{found.bodies.unusable} of {found.bodies.looked_at} bodies looked at cannot be used:"
            f" {found.bodies.examples[0]}"
        )
    if found.cameras.residual is not None:
        said.append(
            "bodies under the cameras that come with them are off their keypoints by"
            f" {_told(found.cameras.residual)}"
        )
    if found.animal3d is not None:
        said += _about_animal3d(found.animal3d)
    return said


def _told(one: Residual) -> str:
    return (
        f"{one.median_px:.2f} px (95 % within {one.p95_px:.2f}), {one.median_percent:.1f} % of"
        f" their extent, in {one.animals} animals"
    )


def _about_masks(found: Inspection) -> Iterator[str]:
    facts = found.masks
    if not facts.animals:
        yield "there are no masks"
        return
    levels = ", ".join(f"{name} in {count}" for name, count in facts.levels.items()) or "nothing"
    yield (
        f"{facts.animals} of {found.animals} animals have a mask; of {facts.looked_at} looked at:"
        f" {levels}; {facts.unusable} unusable. Read as the animal: all above half of the greatest"
        " level"
    )


def _about_animal3d(facts: Animal3DFacts) -> Iterator[str]:
    marks = [value for value in facts.visibility if value != "0"]
    yield (
        f"keypoint_2d marks with {' and '.join(marks) or 'nothing'}; all above 0 are read as"
        " visible"
    )
    untailed = sum(count for value, count in facts.with_tail.items() if value in ("0", "False"))
    if untailed:
        yield (
            f"{untailed} bodies were fitted without their tail (with_tail 0): label with --tail"
            " drop"
        )
    yield from (_about_picture(fit) for fit in facts.pictures)
    yield from _about_cameras(facts)
    if facts.stored_points is not None:
        told = ", ".join(
            f"{relation} in {count}" for relation, count in facts.stored_points.relations.items()
        )
        yield (
            f"keypoint_3d against the posed bodies, {facts.stored_points.compared} compared: {told}"
        )
    if facts.sides is not None:
        yield from _about_sides(facts.sides)


def _about_picture(fit: PictureFit) -> str:
    if fit.relation == "none":
        return (
            f"{fit.key} is in no simple relation to keypoint_2d: as stored it is off by"
            f" {_told(fit.residuals['as stored'])}"
        )
    told = _told(fit.residuals[fit.relation])
    if fit.scale is None or fit.shift_px is None:
        return f"{fit.key} lives in the image as stored, off keypoint_2d by {told}"
    shift = (
        f" and shifted by ({fit.shift_px[0]:.1f}, {fit.shift_px[1]:.1f}) px"
        if fit.relation != "scaled"
        else ""
    )
    return (
        f"{fit.key} lives in another picture: the image scaled by {fit.scale:.3g}{shift} (medians);"
        f" brought back, it is off by {told}"
    )


def _about_cameras(facts: Animal3DFacts) -> Iterator[str]:
    """The best camera of each target, and whether it is the stored one."""
    for target in dict.fromkeys(fit.target for fit in facts.cameras):
        best = next(fit for fit in facts.cameras if fit.target == target)
        if best.free.median_percent > 100 * CLOSE:
            yield (
                f"no points and frame project onto {target}: the nearest, {best.points} in"
                f" {best.frame}, are off by {_told(best.free)}"
            )
            continue
        yield (
            f"{target} is {best.points} in the camera frame {best.frame}: with the best focal"
            f" lengths and centres off by {_told(best.free)}"
        )
        yield _about_focal(best, facts.flength)


def _about_focal(best: CameraFit, flength: float | None) -> str:
    low, high = best.focal_range_px
    fitted = (
        f"the focal length that fits {best.target} is {best.focal_px:.0f} px (5 to 95 %: {low:.0f}"
        f" to {high:.0f}), its centre ({best.offset_px[0]:+.1f}, {best.offset_px[1]:+.1f}) px off"
        " the image's middle"
    )
    if flength is None or best.stored is None:
        return f"{fitted}; the file has no flength"
    near = (
        100 * abs(best.focal_px / flength - 1) < CENTRED
        and max(map(abs, best.offset_px)) < CENTRED / 100 * flength
    )
    verdict = "which is the stored camera's" if near else "which is not the stored camera's"
    return (
        f"{fitted}, {verdict} (flength {flength:g}, centred), under which it is off by"
        f" {_told(best.stored)}"
    )


def _about_sides(sides: SideFacts) -> Iterator[str]:
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
