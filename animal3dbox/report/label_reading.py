"""labels.json read back, one animal by one, so that a bad row is named and spoils no other."""

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import msgspec

from animal3dbox.datasets.readers.elements import decoded
from animal3dbox.datasets.storage.json_files import decode_json
from animal3dbox.errors import DatasetFormatError, SampleError
from animal3dbox.geometry.cuboid import CORNER_SIGNS, FACE_NAMES
from animal3dbox.progress import watched
from animal3dbox.report.label_files import AnimalRow, LabelFile

REMEDY = "label its image again, or take the row out"


class _Undecoded(LabelFile, kw_only=True):
    """labels.json with its animals still to be decoded."""

    animals: list[msgspec.Raw]  # type: ignore[assignment]


class _Named(msgspec.Struct):
    """What an animal is called."""

    sample_id: str


def read_label_rows(path: Path) -> tuple[LabelFile, tuple[SampleError, ...]]:
    """Read labels.json back.

    Args:
        path: the file.

    Returns:
        What it holds, without the animals that cannot be used; and these, each with its name or its
        place in the list, its field and what to do.

    Raises:
        DatasetNotFoundError: no such file.
        DatasetFormatError: not JSON, not of this schema and version, or with faces or corners in
            another order than this version has.

    Example:
        >>> import tempfile
        >>> from animal3dbox.report import LabelFile, RejectedRow, write_labels_json
        >>> row = RejectedRow(sample_id="a", image="a.jpg", animal=0, reason="no_pose", detail="")
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     out = Path(folder) / "labels.json"
        ...     write_labels_json(out, LabelFile(body="dog", config={}, animals=[], rejected=[row]))
        ...     labels, faults = read_label_rows(out)
        >>> labels.rejected[0].reason, faults
        ('no_pose', ())
    """
    file: _Undecoded = decode_json(path, _Undecoded)
    for field, ours in (("face_names", FACE_NAMES), ("corner_signs", CORNER_SIGNS)):
        theirs = getattr(file, field)
        if theirs != ours:
            raise DatasetFormatError(
                f"{path}: {field} must be {list(ours)}, got {list(theirs)}: faces and corners of"
                f" version {file.version} have this order alone. If only the head of the file was"
                f" changed, put {field} back; if the rows were too, label again"
            )
    animals, faults = _rows(file.animals)
    return LabelFile(
        body=file.body, config=file.config, animals=animals, rejected=file.rejected
    ), tuple(faults)


def read_labels_json(path: Path) -> LabelFile:
    """Read labels.json back, checked against its schema as a whole.

    Raises:
        DatasetNotFoundError: no such file.
        DatasetFormatError: as read_label_rows, or for an animal that cannot be used.

    Example:
        >>> import tempfile
        >>> from animal3dbox.report import LabelFile, RejectedRow, write_labels_json
        >>> row = RejectedRow(sample_id="a", image="a.jpg", animal=0, reason="no_pose", detail="")
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     out = Path(folder) / "labels.json"
        ...     write_labels_json(out, LabelFile(body="dog", config={}, animals=[], rejected=[row]))
        ...     read_labels_json(out).body
        'dog'
    """
    file, faults = read_label_rows(path)
    if faults:
        raise DatasetFormatError(f"{path}: {faults[0]}") from faults[0]
    return file


def _rows(raws: Sequence[msgspec.Raw]) -> tuple[list[AnimalRow], list[SampleError]]:
    """The animals that can be used, and what is wrong with the others."""
    animals: list[AnimalRow] = []
    faults: list[SampleError] = []
    places: dict[str, int] = {}
    for place, raw in enumerate(watched(raws, "reading", unit="label")):
        name = f"animals[{place}]"
        with suppress(
            msgspec.DecodeError, UnicodeDecodeError
        ):  # of which decoded tells, with its field
            name = msgspec.json.decode(raw, type=_Named).sample_id
        first = places.setdefault(name, place)
        if first != place:
            faults.append(
                SampleError(
                    name,
                    "sample_id",
                    f"is that of animals[{first}] and of animals[{place}]: take one of these"
                    " rows out",
                )
            )
            continue
        try:
            animals.append(decoded(raw, AnimalRow, name))
        except SampleError as error:
            faults.append(SampleError(name, error.field, f"{error.problem}: {REMEDY}"))
    return animals, faults
