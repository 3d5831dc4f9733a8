"""A labelling run written to a folder: labels, tables, pictures and the page."""

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from pathlib import Path

import msgspec

from animal3dbox.datasets.labelling.animal_outcomes import animal_number
from animal3dbox.errors import ConfigError, SampleError
from animal3dbox.files import ListedFiles, write_whole
from animal3dbox.labels.config import LabelConfig
from animal3dbox.report.gallery import write_gallery
from animal3dbox.report.label_files import LabelFile, write_label_rows
from animal3dbox.report.labels_csv import write_labels_csv
from animal3dbox.report.row_spool import RowSpool
from animal3dbox.report.run_rows import (
    DrawnAnimal,
    Labelled,
    RunRow,
    drawn_animal,
    faults_in_order,
)
from animal3dbox.report.summary import Summary, SummaryCounts
from animal3dbox.smal.model import SmalModel

ROWS = ".rows"
"""The folder below a run's own in which its rows wait for its end."""
OVERLAYS = r"overlays/[A-Za-z0-9._-]{1,200}\.png"
"""The paths of overlays from the run's folder, see overlay_name."""


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
        >>> import numpy as np
        >>> from animal3dbox.labels.types import Rejection
        >>> picture = np.zeros((4, 4, 3), dtype=np.uint8)
        >>> result = Labelled(Rejection("a.jpg", "no_pose", "none"), "a.jpg", "dog", picture)
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     summary = write_run(
        ...         Path(folder), [result], source="set", body="dog", config=LabelConfig()
        ...     )
        ...     summary.reasons, sorted(path.name for path in Path(folder).glob("*.json"))
        ({'no_pose': 1}, ['labels.json', 'report.json'])
    """
    writer = RunWriter(out, source=source, body=body, config=config)
    numbers: Counter[str] = Counter()
    for result in results:
        number = 0
        if isinstance(result, Labelled):
            counted = numbers[result.image_id]
            number = animal_number(result.outcome.sample_id, result.image_id, counted)
            numbers[result.image_id] += 1
        writer.add([drawn_animal(result, number, fitted=fitted)])
    return writer.finish()


class RunWriter:
    """Writes a labelling run into a folder: pictures as results come in, then labels and pages.

    Rows wait in a folder of their own, so that a run of any size is not held in memory, and can be
    gone on with after a kill. At the end that folder goes. The end of a ``with`` block writes the
    rows that are waiting, also if it ends by an error.

    Args:
        out: the folder, made if it is missing; files of an earlier run are replaced, and its
            overlays removed at the end, but not what somebody else put there.
        source: the dataset, for the page's title.
        body: the body source's name.
        config: how the labels were made.
        resume: whether rows of an unfinished run are kept.

    Attributes:
        known_keys: of the rows that are kept.
        turned: the images that were turned as their headers say.
        deleted_overlays: the overlays of rows that somebody deleted before the end of the run, to
            which the gallery has no links.

    Raises:
        ConfigError: the folder cannot be made, or the list of its pictures cannot be used.
        DatasetFormatError: rows of an unfinished run are damaged.

    """

    def __init__(
        self,
        out: Path,
        *,
        source: str,
        body: str,
        config: LabelConfig,
        resume: bool = False,
    ) -> None:
        make_results_folder(out)
        self.out, self.source, self.body, self.config = out, source, body, config
        self.spool = RowSpool(out / ROWS)
        self._overlays = ListedFiles(out, "label", OVERLAYS)
        if not resume:
            self.spool.clear()
        self.known_keys: set[str] = set()
        self.turned: set[str] = set()
        self.deleted_overlays: set[str] = set()
        self._overlay_names: set[str] = set()
        for row in self.spool:
            self.known_keys.add(row.key)
            self._note_turned(row)
            if row.overlay is not None:
                self._overlay_names.add(Path(row.overlay).name.lower())

    def __enter__(self) -> "RunWriter":
        return self

    def __exit__(self, *error: object) -> None:
        self.spool.flush()

    def add(self, animals: Sequence[DrawnAnimal]) -> None:
        """Take finished animals; their overlays are written at once, and not held."""
        for one in animals:
            self._note_turned(one.row)
        self.spool.add([self._with_overlay(one) for one in animals])

    def _note_turned(self, row: RunRow) -> None:
        if row.upright:
            self.turned.add(row.image)

    def _with_overlay(self, animal: DrawnAnimal) -> RunRow:
        """The row of an animal, its overlay written and named."""
        if animal.overlay is None:
            return animal.row
        name = overlay_name(animal.row.image, animal.row.number, self._overlay_names)
        self._overlays.write(f"overlays/{name}", animal.overlay)
        return msgspec.structs.replace(animal.row, overlay=f"overlays/{name}")

    def finish(self) -> Summary:
        """Write labels, gallery and report; returns the counts, as in report.json."""
        self.spool.flush()
        rows, counts = self.spool, SummaryCounts()
        for row in rows:
            if row.animal is not None:
                counts.add_label(row.animal, row.flags)
            elif row.rejected is not None:
                counts.add_rejected(row.rejected)
        faults = faults_in_order([row for row in rows if row.fault is not None])
        summary = counts.summary(
            source=self.source, body=self.body, method=self.config.method, faults=faults
        )
        head = LabelFile(body=self.body, config=asdict(self.config), animals=[], rejected=[])
        write_label_rows(
            self.out / "labels.json",
            head,
            animals=(row.animal for row in rows if row.animal is not None),
            rejected=(row.rejected for row in rows if row.rejected is not None),
        )
        write_labels_csv(
            self.out / "labels.csv",
            (row.animal for row in rows if row.animal is not None),
            (row.flags for row in rows if row.animal is not None),
        )
        cards = (card for row in rows if (card := self._linked(row).card) is not None)
        write_gallery(self.out / "gallery.html", cards, summary)
        report = msgspec.json.format(msgspec.json.encode(summary), indent=1)
        write_whole(self.out / "report.json", report)
        overlays = (row.overlay for row in rows if row.overlay is not None)
        self._overlays.keep_only(name for name in overlays if name not in self.deleted_overlays)
        self.spool.remove()
        return summary

    def _linked(self, row: RunRow) -> RunRow:
        """The row, without its overlay if somebody deleted that: its card leads nowhere then."""
        if row.overlay is None or (self.out / row.overlay).is_file():
            return row
        self.deleted_overlays.add(row.overlay)
        return msgspec.structs.replace(row, overlay=None)


def make_results_folder(out: Path) -> None:
    """Make the folder of a run.

    Raises:
        ConfigError: it cannot be made, or the list of its overlays cannot be used.

    """
    try:
        (out / "overlays").mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(f"the results' folder {out} cannot be made: {error}") from error
    ListedFiles(out, "label", OVERLAYS).check_list()


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
