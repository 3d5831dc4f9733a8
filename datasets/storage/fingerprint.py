"""Short names of contents, so that what was computed from one thing is never taken for another's."""

import hashlib
import os
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from torch import Tensor

import animal3dbox
import animal3dbox.datasets

CODE = ("geometry", "smal", "labels")
"""What a label depends on in the package's folder.

Of the datasets' it is all but NEVER_READ, since masks, headers and bodies are read there.
"""
NEVER_READ = ("exchange", "inspection", "synthetic")
"""Rooms of the datasets that no label depends on.

What they write or draw is read again as files or records.
"""
LIBRARIES = ("numpy", "scipy", "torch", "opencv-python-headless")
"""Whose versions may change a label's last digits."""


def digest(*parts: bytes) -> bytes:
    """16 bytes that name the parts; where one part ends and the next begins counts."""
    return hashlib.blake2b(
        b"".join([piece for part in parts for piece in (len(part).to_bytes(8, "little"), part)]),
        digest_size=16,
    ).digest()


def content_digest(value: Any) -> bytes:
    """16 bytes that name a value made of dataclasses, arrays, tensors, mappings, sequences and plain values.

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
        known = [
            part
            for field in fields(value)
            for part in (field.name.encode(), content_digest(getattr(value, field.name)))
        ]
        return digest(b"dataclass", type(value).__name__.encode(), *known)
    if isinstance(value, Mapping):
        return digest(
            b"mapping",
            *(
                part
                for key, item in value.items()
                for part in (content_digest(key), content_digest(item))
            ),
        )
    if isinstance(value, tuple | list | set | frozenset):
        return digest(
            b"sequence",
            *(
                content_digest(item)
                for item in (sorted(value) if isinstance(value, set | frozenset) else value)
            ),
        )
    if value is None or isinstance(value, str | bytes | bool | int | float | Path):
        return digest(type(value).__name__.encode(), repr(value).encode())
    raise TypeError(f"the content of a {type(value).__name__} has no fingerprint")


def code_files() -> list[Path]:
    """The files of this installation that a label depends on."""
    home, ours = Path(animal3dbox.__file__).parent, Path(animal3dbox.datasets.__file__).parent
    files = sorted(p for p in ours.rglob("*.py") if p.relative_to(ours).parts[0] not in NEVER_READ)
    for folder in CODE:
        files += sorted(p for p in (home / folder).rglob("*") if p.suffix in (".py", ".npz"))
    return files


@lru_cache(maxsize=1)
def code_digest() -> bytes:
    """16 bytes that name the label code of this installation, file by file, and the libraries that
    it computes with."""
    sources = [part for file in code_files() for part in (file.name.encode(), file.read_bytes())]
    return digest(*sources, *(f"{name} {version(name)}".encode() for name in LIBRARIES))


@lru_cache(maxsize=4096)
def _file_digest(path: str, *state: int) -> bytes:
    return digest(Path(path).read_bytes())


def file_digest(path: Path | str) -> bytes:
    """16 bytes that name a file's content.

    Read again only if its size, times of change or place on the disk differ. Raises OSError.
    """
    # A Path made for this would cost as much again.
    told = os.stat(path)  # noqa: PTH116
    return _file_digest(str(path), told.st_size, told.st_mtime_ns, told.st_ctime_ns, told.st_ino)
