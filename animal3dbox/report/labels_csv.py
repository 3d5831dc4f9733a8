"""labels.csv: one row an animal, the columns that an ecologist wants."""

import csv
import io
from collections.abc import Sequence
from pathlib import Path

from animal3dbox.datasets.sightings import SIGHTING_FIELDS
from animal3dbox.files import write_whole
from animal3dbox.geometry.cuboid import FACE_NAMES
from animal3dbox.report.label_files import AnimalRow

CSV_COLUMNS = (
    *("image", "animal", "side", "viewpoint", "sample_id", "category"),
    *("flank", "flank_confidence", "flags", "distance_m", "distance_source"),
    *("x0", "y0", "x1", "y1"),
    *(f"share_{name}" for name in FACE_NAMES),
    *(f"surface_{name}" for name in FACE_NAMES),
    *("azimuth_deg", "elevation_deg", "confidence"),
    *SIGHTING_FIELDS,
)
"""The columns of labels.csv; an empty cell is unknown."""
FORMULA_SIGNS = ("=", "+", "-", "@", "\t", "\r")
"""What a cell begins with that spreadsheets take for a formula."""
UNSURE_FOCAL = ("guessed", "estimated")
"""Sources of a focal length that make a distance unsure by as much as they are."""


def write_labels_csv(
    path: Path, animals: Sequence[AnimalRow], flags: Sequence[Sequence[str]] | None = None
) -> None:
    """Write labels.csv: a row an animal, the columns an ecologist wants.

    Args:
        path: the file.
        animals: the rows of labels.json.
        flags: of each animal, what its report flags; None: only what its quality does.

    Example:
        >>> import tempfile
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     write_labels_csv(Path(folder) / "labels.csv", animals=[])
        ...     (Path(folder) / "labels.csv").read_text().split(",")[:4]
        ['image', 'animal', 'side', 'viewpoint']
    """
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, CSV_COLUMNS)
    writer.writeheader()
    of_each: Sequence[Sequence[str]] = [()] * len(animals) if flags is None else flags
    writer.writerows(_cells(row, raised) for row, raised in zip(animals, of_each, strict=True))
    write_whole(path, text.getvalue().encode())


def _cells(row: AnimalRow, raised: Sequence[str]) -> dict[str, str | int]:
    """Column -> cell of one animal; empty where nothing is known."""
    shares = dict(zip(FACE_NAMES, row.face_share, strict=True))
    surface = dict(zip(FACE_NAMES, row.surface_share or [None] * len(FACE_NAMES), strict=True))
    return {
        "image": text_cell(row.image),
        "animal": row.animal,
        "side": row.side or "",
        "viewpoint": row.viewpoint,
        "sample_id": text_cell(row.sample_id),
        "category": text_cell(row.category),
        "flank": row.flank or "",
        "flank_confidence": _cell(row.flank_confidence, 3),
        "flags": ";".join(_flags(row, raised)),
        "distance_m": "" if row.scale_m_per_unit is None else _cell(row.distance, 3),
        "distance_source": distance_source(row),
        **{name: _cell(px, 1) for name, px in zip(("x0", "y0", "x1", "y1"), row.box, strict=True)},
        **{f"share_{name}": _cell(share, 4) for name, share in shares.items()},
        **{f"surface_{name}": _cell(share, 4) for name, share in surface.items()},
        "azimuth_deg": _cell(row.azimuth_deg, 1),
        "elevation_deg": _cell(row.elevation_deg, 1),
        "confidence": _cell(row.confidence, 3),
        **{name: text_cell(value) for name, value in row.sighting.known.items()},
    }


def _cell(number: float | None, decimals: int) -> str:
    """A number with so many decimals; empty if it is not known."""
    return "" if number is None else f"{number:.{decimals}f}"


def text_cell(text: str) -> str:
    """A text with a mark before it where spreadsheets would run it as a formula."""
    return f"'{text}" if text.startswith(FORMULA_SIGNS) else text


def _flags(row: AnimalRow, raised: Sequence[str]) -> list[str]:
    """The words that call for a look at a label, each once."""
    own = row.quality.get("flags")
    return list(dict.fromkeys((*raised, *(own if isinstance(own, list) else ()))))


def distance_source(row: AnimalRow) -> str:
    """What tells the scale, "unknown" if nothing does, and whether the focal length is unsure."""
    if row.scale_m_per_unit is None:
        return "unknown"
    K_source = row.quality.get("K_source")
    return f"{row.scale_source}, focal {K_source}" if K_source in UNSURE_FOCAL else row.scale_source
