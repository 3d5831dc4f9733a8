"""Reading mesh files: vertices and triangles in the file's own order, or an error naming the file.

Landmarks are given as vertex ids, so the order of the vertices must be the file's. OBJ has a
reader of its own for that reason; PLY, STL and OFF are trimesh's, npz is NumPy's.
"""

import io
import zipfile
import zlib
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray

from animal3dbox.errors import DatasetFormatError, without_addresses

MESH_SUFFIXES = (".obj", ".ply", ".stl", ".off")
"""Suffixes of the files that read_mesh takes."""
WITHOUT_ORDER = (
    "STL stores the corners of each triangle by themselves, so that the vertices have no ids to"
    " name landmarks by: save the mesh as .obj, .ply, .off or .npz"
)
"""The problem of landmarks that are given as vertex ids of an STL file, and its remedy."""
_WHOLE = "is the file whole? Write or copy it again"


def read_mesh(path: Path) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """The vertices (V, 3) and triangles (F, 3) of a mesh file, in the file's own order.

    Args:
        path: a file with one of MESH_SUFFIXES.

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
            f"{path} cannot be read as a mesh: {_problem(error)}; {_WHOLE}"
        ) from error
    check_mesh(vertices, faces, path)
    return vertices, faces


def has_loose_triangles(faces: NDArray[np.int64], vertex_count: int) -> bool:
    """Whether no two triangles (F, 3) share a vertex, as in an STL, but in any format.

    Example:
        >>> has_loose_triangles(np.array([[0, 1, 2], [3, 4, 5]]), 6)
        True
        >>> has_loose_triangles(np.array([[0, 1, 2], [1, 2, 3]]), 4)
        False
    """
    return len(faces) > 1 and faces.size == vertex_count == len(np.unique(faces))


def _problem(error: Exception) -> str:
    """The problem that an error states.

    NumPy's text about rows of different lengths says nothing of a file, so it is replaced.
    """
    return (
        "its rows have different lengths"
        if "array element with a sequence" in str(error)
        else without_addresses(str(error))
    )


def check_mesh(vertices: NDArray[np.float64], faces: NDArray[np.int64], path: Path) -> None:
    """Raise a DatasetFormatError that names the file unless the arrays are a body's mesh.

    Args:
        vertices: (V, 3), at least four, all finite.
        faces: (F, 3), at least one, of ids from 0 to V - 1.
        path: the file that they come from.

    """
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
    """The vertices (V, 3) and triangles (F, 3) of an OBJ file's text, in its own order.

    Polygons are cut into fans. Trimesh's reader is not used, since it doubles and reorders the
    vertices at seams and materials.
    """
    vertices: list[list[float]] = []
    faces: list[tuple[int, int, int]] = []
    for line in text.replace("\r\n", "\n").replace("\\\n", " ").split("\n"):
        kind, *fields = line.split() or [""]
        if kind == "v":
            vertices.append([float(field) for field in fields[:3]])
            _check_row(vertices[-1], line)
        elif kind == "f":
            ids = [int(field.partition("/")[0]) for field in fields]
            _check_row(ids, line)
            # Positive ids count from 1, negative ones back from the last vertex so far.
            first, *rest = (i - 1 if i > 0 else len(vertices) + i for i in ids)
            faces += [(first, a, b) for a, b in pairwise(rest)]
    return (
        np.array(vertices, dtype=np.float64).reshape(-1, 3),
        np.array(faces, dtype=np.int64).reshape(-1, 3),
    )


def _check_row(numbers: Sequence[float], line: str) -> None:
    """Raise a ValueError for a line of an OBJ that has fewer than three numbers."""
    if len(numbers) < 3:
        raise ValueError(f"the line {line[:60]!r} has {len(numbers)} of at least 3 numbers")


def read_npz(
    path: Path,
) -> tuple[NDArray[np.float64], NDArray[np.int64], dict[str, NDArray[np.float64]]]:
    """The mesh and the landmarks of an npz file, of which nothing is unpickled.

    Args:
        path: a file with "vertices" and "faces", and perhaps "landmarks" (N, 3) with
            "landmark_names" (N,).

    Returns:
        The vertices (V, 3), the faces (F, 3), and landmark name -> place (3,).

    Raises:
        DatasetFormatError: not such a file.

    """
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as arrays:
            vertices = np.asarray(arrays["vertices"], dtype=np.float64)
            faces = np.asarray(arrays["faces"])
            places = np.asarray(arrays.get("landmarks", np.zeros((0, 3))), dtype=np.float64)
            names = [str(name) for name in arrays.get("landmark_names", ())]
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
