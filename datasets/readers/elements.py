"""Checks of single elements of annotation files, for all readers of JSON.

A bad element is an error that names its sample and its field, and spoils no other element.
"""

from typing import Any, TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from animal3dbox.datasets.images.photos import MAX_PIXELS
from animal3dbox.errors import SampleError

MOST_EXACT = 2.0**53
"""From here on floats stand for several whole numbers: as ids they would merge."""
Matrix = list[list[float] | float]
"""The rows of a matrix, or its numbers row by row in one list."""
_Entry = TypeVar("_Entry", bound=msgspec.Struct)


def decoded(raw: msgspec.Raw, kind: type[_Entry], sample_id: str) -> _Entry:
    """One element of a file as a struct of a kind.

    Raises SampleError, naming the field, if it does not have the struct's form.
    """
    try:
        return msgspec.json.decode(raw, type=kind)
    except msgspec.ValidationError as error:
        try:
            value = msgspec.json.decode(raw)
        except msgspec.ValidationError:  # a number that is too large for any type
            raise SampleError(sample_id, *_field_and_problem(error)) from error
        return converted(value, kind, sample_id)
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise SampleError(sample_id, "entry", f"cannot be decoded: {error}") from error


def converted(value: Any, kind: type[_Entry], sample_id: str) -> _Entry:
    """One decoded element of a file, of plain values, as a struct of a kind.

    Raises SampleError, naming the field, if it does not have the struct's form.
    """
    try:
        return msgspec.convert(value, kind)
    except msgspec.ValidationError as error:
        try:
            return msgspec.convert(_with_whole_numbers(value), kind)
        except msgspec.ValidationError:
            raise SampleError(sample_id, *_field_and_problem(error)) from error


def plain_value(raw: msgspec.Raw, sample_id: str) -> Any:
    """One element of a file as plain values; raises SampleError for a number that no float holds.

    Args:
        raw: the element, which is known to be JSON.
        sample_id: named in the error.

    """
    try:
        return msgspec.json.decode(raw)
    except msgspec.ValidationError as error:
        raise SampleError(sample_id, *_field_and_problem(error)) from error


def _with_whole_numbers(value: Any) -> Any:
    """A decoded JSON value with integers for floats such as 640.0, which tables of floats write."""
    if isinstance(value, dict):
        return {key: _with_whole_numbers(one) for key, one in value.items()}
    if isinstance(value, list):
        return [_with_whole_numbers(one) for one in value]
    is_whole = isinstance(value, float) and value.is_integer() and abs(value) < MOST_EXACT
    return int(value) if is_whole else value


def _field_and_problem(error: msgspec.ValidationError) -> tuple[str, str]:
    """The field that msgspec names at the end of its message, and the message."""
    text = str(error)
    path = text.rpartition("$")[2].strip(" .`") if "$" in text else ""
    missing_field = text.partition("field `")[2].partition("`")[0]
    if text.startswith("Number out of range"):
        text += ": no number of 64 bits is so large; correct it in the file"
    return (path or missing_field or "entry"), text


def image_size(
    height: int, width: int, sample_id: str, fields: str = "height, width"
) -> tuple[int, int]:
    """The size (height, width) that a file states for an image, checked.

    Args:
        height: in pixels.
        width: in pixels.
        sample_id: named in the error.
        fields: the file's keys, named in the error.

    Raises:
        SampleError: a side is not positive, or there are more than MAX_PIXELS.

    """
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
    """The keypoints (count, 3) of a file's rows of x, y, visibility.

    A row with a null counts as missing and becomes zeros. Rows of x and y alone are visible but for
    (0, 0).

    Args:
        rows: as the file has them.
        count: number of keypoints that there must be.
        sample_id: named in the error.
        field: the file's key, named in the error.

    Raises:
        SampleError: other than count rows of three numbers.

    """
    if rows and all(len(row) == 2 for row in rows):
        rows = [[*row, float(any(row))] for row in rows]
    if len(rows) != count or any(len(row) != 3 for row in rows):
        lengths = sorted({len(row) for row in rows})
        raise SampleError(
            sample_id,
            field,
            f"must be {count} x 3 (x, y, visibility), got {len(rows)} rows of {lengths} numbers",
        )
    return np.array([[0.0, 0.0, 0.0] if None in row else row for row in rows], dtype=np.float64)


def read_box(
    numbers: Any, sample_id: str, field: str, form: str = "x, y, w, h"
) -> NDArray[np.float64]:
    """The upright box (4,) of four numbers, xyxy in our pixels, whose centres are whole numbers.

    Args:
        numbers: as the file has them, whatever they are; a pixel goes from its whole number to the
            next.
        sample_id: named in the error.
        field: the file's key, named in the error.
        form: "x, y, w, h", or "xmin, ymin, xmax, ymax".

    Raises:
        SampleError: not four finite numbers of a positive area.

    """
    try:
        box = np.array(numbers, dtype=np.float64)
    except (TypeError, ValueError):
        box = np.zeros(0)
    if box.shape == (4,) and form == "x, y, w, h":
        box[2:] += box[:2]
    if box.shape != (4,) or not np.isfinite(box).all() or not (box[2:] > box[:2]).all():
        raise SampleError(sample_id, field, f"must be [{form}] with a positive area, got {numbers}")
    return box - 0.5


def read_matrix(numbers: Matrix) -> NDArray[np.float64]:
    """A matrix of a file's rows; nine numbers in one list are 3 x 3, row by row.

    Raises ValueError for rows of different lengths.

    Args:
        numbers: as the file has them.

    """
    values = np.array(numbers, dtype=np.float64)
    return values.reshape(3, 3) if values.shape == (9,) else values
