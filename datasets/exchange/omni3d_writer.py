"""The writer of cuboids as Omni3D's JSON, with the files that its trainers want beside it.

These are the categories' numbers, and statistics of their boxes' dimensions.
"""

from collections.abc import Sequence
from pathlib import Path

import msgspec
import numpy as np

from animal3dbox.datasets.exchange.export import (
    SUPERCATEGORY,
    ExportSummary,
    category_ids,
    checked_first_id,
    checked_units,
    heading_note,
    images_with_boxes,
    upright_note,
)
from animal3dbox.datasets.readers.cuboid_conventions import OMNI3D, Floats
from animal3dbox.datasets.readers.omni3d.schema import (
    GENERATOR,
    Key,
    Omni3DAnnotation,
    Omni3DCategory,
    Omni3DFile,
    Omni3DImage,
    Omni3DInfo,
)
from animal3dbox.datasets.readers.visible_boxes import stated_truncation, visible_boxes
from animal3dbox.datasets.records import CuboidImage, CuboidRecord, CuboidSet
from animal3dbox.files import write_whole
from animal3dbox.geometry.box_visibility import corners_visibility, visible_faces
from animal3dbox.geometry.cuboid import corners_of
from animal3dbox.progress import watched

UNKNOWN_BOX = [-1.0, -1.0, -1.0, -1.0]
"""Value of a 2D box that is not known."""
STATISTICS = ("id", "name", "n_anns", "dimensions_mean", "dimensions_std")
"""Keys of a category in X_stats.json."""


def write_omni3d(
    cuboids: CuboidSet,
    path: Path,
    *,
    scale_free: bool = False,
    split: str = "train",
    dataset_id: int = 0,
    first_category_id: int = 0,
    first_id: int = 1,
    categories: Sequence[str] = (),
    faces: bool = False,
) -> ExportSummary:
    """Write cuboids in Omni3D's format as X.json, X_category_meta.json and X_stats.json.

    Category names are in lower case, as the trainer's priors look them up; ids follow their
    alphabet. Values that are not known are -1, never 0, for which the trainer ignores a box. Ids of
    images and annotations begin at 1, because evaluators made after pycocotools take a match with
    annotation 0 for none.

    Exports that are to be joined need ids that differ and one list of categories: give the second
    one the first's next_id as first_id, another dataset_id, and both the same categories.

    Args:
        cuboids: boxes in metres.
        path: the JSON file; one that is there is replaced.
        scale_free: write boxes of unknown scale as they are; info.units and each annotation's
            metric then say so.
        split: info.split.
        dataset_id: info.id, which images and annotations repeat; another one for each dataset that
            is trained together.
        first_category_id: id of the first category; 1000, for example, keeps clear of Omni3D's own.
        first_id: id of the first image and of the first annotation.
        categories: names in the order of their ids, which may be more than the boxes have; none:
            those of the boxes.
        faces: write which faces of each box are seen and their parts of the picture too, in keys of
            this package's own that other readers leave alone.

    Returns:
        The summary; its faults are the boxes that were left out.

    Raises:
        ConfigError: the scale of a box is not known, and scale_free is false; first_id is below 1;
            or categories lacks one of a box.

    Example:
        >>> import tempfile
        >>> from animal3dbox.datasets import CuboidRecord, CuboidSet
        >>> K = np.array([[500.0, 0, 319.5], [0, 500, 239.5], [0, 0, 1]])
        >>> dog = CuboidRecord(
        ...     sample_id="a.jpg",
        ...     image_id="a.jpg",
        ...     image_path=None,
        ...     image_hw=(480, 640),
        ...     category="dog",
        ...     K=K,
        ...     center=np.array([0.0, 0.0, 4.0]),
        ...     rotation=np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]]),
        ...     size=np.array([0.9, 0.3, 0.6]),
        ... )
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     summary = write_omni3d(CuboidSet("dogs", (dog,), ()), Path(folder) / "dogs.json")
        >>> [file.name for file in summary.files]
        ['dogs.json', 'dogs_category_meta.json', 'dogs_stats.json']

    """
    units = checked_units(cuboids, OMNI3D, scale_free=scale_free)
    members, faults = images_with_boxes(cuboids)
    records = [record for _, boxes in members for record in boxes]
    used = {category_name(record.category) for record in records}
    ids = category_ids(used, [category_name(name) for name in categories], first_category_id)
    start = checked_first_id(first_id)
    numbers = {image.image_id: number for number, (image, _) in enumerate(members, start)}
    file = Omni3DFile(
        info=_info(ids, split=split, dataset_id=dataset_id, units=units),
        images=_images(members, numbers, dataset_id),
        categories=[
            Omni3DCategory(id=number, name=name, supercategory=SUPERCATEGORY)
            for name, number in ids.items()
        ],
        annotations=_annotations(records, numbers, ids, dataset_id=dataset_id, first_id=start),
    )
    if faces:
        _add_faces(file.annotations, records)
    meta, stats = (
        path.with_name(f"{path.stem}_{name}.json") for name in ("category_meta", "stats")
    )
    write_whole(path, msgspec.json.encode(file))
    write_whole(meta, _pretty(_category_meta(ids)))
    write_whole(stats, _pretty(dimension_stats(records, ids, len(members), units)))
    return ExportSummary(
        files=(path, meta, stats),
        images=len(members),
        boxes=len(records),
        faults=tuple(faults),
        notes=(*heading_note(records), *upright_note(cuboids), *_unit_note(units)),
        next_id=start + max(len(members), len(records)),
    )


