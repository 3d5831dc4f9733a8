"""Honest SMAL pickles, written as Python 2 wrote them (protocols 0 to 2) and as Python 3 does, by a
small assembler of opcodes."""

import io
import pickle
import struct
import sys
import types
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_matrix

from animal3dbox.smal.keypoints.smal_topology import SMAL_LANDMARKS, SMAL_PARENTS, SMAL_VERTICES
from animal3dbox.smal.model import SmalModel

Arrays = dict[str, object]
ROOT_PARENT = 2**32 - 1


@dataclass(frozen=True)
class Name:
    """A global."""

    module: str
    name: str


@dataclass(frozen=True)
class Made:
    """What `func(*args)` returns, then given a state."""

    func: Name
    args: tuple[object, ...]
    state: object = None


@dataclass(frozen=True)
class Chumpy:
    """An array inside a chumpy.ch.Ch."""

    x: object


@dataclass(frozen=True)
class Unicode:
    """Python 2's unicode; a str is its byte string."""

    text: str


@dataclass(frozen=True)
class Raw:
    """Opcodes as they are, which leave one value on the stack."""

    opcodes: bytes


class Python2Pickler:
    """Opcodes for values as Python 2's cPickle writes them, memo puts included."""

    def __init__(self, protocol: int) -> None:
        self.protocol = protocol
        self.out = io.BytesIO()
        self.memo_size = 0

    def dump(self, value: object) -> bytes:
        if self.protocol == 2:
            self.out.write(b"\x80\x02")
        self.save(value)
        return self.out.getvalue() + b"."

    def put(self) -> None:
        index, self.memo_size = self.memo_size, self.memo_size + 1
        if self.protocol == 0:
            self.out.write(b"p%d\n" % index)
        else:
            self.out.write(
                b"q" + bytes([index]) if index < 256 else b"r" + struct.pack("<I", index)
            )

    def save(self, value: object) -> None:
        if isinstance(value, Made | Name | Chumpy | np.ndarray | np.generic | csc_matrix):
            self.save_object(value)
        elif value is None or isinstance(value, Raw):
            self.out.write(b"N" if value is None else value.opcodes)
        elif isinstance(value, bool):
            self.out.write(
                (b"\x88" if value else b"\x89") if self.protocol == 2 else b"I0%d\n" % value
            )
        elif isinstance(value, int):
            self.save_int(value)
        elif isinstance(value, float):
            self.out.write(
                b"F%r\n" % value if self.protocol == 0 else b"G" + struct.pack(">d", value)
            )
        elif isinstance(value, str | bytes | Unicode):
            self.save_string(value)
        elif isinstance(value, tuple | list | dict):
            self.save_container(value)
        else:
            raise TypeError(type(value))

    def save_int(self, value: int) -> None:
        if not -(2**31) <= value < 2**31:
            if self.protocol == 2:
                raw = value.to_bytes(value.bit_length() // 8 + 1, "little", signed=True)
                self.out.write(b"\x8a" + bytes([len(raw)]) + raw)
            else:
                self.out.write(b"L%dL\n" % value)
        elif self.protocol == 0:
            self.out.write(b"I%d\n" % value)
        elif 0 <= value < 256:
            self.out.write(b"K" + bytes([value]))
        elif 0 <= value < 65536:
            self.out.write(b"M" + struct.pack("<H", value))
        else:
            self.out.write(b"J" + struct.pack("<i", value))

    def save_string(self, value: str | bytes | Unicode) -> None:
        if isinstance(value, Unicode):
            raw = value.text.encode("raw-unicode-escape" if self.protocol == 0 else "utf-8")
            self.out.write(
                b"V" + raw + b"\n"
                if self.protocol == 0
                else b"X" + struct.pack("<I", len(raw)) + raw
            )
        else:
            raw = value.encode("latin1") if isinstance(value, str) else value
            if self.protocol == 0:
                self.out.write(b"S" + python2_repr(raw) + b"\n")
            else:
                self.out.write(
                    (
                        b"U" + bytes([len(raw)])
                        if len(raw) < 256
                        else b"T" + struct.pack("<i", len(raw))
                    )
                    + raw
                )
        self.put()

    def save_container(
        self, value: tuple[object, ...] | list[object] | dict[object, object]
    ) -> None:
        if isinstance(value, tuple):
            if self.protocol and not value:
                self.out.write(b")")
                return
            short = self.protocol == 2 and len(value) <= 3
            self.out.write(b"" if short else b"(")
            for member in value:
                self.save(member)
            self.out.write(bytes([0x84 + len(value)]) if short else b"t")
            self.put()
            return
        empty = {0: {list: b"(l", dict: b"(d"}}.get(self.protocol, {list: b"]", dict: b"}"})
        self.out.write(empty[type(value)])
        self.put()
        pairs: list[tuple[object, ...]] = (
            list(value.items()) if isinstance(value, dict) else [(member,) for member in value]
        )
        one, many = (b"s", b"u") if isinstance(value, dict) else (b"a", b"e")
        for begin in range(0, len(pairs), 1 if self.protocol == 0 else 1000):
            batch = pairs[begin : begin + (1 if self.protocol == 0 else 1000)]
            self.out.write(b"(" if self.protocol else b"")
            for pair in batch:
                for member in pair:
                    self.save(member)
            self.out.write(many if self.protocol else one)

    def save_object(self, value: object) -> None:
        if isinstance(value, Name):
            self.out.write(f"c{value.module}\n{value.name}\n".encode())
            self.put()
            return
        made = value if isinstance(value, Made) else python2_record(value, self.protocol)
        self.save(made.func)
        self.save(made.args)
        self.out.write(b"\x81" if made.func.module in ("chumpy.ch", "scipy.sparse.csc") else b"R")
        self.put()
        if made.state is not None:
            self.save(made.state)
            self.out.write(b"b")


def python2_repr(raw: bytes) -> bytes:
    """Python 2's repr of a byte string."""
    text = repr(raw)[
        1:
    ]  # Python 3 escapes the same bytes in the same way, and chooses the same quotes
    return text.encode("ascii")


def python2_record(value: object, protocol: int) -> Made:
    """How Python 2 reduces NumPy's, SciPy's and chumpy's objects."""
    if isinstance(value, np.ndarray):
        fortran = bool(value.flags.f_contiguous and not value.flags.c_contiguous)
        state = (
            1,
            tuple(value.shape),
            python2_dtype(value.dtype),
            fortran,
            value.tobytes("F" if fortran else "C"),
        )
        return Made(
            Name("numpy.core.multiarray", "_reconstruct"),
            (Name("numpy", "ndarray"), (0,), "b"),
            state,
        )
    if isinstance(value, np.generic):
        return Made(
            Name("numpy.core.multiarray", "scalar"), (python2_dtype(value.dtype), value.tobytes())
        )
    if isinstance(value, Chumpy):
        dirty = Made(Name("__builtin__", "set"), ([],))
        return python2_instance(
            Name("chumpy.ch", "Ch"), {"x": value.x, "_dirty_vars": dirty, "_itr": None}, protocol
        )
    assert isinstance(value, csc_matrix)
    content = {
        "_shape": tuple(int(n) for n in value.shape),
        "maxprint": 50,
        "indptr": value.indptr,
        "indices": value.indices,
        "data": value.data,
    }
    return python2_instance(Name("scipy.sparse.csc", "csc_matrix"), content, protocol)


def python2_instance(kind: Name, state: Mapping[str, object], protocol: int) -> Made:
    if protocol == 2:
        return Made(kind, (), dict(state))
    return Made(
        Name("copy_reg", "_reconstructor"), (kind, Name("__builtin__", "object"), None), dict(state)
    )


def python2_dtype(dtype: np.dtype[np.generic]) -> Made:
    order = "|" if dtype.itemsize == 1 else {"=": "<"}.get(dtype.byteorder, dtype.byteorder)
    return Made(
        Name("numpy", "dtype"),
        (f"{dtype.kind}{dtype.itemsize}", 0, 1),
        (3, order, None, None, None, -1, -1, 0),
    )


def python2_pickle(value: object, protocol: int) -> bytes:
    """A pickle as Python 2 writes it."""
    return Python2Pickler(protocol).dump(value)


class _Ch:
    """Pickles as chumpy.ch.Ch."""

    def __init__(self, x: object) -> None:
        self.x = x


def python3_pickle(content: Mapping[str, object], protocol: int) -> bytes:
    """A pickle by Python's own module, in any protocol, with the real NumPy and SciPy and a
    stand-in for chumpy."""
    module = types.ModuleType("chumpy.ch")
    _Ch.__module__, _Ch.__qualname__, _Ch.__name__ = "chumpy.ch", "Ch", "Ch"
    module.Ch = _Ch  # type: ignore[attr-defined]
    sys.modules.update({"chumpy": types.ModuleType("chumpy"), "chumpy.ch": module})
    try:
        return pickle.dumps(
            {
                key: _Ch(value.x) if isinstance(value, Chumpy) else value
                for key, value in content.items()
            },
            protocol,
        )
    finally:
        del sys.modules["chumpy.ch"], sys.modules["chumpy"]


def written(content: Mapping[str, object], protocol: int) -> bytes:
    """As Python 2 wrote it up to protocol 2, as Python 3 does from 3 on."""
    return (
        python2_pickle(dict(content), protocol)
        if protocol <= 2
        else python3_pickle(content, protocol)
    )


def smal_content(model: SmalModel, chumpy: bool = True) -> Arrays:
    """The dictionary of a SMAL file with a model's numbers."""
    parents = np.array([ROOT_PARENT, *model.parents[1:]], dtype=np.uint32)
    wrap = Chumpy if chumpy else lambda x: x
    return {
        "v_template": wrap(model.v_template.numpy()),
        "f": model.faces.numpy().astype(np.uint32),
        "shapedirs": wrap(model.shapedirs.numpy()),
        "posedirs": model.posedirs.numpy(),
        "J_regressor": csc_matrix(model.J_regressor.numpy()),
        "kintree_table": np.stack([parents, np.arange(len(parents), dtype=np.uint32)]),
        "weights": wrap(model.weights.numpy()),
        "J": wrap((model.J_regressor @ model.v_template).numpy()),
        "bs_type": "lrotmin",
        "bs_style": "lbs",
    }


def random_content(
    vertices: int = 12,
    faces: int = 20,
    joints: int = 35,
    betas: int = 41,
    seed: int = 0,
    chumpy: bool = True,
) -> Arrays:
    """Random numbers in SMAL's shapes; with SMAL's vertex count, left landmarks lie on the left."""
    rng = np.random.default_rng(seed)
    wrap = Chumpy if chumpy else lambda x: x
    parents = list(SMAL_PARENTS[:joints]) if joints <= 35 else [-1, *range(joints - 1)]
    table = np.array([[ROOT_PARENT, *parents[1:]], range(joints)], dtype=np.uint32)
    return {
        "v_template": wrap(random_template(rng, vertices)),
        "f": rng.integers(0, vertices, (faces, 3)).astype(np.uint32),
        "shapedirs": wrap(rng.normal(size=(vertices, 3, betas))),
        "posedirs": rng.normal(size=(vertices, 3, 9 * (joints - 1))),
        "J_regressor": random_regressor(rng, joints, vertices),
        "kintree_table": table,
        "weights": wrap(random_weights(rng, vertices, joints)),
        "bs_type": "lrotmin",
        "bs_style": "lbs",
    }


def random_template(rng: np.random.Generator, vertices: int) -> NDArray[np.float64]:
    template = rng.normal(size=(vertices, 3))
    if vertices == SMAL_VERTICES:
        for name, ids in SMAL_LANDMARKS.items():
            sign = 1.0 if name.startswith("left_") else -1.0 if name.startswith("right_") else 0.0
            template[list(ids), 1] = sign * rng.uniform(0.1, 1.0, len(ids))
    return template


def random_weights(rng: np.random.Generator, vertices: int, joints: int) -> NDArray[np.float64]:
    weights = rng.uniform(size=(vertices, joints)) ** 8
    return np.asarray(weights / weights.sum(axis=1, keepdims=True))


def random_regressor(rng: np.random.Generator, joints: int, vertices: int) -> csc_matrix:
    dense = np.where(
        rng.uniform(size=(joints, vertices)) < 0.3, rng.uniform(0.1, 1.0, (joints, vertices)), 0.0
    )
    return csc_matrix(dense)
