"""The reader of mesh folders: images with a fitted mesh for each animal, and cameras or keypoints.

Captures, motion capture and the outputs of mesh regressors come in this form.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from animal3dbox.datasets.bodies.mesh_file import Place, read_landmarks
from animal3dbox.datasets.bodies.mesh_folder import MeshFile, MeshFolderBodies
from animal3dbox.datasets.bodies.regressor_npz import weak_perspective_of
from animal3dbox.datasets.images.named_files import resolve_inside
from animal3dbox.datasets.images.photos import stored_size
from animal3dbox.datasets.readers.mesh_folder.camera_files import (
    Camera,
    load_camera,
    weak_perspective_camera,
)
from animal3dbox.datasets.readers.mesh_folder.crop_keypoints import without_crop_keypoints
from animal3dbox.datasets.readers.mesh_folder.files import AnimalFiles, list_mesh_folder
from animal3dbox.datasets.readers.mesh_folder.regressor_names import is_of_crop
from animal3dbox.datasets.readers.tolerance import Tolerance
from animal3dbox.datasets.records import AnimalRecord, RecordSet
from animal3dbox.datasets.storage.json_files import decode_json
from animal3dbox.errors import (
    ConfigError,
    DatasetFormatError,
    DatasetNotFoundError,
    SampleError,
    ShapeError,
)
from animal3dbox.smal.files.model_files import load_model
from animal3dbox.smal.keypoints.vocabularies import vocabulary_of_option
from animal3dbox.smal.keypoints.vocabulary import Vocabulary
from animal3dbox.smal.keypoints.vocabulary_match import match_by_name

FORMAT = "mesh_folder"
"""The format's name in reports and for --format."""
MANIFEST = "mesh_folder.json"
"""The file that says what holds for all animals; it may be missing."""
LANDMARKS = "landmarks.json"
"""The file of vertex ids that hold for every mesh; it may be missing."""


class Manifest(msgspec.Struct, forbid_unknown_fields=True):
    """The keys of mesh_folder.json, which hold for all animals."""

    vocabulary: str = "animal3d26"
    category: str = "animal"
    unit_m: float | None = None


@dataclass(frozen=True)
class MeshFolder:
    """The animals of a mesh folder and the source of their meshes.

    Attributes:
        records: the animals, images in the order of their names.
        bodies: the animals' meshes, each read when it is needed.
    """

    records: RecordSet
    bodies: MeshFolderBodies


def is_mesh_folder(path: Path) -> bool:
    """Whether a path is a mesh folder, or its mesh_folder.json.

    A folder is one if it has that file, or the two folders images/ and meshes/.
    """
    return (
        path.name == MANIFEST
        or (path / MANIFEST).is_file()
        or ((path / "meshes").is_dir() and (path / "images").is_dir())
    )


def read_mesh_folder(
    root: Path,
    images: Path | None = None,
    model: Path | None = None,
    vocabulary: Vocabulary | None = None,
    *,
    upright: bool = False,
) -> MeshFolder:
    """The animals of a folder with images/ and meshes/, see docs/formats.md.

    There may be cameras/, keypoints/ and masks/ beside them.

    Args:
        root: the folder, or its mesh_folder.json.
        images: the folder of images; None: images/.
        model: the SMAL file whose vertices all meshes have.
        vocabulary: the keypoints; None: as mesh_folder.json says, else animal3d26.
        upright: whether pictures and masks are turned as their EXIF headers say.

    Raises:
        DatasetNotFoundError: no such folders.
        DatasetFormatError: no mesh, or mesh_folder.json or landmarks.json is not what it should be.
        ModelFileError: the model is refused.

    """
    home = root.parent if root.is_file() else root
    if not home.is_dir():
        raise DatasetNotFoundError(f"there is no folder {home}")
    manifest = _manifest(home)
    reader = _RecordReader(
        home=home,
        images=images or home / "images",
        vocabulary=vocabulary or _vocabulary(manifest, home),
        manifest=manifest,
        load_camera=lru_cache(maxsize=None)(load_camera),
        tolerance=Tolerance(upright=upright),
    )
    listing = list_mesh_folder(home, reader.images)
    records, faults, meshes, of_crop = [], list(listing.faults), {}, set[str]()
    for files in listing.animals:
        try:
            record, mesh = reader.record(files)
        except SampleError as error:
            faults.append(error)
            continue
        records.append(record)
        camera = None if files.camera is None else Path(files.camera)
        of_crop |= {record.sample_id} if is_of_crop(files.keypoints or "") else set()
        meshes[record.sample_id] = MeshFile(mesh, camera)
    landmarks = _landmarks(home / LANDMARKS)
    bodies = MeshFolderBodies(
        home.resolve(), meshes, landmarks, None if model is None else load_model(model)
    )
    records, crop_faults, crop_notes = without_crop_keypoints(records, bodies, of_crop)
    notes = (*listing.notes, *reader.tolerance.notes(), *crop_notes)
    return MeshFolder(RecordSet(FORMAT, tuple(records), (*faults, *crop_faults), notes), bodies)


