"""Detections without corners: Boxer's csv, WildDet3D's tracks, WildLIFT's frames."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from animal3dbox.datasets.readers.cuboid_conventions import Floats
from animal3dbox.datasets.readers.elements import Matrix, converted
from animal3dbox.datasets.readers.omni3d.elements import checked_rotation, numbers
from animal3dbox.datasets.readers.omni3d.schema import Key
from animal3dbox.datasets.readers.predictions.camera_poses import (
    POSES_FILE,
    Cameras,
    FrameCamera,
    csv_rows,
    frame_cameras,
    quaternion_rotation,
    read_time_cameras,
)
from animal3dbox.datasets.readers.predictions.plain_json import plain_json
from animal3dbox.datasets.readers.predictions.stated import (
    DetectionReading,
    StatedDetection,
    checked_dimensions,
    checked_score,
    is_dummy,
)
from animal3dbox.datasets.readers.predictions.truth import numbered_images
from animal3dbox.datasets.records import CuboidImage
from animal3dbox.datasets.sightings import NO_SIGHTING, Sighting
from animal3dbox.errors import ConfigError, DatasetFormatError, SampleError

PLACE = ("tx_world_object", "ty_world_object", "tz_world_object")
"""Boxer's columns of a centre."""
TURN = ("qw_world_object", "qx_world_object", "qy_world_object", "qz_world_object")
"""Boxer's columns of a quaternion, w first."""
SCALE = ("scale_x", "scale_y", "scale_z")
"""Boxer's columns of full sizes along a box's own x, y, z."""


def read_boxer(path: Path, reading: DetectionReading, cameras: Cameras) -> None:
    """Read Boxer's csv, whose boxes are in a world; the cameras' poses lie beside it.

    Args:
        path: the csv.
        reading: to which the boxes and faults are added.
        cameras: the csv of poses; None: camera_poses.csv beside it.

    Raises:
        ConfigError: cameras is not a path.
        DatasetFormatError: columns are missing, or there are no poses.

    """
    if cameras == "camera":
        raise ConfigError(
            f"Boxer's rows name times, not images: give cameras a csv as {POSES_FILE} is"
        )
    at_time = read_time_cameras(path, cameras, reading.truth)
    for number, row in enumerate(
        csv_rows(path, ("time_ns", *PLACE, *TURN, *SCALE, "name", "prob"))
    ):
        sample_id = f"row {number + 2}"
        try:
            camera = at_time.get(row["time_ns"].strip())
            if camera is None:
                problem = f"{row['time_ns']} is no time of a camera of the truth's images"
                raise SampleError(sample_id, "time_ns", problem)
            sample_id = reading.sample_id(camera.image)
            numbers_of = {
                name: _cells(row, columns, sample_id)
                for name, columns in (("place", PLACE), ("turn", TURN), ("scale", SCALE))
            }
            box = StatedDetection(
                sample_id=sample_id,
                image=camera.image,
                category=row["name"],
                score=checked_score(float(_cells(row, ("prob",), sample_id)[0]), sample_id, "prob"),
                box=None,
                center=camera.points(numbers_of["place"]),
                dimensions=numbers_of["scale"],
                rotation=camera.axes(quaternion_rotation(numbers_of["turn"], sample_id, TURN[0])),
            )
        except SampleError as error:
            reading.faults.append(error)
            continue
        _add(box, reading, "scale_x, scale_y, scale_z")


def _cells(row: Mapping[str, str], columns: tuple[str, ...], sample_id: str) -> Floats:
    """The finite numbers in columns of a row; raises SampleError that names the column."""
    values = []
    for column in columns:
        try:
            value = float(row[column])
        except (TypeError, ValueError) as error:
            raise SampleError(
                sample_id, column, f"must be a number, got {row[column]!r}"
            ) from error
        if not np.isfinite(value):
            raise SampleError(sample_id, column, f"must be finite, got {value}")
        values.append(value)
    return np.array(values)


def _add(box: StatedDetection, reading: DetectionReading, field: str) -> None:
    """Add a box, or note that it is a dummy or has no volume."""
    if is_dummy(None, box.center, box.dimensions):
        reading.dummies.append(box.sample_id)
        return
    try:
        checked_dimensions(box.dimensions, box.sample_id, field)
    except SampleError as error:
        reading.faults.append(error)
    else:
        reading.boxes.append(box)


class _Track(msgspec.Struct):
    """One animal's boxes, a frame each; null where it is not seen."""

    boxes_3d: list[Any]
    category: str = "unknown"


def read_tracks(path: Path, reading: DetectionReading) -> None:
    """Read WildDet3D's tracks: ten numbers a frame, centre, W L H and a quaternion, w first.

    Raises:
        DatasetFormatError: not of the form, or its frames cannot be told among the truth's images.

    """
    content = plain_json(path)
    tracks = content.get("tracks") if isinstance(content, dict) else None
    if not isinstance(tracks, dict):
        raise DatasetFormatError(f'{path} must hold {{"tracks": {{...}}}}')
    images = _images_of_frames(path, content, reading)
    for name, element in tracks.items():
        try:
            track = converted(element, _Track, f"track {name}")
        except SampleError as error:
            reading.faults.append(error)
            continue
        for frame, values in enumerate(track.boxes_3d):
            if values is None:
                continue
            sample_id = f"track {name}, frame {frame}"
            try:
                if frame not in images:
                    raise SampleError(
                        sample_id, "boxes_3d", f"the truth has no image of frame {frame}"
                    )
                sample_id = reading.sample_id(images[frame])
                box = _tracked_box(
                    values, sample_id, image=images[frame], category=track.category, track=name
                )
            except SampleError as error:
                reading.faults.append(error)
                continue
            _add(box, reading, "boxes_3d")


