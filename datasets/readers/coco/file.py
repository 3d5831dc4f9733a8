"""A COCO keypoints file taken apart.

Which annotations belong to which image, and what its keypoint names are.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec

from animal3dbox.datasets.readers.elements import decoded
from animal3dbox.datasets.storage.json_files import decode_json
from animal3dbox.errors import ConfigError, DatasetFormatError, SampleError
from animal3dbox.smal.keypoints.vocabulary import Vocabulary
from animal3dbox.smal.keypoints.vocabulary_match import NameMatch, match_by_name


class _Category(msgspec.Struct):
    """A species, or whatever the dataset tells apart."""

    id: int | str
    name: str = "animal"
    keypoints: list[str] | None = None


class CocoFile(msgspec.Struct):
    """COCO's file, or AnimalPose's, whose images are a dictionary of id and name."""

    images: list[msgspec.Raw] | dict[str, str]
    annotations: list[msgspec.Raw]
    categories: list[_Category] = []


class _Named(msgspec.Struct):
    """What names an image, readable even where the rest is not."""

    file_name: str


class _Image(_Named):
    """An element of "images"."""

    id: int | str
    height: int | None = None
    width: int | None = None


class _Belongs(msgspec.Struct):
    """What names an annotation, readable even where the rest is not."""

    image_id: int | str
    id: int | str | None = None
    iscrowd: int | bool = 0


@dataclass(frozen=True)
class CocoImage:
    """One image and its annotations.

    Attributes:
        name: its file, as the dataset names it.
        image_hw: as the file says; None if it does not.
        annotations: place in the file and content, crowds left out.
    """

    name: str
    image_hw: tuple[int | None, int | None]
    annotations: list[tuple[int, msgspec.Raw]]


@dataclass(frozen=True)
class CocoParts:
    """A file taken apart.

    Attributes:
        images: in the file's order.
        faults: of images, and of annotations that belong to none.
        crowds: so many annotations are of groups.
        is_animalpose: whether images are a dictionary, as in AnimalPose's json.
    """

    images: tuple[CocoImage, ...]
    faults: tuple[SampleError, ...]
    crowds: int
    is_animalpose: bool


def read_coco_file(path: Path) -> CocoFile:
    """The file, its images and annotations undecoded; raises DatasetFormatError if it has none."""
    file: CocoFile = decode_json(path, CocoFile)
    if not file.annotations:
        raise DatasetFormatError(f"{path} has an empty list of annotations")
    return file


def take_apart(file: CocoFile) -> CocoParts:
    """Its annotations by image."""
    images, faults = _images(file.images)
    by_id = {key: image for key, image in images if image is not None}
    ambiguous = {key for key, image in images if image is None}
    crowds, seen, copies = 0, dict[str, int](), dict[bytes, int]()
    for i, raw in enumerate(file.annotations):
        try:
            belongs = decoded(raw, _Belongs, f"annotation {i}")
            name, key = f"annotation {i}", str(belongs.image_id)
            if key in ambiguous:
                raise SampleError(
                    name, "image_id", f"{key} is the id of several images: give each its own"
                )
            if key not in by_id:
                raise SampleError(name, "image_id", f"there is no usable image of the id {key}")
            name = f"{by_id[key].name} (annotation {i})"
            if belongs.id is not None and (first := seen.setdefault(str(belongs.id), i)) != i:
                raise SampleError(
                    name,
                    "id",
                    f"{belongs.id} is annotation {first} once more; remove one or give it its own"
                    " id, or it counts twice",
                )
            if belongs.iscrowd:
                crowds += 1
                continue
            if (first := copies.setdefault(_without_id(raw), i)) != i:
                raise SampleError(
                    name,
                    "entry",
                    f"is annotation {first} once more, but for the id; remove one, or it counts"
                    " twice",
                )
            by_id[key].annotations.append((i, raw))
        except SampleError as error:
            faults.append(error)
    return CocoParts(tuple(by_id.values()), tuple(faults), crowds, isinstance(file.images, dict))


def _without_id(raw: msgspec.Raw) -> bytes:
    """What an annotation says, whatever the order of its keys."""
    return msgspec.json.encode(
        {key: value for key, value in msgspec.json.decode(raw).items() if key != "id"},
        order="sorted",
    )


def _images(
    entries: Sequence[msgspec.Raw] | dict[str, str],
) -> tuple[list[tuple[str, CocoImage | None]], list[SampleError]]:
    """Id and image, None for an id that several have; and the faults."""
    if isinstance(entries, dict):
        return [(key, CocoImage(name, (None, None), [])) for key, name in entries.items()], []
    found: dict[str, CocoImage | None] = {}
    faults, names = [], Counter[str]()
    for i, raw in enumerate(entries):
        try:
            name = decoded(raw, _Named, f"image {i}").file_name
            image = decoded(raw, _Image, name)
            names[name] += 1
            key = str(image.id)
            if names[name] > 1:
                raise SampleError(
                    name,
                    "file_name",
                    f"is listed {names[name]} times, under other ids: keep one image for each file",
                )
            if key in found:
                found[key] = None
                raise SampleError(
                    name, "id", f"{key} is the id of another image, too: give each its own"
                )
            found[key] = CocoImage(name, (image.height, image.width), [])
        except SampleError as error:
            faults.append(error)
    return list(found.items()), faults


@dataclass(frozen=True)
class Species:
    """A category: its name, and what its keypoints are.

    Attributes:
        name: as the dataset calls it.
        keypoints: how many rows its annotations have.
        match: of its names with a vocabulary; None if there is none, which problem explains.
        problem: why.
    """

    name: str
    keypoints: int
    match: NameMatch | None
    problem: str = ""


def species_by_id(file: CocoFile, own: Vocabulary | None) -> dict[str, Species]:
    """Category id -> what it is.

    Args:
        file: with categories, which may have keypoint names each of their own.
        own: the user's vocabulary; also what a file without any names has, in this order.

    Raises:
        ConfigError: not one category has keypoints that are known.
        DatasetFormatError: two categories have one id.

    """
    found: dict[str, Species] = {}
    for category in file.categories:
        if str(category.id) in found:
            raise DatasetFormatError(
                f"the categories {found[str(category.id)].name} and {category.name} have one id,"
                f" {category.id}"
            )
        found[str(category.id)] = _species(category, own)
    if not any(species.match for species in found.values()):
        problems = list(dict.fromkeys(species.problem for species in found.values()))
        raise ConfigError(
            "no category has known keypoints:"
            f" {problems[0] if problems else 'the file has no categories'}"
        )
    return found


def _species(category: _Category, own: Vocabulary | None) -> Species:
    if not category.keypoints:
        if own is None:
            return Species(
                category.name,
                0,
                None,
                f"the category {category.name!r} has no keypoint names: give --vocabulary, in the"
                " file's order",
            )
        return Species(category.name, len(own), NameMatch(own, tuple(range(len(own))), ()))
    try:
        return Species(
            category.name, len(category.keypoints), match_by_name(category.keypoints, own)
        )
    except ConfigError as error:
        return Species(
            category.name, len(category.keypoints), None, f"category {category.name!r}: {error}"
        )