def _manifest(home: Path) -> Manifest:
    """The manifest of a folder, the defaults without one; raises DatasetFormatError."""
    path = home / MANIFEST
    manifest: Manifest = decode_json(path, Manifest) if path.is_file() else Manifest()
    unit_m = manifest.unit_m
    if unit_m is not None and not (np.isfinite(unit_m) and unit_m > 0):
        raise DatasetFormatError(
            f"{path}: unit_m must be the metres of a unit, above 0, got {unit_m}"
        )
    return manifest


def _vocabulary(manifest: Manifest, home: Path) -> Vocabulary:
    """The vocabulary that a manifest names; a .toml file lies beside the manifest."""
    name = manifest.vocabulary
    try:
        return vocabulary_of_option(str(home / name) if name.endswith(".toml") else name)
    except ConfigError as error:
        raise DatasetFormatError(f"{home / MANIFEST}: {error}") from error


def _landmarks(path: Path) -> dict[str, Place]:
    """Landmark name -> vertex ids that hold for every mesh; empty without a file."""
    places = read_landmarks(path) if path.is_file() else {}
    for name, place in places.items():
        if isinstance(place, dict):
            raise DatasetFormatError(
                f"{path}: {name} must be vertex ids: a point does not move with the mesh"
            )
    return places


@dataclass(frozen=True)
class _RecordReader:
    """Makes the records of the animals that a folder lists.

    Attributes:
        home: the mesh folder.
        images: the folder of images.
        vocabulary: the keypoints.
        manifest: what holds for all animals.
        load_camera: reads a camera once for the many images that it took.
        tolerance: how the folder is taken, and how often it needed that.
    """

    home: Path
    images: Path
    vocabulary: Vocabulary
    manifest: Manifest
    load_camera: Callable[[Path, tuple[int, int]], Camera]
    tolerance: Tolerance = field(default_factory=Tolerance)

    def record(self, files: AnimalFiles) -> tuple[AnimalRecord, Path]:
        """The record of an animal and its mesh's file, checked but for the mesh's content.

        Raises SampleError.
        """
        sample_id = files.sample_id
        image = resolve_inside(self.images, files.image, sample_id, "image")
        mesh = resolve_inside(self.home, files.mesh, sample_id, "mesh")
        image_hw = stored_size(image, sample_id, upright=self.tolerance.upright)
        camera = self._camera(files, mesh, image_hw)
        keypoints = self._keypoints(files)
        if camera.pose is None and not keypoints.any():
            raise SampleError(sample_id, "camera, keypoints", _nothing_tells(files))
        record = AnimalRecord(
            sample_id=sample_id,
            image_id=files.image,
            image_path=image,
            image_hw=image_hw,
            vocabulary=self.vocabulary,
            keypoints_2d=keypoints,
            mask_runs=None,
            category=self.manifest.category,
            mask_path=(
                None
                if files.mask is None
                else resolve_inside(self.home, files.mask, sample_id, "mask")
            ),
            K=camera.K,
            stored_pose=None if camera.exact else camera.pose,
            pose=camera.pose if camera.exact else None,
            distortion=camera.distortion,
            metres_per_unit=(
                self.manifest.unit_m if camera.metres_per_unit is None else camera.metres_per_unit
            ),
            upright=self.tolerance.upright,
        )
        return record, mesh

    def _camera(self, files: AnimalFiles, mesh: Path, image_hw: tuple[int, int]) -> Camera:
        """The camera of an animal's image, by its own file, else by a regressor's mesh file.

        Nothing is known of it without either.
        """
        if files.camera is None:
            return self._camera_of_mesh(files, mesh, image_hw)
        path = resolve_inside(self.home, files.camera, files.sample_id, "camera")
        try:
            return self.load_camera(path, image_hw)
        except DatasetFormatError as error:
            raise SampleError(files.sample_id, "camera", str(error)) from error

    def _camera_of_mesh(self, files: AnimalFiles, mesh: Path, image_hw: tuple[int, int]) -> Camera:
        """The camera that an npz of GenZoo holds beside its mesh."""
        if mesh.suffix.lower() != ".npz":
            return Camera()
        try:
            weak = weak_perspective_of(mesh, image_hw)
            if weak is None:
                return Camera()
            K, pose = weak_perspective_camera(weak, image_hw)
        except (DatasetFormatError, ShapeError) as error:
            raise SampleError(files.sample_id, "camera", str(error)) from error
        return Camera(K, pose)

    def _keypoints(self, files: AnimalFiles) -> NDArray[np.float64]:
        """The animal's keypoints (J, 3) by a file that names them; zeros without a file."""
        rows = np.zeros((len(self.vocabulary), 3))
        if files.keypoints is None:
            return rows
        path = resolve_inside(self.home, files.keypoints, files.sample_id, "keypoints")
        if path.suffix.lower() == ".npy":
            return self._keypoint_array(path, files)
        try:
            points: dict[str, list[float] | None] = decode_json(path, dict[str, list[float] | None])
            columns = match_by_name(list(points), self.vocabulary).columns
        except (DatasetFormatError, ConfigError) as error:
            raise SampleError(
                files.sample_id, "keypoints", f"{files.keypoints}: {error}"
            ) from error
        values = list(points.values())
        for row, column in enumerate(columns):
            if column is not None and (point := values[column]) is not None:
                rows[row] = _point(point, files, self.vocabulary.keypoints[row])
        return self.tolerance.without_minus_ones(rows, files.sample_id)

    def _keypoint_array(self, path: Path, files: AnimalFiles) -> NDArray[np.float64]:
        """The keypoints (J, 3) of an array in the vocabulary's order: x, y, perhaps confidence.

        A point that is not finite, (0, 0) and (-1, -1) are missing.
        """
        try:
            array = np.load(path, allow_pickle=False)
            values = np.asarray(array, dtype=np.float64)
        except (ValueError, TypeError, OSError, EOFError) as error:
            raise SampleError(
                files.sample_id, "keypoints", f"{files.keypoints} is no array of numbers: {error}"
            ) from error
        values = values[0] if values.ndim == 3 and len(values) == 1 else values
        count = len(self.vocabulary)
        if values.shape not in ((count, 2), (count, 3)):
            raise SampleError(
                files.sample_id,
                "keypoints",
                f"{files.keypoints}: must be {count} x 3 (x, y, confidence) or {count} x 2 of"
                f" {self.vocabulary.name}, got {values.shape}",
            )
        marks = values[:, 2:] if values.shape[1] == 3 else np.ones((count, 1))
        rows = self.tolerance.without_minus_ones(
            np.concatenate((values[:, :2], marks), axis=1), files.sample_id
        )
        marks = rows[:, 2:]
        is_known = np.isfinite(rows).all(axis=1) & rows[:, :2].any(axis=1)
        if not ((marks[is_known] >= 0) & (marks[is_known] <= 1)).all():
            raise SampleError(
                files.sample_id,
                "keypoints",
                f"{files.keypoints}: confidences must be from 0 to 1, got up to"
                f" {np.abs(marks[is_known]).max():g}",
            )
        return np.where((is_known & (marks[:, 0] > 0))[:, None], rows, 0.0)


