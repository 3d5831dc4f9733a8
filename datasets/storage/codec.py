"""Records and parameters as bytes: the same bytes for the same content, and nothing to execute.

The bytes are MessagePack with extension types for arrays, tensors and paths. A frozen dataclass
becomes a map of its fields; an object that many of them share, such as a vocabulary, is written as
its place among the shared ones.
"""

from collections.abc import Sequence
from dataclasses import fields, is_dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import torch
from torch import Tensor

_ARRAY, _TENSOR, _PATH, _SHARED = 1, 2, 3, 4
_HEADER_ENCODER = msgspec.msgpack.Encoder()
_HEADER_DECODER = msgspec.msgpack.Decoder()
_ALIGNMENT = 8
"""Numbers begin at a multiple of so many bytes, as a view of them as float64 needs."""


class Codec:
    """Serialises dataclasses of plain values, arrays, tensors and paths, and reads them back.

    Args:
        shared: objects that values refer to, told apart by equality; they are not written, only
            their place in this sequence.

    """

    def __init__(self, shared: Sequence[object] = ()) -> None:
        self.shared = tuple(shared)
        self._make()

    def _make(self) -> None:
        self._encoder = msgspec.msgpack.Encoder(enc_hook=self._encode)
        self._decoder = msgspec.msgpack.Decoder(ext_hook=self._decode)

    def __getstate__(self) -> tuple[object, ...]:
        return self.shared

    def __setstate__(self, state: tuple[object, ...]) -> None:
        self.shared = state
        self._make()

    def pack(self, value: Any) -> bytes:
        """The bytes of a dataclass, or of plain values, arrays and tensors.

        Raises TypeError for anything else, and for a dataclass inside it that is not shared.
        """
        return self._encoder.encode(self._flat(value) if is_dataclass(value) else value)

    def unpack(self, data: bytes | memoryview) -> dict[str, Any]:
        """The fields of a packed dataclass, in which tuples and lists have become tuples."""
        return {name: _with_tuples(value) for name, value in self._decoder.decode(data).items()}

    def _flat(self, value: Any) -> dict[str, Any]:
        """The fields of a dataclass by name, shared objects as their places."""
        return {
            field.name: self._shared_place(getattr(value, field.name)) for field in fields(value)
        }

    def _shared_place(self, value: Any) -> Any:
        """The place of a shared object, or the value itself if it is no dataclass."""
        if is_dataclass(value):
            for place, shared in enumerate(self.shared):
                if shared is value or shared == value:
                    return msgspec.msgpack.Ext(_SHARED, str(place).encode())
            raise TypeError(
                f"a {type(value).__name__} inside what is packed must be among the shared objects"
            )
        return value

    def _encode(self, value: Any) -> Any:
        """MessagePack's form of a value that it does not know."""
        if isinstance(value, Tensor):
            return msgspec.msgpack.Ext(_TENSOR, _array_bytes(value.detach().cpu().numpy()))
        if isinstance(value, np.ndarray):
            return msgspec.msgpack.Ext(_ARRAY, _array_bytes(value))
        if isinstance(value, Path):
            return msgspec.msgpack.Ext(_PATH, str(value).encode("utf-8", "surrogateescape"))
        if isinstance(value, np.generic):
            return value.item()
        raise TypeError(f"a {type(value).__name__} cannot be packed")

    def _decode(self, code: int, data: memoryview) -> Any:
        """The value of one of our extension types."""
        if code == _SHARED:
            return self.shared[int(bytes(data))]
        if code == _PATH:
            return Path(bytes(data).decode("utf-8", "surrogateescape"))
        begin, header_length = data[0], data[1]
        dtype, shape = _type_and_shape(bytes(data[2 : 2 + header_length]))
        # A copy, so that the array can be written to and does not hold the packed bytes.
        array = np.ndarray(shape, dtype, bytearray(data), begin)
        return torch.from_numpy(array) if code == _TENSOR else array


def _array_bytes(array: np.ndarray) -> bytes:
    """An array as bytes: two lengths, a header, zeros up to the alignment, and the numbers.

    The first byte says where the numbers begin, the second how long the header is, which holds the
    array's type and shape.
    """
    header = _HEADER_ENCODER.encode((array.dtype.str, array.shape))
    begin = -(-(len(header) + 2) // _ALIGNMENT) * _ALIGNMENT
    return (
        bytes((begin, len(header)))
        + header.ljust(begin - 2, b"\0")
        + np.ascontiguousarray(array).tobytes()
    )


@lru_cache(maxsize=1024)
def _type_and_shape(header: bytes) -> tuple[np.dtype[Any], tuple[int, ...]]:
    """The type and shape of an array by its header; the headers of a dataset are few."""
    dtype, shape = _HEADER_DECODER.decode(header)
    return np.dtype(dtype), tuple(shape)


def _with_tuples(value: Any) -> Any:
    """A decoded value with its lists, at any depth, made tuples, as frozen dataclasses have."""
    if isinstance(value, list):
        # A mask's runs are thousands of numbers (benchmarks/loader.py, "mask"): no call for each.
        if {list, dict}.isdisjoint(map(type, value)):
            return tuple(value)
        return tuple(_with_tuples(part) for part in value)
    if isinstance(value, dict):
        return {name: _with_tuples(part) for name, part in value.items()}
    return value
