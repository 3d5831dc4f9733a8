"""labels.csv: one row an animal, the columns that an ecologist wants."""

import csv
import io
from collections.abc import Iterable, Sequence
from pathlib import Path

from animal3dbox.datasets.sightings import SIGHTING_FIELDS
from animal3dbox.files import whole_file
from animal3dbox.geometry.cuboid import FACE_NAMES
from animal3dbox.report.label_files import AnimalRow

FIELD_COLUMNS = {
    "flank_confidence": ("flank_confidence",),
    "box": ("x0", "y0", "x1", "y1"),
    "face_share": tuple(f"share_{name}" for name in FACE_NAMES),
    "surface_share": tuple(f"surface_{name}" for name in FACE_NAMES),
}
"""The fields of a row of labels.json that have columns of their own -> these, in the order of
their numbers."""
CSV_COLUMNS = (
    *("image", "animal", "side", "viewpoint", "sample_id", "category"),
    *("flank", *FIELD_COLUMNS["flank_confidence"], "flags", "distance_m", "distance_source"),
    *FIELD_COLUMNS["box"],
    *FIELD_COLUMNS["face_share"],
    *FIELD_COLUMNS["surface_share"],
    *("azimuth_deg", "elevation_deg", "confidence"),
    *SIGHTING_FIELDS,
)
"""The columns of labels.csv; an empty cell is unknown."""
DECIMALS = {
    **dict.fromkeys(FIELD_COLUMNS["flank_confidence"], 3),
    "distance_m": 3,
    **dict.fromkeys(FIELD_COLUMNS["box"], 1),
    **dict.fromkeys((*FIELD_COLUMNS["face_share"], *FIELD_COLUMNS["surface_share"]), 4),
    **{"azimuth_deg": 1, "elevation_deg": 1, "confidence": 3},
}
"""The columns that hold numbers -> the decimals that labels.csv has of them."""
FORMULA_SIGNS = ("=", "+", "-", "@", "\t", "\r")
"""What a cell begins with that spreadsheets take for a formula."""
UNSURE_FOCAL = ("guessed", "estimated")
"""Sources of a focal length that make a distance unsure by as much as they are."""


def write_labels_csv(
    path: Path, animals: Iterable[AnimalRow], flags: Iterable[Sequence[str]] | None = None
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
    if flags is None:
        pairs: Iterable[tuple[AnimalRow, Sequence[str]]] = ((row, ()) for row in animals)
    else:
        pairs = zip(animals, flags, strict=True)
    with whole_file(path) as file:
        text = io.TextIOWrapper(file, encoding="utf-8", newline="")
        writer = csv.DictWriter(text, CSV_COLUMNS)
        writer.writeheader()
        writer.writerows(_cells(row, raised) for row, raised in pairs)
        text.flush()
        text.detach()


def csv_values(row: AnimalRow, raised: Sequence[str]) -> dict[str, str | int | float | None]:
    """Column -> value of one animal, numbers as they are; None where nothing is known.

    Args:
        row: of labels.json.
        raised: what its report flags.

    """
    fields = {
        column: number
        for field, columns in FIELD_COLUMNS.items()
        for column, number in zip(columns, _numbers(row, field, len(columns)), strict=True)
    }
    return {
        **fields,
        "image": row.image,
        "animal": row.animal,
        "side": row.side,
        "viewpoint": row.viewpoint,
        "sample_id": row.sample_id,
        "category": row.category,
        "flank": row.flank,
        "flags": ";".join(_flags(row, raised)),
        "distance_m": None if row.scale_m_per_unit is None else row.distance,
        "distance_source": distance_source(row),
        "azimuth_deg": row.azimuth_deg,
        "elevation_deg": row.elevation_deg,
        "confidence": row.confidence,
        **row.sighting.known,
    }


def _numbers(row: AnimalRow, field: str, count: int) -> Sequence[float | None]:
    """The numbers of a field, one or several; of one that is not known, None so many times."""
    value = getattr(row, field)
    if value is None:
        return (None,) * count
    return value if isinstance(value, list) else (value,)


def _cells(row: AnimalRow, raised: Sequence[str]) -> dict[str, str | int]:
    """Column -> cell of one animal; empty where nothing is known."""
    return {name: _cell(name, value) for name, value in csv_values(row, raised).items()}


def _cell(column: str, value: str | int | float | None) -> str | int:
    """A cell: text that no spreadsheet runs, a number with the decimals of its column."""
    if value is None:
        return ""
    if isinstance(value, str):
        return text_cell(value)
    decimals = DECIMALS.get(column)
    return int(value) if decimals is None else f"{value:.{decimals}f}"


def text_cell(text: str) -> str:
    """A text with a mark before it where spreadsheets would run it as a formula."""
    return f"'{text}" if text.startswith(FORMULA_SIGNS) else text


def _flags(row: AnimalRow, raised: Sequence[str]) -> list[str]:
    """The words that call for a look at a label, each once."""
    quality_flags = row.quality.get("flags")
    return list(
        dict.fromkeys((*raised, *(quality_flags if isinstance(quality_flags, list) else ())))
    )


def distance_source(row: AnimalRow) -> str:
    """What tells the scale, "unknown" if nothing does, and whether the focal length is unsure."""
    if row.scale_m_per_unit is None:
        return "unknown"
    K_source = row.quality.get("K_source")
    return f"{row.scale_source}, focal {K_source}" if K_source in UNSURE_FOCAL else row.scale_source
