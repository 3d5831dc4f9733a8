"""The Omni3D file that detections are for: its images and categories, by the ids they name."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from animal3dbox.datasets.readers.cuboid_checks import Metric
from animal3dbox.datasets.readers.cuboid_conventions import Convention
from animal3dbox.datasets.readers.omni3d.elements import category_names
from animal3dbox.datasets.readers.omni3d.head import stated_head
from animal3dbox.datasets.readers.omni3d.reader import images_by_id
from animal3dbox.datasets.readers.omni3d.schema import Key, RawOmni3DFile
from animal3dbox.datasets.records import CuboidImage
from animal3dbox.datasets.storage.json_files import decode_json
from animal3dbox.errors import DatasetFormatError, SampleError


@dataclass(frozen=True)
class Truth:
    """The images and categories that detections may name.

    Attributes:
        images: by id; None for images that are faulty themselves.
        categories: names by the file's ids.
        contiguous: names in the order of their contiguous ids, 0 1 2 ..., as trainers count them.
        convention: of the file's pixels.
        metric: whether its lengths are metres, which detections' then are too.
    """

    images: dict[Key, CuboidImage | None]
    categories: dict[Key, str]
    contiguous: tuple[str, ...]
    convention: Convention
    metric: bool

    @property
    def usable(self) -> tuple[CuboidImage, ...]:
        """The images that are not faulty, in the file's order."""
        return tuple(image for image in self.images.values() if image is not None)

    def image(self, key: Key, sample_id: str) -> CuboidImage:
        """The image of an id.

        Raises:
            SampleError: the truth has none, or a faulty one.

        """
        if key not in self.images:
            raise SampleError(
                sample_id,
                "image_id",
                f"{key} is not among the truth's images: give the file that was detected on",
            )
        image = self.images[key]
        if image is None:
            raise SampleError(sample_id, "image_id", f"{key} is faulty in the truth (see `check`)")
        return image

    def category(self, key: Key, ids: str, sample_id: str) -> str:
        """The name of a category by its number.

        Args:
            key: as the detection has it.
            ids: "dataset" or "contiguous".
            sample_id: named in the error.

        Raises:
            SampleError: the truth has no such category.

        """
        if ids == "dataset" and key in self.categories:
            return self.categories[key]
        if ids == "contiguous" and isinstance(key, int) and 0 <= key < len(self.contiguous):
            return self.contiguous[key]
        known = (
            f"the truth's ids ({_few(list(self.categories))})"
            if ids == "dataset"
            else f"the places 0 to {len(self.contiguous) - 1} of the truth's categories"
        )
        other = "contiguous" if ids == "dataset" else "dataset"
        raise SampleError(
            sample_id,
            "category_id",
            f"{key} is not among {known}: give the truth that was detected on, or say that ids are"
            f" the {other} ones (category_ids, --category-ids)",
        )


def read_truth(
    path: Path,
    images: Path | None = None,
    *,
    metric: Metric = "info",
    look_for_images: bool = True,
) -> Truth:
    """The images and categories of an Omni3D file; its boxes are not looked at.

    Contiguous ids are those of X_category_meta.json beside X.json, which trainers go by, or else
    the places of the file's ids in rising order.

    Args:
        path: the file.
        images: the folder that image paths are relative to; None: looked for.
        metric: whether its lengths are metres, as for read_omni3d.
        look_for_images: whether an image whose file is missing is a faulty one, likewise.

    Raises:
        DatasetNotFoundError: no such file.
        DatasetFormatError: not of the format, or its category_meta is damaged.

    """
    file: RawOmni3DFile = decode_json(path, RawOmni3DFile)
    head = stated_head(file.info)
    convention = head.convention()
    by_id, _, _ = images_by_id(
        file.images, path, images, convention, look_for_images=look_for_images
    )
    names, _ = category_names(file.categories)
    return Truth(
        images=by_id,
        categories=names,
        contiguous=_contiguous(path, names),
        convention=convention,
        metric=head.is_metric(None, metric),
    )


class _CategoryMeta(msgspec.Struct):
    """The part of X_category_meta.json that numbers categories."""

    thing_classes: list[str]


def _contiguous(path: Path, names: dict[Key, str]) -> tuple[str, ...]:
    """The names of categories in the order of their contiguous ids."""
    meta = path.with_name(f"{path.stem}_category_meta.json")
    if meta.is_file():
        content: _CategoryMeta = decode_json(meta, _CategoryMeta)
        return tuple(content.thing_classes)
    return tuple(names[key] for key in sorted(names, key=lambda key: (isinstance(key, str), key)))


def _few(values: Sequence[Any]) -> str:
    """The first values of many, as text."""
    text = ", ".join(map(str, values[:6]))
    return f"{text}, ..." if len(values) > 6 else text


def unique_image(images: Sequence[CuboidImage], name: str, path: Path) -> CuboidImage | None:
    """The one image of a name, which may be the end of its path; None if there is none.

    Raises:
        DatasetFormatError: several have it.

    """
    exact = [image for image in images if image.image_id == name]
    found = exact or [image for image in images if f"/{image.image_id}".endswith(f"/{name}")]
    if len(found) > 1:
        raise DatasetFormatError(
            f"{path}: {name} is the name of {len(found)} images of the truth"
            f" ({_few([image.image_id for image in found])}): give its folder too"
        )
    return found[0] if found else None


def numbered_images(images: Sequence[CuboidImage]) -> dict[int, CuboidImage] | None:
    """The images by the number at the end of their file's name.

    Returns:
        None if a name has no number, or two have the same.

    """
    numbers = [trailing_number(Path(image.image_id).stem) for image in images]
    if None in numbers or max(Counter(numbers).values(), default=1) > 1:
        return None
    return {
        number: image for number, image in zip(numbers, images, strict=True) if number is not None
    }


def trailing_number(stem: str) -> int | None:
    """The number at the end of a name, such as 12 of frame_0012; None without."""
    digits = stem[len(stem.rstrip("0123456789")) :]
    return int(digits) if digits else None