def _info(ids: dict[str, int], *, split: str, dataset_id: int, units: str) -> Omni3DInfo:
    """The head of the file; see write_omni3d."""
    category_ids: list[Key] = list(ids.values())
    return Omni3DInfo(
        id=dataset_id,
        split=split,
        known_category_ids=category_ids,
        generator=GENERATOR,
        units=units,
        first_pixel=OMNI3D.first_pixel,
    )


def _category_meta(ids: dict[str, int]) -> dict[str, object]:
    """The content of X_category_meta.json: the categories, and their ids' places from 0 on."""
    contiguous = {str(number): k for k, number in enumerate(ids.values())}
    return {"thing_classes": list(ids), "thing_dataset_id_to_contiguous_id": contiguous}


def _unit_note(units: str) -> tuple[str, ...]:
    """A sentence on lengths that are not in metres, if there are any."""
    if units == "m":
        return ()
    return (
        f"lengths are not all in metres (info.units {units!r}): do not train metric depth on them",
    )


def _images(
    members: Sequence[tuple[CuboidImage, object]], numbers: dict[str, int], dataset_id: int
) -> list[Omni3DImage]:
    """The elements of "images", numbered by image id."""
    return [
        Omni3DImage(
            id=numbers[image.image_id],
            dataset_id=dataset_id,
            width=image.image_hw[1],
            height=image.image_hw[0],
            file_path=image.image_id,
            K=OMNI3D.K_out(image.K).tolist(),
            turned_upright=image.upright or msgspec.UNSET,
        )
        for image, _ in members
    ]


def category_name(category: str) -> str:
    """A category's name as the trainer's priors look it up: in lower case."""
    return category.strip().lower() or "unknown"


