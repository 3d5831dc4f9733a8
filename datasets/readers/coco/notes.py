"""What a careful person should know of a COCO file, in whole sentences."""

from collections import Counter
from collections.abc import Iterable

from animal3dbox.datasets.readers.coco.file import Species
from animal3dbox.datasets.readers.coco.plain import CocoCounts


def coco_notes(
    counts: CocoCounts, species: Iterable[Species], *, has_flags: bool
) -> tuple[str, ...]:
    """Notes on a file for its report.

    Args:
        counts: of its elements.
        species: those that are read.
        has_flags: whether beside each keypoint stands its visibility, not a score.

    """
    notes, animals = list[str](), counts.animals
    if counts.crowds:
        notes.append(
            f"{counts.crowds} annotations are crowds (iscrowd 1), no single animals, and were"
            " left out"
        )
    if counts.bare:
        notes.append(f"{counts.bare} of {counts.images} images have no annotation of an animal")
    if counts.empty:
        notes.append(f"{counts.empty} of {animals} animals have no marked keypoint")
    if counts.miscounted:
        notes.append(
            f"num_keypoints is not the number of marked keypoints in {counts.miscounted} of"
            f" {animals} animals; the marks count"
        )
    if has_flags and not counts.graded and animals > counts.empty:
        notes.append(
            "no keypoint has the visibility 2: 1 is taken to mean visible, not labelled but hidden"
        )
    matches = dict.fromkeys(kind.match for kind in species if kind.match is not None)
    for match in matches:
        if match.unused:
            notes.append(
                f"the keypoints {', '.join(match.unused)} are not in the vocabulary"
                f" {match.vocabulary.name} and not used"
            )
    return (*notes, *_category_notes(counts.left_out))


def _category_notes(left_out: Counter[str]) -> tuple[str, ...]:
    """A sentence on the annotations of categories that are not read."""
    if not left_out:
        return ()
    counts = ", ".join(f"{count} of {name!r}" for name, count in left_out.most_common())
    return (f"annotations of other categories are left out: {counts} (--categories says which)",)
