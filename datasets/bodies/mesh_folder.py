"""A folder of meshes as a body source: each animal's own file, read when its body is needed."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from animal3dbox.datasets.bodies.mesh_file import Place, keypoints_of
from animal3dbox.datasets.bodies.mesh_formats import (
    WITHOUT_ORDER,
    has_loose_triangles,
    read_mesh,
    read_npz,
)
from animal3dbox.datasets.bodies.regressor_npz import (
    LANDMARKS,
    npz_names,
    posed_mesh,
    skeleton_of,
)
from animal3dbox.datasets.bodies.sources import model_digest
from animal3dbox.datasets.records import AnimalRecord
from animal3dbox.datasets.storage.fingerprint import content_digest, digest, file_digest
from animal3dbox.datasets.storage.packed import PackedMapping
from animal3dbox.errors import ConfigError, DatasetFormatError, SampleError
from animal3dbox.geometry.camera import WEAK_FOCAL
from animal3dbox.geometry.used_vertices import used_vertices
from animal3dbox.labels.body import Body
from animal3dbox.labels.mesh_landmarks import SMAL_NOTE, template_landmarks, topology_landmarks
from animal3dbox.smal.correspondence import corresponds
from animal3dbox.smal.keypoints.smal_recognition import why_not_smal
from animal3dbox.smal.keypoints.smal_topology import SMAL_VERTICES
from animal3dbox.smal.model import SmalModel

CACHED = 32
"""Number of meshes that a process keeps decoded.

