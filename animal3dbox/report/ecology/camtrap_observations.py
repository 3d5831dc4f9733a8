"""Labels as observations of a Camera Trap Data Package: side, viewpoint, box, distance, angle.

Nothing is invented: what the label or the user's package does not say stays empty, and a label
whose media file is not found is refused.
"""

import csv
import io
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from importlib.metadata import version
from pathlib import Path

from animal3dbox.datasets.exchange.export import ExportSummary
from animal3dbox.errors import ConfigError, SampleError
from animal3dbox.files import write_whole
from animal3dbox.report.ecology.camtrap_package import CamtrapPackage, read_camtrap_package
from animal3dbox.report.ecology.edge_boxes import EdgeBox, rows_with_boxes, turned_notes
from animal3dbox.report.label_files import AnimalRow
from animal3dbox.report.labels_csv import distance_source

TIMESTAMP = re.compile(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d(Z|[+-]\d\d:?\d\d)")


@dataclass(frozen=True)
class Field:
    """A column of the table of observations, and what its cells may be.

    Attributes:
        required: whether a cell must not be empty.
        words: what it may be; none: anything.
        low: least number; None: it is no number.
        high: greatest number.
        pattern: of the text.
    """

    required: bool = False
    words: tuple[str, ...] = ()
    low: float | None = None
    high: float = math.inf
    pattern: re.Pattern[str] | None = None

    def fault(self, cell: str) -> str | None:
        """What is wrong with a cell; None if nothing is."""
        if not cell:
            return "is empty, and the standard requires it" if self.required else None
        if self.words and cell not in self.words:
            return f"must be one of {', '.join(self.words)}, got {cell!r}"
        if self.low is not None and not self.low <= float(cell) <= self.high:
            return f"must lie within {self.low} and {self.high}, got {cell}"
        if self.pattern is not None and not (self.pattern.fullmatch(cell) and _is_time(cell)):
            return f"must be a time with its zone, as 2024-05-01T06:10:00+02:00, got {cell!r}"
        return None


def _is_time(cell: str) -> bool:
    """Whether a text is a time that a calendar has."""
    try:
        datetime.fromisoformat(cell)
    except ValueError:
        return False
    return True


FIELDS: Mapping[str, Field] = {
    "observationID": Field(required=True),
    "deploymentID": Field(required=True),
    "mediaID": Field(),
    "eventID": Field(),
    "eventStart": Field(required=True, pattern=TIMESTAMP),
    "eventEnd": Field(required=True, pattern=TIMESTAMP),
    "observationLevel": Field(required=True, words=("media", "event")),
    "observationType": Field(
        required=True,
        words=("animal", "human", "vehicle", "blank", "unknown", "unclassified"),
    ),
    "cameraSetupType": Field(words=("setup", "calibration")),
    "scientificName": Field(),
    "count": Field(low=1),
    "lifeStage": Field(words=("adult", "subadult", "juvenile")),
    "sex": Field(words=("female", "male")),
    "behavior": Field(),
    "individualID": Field(),
    "individualPositionRadius": Field(low=0),
    "individualPositionAngle": Field(low=-90, high=90),
    "individualSpeed": Field(low=0),
    "bboxX": Field(low=0, high=1),
    "bboxY": Field(low=0, high=1),
    "bboxWidth": Field(low=1e-15, high=1),
    "bboxHeight": Field(low=1e-15, high=1),
    "classificationMethod": Field(words=("human", "machine")),
    "classifiedBy": Field(),
    "classificationTimestamp": Field(pattern=TIMESTAMP),
    "classificationProbability": Field(low=0, high=1),
    "observationTags": Field(),
    "observationComments": Field(),
}
"""The columns of observations.csv in Camtrap DP 1.0 to 1.0.2, in their order."""


def write_camtrap_dp(
    animals: Sequence[AnimalRow], package: Path | CamtrapPackage, path: Path
) -> ExportSummary:
    """Write labels as observations of the user's Camera Trap Data Package.

    An observation is of a media file: mediaID, deploymentID and its time are copied from the
    package's media.csv. The box is a part of the picture, `observationTags` are
    `side:left|viewpoint:front-left`; radius (m) and angle (degrees, negative to the left) stand
    only where the scale is known, and observationComments says by what. Species and the probability
    of a classification stay empty: no label knows them; the dataset's category is in the comments.

    Args:
        animals: the rows of labels.json.
        package: the package, or the folder of its datapackage.json.
        path: the CSV file. It must not be the package's own observations.csv: join them yourself.

    Returns:
        The summary; its faults are the animals that could not be written.

    Raises:
        ConfigError: path is the package's own, or the package is of another version.
        DatasetNotFoundError: the package is not there.
        DatasetFormatError: the package is not as the standard says.

    Example:
        >>> import tempfile
        >>> package = CamtrapPackage(Path("camera-7"), "1.0.2", {}, {})
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     summary = write_camtrap_dp([], package, Path(folder) / "observations.csv")
        ...     (Path(folder) / "observations.csv").read_text().split(",")[:2]
        ['observationID', 'deploymentID']
    """
    if isinstance(package, Path):
        package = read_camtrap_package(package)
    if path.resolve() == (package.folder / "observations.csv").resolve():
        raise ConfigError(
            f"--out {path} is the package's own observations.csv: name another file, and join them"
        )
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, tuple(FIELDS))
    writer.writeheader()
    pairs, outside = rows_with_boxes(animals)
    faults: list[SampleError] = [*outside]
    rows: list[AnimalRow] = []
    for row, box in pairs:
        try:
            writer.writerow(_observation(row, box, package))
        except SampleError as fault:
            faults.append(fault)
            continue
        rows.append(row)
    write_whole(path, text.getvalue().encode())
    unplaced = sum(not _scale_is_known(row) for row in rows)
    note = f"{unplaced} of {len(rows)} animals have no distance: their scale is not known"
    return ExportSummary(
        files=(path,),
        images=len({row.image for row in rows}),
        boxes=len(rows),
        faults=tuple(faults),
        notes=((note,) if unplaced else ()) + turned_notes(rows),
    )


