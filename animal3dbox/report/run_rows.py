"""What a labelling run keeps of each animal, and the pictures that are drawn of it.

Drawing needs the label and its photograph; what is left of them is a RunRow and a PNG, which any
process may make and the run's writer stores.
"""

import io
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import msgspec
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from animal3dbox.datasets.sightings import NO_SIGHTING, Sighting
from animal3dbox.errors import SampleError
from animal3dbox.labels.types import CuboidLabel, Rejection
from animal3dbox.report.advice import flag_findings, rejection_finding
from animal3dbox.report.gallery import Card, card_picture
from animal3dbox.report.label_files import AnimalRow, RejectedRow, animal_row
from animal3dbox.report.label_words import words_of_label
from animal3dbox.report.overlay import draw_label
from animal3dbox.report.summary import FaultRow, flags_of
from animal3dbox.smal.model import SmalModel

Pictures = Literal["all", "flagged", "none"]
"""Which animals get pictures; with "flagged" those with flags, and rejected ones."""


@dataclass(frozen=True)
class Labelled:
    """The outcome of one animal with its picture, as the writer of a run takes it.

    Attributes:
        outcome: its label, or why it has none.
        image_id: its image.
        category: its species, as the dataset says.
        picture: (H, W, 3) uint8 RGB; None where pictures are not wanted.
        sighting: when, where and of whom the picture is.
        upright: whether the picture was turned as its file's header says.

    Example:
        >>> picture = np.zeros((4, 4, 3), dtype=np.uint8)
        >>> Labelled(Rejection("a.jpg", "no_pose", "none"), "a.jpg", "dog", picture).outcome.reason
        'no_pose'
    """

    outcome: CuboidLabel | Rejection
    image_id: str
    category: str
    picture: NDArray[np.uint8] | None
    sighting: Sighting = NO_SIGHTING
    upright: bool = False


class RunRow(msgspec.Struct, frozen=True, kw_only=True):
    """One animal of a run: its label's row, or its rejection, or what is wrong with it.

    Attributes:
        key: of its row in the dataset's table (table/keys.py); "" where nobody resumes.
        animal: of a label.
        rejected: of an animal without one.
        fault: of a sample that could not be read.
        is_unread: whether that was its annotation.
        image: its image; "" of a fault.
        upright: whether the picture was turned as its header says.
        category: its species, as the dataset says.
        flags: that the label raises.
        facts: the lines of its card.
        picture: JPEG of its card; None without.
        overlay: the file of its overlay, below the run's folder; None without.
    """

    key: str = ""
    animal: AnimalRow | None = None
    rejected: RejectedRow | None = None
    fault: FaultRow | None = None
    is_unread: bool = False
    image: str = ""
    upright: bool = False
    category: str = ""
    flags: tuple[str, ...] = ()
    facts: tuple[str, ...] = ()
    picture: bytes | None = None
    overlay: str | None = None

    @property
    def number(self) -> int:
        """Which of its image's animals it is."""
        row = self.animal or self.rejected
        return 0 if row is None else row.animal

    @property
    def card(self) -> Card | None:
        """Its card in the gallery; a fault has none."""
        if self.rejected is not None:
            return Card(
                title=self.rejected.sample_id,
                picture=self.picture,
                status="rejected",
                confidence=-1.0,
                error_px=None,
                mask_iou=None,
                facts=self.facts,
                overlay=None,
                image=self.image,
                category=self.category,
                findings=(rejection_finding(self.rejected.reason, self.rejected.detail),),
            )
        if self.animal is None:
            return None
        quality = self.animal.quality
        return Card(
            title=self.animal.sample_id,
            picture=self.picture,
            status="flagged" if self.flags else "kept",
            confidence=self.animal.confidence,
            error_px=_number(quality["reprojection_error_px"]),
            mask_iou=_number(quality["mask_iou"]),
            facts=self.facts,
            overlay=self.overlay,
            image=self.image,
            category=self.category,
            flank=self.animal.flank or "",
            findings=flag_findings(
                self.flags,
                {
                    **quality,
                    "confidence": self.animal.confidence,
                    "truncation": self.animal.truncation,
                },
                causes=_words(quality.get("flags")),
            ),
        )


