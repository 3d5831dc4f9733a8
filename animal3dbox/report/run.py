"""A labelling run written to a folder: labels, tables, pictures and the page."""

import io
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from animal3dbox.datasets.sightings import NO_SIGHTING, Sighting
from animal3dbox.errors import ConfigError, SampleError
from animal3dbox.files import write_whole
from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.types import CuboidLabel, Rejection
from animal3dbox.report.gallery import Card, card_picture, write_gallery
from animal3dbox.report.label_files import (
    AnimalRow,
    LabelFile,
    RejectedRow,
    animal_row,
    write_labels_json,
)
from animal3dbox.report.label_words import words_of_label
from animal3dbox.report.labels_csv import write_labels_csv
from animal3dbox.report.overlay import draw_label
from animal3dbox.report.summary import Summary, flags_of, summarize
from animal3dbox.smal.model import SmalModel


@dataclass(frozen=True)
class Labelled:
    """The outcome of one animal with its picture, as the writer of a run takes it.

    Attributes:
        outcome: its label, or why it has none.
        image_id: its image.
        category: its species, as the dataset says.
        picture: (H, W, 3) uint8 RGB.
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
    picture: NDArray[np.uint8]
    sighting: Sighting = NO_SIGHTING
    upright: bool = False


def write_run(
    out: Path,
    results: Iterable[Labelled | SampleError],
    *,
    source: str,
    body: str,
    config: LabelConfig,
    fitted: SmalModel | None = None,
) -> Summary:
    """Label files, overlays, gallery and report of finished results; see RunWriter.

    Example:
        >>> import tempfile
        >>> picture = np.zeros((4, 4, 3), dtype=np.uint8)
        >>> result = Labelled(Rejection("a.jpg", "no_pose", "none"), "a.jpg", "dog", picture)
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     summary = write_run(
        ...         Path(folder), [result], source="set", body="dog", config=LabelConfig()
        ...     )
        ...     summary.reasons, sorted(path.name for path in Path(folder).glob("*.json"))
        ({'no_pose': 1}, ['labels.json', 'report.json'])
    """
    writer = RunWriter(out, source=source, body=body, config=config, fitted=fitted)
    writer.add(results)
    return writer.finish()


class RunWriter:
    """Writes a labelling run into a folder: pictures as results come in, then labels and pages.

    Args:
        out: the folder, made if it is missing; files of an earlier run are replaced.
        source: the dataset, for the page's title.
        body: the body source's name.
        config: how the labels were made.
        fitted: the model that was fitted, whose outlines the pictures show; None: no outlines.

    Raises:
        ConfigError: the folder cannot be made.

    """

    def __init__(
        self,
        out: Path,
        *,
        source: str,
        body: str,
        config: LabelConfig,
        fitted: SmalModel | None = None,
    ) -> None:
        try:
            (out / "overlays").mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise ConfigError(f"the results' folder {out} cannot be made: {error}") from error
        self.out, self.source, self.body, self.config = out, source, body, config
        self.fitted = fitted
        self._animals: list[AnimalRow] = []
        self._flags: list[tuple[str, ...]] = []
        self._rejected: list[RejectedRow] = []
        self._faults: list[SampleError] = []
        self._cards: list[Card] = []
        self._numbers: Counter[str] = Counter()
        self._overlay_names: set[str] = set()

    def add(self, results: Iterable[Labelled | SampleError]) -> None:
        """Take finished results; their overlays are written at once, and pictures not held."""
        for result in results:
            if isinstance(result, SampleError):
                self._faults.append(result)
                continue
            number = _number(result, self._numbers[result.image_id])
            self._numbers[result.image_id] += 1
            if isinstance(result.outcome, Rejection):
                self._add_rejected(result, result.outcome, number)
            else:
                self._add_label(result, result.outcome, number)

    def finish(self) -> Summary:
        """Write labels, gallery and report; returns the counts, as in report.json."""
        summary = summarize(
            source=self.source,
            body=self.body,
            method=self.config.method,
            animals=self._animals,
            flags=self._flags,
            rejected=self._rejected,
            faults=self._faults,
        )
        labels = LabelFile(
            body=self.body,
            config=asdict(self.config),
            animals=self._animals,
            rejected=self._rejected,
        )
        write_labels_json(self.out / "labels.json", labels)
        write_labels_csv(self.out / "labels.csv", self._animals, self._flags)
        write_gallery(self.out / "gallery.html", self._cards, summary)
        report = msgspec.json.format(msgspec.json.encode(summary), indent=1)
        write_whole(self.out / "report.json", report)
        return summary

    def _add_rejected(self, result: Labelled, rejection: Rejection, number: int) -> None:
        row = RejectedRow(
            sample_id=_name(result, number),
            image=result.image_id,
            animal=number,
            reason=rejection.reason,
            detail=rejection.detail,
        )
        self._rejected.append(row)
        self._cards.append(
            Card(
                title=row.sample_id,
                picture=card_picture(result.picture),
                status="rejected",
                confidence=-1.0,
                error_px=None,
                mask_iou=None,
                facts=(f"{row.reason}: {row.detail}",),
                overlay=None,
            )
        )

    def _add_label(self, result: Labelled, label: CuboidLabel, number: int) -> None:
        picture, flags = draw_label(result.picture, label, self.fitted), flags_of(label)
        name = overlay_name(result.image_id, number, self._overlay_names)
        overlay = f"overlays/{name}"
        write_whole(self.out / overlay, _png(picture))
        row = animal_row(
            label,
            image=result.image_id,
            animal=number,
            category=result.category,
            sighting=result.sighting,
            upright=result.upright,
        )
        self._animals.append(row)
        self._flags.append(flags)
        title, small = _name(result, number), card_picture(picture)
        seen = ", ".join(f"{name} {value}" for name, value in result.sighting.known.items())
        card = _card(label, title=title, picture=small, flags=flags, overlay=overlay)
        self._cards.append(replace(card, facts=(*card.facts, seen)) if seen else card)


def overlay_name(image_id: str, number: int, taken: set[str]) -> str:
    """A file name for an animal's overlay.

    The image's path with nothing in it that a file system minds.

    Args:
        image_id: the image's path.
        number: the animal in it.
        taken: names given so far, which gets the new one: other paths can come out the same.

    """
    plain = (
        re.sub(r"[^A-Za-z0-9._-]+", "_", re.sub(r"\.[^./]*$", "", image_id)).strip("._")[-120:]
        or "image"
    )
    stem = f"{plain}-{number}" if number else plain
    name, copy = f"{stem}.png", 2
    while name.lower() in taken:
        name, copy = f"{stem}_{copy}.png", copy + 1
    taken.add(name.lower())
    return name


def _number(result: Labelled, counted: int) -> int:
    """The animal's number in its image.

    The one its sample_id says ("image#k"), so that a faulty neighbour shifts none.
    """
    said = (result.outcome.sample_id or "").removeprefix(f"{result.image_id}#")
    return int(said) if said.isdecimal() else counted


def _png(picture: NDArray[np.uint8]) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(picture).save(buffer, "PNG")
    return buffer.getvalue()


def _name(result: Labelled, number: int) -> str:
    return result.outcome.sample_id or f"{result.image_id}#{number}"


def _card(
    label: CuboidLabel, *, title: str, picture: bytes, flags: Sequence[str], overlay: str
) -> Card:
    """The gallery's card of a label."""
    quality = label.quality
    return Card(
        title=title,
        picture=picture,
        status="flagged" if flags else "kept",
        confidence=label.confidence,
        error_px=quality.reprojection_error_px,
        mask_iou=quality.mask_iou,
        facts=words_of_label(label).facts(flags),
        overlay=overlay,
    )
