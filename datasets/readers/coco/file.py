"""A COCO keypoints file taken apart: the annotations of each image, the keypoints of each species.

Images or annotations that cannot be told apart are faults here, before any record is made.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec

from animal3dbox.datasets.readers.elements import decoded
from animal3dbox.datasets.sightings import NO_SIGHTING, Sighting, SightingKeys, sighting_of
from animal3dbox.datasets.storage.json_files import decode_json_bytes
from animal3dbox.errors import ConfigError, DatasetFormatError, SampleError
from animal3dbox.smal.keypoints.vocabulary import Vocabulary
from animal3dbox.smal.keypoints.vocabulary_match import NameMatch, is_misspelt, match_by_name


class Category(msgspec.Struct):
    """One element of "categories": a species, or whatever else the dataset distinguishes."""

    id: int | str | float
    name: str = "animal"
    keypoints: list[str] | None = None


class CocoFile(msgspec.Struct):
    """COCO's file, or AnimalPose's, whose images are a dictionary of id and name.

    Images and annotations are still undecoded, so that one bad element spoils no other.
    """

    images: list[msgspec.Raw] | dict[str, str]
    annotations: list[msgspec.Raw]
    categories: list[Category] = []


@dataclass(frozen=True)
class CocoElements:
    """Some images and annotations of a COCO file, undecoded, each with its place in its list.

    Attributes:
        images: place and content, or AnimalPose's id -> name.
        annotations: place and content.
        is_animalpose: whether images are a dictionary, as in AnimalPose's json.
    """

    images: Sequence[tuple[int, msgspec.Raw]] | dict[str, str]
    annotations: Sequence[tuple[int, msgspec.Raw]]
    is_animalpose: bool = False


class ImageName(SightingKeys):
    """The part of an image's element that names it, readable even where the rest is not."""

    file_name: str


class ImageElement(ImageName):
    """One element of "images", by the keys that we use."""

    id: int | str
    height: int | None = None
    width: int | None = None


class AnnotationIds(msgspec.Struct):
    """The ids of an annotation and of its image, readable even where the rest is not."""

    image_id: int | str
    id: int | str | None = None
    iscrowd: int | bool | None = 0


@dataclass(frozen=True)
class CocoImage:
    """One image of a file with the annotations that belong to it.

    Attributes:
        place: in the file's list of images.
        name: the image's file, as the dataset names it.
        image_hw: height and width, each None if the file does not say it.
        annotations: place in the file and content of each annotation, without crowds.
        sighting: when, where and of whom it is, as the file says.
    """

    place: int
    name: str
    image_hw: tuple[int | None, int | None]
    annotations: list[tuple[int, msgspec.Raw]]
    sighting: Sighting = NO_SIGHTING


@dataclass(frozen=True)
class CocoParts:
    """A COCO file as images with their annotations.

    Attributes:
        images: the usable images in the file's order.
        faults: one error an unusable image, or annotation that belongs to no image.
        crowds: number of annotations of groups, which are left out.
    """

    images: tuple[CocoImage, ...]
    faults: tuple[SampleError, ...]
    crowds: int


def coco_file(data: bytes, path: Path) -> CocoFile:
    """The content of a COCO file; raises DatasetFormatError if it has no annotation.

    Args:
        data: its bytes, which images and annotations stay in.
        path: named in errors.

    """
    file: CocoFile = decode_json_bytes(data, CocoFile, path)
    if not file.annotations:
        raise DatasetFormatError(f"{path} has an empty list of annotations")
    return file


def take_apart(elements: CocoElements) -> CocoParts:
    """The annotations of a file by image, and an error for each that belongs to none."""
    images, faults = _images(elements.images)
    by_id = {key: image for key, image in images if image is not None}
    ambiguous = {key for key, image in images if image is None}
    crowds, first_of_id, copies = 0, dict[str, int](), dict[bytes, int]()
    for i, raw in elements.annotations:
        try:
            ids = decoded(raw, AnnotationIds, f"annotation {i}")
            name, key = f"annotation {i}", str(ids.image_id)
            if key in ambiguous:
                raise SampleError(
                    name, "image_id", f"{key} is the id of several images: give each its own"
                )
            if key not in by_id:
                raise SampleError(name, "image_id", f"there is no usable image of the id {key}")
            name = f"{by_id[key].name} (annotation {i})"
            if ids.id is not None and (first := first_of_id.setdefault(str(ids.id), i)) != i:
                raise SampleError(
                    name,
                    "id",
                    f"{ids.id} is annotation {first} once more; remove one or give it its own"
                    " id, or it counts twice",
                )
            if ids.iscrowd:
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
    return CocoParts(tuple(by_id.values()), tuple(faults), crowds)


