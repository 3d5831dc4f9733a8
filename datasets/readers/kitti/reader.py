"""Cuboids of KITTI's text files."""

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

    """
    labels = sorted((folder / "label_2").glob("*.txt"))
    if not labels:
        raise DatasetNotFoundError(f"{folder} has no label_2/*.txt")
    try:
        listed = (
            parsed_images((folder / "images.txt").read_text(errors="replace"))
            if (folder / "images.txt").is_file()
            else None
        )
    except SampleError as error:
        raise DatasetFormatError(f"{folder}: {error}") from error
    records: list[CuboidRecord] = []
    images: list[CuboidImage] = []
    faults: list[SampleError] = []
    counts: Counter[str] = Counter()
    for label in labels:
        try:
            image, moved = _image(folder, label.stem, listed)
        except SampleError as error:
            faults.append(error)
            continue
        images.append(image)
        for found in _boxes(label, image, moved, counts, heading_known=heading_known):
            if isinstance(found, SampleError):
                faults.append(found)
            else:
                records.append(found)
    notes = tuple(f"{count} {what} were left out" for what, count in counts.items())
    return CuboidSet(FORMAT, tuple(records), tuple(faults), notes, tuple(images))


def _image(
    folder: Path, stem: str, listed: dict[str, tuple[tuple[int, int], str]] | None
) -> tuple[CuboidImage, Floats]:
    """An image, and where the first camera stands in its frame, (3,)."""
    if listed is not None:
        if stem not in listed:
            raise SampleError(stem, "images.txt", "does not list it")
        image_hw, name = listed[stem]
        path = folder / name
    else:
        path = next(
            (
                p
                for ending in ("png", "jpg")
                if (p := folder / "image_2" / f"{stem}.{ending}").is_file()
            ),
            folder / "image_2" / f"{stem}.png",
        )
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
    return CuboidImage(name, path, image_hw, K), np.asarray(
        np.linalg.solve(P[:, :3], P[:, 3]), dtype=np.float64
    )


def _boxes(
    label: Path, image: CuboidImage, moved: Floats, counts: Counter[str], *, heading_known: bool
) -> Iterator[CuboidRecord | SampleError]:
    number = 0
    for line in parsed_lines(label.read_text(errors="replace"), image.image_id):
        if isinstance(line, SampleError):
            yield line
        elif line.kind == "DontCare":
            counts["DontCare regions"] += 1
        elif (line.location == NO_LOCATION).any() or (line.dimensions == -1).all():
            counts["boxes without a 3D location"] += 1
        else:
            yield _record(
                line,
                f"{image.image_id}#{number}" if number else image.image_id,
                image,
                moved,
                heading_known=heading_known,
            )
            number += 1


def _record(
    line: KittiLine, sample_id: str, image: CuboidImage, moved: Floats, *, heading_known: bool
) -> CuboidRecord | SampleError:
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
        center=center + moved,
        rotation=rotation,
        size=size,
        heading_known=heading_known,
        box=KITTI.boxes_2d_in(line.box) if (line.box[2:] > line.box[:2]).all() else None,
        truncation=line.truncated if line.truncated >= 0 else None,
    )
