"""Any dataset of cuboids in Omni3D's JSON.

The boxes as they are, whatever order their corners are in.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np

from animal3dbox.datasets.readers.cuboid_conventions import OMNI3D, Convention
from animal3dbox.datasets.readers.elements import decoded
from animal3dbox.datasets.readers.omni3d.elements import (
    StatedBox,
    box_2d,
    category_names,
    cuboid_image,
    stated_box,
)
from animal3dbox.datasets.readers.omni3d.image_roots import TRIED, image_root
from animal3dbox.datasets.readers.omni3d.layout import Layout, StatedBoxes, infer_layout
from animal3dbox.datasets.readers.omni3d.schema import (
    GENERATOR,
    Key,
    Omni3DAnnotation,
    Omni3DInfo,
    RawOmni3DFile,
)
from animal3dbox.datasets.readers.visible_boxes import seen_boxes
from animal3dbox.datasets.records import CuboidImage, CuboidRecord, CuboidSet
from animal3dbox.datasets.storage.json_files import decode_json
from animal3dbox.errors import SampleError

LEAST_OVERLAP = 0.5
"""Of bbox2D_proj with the projected box: less means that K, or the box, is of another image."""


def read_omni3d(
    path: Path,
    images: Path | None = None,
    *,
    convention: Convention | None = None,
    heading_known: bool | None = None,
) -> CuboidSet:
    """The cuboids of a file in Omni3D's format.

    Args:
        path: the JSON file.
        images: the folder that image paths are relative to; by default the first of the file's
            folder, its images/ and the two folders above that holds one of them; if none does,
            image files are not looked for.
        convention: what the file means; by default OMNI3D, with the pixel origin that the file
            states if this package wrote it.
        heading_known: whether forward and left mean something; by default what the file says if
            this package wrote it, else not.

    Returns:
        The boxes in our frames, in metres unless the file says otherwise; every usable image; one
        fault each unusable box or image; notes about the corner order and what was left out.

    Raises:
        DatasetNotFoundError: no such file.
        DatasetFormatError: not JSON, or without images, categories and annotations.

    """
    file: RawOmni3DFile = decode_json(path, RawOmni3DFile)
    info = _info(file.info)
    own = info is not None and info.generator == GENERATOR
    if convention is None:
        convention = (
            replace(OMNI3D, first_pixel=info.first_pixel)
            if info is not None and own and info.first_pixel is not None
            else OMNI3D
        )
    found, faults, notes = _images(file.images, path, images, convention)
    names, category_faults = category_names(file.categories)
    stated, box_faults, box_notes = _stated_boxes(file.annotations, found, names, convention)
    layout = infer_layout(_stacked(stated))
    records, layout_faults = _records(
        stated, layout, convention, own=own, heading_known=heading_known
    )
    kept, projection_faults = _checked_projections(records, stated, convention)
    usable = tuple(image for image in found.values() if image is not None)
    all_faults = (*faults, *category_faults, *box_faults, *layout_faults, *projection_faults)
    return CuboidSet(
        convention.name,
        tuple(record for record in kept),
        all_faults,
        (*notes, *box_notes, *layout.notes),
        usable,
        tuple(dict.fromkeys(names.values())),
    )


def _info(raw: msgspec.Raw) -> Omni3DInfo | None:
    """What the file says of itself, if that has the form of this package's files.

    Omni3D's own are lists or have ids that are words.
    """
    try:
        info: Omni3DInfo = msgspec.json.decode(raw, type=Omni3DInfo)
    except msgspec.ValidationError:
        return None
    return info


def _images(
    raws: Sequence[msgspec.Raw], path: Path, images: Path | None, convention: Convention
) -> tuple[dict[Key, CuboidImage | None], list[SampleError], list[str]]:
    """Images by id, None for the faulty ones."""
    root = image_root(path, images, [_named(raw).file_path for raw in raws[:TRIED]])
    found: dict[Key, CuboidImage | None] = {}
    faults: list[SampleError] = []
    paths: dict[str, Key] = {}
    for number, raw in enumerate(raws):
        try:
            key, image = cuboid_image(raw, number, path, root, convention)
            if key in found:
                raise SampleError(
                    image.image_id,
                    "id",
                    f"{key} is another image's too: which boxes are whose cannot be told",
                )
            if paths.setdefault(image.image_id, key) != key:
                raise SampleError(
                    image.image_id,
                    "file_path",
                    f"is that of image {paths[image.image_id]} too, not only of {key}: give it"
                    " once",
                )
        except SampleError as error:
            faults.append(error)
            named = _named(raw)
            if named.id is not None:
                found[named.id] = None
            continue
        found[key] = image
    notes = (
        []
        if root is not None or not raws
        else ["no image file was found near the annotations: files are not checked (see --images)"]
    )
    return found, faults, notes


class _Named(msgspec.Struct):
    """The keys of an image or annotation that are needed before it is checked."""

    id: Key | None = None
    image_id: Key | None = None
    file_path: str = ""


def _named(raw: msgspec.Raw) -> _Named:
    try:
        return msgspec.json.decode(raw, type=_Named)
    except msgspec.DecodeError:
        return _Named()  # whoever decodes the whole says what is wrong with it


def _stated_boxes(
    raws: Sequence[msgspec.Raw],
    images: dict[Key, CuboidImage | None],
    names: dict[Key, str],
    convention: Convention,
) -> tuple[list[StatedBox], list[SampleError], list[str]]:
    """Annotations of the right form, faults, and notes on what was left out."""
    stated, faults, numbers, counts = [], [], Counter[Key](), Counter[str]()
    for number, raw in enumerate(raws):
        key = _named(raw).image_id
        image, k = (None, 0) if key is None else (images.get(key), numbers[key])
        numbers.update(() if key is None else (key,))
        sample_id = (
            f"annotation {number}"
            if image is None
            else f"{image.image_id}#{k}"
            if k
            else image.image_id
        )
        try:
            if key is not None and key not in images:
                raise SampleError(sample_id, "image_id", f"{key} is not among the file's images")
            annotation = decoded(raw, Omni3DAnnotation, sample_id)
            if image is None:
                counts["annotations belong to faulty images and were left out"] += 1
            elif not annotation.valid3D:
                counts[
                    "annotations say that they have no 3D box (valid3D false) and were left out"
                ] += 1
            else:
                stated.append(stated_box(annotation, sample_id, image, names, convention))
                ignored = (
                    0 in (annotation.lidar_pts, annotation.segmentation_pts)
                    or (annotation.depth_error or 0) > 0.5
                )
                counts[
                    "boxes have lidar_pts or segmentation_pts 0, or a depth_error over 0.5:"
                    " Omni3D's trainer ignores them"
                ] += int(ignored)
        except SampleError as error:
            faults.append(error)
    return stated, faults, [f"{count} {what}" for what, count in counts.items() if count]


def _stacked(stated: Sequence[StatedBox]) -> StatedBoxes:
    if not stated:
        return StatedBoxes(
            np.zeros((0, 8, 3)), np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 3, 3))
        )
    corners, center = (
        np.stack([box.corners for box in stated]),
        np.stack([box.center for box in stated]),
    )
    return StatedBoxes(
        corners,
        center,
        np.stack([box.dimensions for box in stated]),
        np.stack([box.rotation for box in stated]),
    )


def _records(
    stated: Sequence[StatedBox],
    layout: Layout,
    convention: Convention,
    *,
    own: bool,
    heading_known: bool | None,
) -> tuple[list[tuple[int, CuboidRecord]], list[SampleError]]:
    """Records with their index in stated, of the boxes that do not contradict themselves."""
    records, faults = [], []
    centers = np.stack([box.center for box in stated]) if stated else np.zeros((0, 3))
    center, rotation, size = convention.boxes_in(centers, layout.rotation, layout.dimensions)
    for index, box in enumerate(stated):
        if index in layout.problems:
            faults.append(SampleError(box.sample_id, *layout.problems[index]))
            continue
        said = box.annotation
        record = CuboidRecord(
            sample_id=box.sample_id,
            image_id=box.image.image_id,
            image_path=box.image.image_path,
            image_hw=box.image.image_hw,
            category=box.category,
            K=box.image.K,
            center=center[index],
            rotation=rotation[index],
            size=size[index],
            metric=True if said.metric is None or not own else said.metric,
            heading_known=(
                bool(own and said.heading_known) if heading_known is None else heading_known
            ),
            box=box.box,
            truncation=box.truncation,
        )
        records.append((index, record))
    return records, faults


def _checked_projections(
    records: Sequence[tuple[int, CuboidRecord]], stated: Sequence[StatedBox], convention: Convention
) -> tuple[list[CuboidRecord], list[SampleError]]:
    """The records whose bbox2D_proj, if there is one, is where K projects the box."""
    seen = seen_boxes([record for _, record in records])
    kept, faults = [], []
    for number, (index, record) in enumerate(records):
        try:
            said = box_2d(
                stated[index].annotation.bbox2D_proj, record.sample_id, "bbox2D_proj", convention
            )
            ours = [
                box
                for box in (seen.projected[number], seen.in_frame[number])
                if not np.isnan(box).any()
            ]
            overlap = (
                max((_overlap(said, box) for box in ours), default=1.0) if said is not None else 1.0
            )
            if overlap < LEAST_OVERLAP:
                raise SampleError(
                    record.sample_id,
                    "bbox2D_proj",
                    f"is not where K projects bbox3D_cam (overlap {overlap:.2f}): K, the image size"
                    " or the box belongs to another image",
                )
        except SampleError as error:
            faults.append(error)
        else:
            kept.append(record)
    return kept, faults


def _overlap(a: np.ndarray, b: np.ndarray) -> float:
    """Intersection over union of upright boxes."""
    sides = np.minimum(a[2:], b[2:]) - np.maximum(a[:2], b[:2])
    common = float(np.prod(np.maximum(sides, 0)))
    return common / (float(np.prod(a[2:] - a[:2]) + np.prod(b[2:] - b[:2])) - common)
