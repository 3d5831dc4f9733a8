"""A labelling run written to a folder: labels, tables, pictures and the page."""

import io
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from animal3dbox.errors import ConfigError, SampleError
from animal3dbox.files import write_whole
from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.types import CuboidLabel, Rejection
from animal3dbox.report.gallery import Card, card_picture, write_gallery
from animal3dbox.report.label_files import (
    LabelFile,
    RejectedRow,
    animal_row,
    write_labels_csv,
    write_labels_json,
)
from animal3dbox.report.overlay import draw_label
from animal3dbox.report.summary import Summary, flags_of, summarize


@dataclass(frozen=True)
class Labelled:
    """What became of one animal.

    Attributes:
        outcome: its label, or why it has none.
        image_id: its image.
        category: its species, as the dataset says.
        picture: (H, W, 3) uint8 RGB.
    """

    outcome: CuboidLabel | Rejection
    image_id: str
    category: str
    picture: NDArray[np.uint8]


def write_run(
    out: Path,
    source: str,
    body: str,
    config: LabelConfig,
    results: Iterable[Labelled | SampleError],
) -> Summary:
    """Label files, overlays, gallery and report of a run.

    Args:
        out: the folder, made if it is missing; files of an earlier run are replaced.
        source: the dataset, for the page's title.
        body: the body source's name.
        config: how the labels were made.
        results: one by one, so that pictures need not all be held.

    Returns:
        The counts, as in report.json.

    """
    try:
        (out / "overlays").mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(f"the results' folder {out} cannot be made: {error}") from error
    animals, flags, rejected, faults, cards = [], [], [], [], []
    numbers: Counter[str] = Counter()
    taken: set[str] = set()
    for result in results:
        if isinstance(result, SampleError):
            faults.append(result)
            continue
        number = _number(result, numbers[result.image_id])
        numbers[result.image_id] += 1
        if isinstance(result.outcome, Rejection):
            row = RejectedRow(
                sample_id=_name(result, number),
                image=result.image_id,
                animal=number,
                reason=result.outcome.reason,
                detail=result.outcome.detail,
            )
            rejected.append(row)
            cards.append(
                Card(
                    row.sample_id,
                    card_picture(result.picture),
                    "rejected",
                    -1.0,
                    None,
                    None,
                    (f"{row.reason}: {row.detail}",),
                    None,
                )
            )
            continue
        label = result.outcome
        picture, raised = draw_label(result.picture, label), flags_of(label)
        overlay = f"overlays/{overlay_name(result.image_id, number, taken)}"
        write_whole(out / overlay, _png(picture))
        animals.append(animal_row(label, result.image_id, number, result.category))
        flags.append(raised)
        cards.append(_card(label, _name(result, number), card_picture(picture), raised, overlay))
    summary = summarize(
        source=source,
        body=body,
        method=config.method,
        animals=animals,
        flags=flags,
        rejected=rejected,
        faults=faults,
    )
    write_labels_json(
        out / "labels.json",
        LabelFile(body=body, config=asdict(config), animals=animals, rejected=rejected),
    )
    write_labels_csv(out / "labels.csv", animals)
    write_gallery(out / "gallery.html", cards, summary)
    write_whole(out / "report.json", msgspec.json.format(msgspec.json.encode(summary), indent=1))
    return summary


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
    label: CuboidLabel, title: str, picture: bytes, raised: Sequence[str], overlay: str
) -> Card:
    quality = label.quality
    facts = [
        f"side {label.side or 'none'}, seen from {label.viewpoint} (azimuth"
        f" {label.azimuth_deg:.0f}°, elevation {label.elevation_deg:.0f}°)"
    ]
    if quality.reprojection_error_px is not None:
        facts.append(
            f"keypoints {quality.reprojection_error_px:.1f} px off, {quality.n_inliers} of"
            f" {quality.n_keypoints} fit"
        )
    if quality.mask_iou is not None:
        facts.append(f"mask overlap {quality.mask_iou:.2f}")
    facts += [f"⚑ {flag}" for flag in raised] + list(quality.warnings)
    status = "flagged" if raised else "kept"
    return Card(
        title,
        picture,
        status,
        label.confidence,
        quality.reprojection_error_px,
        quality.mask_iou,
        tuple(facts),
        overlay,
    )
