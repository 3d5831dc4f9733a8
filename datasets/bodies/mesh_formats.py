"""Mesh files: vertices and triangles, in the file's own order."""

import io
import zipfile
import zlib
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray

from animal3dbox.errors import DatasetFormatError

MESH_SUFFIXES = (".obj", ".ply", ".stl", ".off")
_WHOLE = "is the file whole? Write or copy it again"


def read_mesh(path: Path) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Vertices (V, 3) in the file's own order, which landmarks are counted in, and faces (F, 3).

    Args:
        path: one of MESH_SUFFIXES.

    Raises:
        DatasetFormatError: not a mesh of finite vertices and of triangles of them.

    """
    suffix = path.suffix.lower()
    try:
        data = path.read_bytes()
        if not data:
            raise ValueError("it is empty")
        if suffix == ".obj":
            vertices, faces = _read_obj(data.decode(errors="replace"))
        else:
            file = (
                io.StringIO(data.decode(errors="replace")) if suffix == ".off" else io.BytesIO(data)
            )
            loaded = trimesh.load_mesh(file, file_type=suffix[1:], process=False, fix_texture=False)
            vertices, faces = (
                np.asarray(loaded.vertices, dtype=np.float64),
                np.asarray(loaded.faces, dtype=np.int64),
            )
    except (
        ValueError,
        TypeError,
        IndexError,
        KeyError,
        AttributeError,
        OSError,
        ImportError,
    ) as error:  # trimesh has no error of its own
        raise DatasetFormatError(
            f"{path} cannot be read as a mesh: {_words(error)}; {_WHOLE}"
        ) from error
    check_mesh(vertices, faces, path)
    return vertices, faces


def _words(error: Exception) -> str:
    """What went wrong, but for NumPy's words about rows of different lengths, which say nothing of
    a file."""
    return (
        "its rows have different lengths"
        if "array element with a sequence" in str(error)
        else str(error)
    )


def check_mesh(vertices: NDArray[np.float64], faces: NDArray[np.int64], path: Path) -> None:
    """Raise a DatasetFormatError that names the file unless these are a body's vertices (V, 3) and
    faces (F, 3)."""
    if vertices.ndim != 2 or len(vertices) < 4 or vertices.shape[1] != 3:
        raise DatasetFormatError(
            f"{path} must have four vertices (V, 3) or more, got vertices of shape"
            f" {vertices.shape}: {_WHOLE}"
        )
    if bad := int((~np.isfinite(vertices)).sum()):
        raise DatasetFormatError(
            f"{path} has {len(vertices)} vertices, {bad} of their coordinates not finite: not a"
            " body"
        )
    if faces.ndim != 2 or not len(faces) or faces.min() < 0 or faces.max() >= len(vertices):
        raise DatasetFormatError(
            f"{path} must have faces, all of its own {len(vertices)} vertices: {_WHOLE}"
        )


def _read_obj(text: str) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Points and triangles of an OBJ, nothing else.

    At seams and materials trimesh doubles and reorders the vertices.
    """
    vertices: list[list[float]] = []
    faces: list[tuple[int, int, int]] = []
    for line in text.replace("\r\n", "\n").replace("\\\n", " ").split("\n"):
        words = line.split()
        if words[:1] == ["v"]:
            vertices.append([float(word) for word in words[1:4]])
            _check_row(vertices[-1], line)
        elif words[:1] == ["f"]:
            ids = [int(word.partition("/")[0]) for word in words[1:]]
            _check_row(ids, line)
            first, *rest = (
                i - 1 if i > 0 else len(vertices) + i for i in ids
            )  # negative ones count back from here
            faces += [(first, a, b) for a, b in pairwise(rest)]
    return np.array(vertices, dtype=np.float64).reshape(-1, 3), np.array(
        faces, dtype=np.int64
    ).reshape(-1, 3)


def _check_row(numbers: Sequence[float], line: str) -> None:
    if len(numbers) < 3:
        raise ValueError(f"the line {line[:60]!r} has {len(numbers)} of at least 3 numbers")


def read_npz(
    path: Path,
) -> tuple[NDArray[np.float64], NDArray[np.int64], dict[str, NDArray[np.float64]]]:
    """Vertices (V, 3), faces (F, 3) and places (3,) by landmark of an npz.

    Nothing in it is unpickled.

    Args:
        path: with "vertices" and "faces", and perhaps "landmarks" (N, 3) with "landmark_names"
            (N,).

    Raises:
        DatasetFormatError: not such a file.

    """
    try:
        with np.load(path, allow_pickle=False) as arrays:
            vertices, faces = (
                np.asarray(arrays["vertices"], dtype=np.float64),
                np.asarray(arrays["faces"]),
            )
            places = (
                np.asarray(arrays["landmarks"], dtype=np.float64)
                if "landmarks" in arrays
                else np.zeros((0, 3))
            )
            names = (
                [str(name) for name in arrays["landmark_names"]]
                if "landmark_names" in arrays
                else []
            )
    except (
        ValueError,
        TypeError,
        KeyError,
        OSError,
        EOFError,
        zipfile.BadZipFile,
        zlib.error,
    ) as error:
        raise DatasetFormatError(f"{path} cannot be read as a mesh: {error}") from error
    if not np.issubdtype(faces.dtype, np.integer):
        raise DatasetFormatError(f"{path} must have whole numbers in faces, got {faces.dtype}")
    check_mesh(vertices, faces.astype(np.int64), path)
    if (
        places.shape != (len(names), 3)
        or len(set(names)) != len(names)
        or not np.isfinite(places).all()
    ):
        raise DatasetFormatError(
            f"{path} must have finite landmarks (N, 3) and as many different landmark_names, got"
            f" {places.shape} and {len(names)}"
        )
    return vertices, faces.astype(np.int64), dict(zip(names, places, strict=True))