def _tracked_box(
    values: Any, sample_id: str, *, image: CuboidImage, category: str, track: str
) -> StatedDetection:
    """The box of one track in one image; raises SampleError."""
    row = _numbers(values, (10,), sample_id, "boxes_3d")
    return StatedDetection(
        sample_id=sample_id,
        image=image,
        category=category,
        score=None,
        box=None,
        center=row[:3],
        dimensions=row[3:6],
        rotation=quaternion_rotation(row[6:], sample_id, "boxes_3d"),
        sighting=Sighting(sequence=Path(image.image_id).parent.name, track=track),
    )


def _numbers(values: Any, shape: tuple[int, ...], sample_id: str, field: str) -> Floats:
    """The numbers of a field that must be there; raises SampleError."""
    try:
        found = numbers(values, shape, sample_id, field)
    except TypeError as error:  # a dictionary among the numbers
        raise SampleError(sample_id, field, f"must be {shape} numbers, got {values}") from error
    if found is None:
        raise SampleError(sample_id, field, "is missing, empty or -1")
    return found


def _images_of_frames(
    path: Path, content: dict[str, Any], reading: DetectionReading
) -> dict[int, CuboidImage]:
    """The images of a video's frames 0, 1, 2, ...

    They are those in a folder of the video's name, if the truth has such; else all. By the numbers
    that their names end with, if these begin at 0, or in the file's order if there are as many.
    """
    video = str(content.get("video_name", ""))
    images = [one for one in reading.truth.usable if video in Path(one.image_id).parts[:-1]]
    images = images or list(reading.truth.usable)
    frames = content.get("n_frames")
    numbered = numbered_images(images)
    if numbered is not None and min(numbered, default=1) == 0:
        reading.notes.append(
            f"frames of {video!r} were found among {len(images)} images by the numbers that their"
            " names end with"
        )
        return numbered
    if frames == len(images):
        reading.notes.append(
            f"frames of {video!r} were taken for the truth's {len(images)} images in their order"
        )
        return dict(enumerate(images))
    raise DatasetFormatError(
        f"{path} has {frames} frames (n_frames) and the truth {len(images)} images, whose names do"
        " not end with numbers from 0: which is which cannot be told; name the images' folder as"
        " the video, or give a truth with its frames alone"
    )


class _FrameBox(msgspec.Struct, kw_only=True):
    """One box of WildLIFT's file of a frame."""

    center: list[float]
    dimensions: list[float]
    rotation_matrix: Matrix
    class_name: str = "unknown"
    confidence: float | None = None
    track_id: Key | None = None


def read_frames(path: Path, reading: DetectionReading, cameras: Cameras) -> None:
    """Read WildLIFT's files, one a frame: l, w, h, and columns along length, width, height.

    Args:
        path: one file, or the folder of all.
        reading: to which the boxes and faults are added.
        cameras: see FrameCamera; the boxes are in a world.

    Raises:
        DatasetFormatError: the one file is no list, or no camera's pose is found.

    """
    files = sorted(path.glob("*.json")) if path.is_dir() else [path]
    for file, camera in frame_cameras(files, cameras, reading):
        try:
            content = plain_json(file)
            if not isinstance(content, list):
                raise DatasetFormatError(f"{file} must hold a list of boxes")
        except DatasetFormatError as error:
            if not path.is_dir():
                raise
            reading.faults.append(SampleError(camera.image.image_id, file.name, str(error)))
            continue
        for box in _frame_boxes(content, camera, reading):
            _add(box, reading, "dimensions")


def _frame_boxes(
    content: list[Any], camera: FrameCamera, reading: DetectionReading
) -> Iterator[StatedDetection]:
    """The boxes of one frame; those that are unusable become faults."""
    for element in content:
        sample_id = reading.sample_id(camera.image)
        try:
            stated = converted(element, _FrameBox, sample_id)
            center, dimensions, rotation = (
                _numbers(getattr(stated, field), shape, sample_id, field)
                for field, shape in (
                    ("center", (3,)),
                    ("dimensions", (3,)),
                    ("rotation_matrix", (3, 3)),
                )
            )
            yield StatedDetection(
                sample_id=sample_id,
                image=camera.image,
                category=stated.class_name,
                score=checked_score(stated.confidence, sample_id, "confidence"),
                box=None,
                center=camera.points(center),
                dimensions=dimensions,
                rotation=camera.axes(checked_rotation(rotation, sample_id, "rotation_matrix")),
                sighting=_sighting(stated.track_id),
            )
        except SampleError as error:
            reading.faults.append(error)


def _sighting(track: Key | None) -> Sighting:
    """The track of a box; WildLIFT's -1 is none."""
    return NO_SIGHTING if track in (None, -1) else Sighting(track=str(track))
