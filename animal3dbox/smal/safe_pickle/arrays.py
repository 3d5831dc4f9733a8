"""Arrays from a model pickle's inert records: NumPy's, chumpy's, and SciPy's CSC matrices."""

import math
import re
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from animal3dbox.errors import ModelFileError
from animal3dbox.smal.safe_pickle.stream import (
    UNREADABLE,
    Call,
    Global,
    PickleLimits,
    describe,
    refusal,
)

Array = NDArray[Any]

_NUMPY = ("numpy.core.multiarray", "numpy._core.multiarray")
_RECONSTRUCT = {Global(module, "_reconstruct") for module in _NUMPY}
_SCALAR = {Global(module, "scalar") for module in _NUMPY}
_FROM_BUFFER = {
    Global("numpy.core.numeric", "_frombuffer"),
    Global("numpy._core.numeric", "_frombuffer"),
}
_NDARRAY = Global("numpy", "ndarray")
_DTYPE = Global("numpy", "dtype")
_CHUMPY = {Global("chumpy.ch", "Ch"), Global("chumpy", "Ch")}
_CSC = {
    Global(f"scipy.sparse.{module}", f"csc_{kind}")
    for module in ("csc", "_csc")
    for kind in ("matrix", "array")
}
_RECONSTRUCTOR = {Global("copy_reg", "_reconstructor"), Global("copyreg", "_reconstructor")}
_NEW_OBJECT = {Global("copy_reg", "__newobj__"), Global("copyreg", "__newobj__")}
_OBJECT = {Global("__builtin__", "object"), Global("builtins", "object")}
_ENCODE = Global("_codecs", "encode")
_BYTES = {Global("__builtin__", "bytes"), Global("builtins", "bytes"), Global("__builtin__", "str")}
_PLAIN_TYPE = re.compile(r"b1|[iu][1248]|f[248]")
_MOST_DIMENSIONS = 4
_MOST_ENTRIES = 2**48  # also of an array with an empty axis, whose other axes NumPy multiplies
_MOST_WRAPPERS = 4  # of chumpy objects around one array
_ARRAY_STATE, _DTYPE_STATE = 5, (8, 9)


@dataclass(frozen=True)
class Place:
    """The value that is being read, for the errors about it, and how much it may take.

    Attributes:
        source: the file.
        key: which of its values.
        limits: how much it may ask for.
    """

    source: str
    key: str
    limits: PickleLimits

    def fail(self, offset: int | None, problem: str, remedy: str = UNREADABLE) -> ModelFileError:
        """The error for the record at an offset."""
        return refusal(self.source, offset, f"{self.key}: {problem}", remedy)


def read_array(value: object, place: Place) -> Array:
    """The array that a value of the file stands for, in native byte order.

    A sparse matrix is filled.

    Raises:
        ModelFileError: it stands for none, or its bytes do not fit what it says of itself.

    """
    value = _without_chumpy(value, place)
    if isinstance(value, list | tuple):
        return _array_of_numbers(value, place)
    if not isinstance(value, Call):
        raise place.fail(None, f"expected an array, got {describe(value)}")
    if _named(value.func, _RECONSTRUCT):
        shape, dtype, order, raw = _reconstructed(value, place)
        data = _raw_bytes(raw, value.offset, place)
        return _array_of_bytes(data, dtype, shape, order=order, offset=value.offset, place=place)
    if _named(value.func, _FROM_BUFFER):
        return _from_buffer(value, place)
    if _named(value.func, _SCALAR) and len(value.args) == 2:
        data = _raw_bytes(value.args[1], value.offset, place)
        dtype = _read_dtype(value.args[0], place)
        return _array_of_bytes(data, dtype, (), order="C", offset=value.offset, place=place)
    if _named(class_of(value), _CSC):
        return _filled_matrix(value, place)
    kind = class_of(value)
    raise place.fail(
        value.offset,
        f"expected an array, got {describe(value) if kind is None else f'an object of {kind}'}",
    )


def read_array_list(value: object, place: Place, shape: tuple[int, ...]) -> Array:
    """Arrays of one shape, stacked: a list of them, an array of objects, or one array already.

    The shape is checked before memory is taken and at every member: a file can hold one array and
    name it very often.
    """
    if math.prod(shape) > place.limits.dense_cells:
        raise place.fail(
            None,
            f"expected numbers of shape {shape}, which are more than {place.limits.dense_cells}",
        )
    if isinstance(value, Call) and _named(value.func, _RECONSTRUCT) and _is_object_array(value):
        counts, _, _, members = _reconstructed(value, place, object_allowed=True)
        if not isinstance(members, list) or counts != (len(members),):
            raise place.fail(
                value.offset, f"an array of objects of shape {counts} with {describe(members)}"
            )
        value = members
    if not isinstance(value, list | tuple):
        return _of_shape(read_array(value, place), shape, place)
    if len(value) != shape[0]:
        raise place.fail(None, f"expected {shape[0]} arrays of shape {shape[1:]}, got {len(value)}")
    return np.stack([_of_shape(read_array(member, place), shape[1:], place) for member in value])


