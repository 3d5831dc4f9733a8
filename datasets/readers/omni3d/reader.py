"""The reader of cuboids in Omni3D's JSON, whatever order their corners are in.

Nothing of a box is estimated: it is brought into our frames, or it is a fault if its fields
contradict each other.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np

from animal3dbox.datasets.images.remote_files import PicturePath
from animal3dbox.datasets.readers.cuboid_checks import (
    Metric,
    check_metric,
    size_note,
    without_repeats,
)
from animal3dbox.datasets.readers.cuboid_conventions import Convention
from animal3dbox.datasets.readers.elements import decoded
from animal3dbox.datasets.readers.omni3d.consistency import (
    all_behind_note,
    behind_camera_problems,
    with_consistent_boxes_2d,
)
from animal3dbox.datasets.readers.omni3d.dimension_order import order_problems
from animal3dbox.datasets.readers.omni3d.elements import (
    StatedBox,
    category_names,
    cuboid_image,
    sighting_in,
    stated_box,
)
from animal3dbox.datasets.readers.omni3d.head import StatedHead, stated_head
from animal3dbox.datasets.readers.omni3d.headings import with_named_faces
from animal3dbox.datasets.readers.omni3d.image_roots import TRIED, image_root
from animal3dbox.datasets.readers.omni3d.layout import Layout, StatedBoxes, infer_layout
from animal3dbox.datasets.readers.omni3d.schema import (
    Key,
    Omni3DAnnotation,
    RawOmni3DFile,
    StatedAnnotation,
)
from animal3dbox.datasets.records import CuboidImage, CuboidRecord, CuboidSet
from animal3dbox.datasets.sightings import NO_SIGHTING
from animal3dbox.datasets.storage.json_files import decode_json
from animal3dbox.errors import SampleError
from animal3dbox.files import user_path
from animal3dbox.progress import watched

_OF_FAULTY_IMAGES = "annotations belong to faulty images and were left out"
_WITHOUT_3D = "annotations say that they have no 3D box (valid3D false) and were left out"
_IGNORED_BY_TRAINER = (
    "boxes have lidar_pts or segmentation_pts 0, or a depth_error over 0.5: Omni3D's trainer"
    " ignores them"
)


def read_omni3d(
    path: Path | str,
    images: Path | str | None = None,
    *,
    convention: Convention | None = None,
    heading_known: bool | None = None,
    metric: Metric = "info",
    look_for_images: bool = True,
) -> CuboidSet:
    """The cuboids of a file in Omni3D's format, in our frames and corner order.

    Args:
        path: the JSON file.
        images: the folder that image paths are relative to; by default the first of the file's
            folder, its images/ and the two folders above that holds one of them; if none does,
            image files are not looked for.
        convention: the meaning of the file's numbers; by default OMNI3D, with the pixel origin that
            the file states if this package wrote it.
        heading_known: whether forward and left mean something; by default as the file says if this
            package wrote it, or where it tells by face_locks or heading_alpha; else not.
        metric: whether lengths are metres: "yes", "no", or "info": as the file says, which files of
            this package do, others in info.units ("m"); of a file that says nothing the scale is
            not known.
        look_for_images: False: what the file says counts alone, and an image whose file is missing
            is no fault.

    Returns:
        The boxes in our frames; every usable image; one fault each unusable box or image; notes
        about units, the corner order and left-out boxes.

    Raises:
        ConfigError: another word for metric.
        DatasetNotFoundError: no such file.
        DatasetFormatError: not JSON, or without images, categories and annotations.

    Example:
        >>> import tempfile
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
        ...     path = Path(folder) / "dogs.json"
        ...     _ = write_omni3d(CuboidSet("dogs", (dog,), ()), path)
        ...     boxes = read_omni3d(path)
        >>> boxes.records[0].category, boxes.records[0].size.tolist()
        ('dog', [0.9, 0.3, 0.6])

    """
    check_metric(metric)
    path, images = user_path(path), None if images is None else user_path(images)
    file: RawOmni3DFile = decode_json(path, RawOmni3DFile)
    head = stated_head(file.info)
    convention = convention or head.convention()
    by_id, image_faults, image_notes = images_by_id(
        file.images, path, images, convention, look_for_images=look_for_images
    )
    names, category_faults = category_names(file.categories)
    boxes, box_faults, box_notes = _stated_boxes(file, by_id, names, convention)
    records, record_faults, record_notes = _sound_records(
        boxes, convention, head=head, heading_known=heading_known, metric=metric
    )
    unit_notes = (*head.unit_note(metric), *(size_note(records) if metric != "no" else ()))
    return CuboidSet(
        name=convention.name,
        records=records,
        faults=(*image_faults, *category_faults, *box_faults, *record_faults),
        notes=(*image_notes, *box_notes, *record_notes, *unit_notes),
        images=tuple(image for image in by_id.values() if image is not None),
        categories=tuple(dict.fromkeys(names.values())),
    )


def _sound_records(
    boxes: Sequence[StatedBox],
    convention: Convention,
    *,
    head: StatedHead,
    heading_known: bool | None,
    metric: Metric,
) -> tuple[tuple[CuboidRecord, ...], list[SampleError], list[str]]:
    """The records of the boxes that contradict nothing, an error for each other one, and notes.

    Args:
        boxes: of the file.
        convention: of the file.
        head: of the file.
        heading_known: as the user says; None: as the file does.
        metric: likewise.

    """
    layout = infer_layout(_stacked(boxes))
    problems = {**behind_camera_problems(boxes), **layout.problems}
    layout = replace(layout, problems=problems)
    records, faults = _records(
        boxes, layout, convention, head=head, heading_known=heading_known, metric=metric
    )
    notes = list(layout.notes)
    if heading_known is None:
        records, heading_faults, heading_notes = with_named_faces(records, boxes)
        faults += heading_faults
        notes += heading_notes
    misread = order_problems(records, boxes, convention)
    records = [(index, record) for index, record in records if index not in misread]
    consistent, projection_faults = with_consistent_boxes_2d(records, boxes, convention)
    kept, repeats = without_repeats(consistent)
    faults += [*misread.values(), *projection_faults, *repeats]
    return kept, faults, [*notes, *all_behind_note(boxes)]


def images_by_id(
    raws: Sequence[msgspec.Raw],
    path: Path,
    images: Path | None,
    convention: Convention,
    *,
    look_for_images: bool = True,
) -> tuple[dict[Key, CuboidImage | None], list[SampleError], list[str]]:
    """The images by id, None for faulty ones; an error for each of those; and notes.

    Args:
        raws: the elements of "images".
        path: the annotation file.
        images: the user's folder of images; None: look for one.
        convention: of the file.
        look_for_images: whether an image whose file is missing is a fault.

    """
    root = None
    if look_for_images:
        root = image_root(path, images, [_ids_of(raw).file_path for raw in raws[:TRIED]])
    by_id: dict[Key, CuboidImage | None] = {}
    faults: list[SampleError] = []
    paths: dict[PicturePath, Key] = {}
    for number, raw in enumerate(raws):
        try:
            key, image = cuboid_image(
                raw, number, annotations=path, root=root, convention=convention
            )
            if key in by_id:
                raise SampleError(
                    image.image_id,
                    "id",
                    f"{key} is another image's too: which boxes are whose cannot be told",
                )
            place = image.image_path  # of which a file may have two names
            if place is not None and paths.setdefault(place, key) != key:
                raise SampleError(
                    image.image_id,
                    "file_path",
                    f"is that of image {paths[place]} too, not only of {key}: give it once",
                )
        except SampleError as error:
            faults.append(error)
            faulty_id = _ids_of(raw).id
            if faulty_id is not None:
                by_id[faulty_id] = None
            continue
        by_id[key] = image
    notes = (
        []
        if root is not None or not raws or not look_for_images
        else ["no image file was found near the annotations: files are not checked (see --images)"]
    )
    return by_id, faults, notes


class _Ids(msgspec.Struct):
    """The keys of an image or annotation that are needed before it is checked."""

    id: Key | None = None
    image_id: Key | None = None
    file_path: str = ""


def _ids_of(raw: msgspec.Raw) -> _Ids:
    """The ids of an element, none of one that cannot be decoded, which is an error later."""
    try:
        return decoded(raw, _Ids, "element")
    except SampleError:
        return _Ids()


def _stated_boxes(
    file: RawOmni3DFile,
    images: dict[Key, CuboidImage | None],
    names: dict[Key, str],
    convention: Convention,
) -> tuple[list[StatedBox], list[SampleError], list[str]]:
    """The boxes that annotations state, an error a faulty annotation, and notes on the others.

    Args:
        file: with the elements of "annotations", and of "images" for what they say of all animals.
        images: by id, None for faulty ones.
        names: of the categories, by id.
        convention: of the file.

    """
    boxes, faults, numbers, counts = [], [], Counter[Key](), Counter[str]()
    owners: dict[Key, str] = {}
    seen = {one: sighting_in(raw) for raw in file.images if (one := _ids_of(raw).id) is not None}
    for number, raw in enumerate(watched(file.annotations, "reading", unit="box")):
        key = _ids_of(raw).image_id
        image = None if key is None else images.get(key)
        sample_id = f"annotation {number}"
        if image is not None and key is not None:
            sample_id = f"{image.image_id}#{numbers[key]}" if numbers[key] else image.image_id
        if key is not None:
            numbers[key] += 1
        try:
            if key is not None and key not in images:
                raise SampleError(sample_id, "image_id", f"{key} is not among the file's images")
            annotation = decoded(raw, StatedAnnotation, sample_id)
            if owners.setdefault(annotation.id, sample_id) != sample_id:
                raise SampleError(
                    sample_id,
                    "id",
                    f"{annotation.id} is that of {owners[annotation.id]} too: evaluators count"
                    " one of them; give each annotation an id of its own",
                )
            if image is None:
                counts[_OF_FAULTY_IMAGES] += 1
            elif annotation.valid3D in (False, 0):
                counts[_WITHOUT_3D] += 1
            else:
                box = stated_box(
                    annotation, sample_id, image=image, categories=names, convention=convention
                )
                sighting = sighting_in(raw, seen.get(annotation.image_id, NO_SIGHTING))
                boxes.append(replace(box, sighting=sighting))
                counts[_IGNORED_BY_TRAINER] += _is_ignored(annotation)
        except SampleError as error:
            faults.append(error)
    return boxes, faults, [f"{count} {note}" for note, count in counts.items() if count]


def _is_ignored(annotation: Omni3DAnnotation) -> bool:
    """Whether Omni3D's trainer ignores an annotation for what was measured of its box."""
    points = (annotation.lidar_pts, annotation.segmentation_pts)
    return 0 in points or (annotation.depth_error or 0) > 0.5


