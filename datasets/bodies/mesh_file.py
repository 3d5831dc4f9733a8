"""One mesh file as the body of every animal.

Its topology, frame and unit may be any: a JSON file beside it says where it has its landmarks.
"""

import difflib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from animal3dbox.datasets.bodies.mesh_formats import MESH_SUFFIXES, WITHOUT_ORDER, read_mesh
from animal3dbox.datasets.records import AnimalRecord
from animal3dbox.datasets.storage.fingerprint import content_digest
from animal3dbox.datasets.storage.json_files import decode_json
from animal3dbox.errors import ConfigError, DatasetFormatError, DatasetNotFoundError
from animal3dbox.labels.body import Body
from animal3dbox.smal.keypoints.vocabularies import VOCABULARIES
from animal3dbox.smal.keypoints.vocabulary import Vocabulary, aliases
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped, quadruped_names

Place = list[int] | dict[str, list[float]]
"""A landmark's place on a mesh: vertex ids, whose mean it is, or {"point": [x, y, z]}."""


@dataclass(frozen=True)
class MeshBody:
    """A body source that gives every animal the same mesh, of any topology.

    Attributes:
        path: the file that it was read from.
        vertices: (V, 3) in the mesh's frame and unit.
        faces: (F, 3) int64.
        points: landmark or keypoint name -> (3,) on the mesh.
    """

    path: Path
    vertices: Tensor
    faces: Tensor
    points: dict[str, Tensor]

    @property
    def name(self) -> str:
        """The mesh file's name, as reports print it."""
        return f"mesh:{self.path.name}"

    @property
    def fingerprint(self) -> bytes:
        """Digest of the mesh and its landmarks."""
        return content_digest((self.vertices, self.faces, self.points))

    @property
    def lasting(self) -> bool:
        """True: the mesh is held in memory and does not change."""
        return True

    def content(self, sample_id: str) -> bytes:
        """Empty, since all animals have the same mesh."""
        return b""

    def body(self, record: AnimalRecord) -> Body:
        """The mesh with the landmarks of the record's vocabulary."""
        return Body(
            vertices=self.vertices,
            faces=self.faces,
            landmarks=keypoints_of(self.points, record.vocabulary),
            landmark_sigma=None,
            template=None,
        )


def keypoints_of(points: Mapping[str, Tensor], vocabulary: Vocabulary) -> Tensor:
    """The keypoints of a vocabulary on a mesh that has landmarks.

    A keypoint lies at its own place if the mesh has one of its name, else at the first of its
    landmarks that the mesh has.

    Args:
        points: landmark or keypoint name -> (3,) in the mesh's frame.
        vocabulary: names the J keypoints, and the landmarks that stand for each.

    Returns:
        (J, 3); NaN for those that the mesh does not have.

    """
    rows = torch.full((len(vocabulary), 3), torch.nan, dtype=torch.float64)
    for row, (keypoint, names) in enumerate(
        zip(vocabulary.keypoints, vocabulary.landmarks, strict=True)
    ):
        candidates = (keypoint, *(alias for name in names for alias in aliases(name)))
        point = next((points[name] for name in candidates if name in points), None)
        if point is not None:
            rows[row] = point
    return rows


def load_mesh_body(mesh: Path, landmarks: Path) -> MeshBody:
    """The body source of a mesh file and of the file that names its landmarks.

    Args:
        mesh: .obj, .ply, .stl or .off; any frame, any unit.
        landmarks: JSON, landmark or keypoint name -> a list of vertex ids (whole numbers), or
            {"point": [x, y, z]} in the mesh's frame.

    Raises:
        ConfigError: the file's suffix is no mesh's.
        DatasetNotFoundError: no such file.
        DatasetFormatError: not a mesh, or landmarks that do not fit it, as ids of an STL do not.

    """
    if mesh.suffix.lower() not in MESH_SUFFIXES:
        raise ConfigError(
            f"{mesh} must be a mesh file ({', '.join(MESH_SUFFIXES)}) or a preset"
            f" ({', '.join(quadruped_names().presets)})"
        )
    if not mesh.is_file():
        raise DatasetNotFoundError(f"there is no file {mesh}")
    vertices, faces = read_mesh(mesh)
    points = {
        name: _place(name, place, vertices, landmarks, is_stl=mesh.suffix.lower() == ".stl")
        for name, place in read_landmarks(landmarks).items()
    }
    return MeshBody(mesh, torch.from_numpy(vertices), torch.from_numpy(faces), points)


def read_landmarks(path: Path) -> dict[str, Place]:
    """A landmarks file: landmark or keypoint name -> where it is on the mesh.

    Raises DatasetFormatError for a name that is neither.
    """
    places: dict[str, Place] = decode_json(path, dict[str, Place])
    for name in places:
        if name not in _landmark_names():
            near = difflib.get_close_matches(name, _landmark_names(), n=3, cutoff=0.0)
            raise DatasetFormatError(
                f"{path}: {name!r} is no landmark or keypoint; the nearest names are"
                f" {', '.join(near)}"
            )
    return places


def landmark_ids(path: Path) -> dict[str, tuple[int, ...]]:
    """A landmarks file of a model: landmark name -> vertex ids.

    Raises:
        DatasetFormatError: a name is no landmark's.
        ConfigError: a place is a point, which does not move with the model.

    """
    places = read_landmarks(path)
    ids = {name: tuple(place) for name, place in places.items() if not isinstance(place, dict)}
    if len(ids) < len(places):
        name = next(name for name in places if name not in ids)
        raise ConfigError(f"{path}: {name} must be vertex ids: a model's landmarks move with it")
    return ids


@cache
def _landmark_names() -> tuple[str, ...]:
    """Every name by which a landmark of a mesh can be used, in the order of the alphabet."""
    vocabularies = VOCABULARIES.values()
    keypoints = {name for vocabulary in vocabularies for name in vocabulary.keypoints}
    landmarks = {
        name for vocabulary in vocabularies for names in vocabulary.landmarks for name in names
    }
    return tuple(sorted(keypoints | landmarks | set(load_quadruped().extra_landmarks)))


def _place(name: str, place: Place, vertices: np.ndarray, path: Path, *, is_stl: bool) -> Tensor:
    """The point (3,) of one landmark on the mesh; raises DatasetFormatError."""
    if isinstance(place, dict):
        point = place.get("point")
        if point is None or len(point) != 3:
            raise DatasetFormatError(
                f'{path}: {name} must be {{"point": [x, y, z]}} or a list of vertex ids'
            )
        return torch.tensor(point, dtype=torch.float64)
    if is_stl:
        raise DatasetFormatError(
            f'{path}: {name} is given as vertex ids, but {WITHOUT_ORDER}, or give {{"point":'
            " [x, y, z]}"
        )
    if not place or min(place) < 0 or max(place) >= len(vertices):
        raise DatasetFormatError(
            f"{path}: {name} must be vertex ids from 0 to {len(vertices) - 1}, got {place}"
        )
    return torch.from_numpy(vertices[place].mean(0))
