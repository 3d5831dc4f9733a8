"""Writing a body model as the pickle that SMAL comes in.

Protocol 2, as Python 2 wrote it, with chumpy's arrays but without chumpy. Such files are for trying
the whole way with a body of one's own; reading them needs no trust (safe_pickle/reader.py).
"""

import io
import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_matrix

from animal3dbox.files import write_whole
from animal3dbox.smal.model import SmalModel

NO_PARENT = 2**32 - 1
"""The root's parent in kintree_table: -1 as an unsigned number."""


@dataclass(frozen=True)
class _Global:
    """A name that the pickle mentions."""

    module: str
    name: str


@dataclass(frozen=True)
class _Object:
    """An object that the pickle makes: func(*args), or an empty one of the class func (by_new).

    It is then given the state, if that is not None.
    """

    func: _Global
    args: tuple[object, ...]
    state: object
    by_new: bool = False


def write_smal_pickle(model: SmalModel, path: Path) -> None:
    """Write a model as a SMAL pickle, as load_smal reads it, float64.

    SMAL's keys, of this model's numbers; landmarks and names have no place in it.

    Example:
        >>> from tempfile import TemporaryDirectory
        >>> from animal3dbox.smal import load_model, load_quadruped
        >>> with TemporaryDirectory() as folder:
        ...     write_smal_pickle(load_quadruped(), Path(folder, "smal.pkl"))
        ...     load_model(Path(folder, "smal.pkl")).joint_count
        35
    """
    parents = [NO_PARENT if p < 0 else p for p in model.parents]
    content: dict[object, object] = {
        "v_template": _chumpy(model.v_template.numpy()),
        "f": model.faces.numpy().astype(np.uint32),
        "shapedirs": _chumpy(model.shapedirs.numpy()),
        "posedirs": _chumpy(model.posedirs.numpy()),
        "J_regressor": _sparse(csc_matrix(model.J_regressor.numpy())),
        "kintree_table": np.array([parents, range(len(parents))], dtype=np.uint32),
        "weights": _chumpy(model.weights.numpy()),
        "J": _chumpy((model.J_regressor @ model.v_template).numpy()),
        "bs_type": "lrotmin",
        "bs_style": "lbs",
    }
    out = io.BytesIO()
    out.write(b"\x80\x02")
    _save(content, out)
    out.write(b".")
    write_whole(path, out.getvalue())


def _chumpy(array: NDArray[np.generic]) -> _Object:
    """An array as chumpy's object around it."""
    dirty = _Object(_Global("__builtin__", "set"), ([],), None)
    return _Object(
        _Global("chumpy.ch", "Ch"),
        (),
        {"x": array, "_dirty_vars": dirty, "_itr": None},
        by_new=True,
    )


def _sparse(matrix: csc_matrix) -> _Object:
    """A sparse matrix as SciPy's object."""
    rows, columns = matrix.shape
    state = {
        "_shape": (int(rows), int(columns)),
        "maxprint": 50,
        "indptr": matrix.indptr,
        "indices": matrix.indices,
        "data": matrix.data,
    }
    return _Object(_Global("scipy.sparse.csc", "csc_matrix"), (), state, by_new=True)


def _array(array: NDArray[np.generic]) -> _Object:
    """An array as NumPy's object."""
    kind = array.dtype
    dtype = _Object(
        _Global("numpy", "dtype"),
        (f"{kind.kind}{kind.itemsize}", 0, 1),
        (3, "<", None, None, None, -1, -1, 0),
    )
    state = (
        1,
        tuple(int(n) for n in array.shape),
        dtype,
        False,
        np.ascontiguousarray(array).astype(kind.newbyteorder("<"), copy=False).tobytes(),
    )
    return _Object(
        _Global("numpy.core.multiarray", "_reconstruct"),
        (_Global("numpy", "ndarray"), (0,), "b"),
        state,
    )


def _save(value: object, out: io.BytesIO) -> None:
    """Write the opcodes that put a value on the stack."""
    if value is None or isinstance(value, bool):
        out.write({None: b"N", True: b"\x88", False: b"\x89"}[value])
    elif isinstance(value, int):
        out.write(b"J" + struct.pack("<i", value))
    elif isinstance(value, str | bytes):
        raw = value.encode("ascii") if isinstance(value, str) else value
        out.write(b"T" + struct.pack("<i", len(raw)) + raw)
    elif isinstance(value, tuple | list | dict):
        _save_members(value, out)
    elif isinstance(value, np.ndarray):
        _save(_array(value), out)
    elif isinstance(value, _Global):
        out.write(f"c{value.module}\n{value.name}\n".encode())
    elif isinstance(value, _Object):
        _save(value.func, out)
        _save(value.args, out)
        out.write(b"\x81" if value.by_new else b"R")
        if value.state is not None:
            _save(value.state, out)
            out.write(b"b")
    else:
        raise AssertionError(f"no model holds a {type(value).__name__}")


def _save_members(
    value: tuple[object, ...] | list[object] | dict[object, object], out: io.BytesIO
) -> None:
    pairs: list[tuple[object, ...]] = (
        list(value.items()) if isinstance(value, dict) else [(member,) for member in value]
    )
    opening, closing = {tuple: (b"(", b"t"), list: (b"](", b"e"), dict: (b"}(", b"u")}[type(value)]
    out.write(opening)
    for pair in pairs:
        for member in pair:
            _save(member, out)
    out.write(closing)