def _observation(row: AnimalRow, box: EdgeBox, package: CamtrapPackage) -> dict[str, str]:
    """Column -> cell of an animal with its 2D box, each as the standard wants it.

    Raises:
        SampleError: its media file is not found, or a cell would not be as the standard says.

    """
    media = package.media_of(row.image, row.sample_id)
    height, width = row.image_hw
    x, y, wide, high = box
    side = (f"side:{row.side}",) if row.side else ()
    cells = {
        "observationID": f"{media['mediaID']}:{row.animal}" if media["mediaID"] else "",
        "deploymentID": media["deploymentID"],
        "mediaID": media["mediaID"],
        "eventStart": media["timestamp"],
        "eventEnd": media["timestamp"],
        "observationLevel": "media",
        "observationType": "animal",
        "count": "1",
        "individualID": row.sighting.individual or "",
        **_position(row),
        "bboxX": f"{x / width:.6f}",
        "bboxY": f"{y / height:.6f}",
        "bboxWidth": f"{wide / width:.6f}",
        "bboxHeight": f"{high / height:.6f}",
        "classificationMethod": "machine",
        "classifiedBy": f"animal3dbox {version('animal3dbox')}",
        "observationTags": "|".join((*side, f"viewpoint:{row.viewpoint}")),
        "observationComments": _comments(row),
    }
    for name, field in FIELDS.items():
        if problem := field.fault(cells.get(name, "")):
            raise SampleError(row.sample_id, name, f"{problem} (media.csv: {dict(media)})")
    return cells


def _scale_is_known(row: AnimalRow) -> bool:
    return row.scale_m_per_unit is not None


def _position(row: AnimalRow) -> dict[str, str]:
    """Radius in m and angle in degrees of an animal whose scale is known."""
    if not _scale_is_known(row):
        return {}
    x, _, z = row.center
    return {
        "individualPositionRadius": f"{math.hypot(*row.center):.3f}",
        "individualPositionAngle": f"{math.degrees(math.atan2(x, z)):.2f}",
    }


def _comments(row: AnimalRow) -> str:
    """What no column holds: the dataset's category, how sure the box is, what told the distance."""
    remarks = [f"category {row.category}", f"confidence of the 3D box {row.confidence:.2f}"]
    if _scale_is_known(row):
        remarks.append(f"distance by {distance_source(row)}")
    return "; ".join(remarks)
