"""Elements of annotation files, checked one by one.

A bad one is an error that names its sample and field.
"""

from collections.abc import Sequence
from typing import TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from animal3dbox.datasets.images.photos import MAX_PIXELS
from animal3dbox.errors import SampleError

_Entry = TypeVar("_Entry", bound=msgspec.Struct)


def decoded(raw: msgspec.Raw, kind: type[_Entry], sample_id: str) -> _Entry:
    """One element as a struct."""
    try:
        return msgspec.json.decode(raw, type=kind)
    except msgspec.ValidationError as error:
        raise SampleError(sample_id, *_field_and_problem(error)) from error
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise SampleError(sample_id, "entry", f"cannot be decoded: {error}") from error


def _field_and_problem(error: msgspec.ValidationError) -> tuple[str, str]:
    """The field that msgspec names at the end of its message, and the message."""
    text = str(error)
    where = text.rpartition("$")[2].strip(" .`") if "$" in text else ""
    missing = text.partition("field `")[2].partition("`")[0]
    return (where or missing or "entry"), text


def image_size(
    height: int, width: int, sample_id: str, fields: str = "height, width"
) -> tuple[int, int]:
    """(height, width), positive and not of more than MAX_PIXELS."""
    if height <= 0 or width <= 0 or height * width > MAX_PIXELS:
        raise SampleError(
            sample_id,
            fields,
            f"must be positive and make at most {MAX_PIXELS} pixels, got {width} x {height}",
        )
    return height, width


def read_rows(
    rows: list[list[float | None]], count: int, sample_id: str, field: str
) -> NDArray[np.float64]:
    """Keypoints (count, 3) of x, y, visibility; one with a null counts as missing."""
    if len(rows) != count or any(len(row) != 3 for row in rows):
        lengths = sorted({len(row) for row in rows})
        raise SampleError(
            sample_id,
            field,
            f"must be {count} x 3 (x, y, visibility), got {len(rows)} rows of {lengths} numbers",
        )
    return np.array([[0.0, 0.0, 0.0] if None in row else row for row in rows], dtype=np.float64)


def read_box(
    numbers: Sequence[float], sample_id: str, field: str, form: str = "x, y, w, h"
) -> NDArray[np.float64]:
    """A box (4,) xyxy px in our pixels, whose centres are whole numbers.

    Args:
        numbers: as the file has them: a pixel goes from its whole number to the next.
        sample_id: named in every error.
        field: likewise.
        form: "x, y, w, h", or "xmin, ymin, xmax, ymax".

    """
    box = np.array(numbers, dtype=np.float64)
    if len(box) == 4 and form == "x, y, w, h":
        box[2:] += box[:2]
    if len(box) != 4 or not np.isfinite(box).all() or not (box[2:] > box[:2]).all():
        raise SampleError(
            sample_id, field, f"must be [{form}] with a positive area, got {list(numbers)}"
        )
    return box - 0.5


def check_in_box(
    keypoints: NDArray[np.float64],
    box: NDArray[np.float64],
    sample_id: str,
    fields: tuple[str, str],
) -> None:
    """Raise if most visible keypoints (J, 3) miss the animal's box, grown by a tenth.

    They are not pixels of this image, or not of this animal.

    Args:
        keypoints: x, y, visibility; (0, 0) counts as missing.
        box: (4,) xyxy px.
        sample_id: named in the error.
        fields: of the keypoints and of the box, likewise.

    """
    seen = keypoints[(keypoints[:, 2] > 0) & keypoints[:, :2].any(axis=1), :2]
    size = box[2:] - box[:2]
    inside = int(((seen > box[:2] - 0.1 * size) & (seen < box[2:] + 0.1 * size)).all(axis=1).sum())
    if 2 * inside < len(seen):
        said = [float(v) for v in box + 0.5]
        raise SampleError(
            sample_id,
            fields[0],
            f"only {inside} of {len(seen)} visible ones lie in or near {fields[1]} (from {said[:2]}"
            f" to {said[2:]}): are they pixels of this image?",
        )