The views of one animal by several cameras use the same file and follow each other.
"""

LEAST_PX = 5.0
"""Length in the picture under which a mesh under its known camera cannot be an animal in it."""
LOOSE_NOTE = (
    "no two triangles of the mesh share a vertex, as in an STL: landmarks.json holds for it only if"
    " its ids were chosen on this very file"
)
"""The note of a mesh on which ids of vertices may not be what they were on another file of it."""

SKELETON_NOTE = "the file has a skeleton without a body: the box bounds its landmarks"
"""The note of an animal of which only the landmarks are known."""
WEAK_NOTE = (
    "the camera is a weak perspective's, and stands for it from so far away: distances mean nothing"
)
"""The note of an animal under a camera that sees no depth."""

MeshArrays = tuple[Tensor | None, Tensor, dict[str, Tensor]]
"""Vertices (V, 3), None of a skeleton, faces (F, 3), and landmark name -> place (3,), empty if the
file names none."""


@dataclass(frozen=True)
class MeshFile:
    """The place of one animal's mesh on the disk.

    Attributes:
        path: the mesh's file.
        camera: the file that says where the mesh stands, for errors; None without.
    """

    path: Path
    camera: Path | None = None


@dataclass(frozen=True)
class MeshFolderBodies:
    """A body source that gives each animal its own mesh, of any topology.

    It holds the files' paths only, so that sending it to a worker is cheap.

    Attributes:
        folder: the root of the mesh folder, as reports name it.
        meshes: sample id -> the animal's mesh file.
        landmarks: landmark or keypoint name -> vertex ids, of all meshes; empty if they bring their
            own or a model has them.
        model: what all meshes correspond to vertex by vertex; None if nothing.
    """

    folder: Path
    meshes: Mapping[str, MeshFile]
    landmarks: Mapping[str, Place]
    model: SmalModel | None = None

    @property
    def name(self) -> str:
        """Number of meshes and the folder's name, as reports print them."""
        return f"meshes:{len({file.path for file in self.meshes.values()})} of {self.folder.name}"

    @property
    def fingerprint(self) -> bytes:
        """Digest of the landmarks and the model, which all meshes share."""
        return digest(
            content_digest(self.landmarks), b"" if self.model is None else model_digest(self.model)
        )

    def packed(self) -> "MeshFolderBodies":
        """The same source with its paths in a few tensors, for workers (see packed.py)."""
        return replace(self, meshes=PackedMapping(MeshFile, self.meshes))

    @property
    def lasting(self) -> bool:
        """False: a mesh's file may be replaced at any time."""
        return False

    def content(self, sample_id: str) -> bytes:
        """Digest of the animal's mesh file; raises SampleError if it cannot be read."""
        try:
            return file_digest(self._file(sample_id))
        except OSError as error:
            raise SampleError(sample_id, "mesh", str(error)) from error

    def _file(self, sample_id: str) -> Path:
        if sample_id not in self.meshes:
            raise SampleError(sample_id, "mesh", "there is none for this sample")
        return self.meshes[sample_id].path

    def body(self, record: AnimalRecord) -> Body:
        """The animal's mesh with the landmarks of the record's vocabulary, in the animal's pose.

        Raises:
            SampleError: there is no mesh, it is damaged, or nothing tells where its landmarks are.

        """
        path = self._file(record.sample_id)
        try:
            stamp = path.stat()
            vertices, faces, points = _read(path, stamp.st_mtime_ns, stamp.st_size, self.model)
        except (OSError, DatasetFormatError) as error:
            raise SampleError(record.sample_id, "mesh", str(error)) from error
        if vertices is None:
            landmarks = keypoints_of(points, record.vocabulary)
            return Body(None, None, landmarks, None, template=None, notes=(SKELETON_NOTE,))
        if self.model is not None:
            _check_order(self.model, vertices, faces, sample_id=record.sample_id, path=path)
        mesh = _Mesh(path, vertices, faces, points)
        check_scale(record, mesh, self.meshes[record.sample_id].camera)
        landmarks, notes = self._keypoints(record, mesh)
        if not bool(torch.isfinite(landmarks).any()):
            raise SampleError(
                record.sample_id,
                "landmarks",
                f"nothing tells where {path.name} has its nose or tail"
                f"{_why_not_smal(vertices, faces)}: give landmarks.json with the vertices' ids,"
                " landmarks in the npz, or --model if it corresponds to a SMAL model",
            )
        return Body(
            vertices=vertices,
            faces=faces,
            landmarks=landmarks,
            landmark_sigma=None,
            template=self.model,
            notes=(*notes, WEAK_NOTE) if _is_weak(record) else notes,
        )

    def _keypoints(self, record: AnimalRecord, mesh: "_Mesh") -> tuple[Tensor, tuple[str, ...]]:
        """The record's keypoints (J, 3) on its mesh, from the first source that has places.

        The sources are the mesh's own points, landmarks.json, the model, and SMAL's public
        topology.

        Returns:
            The keypoints, NaN where there is no place, and notes on them.

        """
        words, vertices = record.vocabulary, mesh.vertices
        if mesh.points:
            return keypoints_of(mesh.points, words), ()
        if self.landmarks:
            places = self._places(record.sample_id, vertices, mesh.path)
            is_loose = has_loose_triangles(mesh.faces.numpy(), len(vertices))
            return keypoints_of(places, words), (LOOSE_NOTE,) if is_loose else ()
        used = used_vertices(mesh.faces, len(vertices))
        try:
            if self.model is not None:
                return template_landmarks(self.model, words, vertices, used), ()
            found = topology_landmarks(words, vertices, mesh.faces, used)
            if not isinstance(found, str):
                return found, (SMAL_NOTE,)
            return words.on_body({}, vertices), ()
        except ConfigError as error:
            raise SampleError(record.sample_id, "vocabulary", str(error)) from error

    def _places(self, sample_id: str, vertices: Tensor, path: Path) -> dict[str, Tensor]:
        """Landmark name -> place (3,) by landmarks.json; raises SampleError if ids do not fit."""
        if path.suffix.lower() == ".stl":
            problem = f"has vertices' ids for {path.name}, but {WITHOUT_ORDER}"
            raise SampleError(sample_id, "landmarks", problem)
        places = {}
        for name, ids in self.landmarks.items():
            if not isinstance(ids, list) or not ids or min(ids) < 0 or max(ids) >= len(vertices):
                raise SampleError(
                    sample_id,
                    "landmarks",
                    f"landmarks.json: {name} must be vertex ids from 0 to {len(vertices) - 1} of"
                    f" {path.name}, got {ids}",
                )
            places[name] = vertices[ids].mean(0)
        return places


