"""What readers accept of files that other programs wrote, and the notes that say so."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from animal3dbox.datasets.records import CuboidSet, RecordSet
from animal3dbox.datasets.storage.records_on_demand import RecordsOnDemand
from animal3dbox.errors import ConfigError, SampleError

Array = NDArray[np.float64]
BadParts = Literal["fault", "drop"]
"""What a bad mask or box is: an error of its animal, or left out with a note."""
Visibility = Literal["flags", "scores"]
"""What stands beside a keypoint's place: 0, 1 or 2, or how sure a network was of it."""
TURNED = (
    "pictures and masks are turned upright as their EXIF headers say: the annotations are taken to"
    " be for the turned pixels"
)
"""The note of a dataset whose pictures are turned."""
LEAST_SCORE = 0.3
"""Score under which a network's keypoint counts as missing."""
_Part = TypeVar("_Part")


@dataclass
class Tolerance:
    """How one file is taken, and how often it needed that.

    Attributes:
        optional: see BadParts.
        visibility: see Visibility.
        upright: whether pictures and masks are turned as their EXIF headers say.
        left_out: the errors of the parts that were left out.
        minus_ones: sample ids of animals with marked keypoints at (-1, -1).

    Example:
        >>> tolerance = Tolerance(optional="drop")
        >>> rows = np.array([[-1.0, -1, 2], [5, 6, 2]])
        >>> tolerance.keypoints(rows, "a.jpg", "keypoints").tolist()
        [[0.0, 0.0, 0.0], [5.0, 6.0, 2.0]]
        >>> len(tolerance.notes())
        1
    """

    optional: BadParts = "fault"
    visibility: Visibility = "flags"
    upright: bool = False
    left_out: list[SampleError] = field(default_factory=list)
    minus_ones: list[str] = field(default_factory=list)

    def part(self, read: Callable[[], _Part]) -> _Part | None:
        """A mask or a box; None where it is bad and may be left out.

        Raises:
            SampleError: it is bad, and bad ones are errors.

        """
        try:
            return read()
        except SampleError as error:
            if self.optional == "fault":
                raise
            self.left_out.append(error)
            return None

    def without_minus_ones(self, rows: Array, sample_id: str) -> Array:
        """Rows (J, 3) of x, y and visibility, zeros where (-1, -1) or -1 stand for none."""
        at_minus_one = (rows[:, :2] == -1).all(1)
        if (at_minus_one & (rows[:, 2] > 0)).any():
            self.minus_ones.append(sample_id)
        is_missing = at_minus_one | (rows[:, 2] == -1)
        return np.where(is_missing[:, None], 0.0, rows)

    def keypoints(self, rows: Array, sample_id: str, field: str) -> Array:
        """Rows (J, 3) of x, y and visibility, zeros where a keypoint is missing.

        Args:
            rows: as the file has them.
            sample_id: named in the error.
            field: the file's key, likewise.

        Raises:
            SampleError: a visibility that is neither 0, 1 nor 2; or no score from 0 to 1.

        """
        rows = self.without_minus_ones(rows, sample_id)
        marks = rows[:, 2]
        if self.visibility == "scores":
            if not ((marks >= 0) & (marks <= 1)).all():
                raise SampleError(
                    sample_id, field, f"scores must be from 0 to 1, got {marks.max():g}"
                )
            rows[marks < LEAST_SCORE] = 0.0
            return rows
        if not ((marks == 0) | (marks == 1) | (marks == 2)).all():
            raise SampleError(
                sample_id,
                field,
                f"visibility must be 0, 1 or 2, got {sorted(set(marks.tolist()))}: are these"
                " scores? Say so (visibility='scores', --visibility scores)",
            )
        rows[marks == 0] = 0.0
        return rows

    def notes(self) -> tuple[str, ...]:
        """Sentences for the report on what was taken so."""
        notes = []
        if self.minus_ones:
            notes.append(
                f"{len(self.minus_ones)} animals have marked keypoints at (-1, -1), which count as"
                f" missing; the first is {self.minus_ones[0]}"
            )
        if self.left_out:
            notes.append(
                f"{len(self.left_out)} masks or boxes cannot be used and are left out"
                f" (optional='fault' makes them errors); the first: {self.left_out[0]}"
            )
        if self.upright:
            notes.append(TURNED)
        if self.visibility == "scores":
            notes.append(f"keypoints of a score below {LEAST_SCORE:g} count as missing")
        return tuple(notes)


def upright_cuboids(cuboids: CuboidSet) -> CuboidSet:
    """The same boxes, of pictures that are turned upright as their EXIF headers say."""
    return replace(
        cuboids,
        records=tuple(replace(record, upright=True) for record in cuboids.records),
        images=tuple(replace(image, upright=True) for image in cuboids.images),
        notes=(*cuboids.notes, TURNED),
    )


def of_categories(records: RecordSet, categories: Sequence[str]) -> RecordSet:
    """The animals of some categories, others counted in a note.

    Args:
        records: of any format.
        categories: names in any letter case; none: all.

    Raises:
        ConfigError: the dataset has no such category.

    """
    if not categories or isinstance(records.records, RecordsOnDemand):
        return records  # the latter's reader has chosen already
    names = dict.fromkeys((*records.categories, *(one.category for one in records.records)))
    known = {name.casefold(): name for name in names}
    if unknown := [name for name in categories if name.casefold() not in known]:
        raise ConfigError(
            f"categories must be of {', '.join(known.values())}, got {', '.join(unknown)}"
        )
    wanted = {known[name.casefold()] for name in categories}
    kept = tuple(one for one in records.records if one.category in wanted)
    count = len(records.records) - len(kept)
    note = (f"{count} animals of other categories are left out",) if count else ()
    return replace(records, records=kept, notes=(*records.notes, *note))
