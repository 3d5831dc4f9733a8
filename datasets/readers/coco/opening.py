"""A COCO file opened as a whole: what is clean read fast, the rest plainly, and both put together.

Elements that are clean by themselves (clean_elements.py) may be odd beside others: of one id, or
with the same keypoints. Every image with an odd element is read plainly, with all that it has, and
so the result is that of reading everything plainly.
"""

from dataclasses import dataclass

import msgspec
import numpy as np
from numpy.typing import NDArray

from animal3dbox.datasets.images.picture_folder import PictureFolder
from animal3dbox.datasets.readers.coco.animal import AnimalReading
from animal3dbox.datasets.readers.coco.clean_elements import (
    NO_ID,
    AnnotationScan,
    CleanAnnotations,
    CleanImages,
    Flags,
    Places,
    clean_images,
    id_number,
)
from animal3dbox.datasets.readers.coco.file import (
    AnnotationIds,
    CocoElements,
    CocoFile,
    ImageElement,
    ImageName,
)
from animal3dbox.datasets.readers.coco.plain import CocoCounts, PlainAnimals, read_plainly
from animal3dbox.datasets.readers.coco.repeated_animals import images_with_repetitions
from animal3dbox.datasets.readers.elements import decoded
from animal3dbox.datasets.storage.json_ranges import ElementRanges, element_ranges
from animal3dbox.errors import SampleError


@dataclass(frozen=True)
class CocoRanges:
    """Where the elements of a file lie in its bytes.

    Attributes:
        data: the bytes.
        images: the list of images, or AnimalPose's id -> name.
        annotations: the list of annotations.
    """

    data: bytes
    images: ElementRanges | dict[str, str]
    annotations: ElementRanges

    @classmethod
    def of(cls, data: bytes, file: CocoFile) -> "CocoRanges":
        """The ranges of a file that was decoded from its bytes."""
        images = file.images
        return cls(
            data,
            images if isinstance(images, dict) else element_ranges(data, images),
            element_ranges(data, file.annotations),
        )

    def elements(self, images: Flags | None, annotations: Flags | None) -> CocoElements:
        """Some images and annotations; None: all."""
        if isinstance(self.images, dict):
            return CocoElements(self.images, self._some(self.annotations, None), is_animalpose=True)
        return CocoElements(
            self._some(self.images, images), self._some(self.annotations, annotations)
        )

    def _some(self, ranges: ElementRanges, some: Flags | None) -> list[tuple[int, msgspec.Raw]]:
        places = range(len(ranges)) if some is None else np.nonzero(some)[0].tolist()
        return [(place, ranges.element(self.data, place)) for place in places]


@dataclass(frozen=True)
class OpenedCoco:
    """The animals of a file, by the places of their images and annotations in it.

    Attributes:
        image: (A,) of each animal, those of an image together, in the order of images.
        number: (A,) which of its image's annotations it is.
        annotation: (A,) the place of its annotation.
        without_box: (A,) whether the box that its annotation has is left out.
        names: place of an image -> its name, of those with animals, in order.
        image_hw: (M, 2) height and width of the same images.
        categories: names of those that animals have.
        with_place: how many animals' places the file says.
        counts: of all elements.
        plain: what was read plainly.
    """

    image: Places
    number: Places
    annotation: Places
    without_box: Flags
    names: dict[int, str]
    image_hw: NDArray[np.int32]
    categories: frozenset[str]
    with_place: int
    counts: CocoCounts
    plain: PlainAnimals


def opened_plainly(ranges: CocoRanges, reading: AnimalReading, read: frozenset[str]) -> OpenedCoco:
    """A file of which every element is read plainly; arguments as opened_coco has them."""
    plain = read_plainly(ranges.elements(None, None), reading, read)
    return _put_together(_NO_ANIMALS, plain)


def opened_coco(ranges: CocoRanges, reading: AnimalReading, read: frozenset[str]) -> OpenedCoco:
    """A file whose elements are decoded no further than needed.

    Args:
        ranges: where they lie.
        reading: how annotations are read.
        read: names of the categories that are.

    """
    if isinstance(ranges.images, dict):
        return opened_plainly(ranges, reading, read)
    images = _distinct_images(ranges.data, ranges.images, reading.pictures)
    scan = AnnotationScan(images, reading.species, read, reading.tolerance.visibility)
    annotations = scan.annotations(ranges.data, ranges.annotations)
    odd = _odd_images(ranges, images, annotations)
    is_plain = ~annotations.is_clean | odd[annotations.image]
    clean = np.nonzero(~is_plain & (annotations.category >= 0))[0]
    has_box = annotations.has_box[clean]
    may_be_corners = bool(annotations.has_possible_corners[clean][has_box].all())
    plain = read_plainly(
        ranges.elements(odd, is_plain), reading, read, others_may_be_corners=may_be_corners
    )
    if may_be_corners and has_box.any() and plain.has_evident_corners:
        # The boxes of the whole file are corners: hardly ever, and then each has a fault.
        return opened_plainly(ranges, reading, read)
    return _put_together(_clean_part(images, annotations, scan, odd=odd, clean=clean), plain)


def _distinct_images(data: bytes, ranges: ElementRanges, pictures: PictureFolder) -> CleanImages:
    """The images of a file, those not clean that share their name or id with another one."""
    images = clean_images(data, ranges, pictures)
    numbers, names = images.numbers.copy(), set[str]()
    for place in np.nonzero(numbers == NO_ID)[0].tolist():
        raw = ranges.element(data, place)
        names.add(getattr(_careful(raw, ImageName), "file_name", ""))
        numbers[place] = id_number(getattr(_careful(raw, ImageElement), "id", None))
    is_clean = images.is_clean & ~_is_shared(numbers)
    if names:
        is_clean &= np.fromiter((one not in names for one in images.names), np.bool_, len(is_clean))
    return CleanImages(images.names, numbers, images.image_hw, is_clean, images.has_place)


