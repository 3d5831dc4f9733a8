"""Records, parameters and labels as bytes.

Compact, the same bytes for the same content, and nothing to execute.

MessagePack, with arrays as an extension type. Frozen dataclasses become maps of their fields; what
many of them share, such as a vocabulary, is named by a number.
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
_PARTS = msgspec.msgpack.Encoder()
_UNPART = msgspec.msgpack.Decoder()
_ALIGNMENT = 8


class Codec:
    """Turns values into bytes and back.

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
        """The bytes of a dataclass, or of plain values, arrays and tensors."""
        return self._encoder.encode(self._flat(value) if is_dataclass(value) else value)

    def unpack(self, data: bytes | memoryview) -> dict[str, Any]:
        """The fields of a dataclass that was packed; what were tuples or lists are tuples."""
        return {name: _tuples(value) for name, value in self._decoder.decode(data).items()}

    def _flat(self, value: Any) -> dict[str, Any]:
        return {field.name: self._known(getattr(value, field.name)) for field in fields(value)}

    def _known(self, value: Any) -> Any:
        """A value, or the number that stands for it."""
        if is_dataclass(value):
            for place, known in enumerate(self.shared):
                if known is value or known == value:
                    return msgspec.msgpack.Ext(_SHARED, str(place).encode())
            raise TypeError(
                f"a {type(value).__name__} inside what is packed must be among the shared objects"
            )
        return value

    def _encode(self, value: Any) -> Any:
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
        if code == _SHARED:
            return self.shared[int(bytes(data))]
        if code == _PATH:
            return Path(bytes(data).decode("utf-8", "surrogateescape"))
        begin = data[0]
        dtype, shape = _form(bytes(data[:begin]))
        array = np.ndarray(shape, dtype, bytearray(data), begin)  # a copy of its own, writable
        return torch.from_numpy(array) if code == _TENSOR else array


def _array_bytes(array: np.ndarray) -> bytes:
    """Where the numbers begin, how long type and shape are, these, zeros until numbers are aligned,
    numbers."""
    told = _PARTS.encode((array.dtype.str, array.shape))
    begin = -(-(len(told) + 2) // _ALIGNMENT) * _ALIGNMENT
    return (
        bytes((begin, len(told)))
        + told.ljust(begin - 2, b"\0")
        + np.ascontiguousarray(array).tobytes()
    )


@lru_cache(maxsize=1024)
def _form(header: bytes) -> tuple[np.dtype[Any], tuple[int, ...]]:
    """Type and shape of an array of the bytes before its numbers."""
    dtype, shape = _UNPART.decode(header[2 : 2 + header[1]])
    return np.dtype(dtype), tuple(shape)


def _tuples(value: Any) -> Any:
    kind = type(value)
    if kind is list:
        return tuple(_tuples(part) if type(part) in (list, dict) else part for part in value)
    if kind is dict:
        return {
            name: _tuples(part) if type(part) in (list, dict) else part
            for name, part in value.items()
        }
    return value
