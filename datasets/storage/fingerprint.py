"""Digests that name contents, from which the keys of the label cache are made.

A label is taken from the cache only if its key is the same: the label code and its libraries, the
bodies, the annotations and the files that it was made of.
"""

import hashlib
import os
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from torch import Tensor

import animal3dbox
import animal3dbox.datasets

CODE = ("geometry", "smal", "labels")
"""Folders of the package that a label depends on, besides the rooms of the datasets.

Of those it is all but NEVER_READ, since masks, headers and bodies are read there.
"""
NEVER_READ = ("exchange", "inspection", "synthetic")
"""Rooms of the datasets that no label depends on.

Files and records that they make are read again, and named then.
"""
LIBRARIES = ("numpy", "scipy", "torch", "opencv-python-headless")
"""Libraries whose versions may change a label's last digits."""


def digest(*parts: bytes | bytearray | memoryview) -> bytes:
    """16 bytes that name a sequence of parts.

    Each part is preceded by its length, so that ("ab", "c") and ("a", "bc") differ.
    """
    return hashlib.blake2b(
        b"".join([piece for part in parts for piece in (len(part).to_bytes(8, "little"), part)]),
        digest_size=16,
    ).digest()


def content_digest(value: Any) -> bytes:
    """16 bytes that name a value of dataclasses, structs, arrays, mappings, sequences or numbers.

    Raises:
        TypeError: something in it is of another kind, whose content is not known.

    """
    if isinstance(value, Tensor):
        value = value.detach().cpu().numpy()
    if isinstance(value, np.ndarray):
        return digest(
            b"array",
            value.dtype.str.encode(),
            repr(value.shape).encode(),
            np.ascontiguousarray(value).tobytes(),
        )
    if is_dataclass(value) and not isinstance(value, type):
        parts = [
            part
            for field in fields(value)
            for part in (field.name.encode(), content_digest(getattr(value, field.name)))
        ]
        return digest(b"dataclass", type(value).__name__.encode(), *parts)
    if isinstance(value, msgspec.Struct):
        return content_digest({"struct": type(value).__name__, **msgspec.structs.asdict(value)})
    if isinstance(value, Mapping):
        pairs = [content_digest(part) for item in value.items() for part in item]
        return digest(b"mapping", *pairs)
    if isinstance(value, tuple | list | set | frozenset):
        items = sorted(value) if isinstance(value, set | frozenset) else value
        return digest(b"sequence", *(content_digest(item) for item in items))
    if value is None or isinstance(value, str | bytes | bool | int | float | Path):
        return digest(type(value).__name__.encode(), repr(value).encode())
    raise TypeError(f"the content of a {type(value).__name__} has no fingerprint")


def code_files() -> list[Path]:
    """The files of this installation that a label depends on."""
    home, ours = Path(animal3dbox.__file__).parent, Path(animal3dbox.datasets.__file__).parent
    files = sorted(p for p in ours.rglob("*.py") if p.relative_to(ours).parts[0] not in NEVER_READ)
    for folder in CODE:
        files += sorted(
            p for p in (home / folder).rglob("*") if p.suffix in (".py", ".npz", ".json")
        )
    return files


@lru_cache(maxsize=1)
def code_digest() -> bytes:
    """16 bytes that name the label code of this installation and the libraries it computes with."""
    sources = [part for file in code_files() for part in (file.name.encode(), file.read_bytes())]
    return digest(*sources, *(f"{name} {version(name)}".encode() for name in LIBRARIES))


def file_digest(path: Path | str) -> bytes:
    """16 bytes that name a file's content; raises OSError.

    The file is read again only if its size, times of change or place on the disk differ: reading a
    mask anew would cost about as much as the rest of a cached label (the line "label, from the
    cache" of benchmarks/loader.py).
    """
    stat = os.stat(path)  # noqa: PTH116  # a Path made for it costs two more such calls
    state = (stat.st_size, stat.st_mtime_ns, stat.st_ctime_ns, stat.st_ino)
    return _digest_of_state(str(path), state)


@lru_cache(maxsize=4096)
def _digest_of_state(path: str, state: tuple[int, ...]) -> bytes:
    """The digest of a file's content, once for each state in which the file was found."""
    return digest(Path(path).read_bytes())
