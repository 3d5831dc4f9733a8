"""Cuboids written as Omni3D's JSON, with the category files and dimension statistics that its
trainers want beside it."""

from collections.abc import Sequence
from pathlib import Path

import msgspec
import numpy as np

from animal3dbox.datasets.exchange.export import (
    SUPERCATEGORY,
    Exported,
    checked_units,
    heading_note,
    images_with_boxes,
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

UNKNOWN_BOX = [-1.0, -1.0, -1.0, -1.0]


def write_omni3d(
    cuboids: CuboidSet,
    path: Path,
    *,
    scale_free: bool = False,
    split: str = "train",
    dataset_id: int = 0,
    first_category_id: int = 0,
) -> Exported:
    """Write cuboids as X.json, X_category_meta.json and X_stats.json.

    Category names are in lower case, as the trainer's priors look them up; ids follow their
    alphabet. What is not known is -1, never 0, for which the trainer ignores a box.

    Args:
        cuboids: boxes in metres.
        path: the JSON file; one that is there is replaced.
        scale_free: write boxes of unknown scale as they are; info.units and each annotation's
            metric then say so.
        split: info.split.
        dataset_id: info.id, which images and annotations repeat; another one for each dataset that
            is trained together.
        first_category_id: of the first category; 1000, for example, keeps clear of Omni3D's own.

    Raises:
        ConfigError: the scale of a box is not known, and scale_free is false.

    """
    units = checked_units(cuboids, OMNI3D, scale_free=scale_free)
    members, faults = images_with_boxes(cuboids)
    kept = [record for _, records in members for record in records]
    names = sorted({category_name(record.category) for record in kept})
    ids = {name: first_category_id + number for number, name in enumerate(names)}
    numbers = {image.image_id: number for number, (image, _) in enumerate(members)}
    known: list[Key] = list(ids.values())
    info = Omni3DInfo(
        id=dataset_id,
        split=split,
        known_category_ids=known,
        generator=GENERATOR,
        units=units,
        first_pixel=OMNI3D.first_pixel,
    )
    file = Omni3DFile(
        info=info,
        images=_images(members, numbers, dataset_id),
        categories=[
            Omni3DCategory(id=number, name=name, supercategory=SUPERCATEGORY)
            for name, number in ids.items()
        ],
        annotations=_annotations(kept, numbers, ids, dataset_id),
    )
    meta, stats = (
        path.with_name(f"{path.stem}_{name}.json") for name in ("category_meta", "stats")
    )
    contiguous = {str(number): k for k, number in enumerate(ids.values())}
    write_whole(path, msgspec.json.encode(file))
    write_whole(
        meta, _pretty({"thing_classes": names, "thing_dataset_id_to_contiguous_id": contiguous})
    )
    write_whole(stats, _pretty(dimension_stats(kept, ids, len(members), units)))
    notes = heading_note(kept) + (
        ()
        if units == "m"
        else (
            (
                f"lengths are not all in metres (info.units {units!r}): do not train metric depth"
                " on them"
            ),
        )
    )
    return Exported((path, meta, stats), len(members), len(kept), tuple(faults), notes)


def _images(
    members: Sequence[tuple[CuboidImage, object]], numbers: dict[str, int], dataset_id: int
) -> list[Omni3DImage]:
    return [
        Omni3DImage(
            id=numbers[image.image_id],
            dataset_id=dataset_id,
            width=image.image_hw[1],
            height=image.image_hw[0],
            file_path=image.image_id,
            K=OMNI3D.K_out(image.K).tolist(),
        )
        for image, _ in members
    ]


def category_name(category: str) -> str:
    """A category as the trainer's priors look it up: in lower case."""
    return category.strip().lower() or "unknown"


def _annotations(
    records: Sequence[CuboidRecord], numbers: dict[str, int], ids: dict[str, int], dataset_id: int
) -> list[Omni3DAnnotation]:
    seen = visible_boxes(records)
    annotations = []
    for index, record in enumerate(records):
        location, rotation, dimensions = OMNI3D.boxes_out(
            record.center, record.rotation, record.size
        )
        name = category_name(record.category)
        annotation = Omni3DAnnotation(
            id=index,
            image_id=numbers[record.image_id],
            dataset_id=dataset_id,
            category_id=ids[name],
            category_name=name,
            valid3D=True,
            bbox2D_tight=_box(record.box),
            bbox2D_proj=_box(seen.projected[index]),
            bbox2D_trunc=_box(seen.in_frame[index]),
            bbox3D_cam=OMNI3D.corners_out(record.center, record.rotation, record.size).tolist(),
            center_cam=location.tolist(),
            dimensions=dimensions.tolist(),
            R_cam=rotation.tolist(),
            behind_camera=bool(seen.behind_camera[index]),
            visibility=-1,
            truncation=stated_truncation(record, seen, index),
            segmentation_pts=-1,
            lidar_pts=-1,
            depth_error=-1,
            metric=record.metric,
            heading_known=record.heading_known,
        )
        annotations.append(annotation)
    return annotations


def _box(box: Floats | None) -> list[float]:
    return (
        UNKNOWN_BOX
        if box is None or np.isnan(box).any()
        else [float(value) for value in OMNI3D.boxes_2d_out(box)]
    )


def dimension_stats(
    records: Sequence[CuboidRecord], ids: dict[str, int], images: int, units: str
) -> dict[str, object]:
    """Counts, and mean and standard deviation (of a sample) of [W, H, L] a category, as priors of a trainer.

    Args:
        records: every box.
        ids: category ids by name.
        images: how many there are.
        units: of the lengths.

    Returns:
        What stats.json holds; a standard deviation is None where there is one box only.

    """
    rows = []
    for name, number in ids.items():
        sizes = np.array(
            [record.size for record in records if category_name(record.category) == name]
        )
        dimensions = OMNI3D.boxes_out(
            np.zeros_like(sizes), np.broadcast_to(np.eye(3), (len(sizes), 3, 3)), sizes
        )[2]
        spread = dimensions.std(axis=0, ddof=1).tolist() if len(sizes) > 1 else None
        rows.append(
            {
                "id": number,
                "name": name,
                "n_anns": len(sizes),
                "dimensions_mean": dimensions.mean(axis=0).tolist(),
                "dimensions_std": spread,
            }
        )
    priors = [[row["dimensions_mean"], row["dimensions_std"]] for row in rows]
    counts = {"n_datasets": 1, "n_ims": images, "n_anns": len(records), "units": units}
    return {
        **counts,
        "category_names": list(ids),
        "categories": rows,
        "priors_dims_per_cat": priors,
    }


def _pretty(content: dict[str, object]) -> bytes:
    return msgspec.json.format(msgspec.json.encode(content), indent=1)
