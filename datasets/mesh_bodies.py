"""A mesh file as a body source: any topology, frame and unit, with its landmarks in a JSON file beside it."""

import difflib
import io
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
import torch
import trimesh
from numpy.typing import NDArray
from torch import Tensor

from animal3dbox.datasets.bodies import Body
from animal3dbox.datasets.fingerprint import content_digest
from animal3dbox.datasets.json_files import decode_json
from animal3dbox.datasets.records import AnimalRecord
from animal3dbox.errors import ConfigError, DatasetFormatError, DatasetNotFoundError
from animal3dbox.smal.quadruped import load_quadruped, quadruped_names
from animal3dbox.smal.vocabularies import VOCABULARIES
from animal3dbox.smal.vocabulary import Vocabulary

MESH_SUFFIXES = (".obj", ".ply", ".stl", ".off")


@dataclass(frozen=True)
class MeshBody:
    """One mesh for every animal, of any topology.

    Attributes:
        path: where it came from.
        vertices: (V, 3).
        faces: (F, 3) int64.
        points: landmark or keypoint name -> (3,) on the mesh.
    """

    path: Path
    vertices: Tensor
    faces: Tensor
    points: dict[str, Tensor]

    @property
    def name(self) -> str:
        """The file."""
        return f"mesh:{self.path.name}"

    @property
    def fingerprint(self) -> bytes:
        """Of the mesh and its landmarks."""
        return content_digest((self.vertices, self.faces, self.points))

    def content(self, record: AnimalRecord) -> bytes:
        """Nothing: all animals have the same mesh."""
        return b""

    def body(self, record: AnimalRecord) -> Body:
        """The mesh with the record's landmarks."""
        return Body(self.vertices, self.faces, self._landmarks(record.vocabulary), None, None)

    def _landmarks(self, vocabulary: Vocabulary) -> Tensor:
        rows = torch.full((len(vocabulary), 3), torch.nan, dtype=torch.float64)
        for row, (keypoint, names) in enumerate(zip(vocabulary.keypoints, vocabulary.landmarks, strict=True)):
            found = next((self.points[name] for name in (keypoint, *names) if name in self.points), None)
            if found is not None:
                rows[row] = found
        return rows


def load_mesh_body(mesh: Path, landmarks: Path) -> MeshBody:
    """A mesh file and the places of its landmarks.

    Args:
        mesh: .obj, .ply, .stl or .off; any frame, any unit.
        landmarks: JSON, landmark or keypoint name -> a list of vertex ids (whole numbers), or {"point": [x, y, z]} in the
            mesh's frame.

    Raises:
        DatasetNotFoundError: no such file.
        DatasetFormatError: not a mesh, or landmarks that do not fit it.

    """
    if mesh.suffix.lower() not in MESH_SUFFIXES:
        raise ConfigError(f"{mesh} must be a mesh file ({', '.join(MESH_SUFFIXES)}) or a preset ({', '.join(quadruped_names().presets)})")
    if not mesh.is_file():
        raise DatasetNotFoundError(f"there is no file {mesh}")
    vertices, faces = _read_mesh(mesh)
    points = {}
    for name, place in decode_json(landmarks, dict[str, list[int] | dict[str, list[float]]]).items():
        if name not in (known := _landmark_names()):
            near = difflib.get_close_matches(name, known, n=3, cutoff=0.0)
            raise DatasetFormatError(f"{landmarks}: {name!r} is no landmark or keypoint; the nearest names are {', '.join(near)}")
        points[name] = _place(name, place, vertices, landmarks)
    return MeshBody(mesh, torch.from_numpy(vertices), torch.from_numpy(faces), points)


@cache
def _landmark_names() -> tuple[str, ...]:
    """Every name by which a landmark of a mesh can be used."""
    words = VOCABULARIES.values()
    keypoints = {name for vocabulary in words for name in vocabulary.keypoints}
    landmarks = {name for vocabulary in words for names in vocabulary.landmarks for name in names}
    return tuple(sorted(keypoints | landmarks | set(load_quadruped().extra_landmarks)))


def _read_mesh(path: Path) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Vertices (V, 3) in the file's own order, which landmarks are counted in, and faces (F, 3)."""
    suffix = path.suffix.lower()
    try:
        data = path.read_bytes()
        if suffix == ".obj":
            vertices, faces = _read_obj(data.decode(errors="replace"))
        else:
            file = io.StringIO(data.decode(errors="replace")) if suffix == ".off" else io.BytesIO(data)
            loaded = trimesh.load_mesh(file, file_type=suffix[1:], process=False, fix_texture=False)
            vertices, faces = np.asarray(loaded.vertices, dtype=np.float64), np.asarray(loaded.faces, dtype=np.int64)
    except (ValueError, TypeError, IndexError, KeyError, AttributeError, OSError, ImportError) as error:  # trimesh has no error of its own
        raise DatasetFormatError(f"{path} cannot be read as a mesh: {error}") from error
    if vertices.ndim != 2 or len(vertices) < 4 or vertices.shape[1] != 3 or not np.isfinite(vertices).all():
        bad = int((~np.isfinite(vertices)).sum())
        raise DatasetFormatError(f"{path} has vertices of shape {vertices.shape}, {bad} of their coordinates not finite: not a body")
    if faces.ndim != 2 or not len(faces) or faces.min() < 0 or faces.max() >= len(vertices):
        raise DatasetFormatError(f"{path} must have faces, all of its own {len(vertices)} vertices")
    return vertices, faces


def _read_obj(text: str) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Points and triangles of an OBJ, nothing else: at seams and materials trimesh doubles and reorders the vertices."""
    vertices: list[list[float]] = []
    faces: list[tuple[int, int, int]] = []
    for line in text.replace("\r\n", "\n").replace("\\\n", " ").split("\n"):
        words = line.split()
        if words[:1] == ["v"]:
            vertices.append([float(word) for word in words[1:4]])
        elif words[:1] == ["f"]:
            ids = [int(word.partition("/")[0]) for word in words[1:]]
            first, *rest = (i - 1 if i > 0 else len(vertices) + i for i in ids)  # negative ones count back from here
            faces += [(first, a, b) for a, b in pairwise(rest)]
    return np.array(vertices, dtype=np.float64), np.array(faces, dtype=np.int64)


def _place(name: str, place: list[int] | dict[str, list[float]], vertices: np.ndarray, path: Path) -> Tensor:
    """The point of one landmark."""
    if isinstance(place, dict):
        point = place.get("point")
        if point is None or len(point) != 3:
            raise DatasetFormatError(f'{path}: {name} must be {{"point": [x, y, z]}} or a list of vertex ids')
        return torch.tensor(point, dtype=torch.float64)
    if not place or min(place) < 0 or max(place) >= len(vertices):
        raise DatasetFormatError(f"{path}: {name} must be vertex ids from 0 to {len(vertices) - 1}, got {place}")
    return torch.from_numpy(vertices[place].mean(0))
