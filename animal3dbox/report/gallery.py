"""One HTML page that shows every label, worst first, with nothing to load from elsewhere."""

import base64
import html
import io
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from string import Template

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from animal3dbox.files import write_whole
from animal3dbox.report.summary import FLAGS, Summary

MAX_BYTES = 4_500_000
"""The page stays below this; of a large dataset it shows the worst labels that fit, and says so."""
WIDTHS = ((420, 82), (320, 75), (240, 68), (180, 60))
"""Width of the pictures and their JPEG quality, best first: the first at which all fit is taken."""


@dataclass(frozen=True)
class Card:
    """One animal of the gallery.

    Attributes:
        title: the sample.
        picture: JPEG (see card_picture) with the label drawn, or None for a rejected animal without
            an image.
        status: "kept", "flagged" or "rejected".
        confidence: to sort by; -1 for a rejected one.
        error_px: mean keypoint error, or None.
        mask_iou: or None.
        facts: lines below the picture.
        overlay: the file beside the page that the picture leads to, or None.
    """

    title: str
    picture: bytes | None
    status: str
    confidence: float
    error_px: float | None
    mask_iou: float | None
    facts: tuple[str, ...]
    overlay: str | None


def write_gallery(path: Path, cards: Sequence[Card], summary: Summary) -> int:
    """Write the page; returns how many cards it shows.

    Args:
        path: the HTML file.
        cards: in any order.
        summary: the funnel.

    """
    ordered = sorted(cards, key=lambda card: card.confidence)
    shown = _fitting(ordered)
    note = (
        ""
        if len(shown) == len(ordered)
        else f"The {len(shown)} worst of {len(ordered)} animals are shown; all are in labels.json."
    )
    template = Template(
        resources.files("animal3dbox.report").joinpath("gallery.html").read_text(encoding="utf-8")
    )
    page = template.substitute(
        source=html.escape(summary.source),
        body=html.escape(summary.body),
        method=html.escape(summary.method),
        funnel=_funnel(summary),
        note=note,
        cards="\n".join(shown),
    )
    write_whole(path, page.encode())
    return len(shown)


def _fitting(ordered: Sequence[Card]) -> list[str]:
    """The cards as HTML.

    At the best width at which all fit, else the worst animals at the least.
    """
    texts: list[str] = []
    for width, quality in WIDTHS:
        texts, size = [], 0
        for card in ordered:
            text = _card(card, width, quality)
            size += len(text.encode())
            if size > MAX_BYTES:
                break
            texts.append(text)
        if len(texts) == len(ordered):
            break
    return texts


def _card(card: Card, width: int, quality: int) -> str:
    picture = ""
    if card.picture is not None:
        tag = (
            f'<img src="data:image/jpeg;base64,{_jpeg(card.picture, width, quality)}"'
            f' alt="{html.escape(card.title)}" loading="lazy">'
        )
        picture = f'<a href="{html.escape(card.overlay)}">{tag}</a>' if card.overlay else tag
    facts = "".join(f"<li>{html.escape(fact)}</li>" for fact in card.facts)
    keys = {
        "confidence": card.confidence,
        "error": -1 if card.error_px is None else card.error_px,
        "iou": 2 if card.mask_iou is None else card.mask_iou,
    }
    data = " ".join(f'data-{key}="{value:.4f}"' for key, value in keys.items())
    return (
        f'<article class="{card.status}"'
        f" {data}>{picture}<h2>{html.escape(card.title)}</h2><ul>{facts}</ul></article>"
    )


def small_picture(picture: NDArray[np.uint8], width: int) -> NDArray[np.uint8]:
    """The picture at most so wide, and at most three times as high as that."""
    factor = min(1.0, width / picture.shape[1], 3 * width / picture.shape[0])
    if factor == 1.0:
        return picture
    size = (max(1, round(picture.shape[1] * factor)), max(1, round(picture.shape[0] * factor)))
    return np.asarray(Image.fromarray(picture).resize(size, Image.Resampling.LANCZOS))


def card_picture(picture: NDArray[np.uint8]) -> bytes:
    """A picture (H, W, 3) as a card holds it.

    Compressed, so that a long run can hold one for every animal.
    """
    return _compressed(picture, *WIDTHS[0])


def _compressed(picture: NDArray[np.uint8], width: int, quality: int) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(small_picture(picture, width)).save(buffer, "JPEG", quality=quality)
    return buffer.getvalue()


def _jpeg(picture: bytes, width: int, quality: int) -> str:
    """A card's picture at a width and quality, in base64."""
    if (width, quality) != WIDTHS[0]:
        with Image.open(io.BytesIO(picture)) as image:
            picture = _compressed(np.asarray(image), width, quality)
    return base64.b64encode(picture).decode()


def _funnel(summary: Summary) -> str:
    """The counts as table rows: kept, flagged and rejected by reason, faulty."""
    rows = [
        ("animals", summary.animals, ""),
        ("kept", summary.kept, ""),
        ("flagged", summary.flagged, ""),
    ]
    rows += [(f"· {flag}", count, FLAGS.get(flag, "")) for flag, count in summary.flags.items()]
    rows += [("rejected", summary.rejected, "")] + [
        (f"· {reason}", count, "") for reason, count in summary.reasons.items()
    ]
    rows += [("faulty", summary.faulty, "see report.json" if summary.faulty else "")]
    most = max(summary.animals, 1)
    lines = []
    for name, count, note in rows:
        bar = f'<td class="bar"><i style="width:{100 * count / most:.1f}%"></i></td>'
        lines.append(
            f"<tr><th>{html.escape(name)}</th><td>{count}</td>{bar}<td>{html.escape(note)}</td></tr>"
        )
    return "\n".join(lines)
