"""The poses of the cameras whose detections are in a world: of a time, or of a frame."""

import csv
import io
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from animal3dbox.datasets.readers.cuboid_conventions import Floats
from animal3dbox.datasets.readers.omni3d.elements import checked_rotation
from animal3dbox.datasets.readers.predictions.stated import DetectionReading
from animal3dbox.datasets.readers.predictions.truth import (
    Truth,
    numbered_images,
    trailing_number,
    unique_image,
)
from animal3dbox.datasets.records import CuboidImage
from animal3dbox.datasets.storage.json_files import read_json_bytes
from animal3dbox.errors import DatasetFormatError, SampleError

Cameras = Path | Literal["camera"] | None
"""Where cameras' poses are; "camera": boxes are in the cameras' own frames already."""
POSES_FILE = "camera_poses.csv"
"""The csv of poses beside Boxer's csv, in the columns of Project Aria's tables."""
POSE_COLUMNS = (
    *("tx_world_camera", "ty_world_camera", "tz_world_camera"),
    *("qw_world_camera", "qx_world_camera", "qy_world_camera", "qz_world_camera"),
)
"""Its columns besides time_ns and image: T_world_camera of an OpenCV camera."""
POSES_FOLDER = "camera_params"
"""WildLIFT's folder of poses: for each frame an .npz with cam_c2w (4, 4)."""
UNIT_TOLERANCE = 1e-3
"""Greatest difference from 1 of a quaternion's length that is only rounded."""


@dataclass(frozen=True)
class FrameCamera:
    """One image and where its camera stood.

    Attributes:
        image: of the truth.
        R_world_cam: (3, 3).
        position: (3,) of the camera in the world.
    """

    image: CuboidImage
    R_world_cam: Floats
    position: Floats

    def points(self, points_world: Floats) -> Floats:
        """Points (..., 3) of the world in the camera's frame."""
        return np.asarray((points_world - self.position) @ self.R_world_cam)

    def axes(self, R_world_box: Floats) -> Floats:
        """A box's rotation R_world_box (3, 3) as R_cam_box."""
        return np.asarray(self.R_world_cam.T @ R_world_box)


def quaternion_rotation(quaternion: Floats, sample_id: str, field: str) -> Floats:
    """The rotation (3, 3) of a quaternion (4,) w, x, y, z of length 1.

    R = (w² - v·v) I + 2 v vᵀ + 2 w [v]×, with v = (x, y, z).

    Raises:
        SampleError: its length is not 1.

    """
    length = float(np.linalg.norm(quaternion))
    if abs(length - 1) > UNIT_TOLERANCE:
        raise SampleError(
            sample_id, field, f"must be a quaternion w, x, y, z of length 1, got {length:.4g}"
        )
    w, x, y, z = quaternion / length
    v = np.array([x, y, z])
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray((w * w - v @ v) * np.eye(3) + 2 * np.outer(v, v) + 2 * w * cross)


def csv_rows(path: Path, needed: Sequence[str]) -> list[dict[str, str]]:
    """The rows of a csv by column; cells that a short row lacks are empty.

    Args:
        path: the file.
        needed: columns that it must have.

    Raises:
        DatasetFormatError: it is no csv, or lacks a column.

    """
    text = read_json_bytes(path).decode("utf-8", "replace")
    table = csv.DictReader(io.StringIO(text, newline=""), restval="")
    try:
        rows = list(table)
    except csv.Error as error:
        raise DatasetFormatError(f"{path} is no csv: {error}") from error
    if missing := sorted(set(needed) - set(table.fieldnames or ())):
        raise DatasetFormatError(f"{path} lacks columns {', '.join(missing)}")
    return rows