def _odd_images(ranges: CocoRanges, images: CleanImages, annotations: CleanAnnotations) -> Flags:
    """Whether each image has to be read plainly.

    Of annotations that are not clean, `image` and `number` are filled in, as far as they are known.
    """
    order = np.argsort(images.numbers, kind="stable")
    sorted_numbers = images.numbers[order]
    for place in np.nonzero(~annotations.is_clean)[0].tolist():
        ids = _careful(ranges.annotations.element(ranges.data, place), AnnotationIds)
        if isinstance(ids, AnnotationIds):
            number = id_number(ids.image_id)
            at = min(int(sorted_numbers.searchsorted(number)), len(order) - 1)
            if at >= 0 and sorted_numbers[at] == number:
                annotations.image[place] = order[at]
            annotations.number[place] = id_number(ids.id)
    odd = ~images.is_clean
    is_odd = ~annotations.is_clean | annotations.has_evident_corners
    is_odd |= _is_shared(annotations.number)
    concerned = annotations.image[is_odd]
    odd[concerned[concerned >= 0]] = True
    odd[images_with_repetitions(annotations)] = True
    return odd


def _is_shared(numbers: Places) -> Flags:
    """Whether each number of an id is another one's, too."""
    values, counts = np.unique(numbers[numbers != NO_ID], return_counts=True)
    twice = values[counts > 1]
    return np.isin(numbers, twice) if len(twice) else np.zeros(len(numbers), np.bool_)


def _careful(raw: msgspec.Raw, kind: type[msgspec.Struct]) -> msgspec.Struct | None:
    """An element in a form that admits more than the clean one; None if it has not even that."""
    try:
        return decoded(raw, kind, "")
    except SampleError:
        return None


@dataclass(frozen=True)
class _CleanPart:
    """The animals of the images that have nothing odd; fields as in OpenedCoco."""

    image: Places
    number: Places
    annotation: Places
    names: list[str]
    image_hw: NDArray[np.int32]
    categories: frozenset[str]
    with_place: int
    counts: CocoCounts


_NO_PLACES = np.zeros(0, dtype=np.int64)
_NO_ANIMALS = _CleanPart(
    *(_NO_PLACES, _NO_PLACES, _NO_PLACES),
    names=[],
    image_hw=np.zeros((0, 2), np.int32),
    categories=frozenset(),
    with_place=0,
    counts=CocoCounts(),
)


def _clean_part(
    images: CleanImages,
    annotations: CleanAnnotations,
    scan: AnnotationScan,
    *,
    odd: Flags,
    clean: Places,
) -> _CleanPart:
    """The clean animals with their numbers among all annotations of their images, and counts."""
    members = np.nonzero(annotations.is_clean & ~odd[annotations.image])[0]
    in_order = members[np.argsort(annotations.image[members], kind="stable")]
    image = annotations.image[in_order]
    begins = np.nonzero(np.diff(image, prepend=-1))[0]
    number = np.zeros(len(annotations.image), dtype=np.int64)
    number[in_order] = np.arange(len(image)) - np.repeat(begins, np.diff(begins, append=len(image)))
    counts = CocoCounts(
        images=int((~odd).sum()),
        bare=int((~odd).sum()) - len(begins),
        animals=len(clean),
        empty=int(annotations.is_empty[clean].sum()),
        miscounted=int(annotations.is_miscounted[clean].sum()),
        graded=int(annotations.is_graded[clean].sum()),
    )
    for name, places in annotations.left_out.items():
        counts.left_out[name] += int((~odd[annotations.image[places]]).sum())
    return _CleanPart(
        image=annotations.image[clean],
        number=number[clean],
        annotation=clean,
        names=images.names,
        image_hw=images.image_hw,
        categories=frozenset(
            scan.kinds[k].name for k in np.unique(annotations.category[clean]).tolist()
        ),
        with_place=int(annotations.has_place[clean].sum()),
        counts=counts,
    )


def _put_together(clean: _CleanPart, plain: PlainAnimals) -> OpenedCoco:
    """The animals of both parts in the order of their images."""
    animals = plain.animals
    columns = np.array(
        [(one.image, one.number, one.annotation, one.without_box) for one in animals],
        dtype=np.int64,
    ).reshape(len(animals), 4)
    image = np.concatenate((clean.image, columns[:, 0]))
    number = np.concatenate((clean.number, columns[:, 1]))
    order = np.lexsort((number, image))
    without_box = np.zeros(len(image), np.bool_)
    without_box[len(clean.image) :] = columns[:, 3]
    plain_image = {one.image: one.record for one in animals}
    places = np.unique(image).tolist()
    counts = CocoCounts()
    for part in (clean.counts, plain.counts):
        counts.add(part)
    return OpenedCoco(
        image=image[order],
        number=number[order],
        annotation=np.concatenate((clean.annotation, columns[:, 2]))[order],
        without_box=without_box[order],
        names={
            place: plain_image[place].image_id if place in plain_image else clean.names[place]
            for place in places
        },
        image_hw=np.array(
            [
                plain_image[place].image_hw if place in plain_image else clean.image_hw[place]
                for place in places
            ],
            dtype=np.int32,
        ).reshape(len(places), 2),
        categories=clean.categories | {one.record.category for one in animals},
        with_place=clean.with_place + sum(one.record.sighting.place is not None for one in animals),
        counts=counts,
        plain=plain,
    )
