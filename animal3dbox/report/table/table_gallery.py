"""A gallery of a sample of a table: pictures are drawn afterwards, of the rows that are chosen."""

import heapq
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from animal3dbox.datasets.images.photos import read_photo
from animal3dbox.datasets.images.remote_files import PicturePath, PictureUrl, is_remote
from animal3dbox.datasets.storage.fingerprint import digest
from animal3dbox.errors import ConfigError, DatasetNotFoundError, SampleError
from animal3dbox.geometry.cuboid import Cuboid
from animal3dbox.progress import watched
from animal3dbox.report.advice import flag_findings
from animal3dbox.report.gallery import Card, card_picture, write_gallery
from animal3dbox.report.label_words import words_of_row
from animal3dbox.report.overlay import cuboid_in_picture, with_words
from animal3dbox.report.summary import FaultRow, Summary
from animal3dbox.report.table.columns import KINDS, columns_of
from animal3dbox.report.table.parts import Part, parts_of, read_part
from animal3dbox.report.table.source_file import read_source

Row = Mapping[str, Any]
_JUDGED = ("key", "status", "confidence", "flags", "reason", "side")
"""The columns by which rows are chosen and counted."""


@dataclass(frozen=True, order=True)
class _Choice:
    """A row that may be drawn; the least ones are.

    Attributes:
        rank: by which rows are chosen: the confidence, or a number drawn by the seed.
        key: of the row.
    """

    rank: float
    key: str


@dataclass
class _Counts:
    """What became of the animals of a table."""

    status: Counter[str] = field(default_factory=Counter)
    flags: Counter[str] = field(default_factory=Counter)
    reasons: Counter[str] = field(default_factory=Counter)
    sides: Counter[str] = field(default_factory=Counter)
    flagged: int = 0

    def add(self, row: Row) -> None:
        """Count a row."""
        self.status[row["status"]] += 1
        if row["status"] == "labelled":
            flags = row["flags"].split(";") if row["flags"] else []
            self.flagged += bool(flags)
            self.flags.update(flags)
            self.sides[row["side"] or "none"] += 1
        elif row["status"] != "faulty":
            self.reasons[row["reason"]] += 1


def write_table_gallery(
    table: Path,
    page: Path,
    *,
    worst: int = 200,
    random: int = 50,
    seed: int = 0,
    images: Path | None = None,
) -> int:
    """Draw the least confident labels of a table, and some others, into one HTML page.

    Args:
        table: the folder of the table's parts.
        page: the HTML file.
        worst: how many labels of least confidence are drawn.
        random: how many of the others, whatever their confidence.
        seed: another one draws others.
        images: the folder that images' names are relative to; None: as _source.json says. Pictures
            at URLs are fetched, those that are drawn alone.

    Returns:
        How many cards the page shows; those of least confidence first, as many as fit in it.

    Raises:
        ConfigError: a negative number, nobody knows where the images are, or they are at URLs and
            the extra that reads those is not installed.
        DatasetNotFoundError: there is no table.
        DatasetFormatError: a part or _source.json is damaged.

    Example:
        >>> write_table_gallery(Path("nowhere"), Path("page.html"))
        Traceback (most recent call last):
        animal3dbox.errors.DatasetNotFoundError: nowhere holds no parts of a table (label --table)
    """
    if worst < 0 or random < 0:
        raise ConfigError(f"numbers of pictures must not be negative, got {worst} and {random}")
    if not parts_of(table):
        raise DatasetNotFoundError(f"{table} holds no parts of a table (label --table)")
    source = read_source(table)
    folder = None if source.images is None else table / source.images
    keys, counts = _chosen_keys(parts_of(table), worst, random, seed=seed)
    rows = watched(_rows_of(parts_of(table), keys), "drawing", unit="picture", total=len(keys))
    cards = [_card(row, images or folder, table) for row in rows]
    chosen = f"the {worst} of least confidence and {random} drawn at random from the others"
    summary = _summary(counts, source.source, source.body, source.method)
    return write_gallery(page, cards, summary, source_of_cards=f"{chosen}; the table has all")