def _words(value: object) -> tuple[str, ...]:
    return tuple(value) if isinstance(value, list | tuple) else ()


def _number(value: object) -> float | None:
    return float(value) if isinstance(value, int | float) else None


@dataclass(frozen=True)
class DrawnAnimal:
    """One animal of a run, drawn.

    Attributes:
        row: what is kept of it; its overlay has no name yet.
        overlay: PNG of the picture with the label drawn; None without.
    """

    row: RunRow
    overlay: bytes | None = None


def drawn_animal(
    result: Labelled | SampleError,
    number: int,
    *,
    key: str = "",
    fitted: SmalModel | None = None,
    pictures: Pictures = "all",
    is_unread: bool = False,
) -> DrawnAnimal:
    """The row of an animal, and its pictures.

    Args:
        result: what became of it.
        number: which of its image's animals it is.
        key: see RunRow.
        fitted: the model that was fitted, whose outline the picture shows; None: no outline.
        pictures: which animals get some.
        is_unread: see RunRow.

    """
    if isinstance(result, SampleError):
        fault = FaultRow(
            sample_id=result.sample_id or "", field=result.field, problem=result.problem
        )
        return DrawnAnimal(RunRow(key=key, fault=fault, is_unread=is_unread))
    if isinstance(result.outcome, Rejection):
        return DrawnAnimal(_rejected(result, result.outcome, number, key, pictures=pictures))
    return _labelled(result, result.outcome, number, key=key, fitted=fitted, pictures=pictures)


def _rejected(
    result: Labelled, rejection: Rejection, number: int, key: str, *, pictures: Pictures
) -> RunRow:
    """The row of an animal without a label, with its photograph as it is."""
    row = RejectedRow(
        sample_id=rejection.sample_id or f"{result.image_id}#{number}",
        image=result.image_id,
        animal=number,
        reason=rejection.reason,
        detail=rejection.detail,
    )
    picture = None if pictures == "none" else result.picture
    return RunRow(
        key=key,
        rejected=row,
        image=result.image_id,
        upright=result.upright,
        category=result.category,
        facts=(f"{row.reason}: {row.detail}",),
        picture=None if picture is None else card_picture(picture),
    )


def _labelled(
    result: Labelled,
    label: CuboidLabel,
    number: int,
    *,
    key: str,
    fitted: SmalModel | None,
    pictures: Pictures,
) -> DrawnAnimal:
    """The row of a label, and its overlay."""
    flags = flags_of(label)
    row = animal_row(
        label,
        image=result.image_id,
        animal=number,
        category=result.category,
        sighting=result.sighting,
        upright=result.upright,
    )
    sighting = ", ".join(f"{name} {value}" for name, value in result.sighting.known.items())
    facts = words_of_label(label).facts(flags)
    is_wanted = pictures == "all" or (pictures == "flagged" and bool(flags))
    overlay = None
    if is_wanted and result.picture is not None:
        overlay = draw_label(result.picture, label, fitted)
    run_row = RunRow(
        key=key,
        animal=row,
        image=result.image_id,
        upright=result.upright,
        category=result.category,
        flags=flags,
        facts=(*facts, sighting) if sighting else facts,
        picture=None if overlay is None else card_picture(overlay),
    )
    return DrawnAnimal(run_row, None if overlay is None else _png(overlay))


def _png(picture: NDArray[np.uint8]) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(picture).save(buffer, "PNG")
    return buffer.getvalue()


def faults_in_order(rows: Sequence[RunRow]) -> list[FaultRow]:
    """The faults of rows: first of annotations that could not be read, as opening tells them."""
    ordered = sorted(rows, key=lambda row: not row.is_unread)
    return [row.fault for row in ordered if row.fault is not None]
