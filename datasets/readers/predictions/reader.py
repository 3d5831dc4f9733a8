"""The door to detectors' boxes: any layout that is known, in our frames, in a truth's images."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from animal3dbox.datasets.readers.cuboid_checks import Metric, check_metric
from animal3dbox.datasets.readers.kitti.reader import read_kitti
from animal3dbox.datasets.readers.predictions.camera_poses import Cameras
from animal3dbox.datasets.readers.predictions.corner_files import SAME_K, read_corner_file
from animal3dbox.datasets.readers.predictions.layouts import (
    CategoryIds,
    DetectionLayout,
    recognised_layout,
)
from animal3dbox.datasets.readers.predictions.stated import DetectionReading, detection_records
from animal3dbox.datasets.readers.predictions.truth import (
    Truth,
    numbered_images,
    read_truth,
    trailing_number,
    unique_image,
)
from animal3dbox.datasets.readers.predictions.world_files import (
    read_boxer,
    read_frames,
    read_tracks,
)
from animal3dbox.datasets.records import CuboidImage, CuboidRecord, CuboidSet
from animal3dbox.errors import ConfigError, SampleError
from animal3dbox.files import user_path


def read_predictions(
    path: Path | str,
    truth: Path | str,
    *,
    layout: str | None = None,
    cameras: Cameras | str = None,
    category_ids: CategoryIds | None = None,
    heading_known: bool | None = None,
    images: Path | str | None = None,
    metric: Metric = "info",
    look_for_images: bool = True,
) -> CuboidSet:
    """The boxes that a detector found, in our frames and corner order.

    Orders of corners and dimensions are inferred where the file has corners; else they are the
    layout's stated convention. Nothing is matched to the truth's boxes, which are not read.

    Args:
        path: the detector's file or folder; see docs/predictions.md for the layouts.
        truth: the Omni3D JSON that was detected on, for the ids of images and categories.
        layout: the layout's name; None: recognised by suffix and keys.
        cameras: poses of the cameras, for layouts in a world: a file or folder; "camera": the boxes
            are in the cameras' own frames; None: what lies beside the detections.
        category_ids: whether numbers of categories are the truth's ids ("dataset") or their places
            ("contiguous"); None: as the layout has it.
        heading_known: whether forward and left mean something; None: as the layout has it.
        images: the folder that the truth's image paths are relative to.
        metric: whether lengths are metres; "info": as the truth's are.
        look_for_images: False: the truth counts alone, and detections in an image whose file is
            missing are no faults.

    Returns:
        The boxes, with scores; all usable images of the truth; one fault each unusable detection;
        notes about orders, dummy boxes and cameras.

    Raises:
        ConfigError: an option that cannot be.
        DatasetNotFoundError: no such file.
        DatasetFormatError: in no layout that is known, or not readable as a whole.

    Example:
        >>> import json, tempfile
        >>> from animal3dbox.datasets import CuboidRecord, CuboidSet, write_omni3d
        >>> K = np.array([[500.0, 0, 319.5], [0, 500, 239.5], [0, 0, 1]])
        >>> dog = CuboidRecord(
        ...     sample_id="a.jpg",
        ...     image_id="a.jpg",
        ...     image_path=None,
        ...     image_hw=(480, 640),
        ...     category="dog",
        ...     K=K,
        ...     center=np.array([0.0, 0.0, 4.0]),
        ...     rotation=np.eye(3),
        ...     size=np.array([0.9, 0.3, 0.6]),
        ... )
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     truth = Path(folder) / "dogs.json"
        ...     _ = write_omni3d(CuboidSet("dogs", (dog,), ()), truth)
        ...     box = json.loads(truth.read_text())["annotations"][0]
        ...     names = {"bbox3D": "bbox3D_cam", "R_cam": "R_cam", "center_cam": "center_cam"}
        ...     found = {name: box[key] for name, key in names.items()}
        ...     found |= {"dimensions": box["dimensions"], "image_id": 1, "category_id": 0}
        ...     detections = Path(folder) / "detect_3D_results.json"
        ...     _ = detections.write_text(json.dumps([{**found, "score": 0.8}]))
        ...     boxes = read_predictions(detections, truth)
        >>> boxes.records[0].category, boxes.records[0].size.round(6).tolist()
        ('dog', [0.9, 0.3, 0.6])

    """
    check_metric(metric)
    path, truth = user_path(path), user_path(truth)
    images = None if images is None else user_path(images)
    poses: Cameras = "camera" if cameras == "camera" else None
    if cameras is not None and cameras != "camera":
        poses = user_path(cameras)
    kind = recognised_layout(path, layout)
    known = read_truth(truth, images, metric=metric, look_for_images=look_for_images)
    reading = DetectionReading(known, kind)
    if kind.name == "kitti":
        records = _kitti_records(path, reading, heading_known=heading_known)
    else:
        _read(path, reading, kind, cameras=poses, category_ids=category_ids)
        records = detection_records(reading, heading_known=heading_known)
    return CuboidSet(
        name=kind.name,
        records=records,
        faults=tuple(reading.faults),
        notes=reading.all_notes(records),
        images=known.usable,
        categories=tuple(dict.fromkeys(known.categories.values())),
    )


def _read(
    path: Path,
    reading: DetectionReading,
    kind: DetectionLayout,
    *,
    cameras: Cameras,
    category_ids: CategoryIds | None,
) -> None:
    """Read the boxes of a file by its layout."""
    if kind.categories == "name" and category_ids is not None:
        raise ConfigError(f"category_ids has no use: {kind.name} names categories by words")
    if kind.frame == "camera" and cameras is not None:
        raise ConfigError(f"cameras has no use: boxes of {kind.name} are in the cameras' frames")
    if kind.name == "boxer":
        read_boxer(path, reading, cameras)
    elif kind.name == "frames":
        read_frames(path, reading, cameras)
    elif kind.name == "tracks":
        read_tracks(path, reading)
    else:
        read_corner_file(path, reading, category_ids or kind.categories)


def _kitti_records(
    path: Path, reading: DetectionReading, *, heading_known: bool | None
) -> tuple[CuboidRecord, ...]:
    """The boxes of a folder of KITTI's results in the truth's images."""
    named = reading.layout.heading_known if heading_known is None else heading_known
    boxes = read_kitti(path, heading_known=named)
    reading.faults += boxes.faults
    reading.notes += boxes.notes
    numbered = numbered_images(reading.truth.usable) or {}
    records, different = [], set()
    for record in boxes.records:
        image = _kitti_image(record, path, reading.truth, numbered)
        if image is None:
            problem = "the truth has no one image of this name or number"
            reading.faults.append(SampleError(record.sample_id, "image", problem))
            continue
        if np.abs(record.K - image.K).max() > 1 + SAME_K * image.K[0, 0]:
            different.add(image.image_id)
        records.append(
            replace(
                record,
                sample_id=reading.sample_id(image),
                image_id=image.image_id,
                image_path=image.image_path,
                image_hw=image.image_hw,
                K=image.K,
                metric=reading.truth.metric,
            )
        )
    if different:
        reading.notes.append(f"P2 of {len(different)} images differ from the truth's K")
    return tuple(records)


def _kitti_image(
    record: CuboidRecord, path: Path, truth: Truth, numbered: dict[int, CuboidImage]
) -> CuboidImage | None:
    """The truth's image of a record of KITTI's: by its name, its id, or its number."""
    image = unique_image(truth.usable, record.image_id, path)
    number = trailing_number(Path(record.image_id).stem)
    if image is not None or number is None:
        return image
    return truth.images.get(number) or numbered.get(number)