def _point(numbers: list[float], files: AnimalFiles, name: str) -> list[float]:
    """x, y and confidence of one keypoint; the confidence is 1 if it is left out."""
    point = [*numbers, 1.0] if len(numbers) == 2 else numbers
    if len(point) != 3 or not np.isfinite(point).all() or not _is_mark(point[2]):
        raise SampleError(
            files.sample_id,
            "keypoints",
            f"{files.keypoints}: {name} must be [x, y] or [x, y, confidence from 0 to 1] or null,"
            f" got {numbers}",
        )
    return point if point[2] else [0.0, 0.0, 0.0]


def _is_mark(number: float) -> bool:
    """Whether a number is a confidence, or the -1 that some programs write of a missing point."""
    return 0 <= number <= 1 or number == -1


def _nothing_tells(files: AnimalFiles) -> str:
    """The problem of an animal without camera pose and keypoints, and its remedy."""
    has = f"{files.camera} has no R and t" if files.camera else "there is no camera"
    marks = f"{files.keypoints} marks nothing" if files.keypoints else "there are no keypoints"
    name = Path(files.image).with_suffix("").as_posix()
    remedy = (
        f"Give K, R and t in cameras/{name}.json (or one camera.json), or keypoints/{name}.json"
    )
    return f"{has}, and {marks}: nothing tells where {files.mesh} stands. {remedy}"
