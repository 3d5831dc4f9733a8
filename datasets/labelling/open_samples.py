"""What is read of samples' files before their animals are labelled."""

from collections.abc import Callable, Mapping, Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from animal3dbox.datasets.images.exif import PhotoFacts
from animal3dbox.datasets.images.photos import Photo
from animal3dbox.datasets.labelling.image_samples import ImageSample, SampleSource
from animal3dbox.datasets.labelling.label_requests import LabelRequest
from animal3dbox.datasets.labelling.label_store import LabelStore
from animal3dbox.datasets.labelling.sample_checks import with_decoded_mask
from animal3dbox.errors import SampleError

T = TypeVar("T")
RequestOrError = LabelRequest | SampleError
OpenSample = tuple[ImageSample, Photo, list[RequestOrError]]
"""An image's annotations, its picture, decoded, and the requests for its animals' labels, or what
is wrong with those that cannot be labelled."""


def open_samples(
    source: SampleSource,
    places: Sequence[int],
    *,
    classes: Mapping[str, int],
    store: LabelStore,
    masks: bool,
) -> list[OpenSample | SampleError]:
    """Samples with their pictures and masks, in order, and the errors of those that are unreadable.

    Step by step for all of them: the small steps cost less in a row than between decodings, which
    fill the processor's caches (benchmarks/loader.py, "cached labels").

    Args:
        source: of the samples.
        places: in the source.
        classes: the categories that animals may be of.
        store: will be asked for the animals' labels.
        masks: whether targets hold masks, so that all are decoded here; else only those are, later,
            of which a label has to be made.

    """
    samples = [_attempt(source.sample, place) for place in places]
    photos = [
        sample if isinstance(sample, SampleError) else _attempt(source.photo, sample)
        for sample in samples
    ]
    opened: list[OpenSample | SampleError] = []
    for sample, photo in zip(samples, photos, strict=True):
        if isinstance(photo, SampleError):
            opened.append(photo)
        elif not isinstance(sample, SampleError):
            requests = requests_of_sample(sample, photo.facts, classes, store)
            opened.append((sample, photo, requests))
    if not masks:
        return opened
    return [
        one
        if isinstance(one, SampleError)
        else (one[0], one[1], [_with_mask(request, store) for request in one[2]])
        for one in opened
    ]


def mask_of(request: RequestOrError) -> NDArray[np.bool_] | None:
    """The mask (H, W) of a request; None without."""
    return None if isinstance(request, SampleError) else request.mask


def _attempt(read: Callable[..., T], *arguments: object) -> T | SampleError:
    """The result of a call, or the SampleError that it raises."""
    try:
        return read(*arguments)
    except SampleError as error:
        return error


def requests_of_sample(
    sample: ImageSample, facts: PhotoFacts, classes: Mapping[str, int], store: LabelStore
) -> list[RequestOrError]:
    """The requests for the labels of a sample's animals, their masks not decoded yet.

    Args:
        sample: the image.
        facts: of its picture's header.
        classes: the categories that animals may be of.
        store: will be asked for the labels.

    """
    requests: list[RequestOrError] = []
    for place, entry in enumerate(sample.animals):
        if entry.category in classes:
            requests.append(_attempt(store.request, sample, place, facts))
        else:
            known = ", ".join([*classes][:20])
            problem = f"{entry.category!r} is none of the classes {known}"
            requests.append(SampleError(entry.sample_id, "category", problem))
    return requests


def _with_mask(request: RequestOrError, store: LabelStore) -> RequestOrError:
    """A request whose mask has been decoded, or is left out, or why it cannot be decoded."""
    if isinstance(request, SampleError):
        return request
    return _attempt(with_decoded_mask, request, store.optional)