def _without_id(raw: msgspec.Raw) -> bytes:
    """The content of an annotation but for its id, the same whatever the order of its keys."""
    try:
        content = msgspec.json.decode(raw)
    except msgspec.ValidationError:  # it has a number that is too large for any type
        content = msgspec.json.decode(raw, type=dict[str, msgspec.Raw])
    return msgspec.json.encode(
        {key: value for key, value in content.items() if key != "id"}, order="sorted"
    )


def _images(
    entries: Sequence[tuple[int, msgspec.Raw]] | dict[str, str],
) -> tuple[list[tuple[str, CocoImage | None]], list[SampleError]]:
    """Ids and images, None for an id that several images have; and an error a faulty image."""
    if isinstance(entries, dict):
        pairs = enumerate(entries.items())
        return [(key, CocoImage(i, name, (None, None), [])) for i, (key, name) in pairs], []
    by_id: dict[str, CocoImage | None] = {}
    faults, names = [], Counter[str]()
    for i, raw in entries:
        try:
            name = decoded(raw, ImageName, f"image {i}").file_name
            if not name.strip():
                raise SampleError(f"image {i}", "file_name", f"is {name!r}, which names no file")
            image = decoded(raw, ImageElement, name)
            names[name] += 1
            key = str(image.id)
            if names[name] > 1:
                raise SampleError(
                    name,
                    "file_name",
                    f"is listed {names[name]} times, under other ids: keep one image for each file",
                )
            if key in by_id:
                by_id[key] = None
                raise SampleError(
                    name, "id", f"{key} is the id of another image, too: give each its own"
                )
            by_id[key] = CocoImage(i, name, (image.height, image.width), [], sighting_of(image))
        except SampleError as error:
            faults.append(error)
    return list(by_id.items()), faults


@dataclass(frozen=True)
class Species:
    """A category with its keypoints, matched with a vocabulary.

    Attributes:
        name: the category, as the dataset calls it.
        keypoints: number of keypoints that its annotations have.
        match: its keypoints' names matched with a vocabulary; None if no vocabulary has them.
        problem: why there is no match; "" with one.
        misspelt: whether the names are an animal's but for slips.
    """

    name: str
    keypoints: int
    match: NameMatch | None
    problem: str = ""
    misspelt: bool = False


def species_by_id(categories: Sequence[Category], own: Vocabulary | None) -> dict[str, Species]:
    """Category id -> species, for all categories of a file.

    Args:
        categories: of a file, each of which may name keypoints of its own.
        own: the user's vocabulary, which a file without names is taken to have in this order;
            None: the one that the names fit.

    Raises:
        ConfigError: not one category has keypoints that are known.
        DatasetFormatError: two categories have one id.

    """
    by_id: dict[str, Species] = {}
    for category in categories:
        key = _key(category.id)
        if key in by_id:
            raise DatasetFormatError(
                f"the categories {by_id[key].name} and {category.name} have one id, {key}"
            )
        by_id[key] = _species(category, own)
    if not any(species.match for species in by_id.values()):
        problems = list(dict.fromkeys(species.problem for species in by_id.values()))
        raise ConfigError(
            "no category has known keypoints:"
            f" {problems[0] if problems else 'the file has no categories'}"
        )
    return by_id


def wanted_species(species: dict[str, Species], categories: Sequence[str]) -> frozenset[str]:
    """The names of the categories that are read.

    Args:
        species: all of a file.
        categories: names, in any letter case; none: all with an animal's keypoints, misspelt ones
            too, so that their animals are errors.

    Raises:
        ConfigError: the file has no such category.

    """
    if not categories:
        animals = (one for one in species.values() if one.match is not None or one.misspelt)
        return frozenset(kind.name for kind in animals)
    names = {kind.name.casefold(): kind.name for kind in species.values()}
    if unknown := [name for name in categories if name.casefold() not in names]:
        raise ConfigError(
            f"categories must be of {', '.join(names.values())}, got {', '.join(unknown)}"
        )
    return frozenset(names[name.casefold()] for name in categories)


def _key(number: int | str | float) -> str:
    """An id as it is compared: 1, 1.0 and "1" are one."""
    is_whole = isinstance(number, float) and number.is_integer()
    return str(int(number) if is_whole else number)


def _species(category: Category, own: Vocabulary | None) -> Species:
    """The species of one category; see species_by_id."""
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
        names = category.keypoints
        problem = f"category {category.name!r}: {error}"
        return Species(category.name, len(names), None, problem, is_misspelt(names))
