"""What is read of samples' files before their animals are labelled."""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple, TypeVar

from animal3dbox.datasets.images.photos import Photo
from animal3dbox.datasets.labelling.label_store import Asked, RowMaker
from animal3dbox.datasets.labelling.sources import ImageSample, SampleSource
from animal3dbox.errors import SampleError

T = TypeVar("T")


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


def opened_samples(
    source: SampleSource, places: Sequence[int], numbers: Mapping[str, int], rows: RowMaker
) -> list[OpenedSample | SampleError]:
    """Samples with their images and masks, in order, and the errors of those that cannot be read.

    Step by step for all of them: the small steps cost less in a row than between decodings, which
    fill the processor's caches.

    Args:
        source: of the samples.
        places: in the source.
        numbers: of the classes that animals may be of.
        rows: will be asked for the animals' rows.

    """
    samples = [_tried(source.sample, place) for place in places]
    photos = [
        sample if isinstance(sample, SampleError) else _tried(source.photo, sample)
        for sample in samples
    ]
    opened: list[OpenedSample | SampleError] = []
    for sample, photo in zip(samples, photos, strict=True):
        if isinstance(photo, SampleError):
            opened.append(photo)
        elif not isinstance(sample, SampleError):
            opened.append(OpenedSample(sample, photo, _animals(sample, photo, numbers, rows)))
    return [
        (
            one
            if isinstance(one, SampleError)
            else one._replace(asked=tuple([_with_mask(animal) for animal in one.asked]))
        )
        for one in opened
    ]


def _tried(read: Callable[..., T], *arguments: object) -> T | SampleError:
    try:
        return read(*arguments)
    except SampleError as error:
        return error


def _animals(
    sample: ImageSample, photo: Photo, numbers: Mapping[str, int], rows: RowMaker
) -> tuple[Asked | SampleError, ...]:
    """A sample's animals before their masks are decoded, and what is wrong with others."""
    found: list[Asked | SampleError] = []
    for animal, head in enumerate(sample.animals):
        if head.category in numbers:
            found.append(_tried(rows.asked, sample, animal, photo.facts))
        else:
            found.append(
                SampleError(
                    head.sample_id,
                    "category",
                    f"{head.category!r} is none of the classes {', '.join([*numbers][:20])}",
                )
            )
    return tuple(found)


def _with_mask(asked: Asked | SampleError) -> Asked | SampleError:
    if isinstance(asked, SampleError):
        return asked
    try:
        return asked._replace(mask=asked.sample.mask(asked.animal))
    except SampleError as error:
        return error
