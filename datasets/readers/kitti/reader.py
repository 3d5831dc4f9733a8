"""The reader of cuboids in KITTI's text files."""

from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from animal3dbox.datasets.images.photos import read_image
from animal3dbox.datasets.readers.cuboid_conventions import KITTI, Floats, yaw_rotation
from animal3dbox.datasets.readers.kitti.files import (
    NO_LOCATION,
    KittiLine,
    parsed_calibration,
    parsed_images,
    parsed_lines,
)
from animal3dbox.datasets.records import CuboidImage, CuboidRecord, CuboidSet
from animal3dbox.errors import DatasetFormatError, DatasetNotFoundError, SampleError, ShapeError
from animal3dbox.geometry.checks import check_intrinsics

FORMAT = "kitti"
"""The format's name in reports."""


def read_kitti(folder: Path, *, heading_known: bool = True) -> CuboidSet:
    """The cuboids of a folder with label_2/ and calib/, and images.txt or image_2/.

    Args:
        folder: such as KITTI's own training/.
        heading_known: whether forward means something, as it does for KITTI's cars.

    Returns:
        The boxes in the frame of camera 2, in metres; DontCare regions and boxes without a 3D
        location are left out and counted.

    Raises:
        DatasetNotFoundError: no label_2/ with text files.
        DatasetFormatError: images.txt is there and damaged.

    Example:
        >>> import tempfile
        >>> from animal3dbox.datasets import CuboidRecord, CuboidSet, write_kitti
        >>> K = np.array([[500.0, 0, 319.5], [0, 500, 239.5], [0, 0, 1]])
        >>> car = CuboidRecord(
        ...     sample_id="a.jpg",
        ...     image_id="a.jpg",
        ...     image_path=None,
        ...     image_hw=(480, 640),
        ...     category="Car",
        ...     K=K,
        ...     center=np.array([1.0, 0.5, 20.0]),
        ...     rotation=np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]]),
        ...     size=np.array([4.0, 1.6, 1.5]),
        ... )
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     _ = write_kitti(CuboidSet("cars", (car,), ()), Path(folder))
        ...     boxes = read_kitti(Path(folder))
        >>> boxes.records[0].category, boxes.records[0].center.round(6).tolist()
        ('Car', [1.0, 0.5, 20.0])

    """
    labels = sorted((folder / "label_2").glob("*.txt"))
    if not labels:
        raise DatasetNotFoundError(f"{folder} has no label_2/*.txt")
    try:
        index = folder / "images.txt"
        sizes_and_paths = (
            parsed_images(index.read_text(errors="replace")) if index.is_file() else None
        )
    except SampleError as error:
        raise DatasetFormatError(f"{folder}: {error}") from error
    records: list[CuboidRecord] = []
    images: list[CuboidImage] = []
    faults: list[SampleError] = []
    counts: Counter[str] = Counter()
    for label in labels:
        try:
            image, offset = _image(folder, label.stem, sizes_and_paths)
        except SampleError as error:
            faults.append(error)
            continue
        images.append(image)
        for box in _boxes(label, image, offset, counts, heading_known=heading_known):
            if isinstance(box, SampleError):
                faults.append(box)
            else:
                records.append(box)
    return CuboidSet(
        name=FORMAT,
        records=tuple(records),
        faults=tuple(faults),
        notes=tuple(f"{count} {kind} were left out" for kind, count in counts.items()),
        images=tuple(images),
    )


def _image(
    folder: Path, stem: str, sizes_and_paths: dict[str, tuple[tuple[int, int], str]] | None
) -> tuple[CuboidImage, Floats]:
    """The image of a label file, and the place (3,) of the first camera in the image's frame.

    Args:
        folder: with calib/ and image_2/.
        stem: the number that the files of an image share.
        sizes_and_paths: of images.txt; None without, whereupon the image itself is read.

    Raises:
        SampleError: the image or its calibration is missing or damaged.

    """
    if sizes_and_paths is not None:
        if stem not in sizes_and_paths:
            raise SampleError(stem, "images.txt", "does not list it")
        image_hw, name = sizes_and_paths[stem]
        path = folder / name
    else:
        pictures = [folder / "image_2" / f"{stem}.{suffix}" for suffix in ("png", "jpg")]
        path = next((picture for picture in pictures if picture.is_file()), pictures[0])
        name = f"image_2/{path.name}"
        height, width = read_image(path, stem).shape[:2]
        image_hw = (height, width)
    try:
        P = parsed_calibration((folder / "calib" / f"{stem}.txt").read_text(errors="replace"), name)
        K = KITTI.K_in(P[:, :3])
        check_intrinsics("P2", K)
    except OSError as error:
        raise SampleError(name, "calib", f"cannot be read: {error}") from error
    except ShapeError as error:
        raise SampleError(name, "P2", str(error)) from error
    # P [X; 1] = K (X + o), so the first camera's frame is moved by o = K⁻¹ P[:, 3] into camera 2's.
    offset = np.asarray(np.linalg.solve(P[:, :3], P[:, 3]), dtype=np.float64)
    return CuboidImage(name, path, image_hw, K), offset


def _boxes(
    label: Path, image: CuboidImage, offset: Floats, counts: Counter[str], *, heading_known: bool
) -> Iterator[CuboidRecord | SampleError]:
    """The boxes of a label file, an error in the place of a faulty one; others are counted."""
    number = 0
    for line in parsed_lines(label.read_text(errors="replace"), image.image_id):
        if isinstance(line, SampleError):
            yield line
        elif line.kind == "DontCare":
            counts["DontCare regions"] += 1
        elif (line.location == NO_LOCATION).any() or (line.dimensions == -1).all():
            counts["boxes without a 3D location"] += 1
        else:
            sample_id = f"{image.image_id}#{number}" if number else image.image_id
            yield _record(line, sample_id, image, offset, heading_known=heading_known)
            number += 1


def _record(
    line: KittiLine, sample_id: str, image: CuboidImage, offset: Floats, *, heading_known: bool
) -> CuboidRecord | SampleError:
    """The record of a line, or an error if its dimensions are not positive."""
    if line.dimensions.min() <= 0:
        return SampleError(
            sample_id, "dimensions", f"must be positive, got {line.dimensions.tolist()}"
        )
    center, rotation, size = KITTI.boxes_in(
        line.location, yaw_rotation(np.array(line.rotation_y)), line.dimensions
    )
    return CuboidRecord(
        sample_id=sample_id,
        image_id=image.image_id,
        image_path=image.image_path,
        image_hw=image.image_hw,
        category=line.kind,
        K=image.K,
        center=center + offset,
        rotation=rotation,
        size=size,
        heading_known=heading_known,
        box=KITTI.boxes_2d_in(line.box) if (line.box[2:] > line.box[:2]).all() else None,
        truncation=line.truncated if line.truncated >= 0 else None,
    )
