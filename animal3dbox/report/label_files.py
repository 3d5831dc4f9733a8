"""labels.json: one row an animal, in the documented schema."""

from collections.abc import Iterable, Iterator
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal

import msgspec
import numpy as np

from animal3dbox.datasets.sightings import NO_SIGHTING, Sighting
from animal3dbox.errors import DatasetFormatError
from animal3dbox.files import whole_file
from animal3dbox.geometry.cuboid import CORNER_SIGNS, FACE_NAMES
from animal3dbox.labels.fit_parameters import Array, FitParameters
from animal3dbox.labels.flank import Flank
from animal3dbox.labels.types import CuboidLabel
from animal3dbox.target_schema import FILE_FIELDS, Field

SCHEMA: Final = "animal3dbox.labels"
SCHEMA_VERSION: Final = 1


def _file_type(field: Field) -> Any:
    """The type of a field's entry in labels.json: nested lists of numbers, null where unknown."""
    kind: Any = bool if field.kind == "flag" else float
    if field.name == "corners_2d":
        return list[list[float] | None]  # a corner that is not in front of the camera is null
    for _ in field.entry_shape or ():
        kind = list[kind]
    return (
        kind | None if field.name == "surface_share" or field.in_labels_json == "optional" else kind
    )


if TYPE_CHECKING:

    class _Numbers(msgspec.Struct):
        def __getattr__(self, name: str) -> Any: ...

        def __setattr__(self, name: str, value: Any) -> None: ...

else:
    _Numbers = msgspec.defstruct(
        "_Numbers",
        [
            (
                field.label_name,
                _file_type(field),
                *((None,) if field.in_labels_json == "optional" else ()),
            )
            for field in FILE_FIELDS
        ],
        kw_only=True,
    )


class FitRow(msgspec.Struct, kw_only=True):
    """The parameters of a body that was fitted to the picture; see FitParameters.

    Its camera is the row's R, t and K.

    Attributes:
        body: "quadruped", "quadruped:<species>" or "model".
        digest: of the body's model.
        vocabulary: the keypoints' name.
        betas: shape.
        pose: (J, 3) axis-angle in radians, root first.
        keypoints: x, y in px and visibility of each keypoint, as used.

    Example:
        >>> row = FitRow(
        ...     body="model", digest="0", vocabulary="animal3d26", betas=[], pose=[], keypoints=[])
        >>> row.parameters.is_of_quadruped
        False
    """

    body: str
    digest: str
    vocabulary: str
    betas: list[float]
    pose: list[tuple[float, float, float]]
    keypoints: list[tuple[float, float, float]]

    @property
    def parameters(self) -> FitParameters:
        """The same as labels have it."""
        betas, pose = np.array(self.betas), np.array(self.pose).reshape(-1, 3)
        return FitParameters(self.body, self.digest, self.vocabulary, betas, pose)


class AnimalRow(_Numbers, kw_only=True):
    """One labelled animal; see docs/formats.md. Only of a fitted body is there a `fit`.

    Besides what is written here, it has every field of target_schema.FILE_FIELDS.

    Example:
        >>> sorted(AnimalRow.__struct_fields__)[:4]
        ['K', 'R', 'animal', 'azimuth_deg']
    """

    sample_id: str
    image: str
    animal: int
    category: str
    image_hw: tuple[int, int]
    side: str | None
    surface_side: str | None
    viewpoint: str
    azimuth_deg: float
    elevation_deg: float
    confidence: float
    flank: Flank | None = None
    quality: dict[str, float | int | str | list[str] | None]
    scale_m_per_unit: float | None = None
    scale_source: str = "unknown"
    distortion: list[float] | None = None
    sighting: Sighting = NO_SIGHTING
    upright: bool = False
    fit: FitRow | msgspec.UnsetType = msgspec.UNSET


class RejectedRow(msgspec.Struct, kw_only=True):
    """One animal without a label, and the reason.

    Example:
        >>> row = RejectedRow(sample_id="a", image="a.jpg", animal=0, reason="no_pose", detail="")
        >>> row.reason
        'no_pose'
    """

    sample_id: str
    image: str
    animal: int
    reason: str
    detail: str


class LabelFile(msgspec.Struct, kw_only=True):
    """The content of labels.json.

    Example:
        >>> file = LabelFile(body="dog", config={}, animals=[], rejected=[])
        >>> file.schema, file.face_names[0], file.corner_signs[0]
        ('animal3dbox.labels', 'front', (-1, -1, -1))
    """

    schema: Literal["animal3dbox.labels"] = SCHEMA
    version: Literal[1] = SCHEMA_VERSION
    body: str
    config: dict[str, float | int | str | bool | None]
    face_names: tuple[str, ...] = FACE_NAMES
    corner_signs: tuple[tuple[int, int, int], ...] = CORNER_SIGNS
    animals: list[AnimalRow]
    rejected: list[RejectedRow]