def _annotations(
    records: Sequence[CuboidRecord],
    numbers: dict[str, int],
    ids: dict[str, int],
    *,
    dataset_id: int,
    first_id: int,
) -> list[Omni3DAnnotation]:
    """The elements of "annotations".

    Args:
        records: the boxes.
        numbers: image id -> number.
        ids: category name -> id.
        dataset_id: repeated in each.
        first_id: id of the first.

    """
    visible = visible_boxes(records)
    annotations = []
    for index, record in enumerate(watched(records, "writing", unit="box")):
        location, rotation, dimensions = OMNI3D.boxes_out(
            record.center, record.rotation, record.size
        )
        name = category_name(record.category)
        annotation = Omni3DAnnotation(
            id=first_id + index,
            image_id=numbers[record.image_id],
            dataset_id=dataset_id,
            category_id=ids[name],
            category_name=name,
            valid3D=True,
            bbox2D_tight=_box(record.box),
            bbox2D_proj=_box(visible.projected[index]),
            bbox2D_trunc=_box(visible.in_frame[index]),
            bbox3D_cam=OMNI3D.corners_out(record.center, record.rotation, record.size).tolist(),
            center_cam=location.tolist(),
            dimensions=dimensions.tolist(),
            R_cam=rotation.tolist(),
            behind_camera=bool(visible.behind_camera[index]),
            visibility=-1 if record.visibility is None else record.visibility,
            truncation=stated_truncation(record, visible, index),
            segmentation_pts=-1,
            lidar_pts=-1,
            depth_error=-1,
            metric=record.metric,
            heading_known=record.heading_known,
            track_id=record.sighting.track or msgspec.UNSET,
        )
        annotations.append(annotation)
    return annotations


def _add_faces(annotations: Sequence[Omni3DAnnotation], records: Sequence[CuboidRecord]) -> None:
    """Add what each box and its camera say of the faces; of boxes of unknown fronts nothing."""
    for annotation, record in zip(annotations, records, strict=True):
        if not record.heading_known:
            continue
        corners = corners_of(record.center, record.rotation, record.size)
        visible = visible_faces(corners, np.zeros(3))
        faces = corners_visibility(corners, record.K, record.image_hw, visible)
        annotation.face_visible = faces.visible.tolist()
        annotation.face_area = faces.area.tolist()
        annotation.face_share = faces.share.tolist()
        annotation.face_share_in_image = faces.share_in_image.tolist()


def _box(box: Floats | None) -> list[float]:
    """A 2D box (4,) in Omni3D's pixels; UNKNOWN_BOX of None or NaN."""
    if box is None or np.isnan(box).any():
        return UNKNOWN_BOX
    return [float(value) for value in OMNI3D.boxes_2d_out(box)]


def dimension_stats(
    records: Sequence[CuboidRecord], ids: dict[str, int], images: int, units: str
) -> dict[str, object]:
    """The content of X_stats.json: priors of a trainer for the dimensions of each category.

    They are the mean and the standard deviation (of a sample) of [W, H, L].

    Args:
        records: every box.
        ids: category name -> id.
        images: number of images.
        units: unit of the lengths.

    Returns:
        The content; a standard deviation is None where there is one box only, a mean where there
        is none.

    """
    rows = []
    for name, number in ids.items():
        sizes = np.array(
            [record.size for record in records if category_name(record.category) == name]
        )
        if not len(sizes):
            rows.append(dict(zip(STATISTICS, (number, name, 0, None, None), strict=True)))
            continue
        dimensions = OMNI3D.boxes_out(
            np.zeros_like(sizes), np.broadcast_to(np.eye(3), (len(sizes), 3, 3)), sizes
        )[2]
        spread = dimensions.std(axis=0, ddof=1).tolist() if len(sizes) > 1 else None
        values = (number, name, len(sizes), dimensions.mean(axis=0).tolist(), spread)
        rows.append(dict(zip(STATISTICS, values, strict=True)))
    priors = [[row["dimensions_mean"], row["dimensions_std"]] for row in rows]
    counts = {"n_datasets": 1, "n_ims": images, "n_anns": len(records), "units": units}
    return {
        **counts,
        "category_names": list(ids),
        "categories": rows,
        "priors_dims_per_cat": priors,
    }


def _pretty(content: dict[str, object]) -> bytes:
    """Content as JSON that a person can read."""
    return msgspec.json.format(msgspec.json.encode(content), indent=1)
