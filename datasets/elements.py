"""Elements of annotation files, checked one by one: a bad one is an error that names its sample and field."""

from typing import TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from animal3dbox.datasets.images import MAX_PIXELS
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


def image_size(height: int, width: int, sample_id: str, fields: str = "height, width") -> tuple[int, int]:
    """(height, width), positive and not of more than MAX_PIXELS."""
    if height <= 0 or width <= 0 or height * width > MAX_PIXELS:
        raise SampleError(sample_id, fields, f"must be positive and make at most {MAX_PIXELS} pixels, got {width} x {height}")
    return height, width


def read_rows(rows: list[list[float | None]], count: int, sample_id: str, field: str) -> NDArray[np.float64]:
    """Keypoints (count, 3) of x, y, visibility; one with a null counts as missing."""
    if len(rows) != count or any(len(row) != 3 for row in rows):
        lengths = sorted({len(row) for row in rows})
        raise SampleError(sample_id, field, f"must be {count} x 3 (x, y, visibility), got {len(rows)} rows of {lengths} numbers")
    return np.array([[0.0, 0.0, 0.0] if None in row else row for row in rows], dtype=np.float64)
