"""What is read of a sample's files before its animals are labelled."""

from collections.abc import Mapping
from typing import NamedTuple

from animal3dbox.datasets.images import Photo
from animal3dbox.datasets.row_maker import Asked, RowMaker
from animal3dbox.datasets.sources import ImageSample, SampleSource
from animal3dbox.errors import SampleError


class OpenedSample(NamedTuple):
    """An image with what is annotated in it.

    Attributes:
        sample: its annotations.
        photo: its picture, decoded.
        asked: its animals with their masks, and what is wrong with those that cannot be labelled.
    """

    sample: ImageSample
    photo: Photo
    asked: tuple[Asked | SampleError, ...]


def opened_sample(source: SampleSource, place: int, numbers: Mapping[str, int], rows: RowMaker) -> OpenedSample:
    """Read a sample's image and masks; raises SampleError if the image cannot be read.

    Args:
        source: of the sample.
        place: in the source.
        numbers: of the classes that animals may be of.
        rows: will be asked for the animals' rows.

    """
    sample = source.sample(place)
    photo = source.photo(sample)
    return OpenedSample(sample, photo, tuple([_asked(sample, animal, photo, numbers, rows) for animal in range(len(sample.animals))]))


def _asked(sample: ImageSample, animal: int, photo: Photo, numbers: Mapping[str, int], rows: RowMaker) -> Asked | SampleError:
    """An animal with its mask, or what is wrong with it."""
    head = sample.animals[animal]
    if head.category not in numbers:
        return SampleError(head.sample_id, "category", f"{head.category!r} is none of the classes {', '.join([*numbers][:20])}")
    try:
        return rows.asked(sample, animal, photo.facts)._replace(mask=sample.mask(animal))
    except SampleError as error:
        return error