def read_time_cameras(
    path: Path, cameras: Path | None, truth: Truth
) -> dict[str, FrameCamera | None]:
    """The cameras of times, from a csv with time_ns, image and T_world_camera.

    Args:
        path: of the detections.
        cameras: the csv; None: camera_poses.csv beside the detections.
        truth: whose images it names.

    Returns:
        Time as written -> camera; None where the truth does not have the image, as of a split.

    Raises:
        DatasetFormatError: there is none, or a row of it is damaged.

    """
    file = path.with_name(POSES_FILE) if cameras is None else cameras
    if not file.is_file():
        raise DatasetFormatError(
            f"{path} has boxes in a world, and there is no {file}: give the cameras' poses as a csv"
            f" with columns time_ns, image, {', '.join(POSE_COLUMNS)} (cameras=, --cameras)"
        )
    found: dict[str, FrameCamera | None] = {}
    for number, row in enumerate(csv_rows(file, ("time_ns", "image", *POSE_COLUMNS))):
        name = f"row {number + 2}"
        image = unique_image(truth.usable, row["image"], file)
        try:
            values = np.array([float(row[column]) for column in POSE_COLUMNS])
            rotation = quaternion_rotation(values[3:], name, "qw_world_camera")
        except (TypeError, ValueError) as error:
            raise DatasetFormatError(f"{file}: {name}: {error}") from error
        camera = None if image is None else FrameCamera(image, rotation, values[:3])
        found[row["time_ns"].strip()] = camera
    return found


def frame_cameras(
    files: Sequence[Path], cameras: Cameras, reading: DetectionReading
) -> Iterator[tuple[Path, FrameCamera]]:
    """Each file of a frame with its camera; those without an image or a pose become faults.

    The image is the one whose file has the same name, or else the same number at its end.

    Args:
        files: one a frame.
        cameras: WildLIFT's camera_params/; None: beside the files' folder, or in it.
        reading: with the truth.

    Raises:
        DatasetFormatError: no frame has a pose.

    """
    images = reading.truth.usable
    by_stem = {Path(image.image_id).stem: image for image in images}
    by_number = numbered_images(images) or {}
    if len(by_stem) < len(images):
        by_stem = {}  # of several videos
    missing: list[DatasetFormatError] = []
    for file in files:
        number = trailing_number(file.stem)
        image = by_stem.get(file.stem) or (None if number is None else by_number.get(number))
        if image is None:
            reading.faults.append(
                SampleError(file.name, "image", "the truth has no one image of this name or number")
            )
            continue
        try:
            pose = _frame_pose(file, cameras)
        except DatasetFormatError as error:
            missing.append(error)
            continue
        yield file, FrameCamera(image, *pose)
    if missing and len(missing) == len(files):
        raise missing[0]
    reading.faults += [SampleError(None, "camera", str(error)) for error in missing]


def _frame_pose(file: Path, cameras: Cameras) -> tuple[Floats, Floats]:
    """R_world_cam (3, 3) and the position (3,) of a frame's camera."""
    if cameras == "camera":
        return np.eye(3), np.zeros(3)
    folders = (
        (cameras,)
        if cameras is not None
        else (file.parent / POSES_FOLDER, file.parent.parent / POSES_FOLDER)
    )
    found = [one for folder in folders if (one := folder / f"{file.stem}.npz").is_file()]
    if not found:
        raise DatasetFormatError(
            f"{file} has boxes in a world, and there is no {folders[0] / file.stem}.npz with"
            " cam_c2w: give the folder of the cameras' poses (cameras=, --cameras), or 'camera' if"
            " the boxes are in the cameras' own frames"
        )
    try:
        with np.load(found[0], allow_pickle=False) as arrays:
            pose = np.asarray(arrays["cam_c2w"], dtype=np.float64)
        if pose.shape != (4, 4) or not np.isfinite(pose).all():
            raise ValueError(f"cam_c2w must be (4, 4) and finite, got shape {pose.shape}")
        return checked_rotation(pose[:3, :3], found[0].name, "cam_c2w"), pose[:3, 3]
    except (OSError, ValueError, KeyError) as error:
        raise DatasetFormatError(f"{found[0]}: {error}") from error