def _stacked(boxes: Sequence[StatedBox]) -> StatedBoxes:
    """The arrays of boxes, stacked."""
    if not boxes:
        return StatedBoxes(
            corners=np.zeros((0, 8, 3)),
            center=np.zeros((0, 3)),
            dimensions=np.zeros((0, 3)),
            rotation=np.zeros((0, 3, 3)),
        )
    return StatedBoxes(
        corners=np.stack([box.corners for box in boxes]),
        center=np.stack([box.center for box in boxes]),
        dimensions=np.stack([box.dimensions for box in boxes]),
        rotation=np.stack([box.rotation for box in boxes]),
    )


def _records(
    boxes: Sequence[StatedBox],
    layout: Layout,
    convention: Convention,
    *,
    head: StatedHead,
    heading_known: bool | None,
    metric: Metric,
) -> tuple[list[tuple[int, CuboidRecord]], list[SampleError]]:
    """The records of the consistent boxes with their indices, and an error for each other box.

    Args:
        boxes: of the file.
        layout: of the boxes.
        convention: of the file.
        head: of the file.
        heading_known: as the user says; None: as the file does.
        metric: likewise.

    """
    records, faults = [], []
    centers = _stacked(boxes).center
    center, rotation, size = convention.boxes_in(centers, layout.rotation, layout.dimensions)
    for index, box in enumerate(watched(boxes, "reading", unit="box")):
        if index in layout.problems:
            faults.append(SampleError(box.sample_id, *layout.problems[index]))
            continue
        annotation = box.annotation
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
            metric=head.is_metric(annotation.metric, metric),
            heading_known=(
                bool(head.is_own and annotation.heading_known)
                if heading_known is None
                else heading_known
            ),
            box=box.box,
            truncation=box.truncation,
            visibility=box.visibility,
            sighting=box.sighting,
            upright=box.image.upright,
        )
        records.append((index, record))
    return records, faults