def _of_shape(array: Array, shape: tuple[int, ...], place: Place) -> Array:
    if array.shape != shape:
        raise place.fail(None, f"expected an array of shape {shape}, got {array.shape}")
    return array


def class_of(call: Call) -> Global | None:
    """The class of which a call makes an empty object, to be filled by its state.

    None for any other call.
    """
    func, args = call.func, call.args
    if (
        _named(func, _RECONSTRUCTOR)
        and len(args) == 3
        and _named(args[1], _OBJECT)
        and args[2] is None
        and isinstance(args[0], Global)
    ):
        return args[0]
    if _named(func, _NEW_OBJECT) and len(args) == 1 and isinstance(args[0], Global):
        return args[0]
    return func if isinstance(func, Global) and not args else None


def _named(value: object, names: set[Global]) -> bool:
    """Whether a value is one of some globals; others are not hashed, which could take for ever."""
    return isinstance(value, Global) and value in names


def _without_chumpy(value: object, place: Place) -> object:
    for _ in range(_MOST_WRAPPERS):
        if not isinstance(value, Call) or not _named(class_of(value), _CHUMPY):
            return value
        if not isinstance(value.state, dict) or "x" not in value.state:
            raise place.fail(
                value.offset, "a chumpy object without an array under x: it is computed from others"
            )
        value = value.state["x"]
    raise place.fail(None, f"more than {_MOST_WRAPPERS} chumpy objects around one array")


def _is_object_array(call: Call) -> bool:
    state = call.state
    dtype = state[2] if isinstance(state, tuple) and len(state) == _ARRAY_STATE else None
    return (
        isinstance(dtype, Call)
        and dtype.func == _DTYPE
        and dtype.args[:1] in (("O8",), ("O4",), ("O",))
    )


def _reconstructed(
    call: Call, place: Place, object_allowed: bool = False
) -> tuple[tuple[int, ...], np.dtype[Any], str, object]:
    """Shape, type, order and the raw content of an array's record."""
    state = call.state
    if call.args[:1] != (_NDARRAY,) or not isinstance(state, tuple) or len(state) != _ARRAY_STATE:
        raise place.fail(
            call.offset,
            f"an array record with {describe(state)} for its state, where five values belong",
        )
    version, shape, dtype, fortran, raw = state
    if type(version) is not int or version != 1 or type(fortran) not in (bool, int):
        raise place.fail(
            call.offset,
            f"an array record of version {describe(version)}, order {describe(fortran)}",
        )
    number_type = np.dtype(object) if object_allowed else _read_dtype(dtype, place)
    return _read_shape(shape, call.offset, place), number_type, "F" if fortran else "C", raw


def _from_buffer(call: Call, place: Place) -> Array:
    if len(call.args) != 4 or call.args[3] not in ("C", "F"):
        raise place.fail(call.offset, "a buffer record that is not (bytes, type, shape, order)")
    raw, dtype, shape, order = call.args
    checked = _read_shape(shape, call.offset, place)
    return _array_of_bytes(
        _raw_bytes(raw, call.offset, place),
        _read_dtype(dtype, place),
        checked,
        order=str(order),
        offset=call.offset,
        place=place,
    )


def _read_shape(shape: object, offset: int, place: Place) -> tuple[int, ...]:
    if not isinstance(shape, tuple) or len(shape) > _MOST_DIMENSIONS:
        raise place.fail(
            offset,
            f"a shape of at most {_MOST_DIMENSIONS} sizes was expected, got {describe(shape)}",
        )
    sizes = tuple(size for size in shape if type(size) is int and 0 <= size < 2**32)
    if len(sizes) != len(shape) or math.prod(max(size, 1) for size in sizes) > _MOST_ENTRIES:
        raise place.fail(
            offset, f"a shape with impossible sizes: {', '.join(describe(size) for size in shape)}"
        )
    return sizes


def _read_dtype(value: object, place: Place) -> np.dtype[Any]:
    if (
        not isinstance(value, Call)
        or value.func != _DTYPE
        or not value.args
        or not isinstance(value.args[0], str)
    ):
        raise place.fail(
            value.offset if isinstance(value, Call) else None,
            f"a NumPy type was expected, got {describe(value)}",
        )
    name, state = value.args[0], value.state
    if not _PLAIN_TYPE.fullmatch(name):
        raise place.fail(value.offset, f"expected plain numbers, got NumPy's type {name[:40]!r}")
    if (
        not isinstance(state, tuple)
        or len(state) not in _DTYPE_STATE
        or state[2:5] != (None, None, None)
        or state[1] not in ("<", ">", "|", "=")
    ):
        raise place.fail(value.offset, f"a NumPy type {name!r} with unknown details")
    order = "<" if state[1] == "=" else str(state[1])
    return np.dtype(name).newbyteorder("|" if order == "|" else "<" if order == "<" else ">")