def _chosen_keys(
    parts: list[Part], worst: int, random: int, *, seed: int
) -> tuple[set[str], _Counts]:
    """The keys of the rows to draw, the same whatever the parts are; and the counts of all."""
    counts = _Counts()
    least: list[_Choice] = []
    for part in parts:
        labelled = []
        for row in _rows(part, _JUDGED):
            counts.add(row)
            if row["status"] == "labelled":
                labelled.append(_Choice(row["confidence"], row["key"]))
        least = heapq.nsmallest(worst, [*least, *labelled])
    keys = {choice.key for choice in least}
    sample: list[_Choice] = []
    for part in parts:
        rows = _rows(part, ("key", "status"))
        others = (row["key"] for row in rows if row["status"] == "labelled")
        ranked = [_Choice(_drawn_rank(seed, key), key) for key in others if key not in keys]
        sample = heapq.nsmallest(random, [*sample, *ranked])
    return keys | {choice.key for choice in sample}, counts


def _drawn_rank(seed: int, key: str) -> float:
    """A number of a key that looks random."""
    return float(int.from_bytes(digest(str(seed).encode(), key.encode())[:6], "little"))


def _rows(part: Part, columns: tuple[str, ...]) -> Iterator[Row]:
    values = read_part(part, columns)
    for row in zip(*values.values(), strict=True):
        yield dict(zip(columns, row, strict=True))


def _rows_of(parts: list[Part], keys: set[str]) -> Iterator[Row]:
    """The rows of some keys, whole."""
    for part in parts:
        if not keys.isdisjoint(read_part(part, ["key"])["key"]):
            yield from (row for row in _rows(part, (*KINDS,)) if row["key"] in keys)


def _card(row: Row, images: Path | None, table: Path) -> Card:
    """The card of a labelled row; without a picture, and with the reason, if there is none.

    Args:
        row: of the table.
        images: the folder of pictures, if it is known.
        table: named in the error.

    """
    words = words_of_row(row)
    flags = row["flags"].split(";") if row["flags"] else []
    facts = words.facts(flags)
    place = _picture_place(row["image"], images, table)
    picture: bytes | None = None
    try:
        picture = card_picture(_drawn(row, place, words.lines))
    except SampleError as error:
        facts = (*facts, f"no picture: {error.problem}")
    return Card(
        title=row["sample_id"],
        picture=picture,
        status="flagged" if flags else "kept",
        confidence=row["confidence"],
        error_px=words.error_px,
        mask_iou=words.mask_iou,
        facts=facts,
        overlay=None,
        image=row["image"],
        category=row["category"] or "",
        flank=words.flank,
        findings=flag_findings(flags, row),
    )


def _picture_place(name: str, images: Path | None, table: Path) -> PicturePath:
    """The URL or file of an image; raises a ConfigError if nobody knows where its file is."""
    if is_remote(name):
        return PictureUrl(name)
    if images is None:
        raise ConfigError(f"{table} does not say where its images are: give --images")
    return images / name


def _drawn(row: Row, place: PicturePath, lines: list[str]) -> NDArray[np.uint8]:
    """The picture of a row's image with its cuboid; raises SampleError."""
    hw = row["image_height"], row["image_width"]
    photo = read_photo(place, row["sample_id"], hw, upright=row["upright"])
    cuboid = Cuboid(_tensor(row, "center"), _tensor(row, "rotation"), _tensor(row, "size"))
    return with_words(cuboid_in_picture(photo.pixels, cuboid, _tensor(row, "K")), lines)


def _tensor(row: Row, name: str) -> torch.Tensor:
    """A field of a row in its shape, float64."""
    names, shape = columns_of(name)
    numbers = [row[column] for column in names]
    return torch.tensor(numbers, dtype=torch.float64).reshape(shape)


def _summary(counts: _Counts, source: str, body: str, method: str) -> Summary:
    """The counts as the gallery's page shows them; labels that a filter refused are rejected."""
    status = counts.status
    return Summary(
        source=source,
        body=body,
        method=method,
        animals=status.total(),
        kept=status["labelled"] - counts.flagged,
        flagged=counts.flagged,
        rejected=status["rejected"] + status["filtered"],
        faulty=status["faulty"],
        flags=dict(counts.flags),
        reasons=dict(counts.reasons),
        sides=dict(counts.sides),
        median_reprojection_error_px=None,
        median_mask_iou=None,
        faults=list[FaultRow](),
    )
