"""One HTML page that shows every label, worst first, with nothing to load from elsewhere.

It can be searched and filtered, and opens a page for each animal that says why it was flagged.
"""

import base64
import heapq
import io
import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from animal3dbox.files import write_whole
from animal3dbox.labels.types import REASONS
from animal3dbox.report.advice import Finding, explanations, flag_meaning
from animal3dbox.report.html_page import render
from animal3dbox.report.summary import Summary

MAX_BYTES = 4_500_000
"""The page stays below this; of a large dataset it shows the worst labels that fit, and says so."""
MOST_CARDS = 8000
"""So many cards are held at once, the worst ones: more than fit, however small they are."""
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
        image: its image, by which it can be searched.
        category: its species, as the dataset says.
        flank: that is seen; "" of a rejected one.
        findings: why it was flagged or rejected.

    Example:
        >>> card = Card("a.jpg", None, "rejected", -1.0, None, None, ("no_pose: none",), None)
        >>> card.status, card.facts[0]
        ('rejected', 'no_pose: none')
    """

    title: str
    picture: bytes | None
    status: str
    confidence: float
    error_px: float | None
    mask_iou: float | None
    facts: tuple[str, ...]
    overlay: str | None
    image: str = ""
    category: str = ""
    flank: str = ""
    findings: tuple[Finding, ...] = ()


def write_gallery(
    path: Path, cards: Iterable[Card], summary: Summary, source_of_cards: str = ""
) -> int:
    """Write the page; returns how many cards it shows.

    Args:
        path: the HTML file.
        cards: in any order.
        summary: what became of all animals.
        source_of_cards: which animals the cards are of, if not of all, a clause.

    Example:
        >>> import tempfile
        >>> from animal3dbox.report.summary import summarize
        >>> summary = summarize(
        ...     source="set", body="dog", method="default",
        ...     animals=(), flags=(), rejected=(), faults=(),
        ... )
        >>> card = Card("<a>.jpg", None, "kept", 0.9, 1.5, None, ("side: left",), None)
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     shown = write_gallery(Path(folder) / "gallery.html", [card], summary)
        ...     "&lt;a&gt;.jpg" in (Path(folder) / "gallery.html").read_text(), shown
        (True, 1)
    """
    count, cards = itertools.count(), iter(cards)
    counted = (card for card, _ in zip(cards, count, strict=False))
    worst_first = heapq.nsmallest(MOST_CARDS, counted, key=lambda card: card.confidence)
    total = next(count)
    articles = _fitting(worst_first)
    note = f"Shown are {source_of_cards}." if source_of_cards else ""
    if len(articles) < total:
        all_are = "" if source_of_cards else "; all are in labels.json"
        note += f" The {len(articles)} worst of {total} animals are shown{all_are}."
    page = render(
        "animal3dbox.report",
        "gallery.html",
        summary=summary,
        funnel=_funnel(summary),
        most=max(summary.animals, 1),
        note=note.strip(),
        explanations=explanations(),
        articles=articles,
    )
    write_whole(path, page.encode())
    return len(articles)


def _fitting(worst_first: Sequence[Card]) -> list[str]:
    """The cards as HTML: all at the best width at which they fit, else the worst at the least."""
    articles: list[str] = []
    for width, quality in WIDTHS:
        articles, size = [], 0
        for card in worst_first:
            article = _article(card, width, quality)
            size += len(article.encode())
            if size > MAX_BYTES:
                break
            articles.append(article)
        if len(articles) == len(worst_first):
            break
    return articles


def _article(card: Card, width: int, quality: int) -> str:
    """A card as HTML, its picture within the page."""
    jpeg = None if card.picture is None else _jpeg(card.picture, width, quality)
    return render("animal3dbox.report", "gallery_card.html", card=card, jpeg=jpeg)


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


def _funnel(summary: Summary) -> list[tuple[str, int, str]]:
    """Name, count and note of each row: kept, flagged and rejected by reason, faulty."""
    return [
        ("animals", summary.animals, ""),
        ("kept", summary.kept, ""),
        ("flagged", summary.flagged, ""),
        *((f"· {flag}", count, flag_meaning(flag)) for flag, count in summary.flags.items()),
        ("rejected", summary.rejected, ""),
        *(
            (f"· {reason}", count, REASONS.get(reason, ""))
            for reason, count in summary.reasons.items()
        ),
        ("faulty", summary.faulty, "see report.json" if summary.faulty else ""),
    ]