def animal_row(
    label: CuboidLabel,
    *,
    image: str,
    animal: int,
    category: str,
    sighting: Sighting = NO_SIGHTING,
    upright: bool = False,
) -> AnimalRow:
    """The row of a label; what is unknown is null.

    Args:
        label: of the animal.
        image: its image.
        animal: its number there.
        category: what the dataset calls it.
        sighting: when, where and of whom the picture is.
        upright: whether the label is for the picture turned as its file's header says.

    Example:
        >>> from animal3dbox import LabelConfig, label_animal
        >>> label = label_animal(
        ...     image_hw=(120, 160),
        ...     vertices=[[x, y, z] for x in (-1, 1) for y in (-0.5, 0.5) for z in (-0.4, 0.4)],
        ...     K=[[100, 0, 79.5], [0, 100, 59.5], [0, 0, 1]],
        ...     pose=([[1, 0, 0], [0, 0, -1], [0, 1, 0]], [0, 0, 5]),
        ...     config=LabelConfig(axes="pca"),
        ... )
        >>> row = animal_row(label, image="herd/a.jpg", animal=1, category="dog")
        >>> row.sample_id, row.side
        ('herd/a.jpg#1', 'right')
    """
    numbers: dict[str, Any] = {}
    for field in FILE_FIELDS:
        name = field.label_name or field.name
        values = label.field(name)
        numbers[name] = (values.astype(bool) if field.kind == "flag" else values).tolist()
    corners = zip(numbers["corners_2d"], label.field("corner_in_front").tolist(), strict=True)
    numbers["corners_2d"] = [px if in_front else None for px, in_front in corners]
    if label.surface_share is None:
        numbers["surface_share"] = None
    quality = {
        field: list(value) if isinstance(value, tuple) else value
        for field, value in asdict(label.quality).items()
    }
    return AnimalRow(
        **numbers,
        sample_id=label.sample_id or f"{image}#{animal}",
        image=image,
        animal=animal,
        category=category,
        image_hw=label.image_hw,
        side=label.side,
        surface_side=label.surface_side,
        viewpoint=label.viewpoint,
        azimuth_deg=label.azimuth_deg,
        elevation_deg=label.elevation_deg,
        confidence=label.confidence,
        flank=label.flank,
        quality=quality,
        scale_m_per_unit=label.scale_m_per_unit,
        scale_source=label.scale_source,
        distortion=None if label.lens is None else label.lens.tolist(),
        sighting=sighting,
        upright=upright,
        fit=msgspec.UNSET if label.fit is None else _fit_row(label.fit, label.keypoints_2d),
    )


def _fit_row(fit: FitParameters, keypoints: Array | None) -> FitRow:
    """The row of a fit to keypoints (J, 3)."""
    return FitRow(
        body=fit.body,
        digest=fit.digest,
        vocabulary=fit.vocabulary,
        betas=fit.betas.tolist(),
        pose=[(x, y, z) for x, y, z in fit.pose.tolist()],
        keypoints=[] if keypoints is None else [(x, y, v) for x, y, v in keypoints.tolist()],
    )


def write_labels_json(path: Path, file: LabelFile) -> None:
    """Write labels.json whole or not at all, once it reads back in its schema.

    Msgspec writes NaN as null.

    Raises:
        DatasetFormatError: a number is NaN or infinite where the schema wants a number.

    Example:
        >>> import tempfile
        >>> from animal3dbox.report import LabelFile, RejectedRow, write_labels_json
        >>> row = RejectedRow(sample_id="a", image="a.jpg", animal=0, reason="no_pose", detail="")
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     out = Path(folder) / "labels.json"
        ...     write_labels_json(out, LabelFile(body="dog", config={}, animals=[], rejected=[row]))
        ...     '"reason": "no_pose"' in out.read_text()
        True
    """
    write_label_rows(path, file, animals=file.animals, rejected=file.rejected)


def write_label_rows(
    path: Path,
    head: LabelFile,
    *,
    animals: Iterable[AnimalRow],
    rejected: Iterable[RejectedRow],
) -> None:
    """Write labels.json row by row, as write_labels_json writes it, without holding all rows.

    Args:
        path: the file.
        head: all but the rows.
        animals: the rows of labels.
        rejected: those of animals without one.

    Raises:
        DatasetFormatError: a number is NaN or infinite where the schema wants a number.

    """
    empty = msgspec.structs.replace(head, animals=[], rejected=[])
    start, _, _ = _indented(empty).rpartition(b' "animals"')
    with whole_file(path) as file:
        file.write(start + b' "animals": ')
        for piece in _array(_checked(path, row) for row in animals):
            file.write(piece)
        file.write(b',\n "rejected": ')
        for piece in _array(map(msgspec.json.encode, rejected)):
            file.write(piece)
        file.write(b"\n}")


def _indented(value: Any) -> bytes:
    return msgspec.json.format(msgspec.json.encode(value), indent=1)


def _array(rows: Iterable[bytes]) -> Iterator[bytes]:
    """The pieces of an array of JSON objects, indented as a field of the file."""
    is_empty = True
    for row in rows:
        yield b"[\n  " if is_empty else b",\n  "
        yield msgspec.json.format(row, indent=1).replace(b"\n", b"\n  ")
        is_empty = False
    yield b"[]" if is_empty else b"\n ]"


def _checked(path: Path, row: AnimalRow) -> bytes:
    """A row as JSON that reads back in its schema."""
    data = msgspec.json.encode(row)
    try:
        msgspec.json.decode(data, type=AnimalRow)
    except msgspec.ValidationError as error:
        raise DatasetFormatError(
            f"{path} is not written, for a value of {row.sample_id} is NaN, infinite or of the"
            f" wrong type: {error}"
        ) from error
    return data


def labels_file(path: Path) -> Path:
    """The labels.json of the folder that ``animal3dbox label`` wrote.

    Any other path is the file itself.
    """
    return path / "labels.json" if path.is_dir() else path
