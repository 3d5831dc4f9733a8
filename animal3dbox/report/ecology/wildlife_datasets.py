"""The table of animals that wildlife-datasets reads, for re-identification by sides."""

import csv
import io
from collections.abc import Sequence
from pathlib import Path

from animal3dbox.datasets.exchange.export import ExportSummary
from animal3dbox.files import write_whole
from animal3dbox.report.ecology.edge_boxes import rows_with_boxes, turned_notes
from animal3dbox.report.label_files import AnimalRow

COLUMNS = ("image_id", "identity", "path", "bbox", "orientation", "species", "date")
UNKNOWN = "unknown"
"""Identity of an animal that nobody knows, as wildlife-datasets writes it."""


def write_wildlife_datasets(animals: Sequence[AnimalRow], path: Path) -> ExportSummary:
    """Write labels as the metadata table of wildlife-datasets, a row an animal.

    `image_id` is the label's sample_id, `path` its image, `bbox` [x, y, width, height] in px from
    the picture's corner, `orientation` the side that is seen (front, back, left, right, top,
    bottom; empty where none is), `identity` and `date` what the dataset's file said.

    Args:
        animals: the rows of labels.json.
        path: the CSV file; one that is there is replaced.

    Returns:
        The summary; its faults are the animals without a box in the frame, which are left out.

    Example:
        >>> import tempfile
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     summary = write_wildlife_datasets([], Path(folder) / "metadata.csv")
        ...     (Path(folder) / "metadata.csv").read_text().split(",")[:2]
        ['image_id', 'identity']
    """
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, COLUMNS)
    writer.writeheader()
    pairs, faults = rows_with_boxes(animals)
    for row, box in pairs:
        writer.writerow(
            {
                "image_id": row.sample_id,
                "identity": row.sighting.individual or UNKNOWN,
                "path": row.image,
                "bbox": f"[{', '.join(f'{px:.1f}' for px in box)}]",
                "orientation": row.side or "",
                "species": row.category,
                "date": row.sighting.time or "",
            }
        )
    write_whole(path, text.getvalue().encode())
    rows = [row for row, _ in pairs]
    unnamed = sum(row.sighting.individual is None for row in rows)
    note = f"{unnamed} of {len(rows)} animals have no identity in their dataset: {UNKNOWN}"
    return ExportSummary(
        files=(path,),
        images=len({row.image for row in rows}),
        boxes=len(rows),
        faults=faults,
        notes=((note,) if unnamed else ()) + turned_notes(rows),
    )