@dataclass(frozen=True)
class _Mesh:
    """A mesh file's arrays.

    Attributes:
        path: the file.
        vertices: (V, 3).
        faces: (F, 3).
        points: landmark name -> place (3,); empty if the file names none.
    """

    path: Path
    vertices: Tensor
    faces: Tensor
    points: dict[str, Tensor]


def check_scale(record: AnimalRecord, mesh: _Mesh, camera: Path | None) -> None:
    """Raise a SampleError for a mesh and a known camera that cannot be in one unit.

    Args:
        record: says where the camera is; one without a known pose is not checked.
        mesh: of the animal.
        camera: the camera's file, for the error; None without.

    """
    if record.pose is None or record.K is None:
        return
    R, t = (torch.from_numpy(np.asarray(part, dtype=np.float64)) for part in record.pose)
    used = used_vertices(mesh.faces, len(mesh.vertices))
    vertices = mesh.vertices if used is None else mesh.vertices[torch.from_numpy(used)]
    least, greatest = vertices.amin(0), vertices.amax(0)
    length, distance = float((greatest - least).norm()), float((R @ vertices.mean(0) + t).norm())
    length_px = float(record.K[0, 0]) * length / max(distance, 1e-12)
    camera_center = -R.mT @ t
    camera_name = "the camera" if camera is None else camera.as_posix()
    where = f"{camera_name} puts {mesh.path.name}, {length:.3g} units long,"
    if length_px < LEAST_PX:
        problem = f"{where} {distance:.3g} units away, where it is {length_px:.1g} px long"
    elif bool(((camera_center > least) & (camera_center < greatest)).all()):
        problem = f"{where} {distance:.3g} units away, so that the camera is inside the animal"
    else:
        return
    raise SampleError(
        record.sample_id,
        "camera, mesh",
        f"{problem}: K must be in px, and t in the mesh's unit (a camera in mm beside a mesh in m"
        " is 1000 times too far); bring both to one unit",
    )


def _why_not_smal(vertices: Tensor, faces: Tensor) -> str:
    """Why a mesh of SMAL's count of vertices is not taken for SMAL's, in brackets; else nothing."""
    if len(vertices) != SMAL_VERTICES:
        return ""
    used = used_vertices(faces, len(vertices))
    reason = why_not_smal(vertices.numpy(), len(faces), used)
    return f" (it has as many vertices as SMAL, but {reason})"


def _check_order(
    model: SmalModel, vertices: Tensor, faces: Tensor, *, sample_id: str, path: Path
) -> None:
    """Raise a SampleError unless a mesh has the model's vertices in the model's order.

    The order shows in the triangles, each of which must be one of the model's.
    """
    if not corresponds(model, len(vertices), faces):
        raise SampleError(
            sample_id,
            "mesh",
            f"{path.name} has {len(vertices)} vertices and {len(faces)} faces that are not among"
            f" those of --model ({model.vertex_count} and {len(model.faces)}): leave --model out"
            " and give landmarks.json",
        )


def _is_weak(record: AnimalRecord) -> bool:
    """Whether a record's camera stands for a weak perspective's."""
    return record.K is not None and float(record.K[0, 0]) >= WEAK_FOCAL


@lru_cache(maxsize=CACHED)
def _read(path: Path, changed_ns: int, size: int, model: SmalModel | None) -> MeshArrays:
    """The arrays of a mesh file, decoded once for the animals that share it.

    The time and the size are part of the cache's key: a file that has changed is read again. The
    model is that of regressors' files, which have no faces of their own.
    """
    if path.suffix.lower() == ".npz":
        names = npz_names(path)
        if "vertices" in names:
            vertices, faces, places = read_npz(path)
        elif any(name in names for name in LANDMARKS):
            skeleton = skeleton_of(path)
            points = {name: torch.from_numpy(point) for name, point in skeleton.items()}
            return None, torch.zeros((0, 3), dtype=torch.int64), points
        else:
            (vertices, faces), places = posed_mesh(path, model), {}
    else:
        (vertices, faces), places = read_mesh(path), {}
    return (
        torch.from_numpy(vertices),
        torch.from_numpy(faces),
        {name: torch.from_numpy(point) for name, point in places.items()},
    )