def _raw_bytes(value: object, offset: int, place: Place) -> bytes:
    """The bytes of an array.

    They stand as bytes, as Python 2's byte string read as latin1 text, or in Python 3's way to
    write bytes in old protocols.
    """
    if (
        isinstance(value, Call)
        and value.func == _ENCODE
        and len(value.args) == 2
        and value.args[1] == "latin1"
    ):
        value = value.args[0]
    elif isinstance(value, Call) and _named(value.func, _BYTES) and not value.args:
        value = b""
    if isinstance(value, bytes):
        return value
    if not isinstance(value, str):
        raise place.fail(offset, f"an array's bytes were expected, got {describe(value)}")
    try:
        return value.encode("latin1")
    except UnicodeEncodeError:
        raise place.fail(offset, "an array's bytes hold characters that are no bytes") from None


def _array_of_bytes(
    raw: bytes,
    dtype: np.dtype[Any],
    shape: tuple[int, ...],
    *,
    order: str,
    offset: int,
    place: Place,
) -> Array:
    """An array's bytes as the array, in native byte order."""
    if math.prod(shape) * dtype.itemsize != len(raw):
        raise place.fail(
            offset,
            f"shape {shape} of {dtype} needs {math.prod(shape) * dtype.itemsize} bytes, but there"
            f" are {len(raw)}",
        )
    if dtype.kind == "b" and raw.strip(b"\0\1"):
        raise place.fail(offset, "booleans other than 0 and 1")
    flat = np.frombuffer(raw, dtype=dtype)
    shaped = flat.reshape(shape[::-1]).transpose() if order == "F" else flat.reshape(shape)
    return np.array(shaped, dtype=dtype.newbyteorder("="), order="C")


def _array_of_numbers(value: list[object] | tuple[object, ...], place: Place) -> Array:
    """The array of a list of numbers, or of rows of numbers of one length."""
    rows = value if value and all(isinstance(row, list | tuple) for row in value) else [value]
    lengths = [len(row) for row in rows if isinstance(row, list | tuple)]
    if sum(lengths) > place.limits.opcodes:  # one row, named very often
        raise place.fail(
            None, f"a list of {sum(lengths)} numbers, more than the file can have written"
        )
    numbers = [
        number
        for row in rows
        if isinstance(row, list | tuple)
        for number in row
        if isinstance(number, int | float)
    ]
    if len(set(lengths)) != 1 or len(numbers) != sum(lengths):
        raise place.fail(
            None,
            f"expected an array, got {describe(value)} that does not hold numbers alone, in rows of"
            " one length",
        )
    whole = all(isinstance(number, int) for number in numbers)
    if whole and not all(-(2**63) <= number < 2**63 for number in numbers):
        raise place.fail(None, "whole numbers that need more than 64 bits with their sign")
    flat: Array = np.array(numbers, dtype=np.int64 if whole else np.float64)
    return flat if rows[0] is value else flat.reshape(len(rows), -1)


def _filled_matrix(call: Call, place: Place) -> Array:
    """The dense form of a CSC matrix; places given twice add up, as in SciPy."""
    state = call.state if isinstance(call.state, dict) else {}
    missing = [name for name in ("indptr", "indices", "data") if name not in state]
    shape = _read_shape(state.get("_shape", state.get("shape")), call.offset, place)
    if missing or len(shape) != 2:
        raise place.fail(
            call.offset,
            f"a sparse matrix of shape {shape} without {', '.join(missing) or 'a second axis'}",
        )
    if math.prod(shape) > place.limits.dense_cells:
        raise place.fail(
            call.offset,
            f"a sparse matrix of shape {shape}, which has more than {place.limits.dense_cells}"
            " entries",
        )
    indptr, indices, data = (
        read_array(state[name], place) for name in ("indptr", "indices", "data")
    )
    problem = _pointer_problem(shape, indptr, indices, data)
    if problem is not None:
        raise place.fail(call.offset, f"a sparse matrix of shape {shape} {problem}")
    dense = np.zeros(shape, dtype=np.float64)
    starts = indptr.astype(np.int64)
    column = np.repeat(np.arange(shape[1]), starts[1:] - starts[:-1])
    with np.errstate(all="ignore"):  # whoever needs finite numbers checks the result
        np.add.at(dense, (indices.astype(np.int64), column), data.astype(np.float64))
    return dense


def _pointer_problem(
    shape: tuple[int, ...], indptr: Array, indices: Array, data: Array
) -> str | None:
    """The fault of a CSC matrix, or None; before any pointer is used."""
    rows, columns = shape
    for name, array in (("indptr", indptr), ("indices", indices), ("data", data)):
        if array.ndim != 1 or (name != "data" and array.dtype.kind not in "iu"):
            return f"whose {name} has shape {array.shape} and type {array.dtype}"
    if len(indptr) != columns + 1 or len(indices) != len(data):
        return f"with {len(indptr)} column pointers, {len(indices)} rows and {len(data)} values"
    if indptr[0] != 0 or indptr[-1] != len(data) or bool((indptr[1:] < indptr[:-1]).any()):
        return f"whose column pointers do not ascend from 0 to {len(data)}"
    if len(indices) and not 0 <= int(indices.min()) <= int(indices.max()) < rows:
        return f"with rows outside 0..{rows - 1}"
    return None
