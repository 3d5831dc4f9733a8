"""Batches of images with different numbers of animals."""

import math
from collections.abc import Iterable, Sequence
from functools import lru_cache
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.utils.data import get_worker_info

from animal3dbox.datasets.labelling.skipped import Skipped, Target
from animal3dbox.errors import SampleError

BY_VALUE_BYTES = 1 << 16
"""Tensors up to this size travel from a worker inside the message.

A larger one gets shared memory, and a file descriptor, of its own.
"""
ALIGNMENT = 8
_PADDING = tuple(bytes(-size % ALIGNMENT) for size in range(ALIGNMENT))
_Layout = tuple[tuple[str, str, tuple[int, ...]], ...]
"""The fields of a target: name, code of the type and shape of those whose numbers travel together.

No type of the others.
"""


class Targets(list[Target]):
    """The targets of a batch, in order, and what was left out of it.

    A plain list of dicts that crosses processes cheaply: of twenty small tensors an image, each
    would cost a file descriptor.

    Attributes:
        skipped: samples that cannot be used; their reasons are in the Dataset's report().
    """

    def __init__(self, targets: Iterable[Target] = (), skipped: Sequence[Skipped] = ()) -> None:
        super().__init__(targets)
        self.skipped = tuple(skipped)

    def __reduce__(self) -> tuple[Any, ...]:
        numbers: list[bytes] = []
        layouts: dict[_Layout, _Layout] = {}
        told = [_sent(target, numbers, layouts) for target in self]
        return _received, (told, bytearray(b"".join(numbers)), self.skipped)


def collate(samples: Sequence[tuple[Tensor, Target] | Skipped]) -> tuple[list[Tensor], Targets]:
    """A batch for a DataLoader's collate_fn: images of any size in a list, and their targets.

    Args:
        samples: of a LabelDataset.

    Returns:
        images: B tensors (3, H, W); samples that were skipped are left out, so B may be smaller
            than the batch size, or 0.
        targets: B dicts; ``targets.skipped`` says what was left out.

    """
    used = [sample for sample in samples if not isinstance(sample, Skipped)]
    return [image for image, _ in used], Targets(
        (target for _, target in used),
        [sample for sample in samples if isinstance(sample, Skipped)],
    )


def collate_stacked(samples: Sequence[tuple[Tensor, Target] | Skipped]) -> tuple[Tensor, Targets]:
    """The same with the images stacked.

    Returns:
        images: (B, C, H, W); (0,) if every sample was skipped.
        targets: see collate.

    Raises:
        SampleError: two images differ in size.

    """
    images, targets = collate(samples)
    for image, target in zip(images, targets, strict=True):
        if image.shape != images[0].shape:
            problem = (
                f"is {tuple(image.shape)}, but the batch begins with {tuple(images[0].shape)}: give"
                " a transform that resizes, or use collate"
            )
            error = SampleError(str(target.get("image_id")), "image", problem)
            if get_worker_info() is not None:
                error.note_for_parent()
            raise error
    return (torch.stack(images) if images else torch.zeros(0)), targets


def _sent(
    target: Target, numbers: list[bytes], layouts: dict[_Layout, _Layout]
) -> tuple[_Layout, list[Any]]:
    """A target's layout, the same object for all targets of one, and what travels as it is.

    The bytes of small tensors are added to numbers.
    """
    layout: list[tuple[str, str, tuple[int, ...]]] = []
    others = []
    for name, value in target.items():
        try:
            array = (
                value.numpy() if type(value) is Tensor else None
            )  # others, as torchvision's, stay what they are
        except (TypeError, RuntimeError):  # bfloat16, sparse or on a device; with a gradient
            array = None
        if array is None or array.nbytes > BY_VALUE_BYTES:
            layout.append((name, "", ()))
            others.append(value)
        else:
            layout.append((name, array.dtype.char, array.shape))
            numbers += (array.tobytes(), _PADDING[array.nbytes % ALIGNMENT])
    known = tuple(layout)
    return layouts.setdefault(known, known), others


@lru_cache(maxsize=256)
def _places(
    layout: _Layout,
) -> tuple[list[tuple[str, np.dtype[Any] | None, tuple[int, ...], int]], int]:
    """Name, type, shape and offset of a target's fields, and the bytes that all take."""
    places: list[tuple[str, np.dtype[Any] | None, tuple[int, ...], int]] = []
    at = 0
    for name, code, shape in layout:
        dtype = np.dtype(code) if code else None
        places.append((name, dtype, shape, at))
        if dtype is not None:
            size = math.prod(shape) * dtype.itemsize
            at += size + -size % ALIGNMENT
    return places, at


def _received(
    told: list[tuple[_Layout, list[Any]]], content: bytearray, skipped: tuple[Skipped, ...]
) -> Targets:
    targets = Targets(skipped=skipped)
    begin = 0
    for layout, others in told:
        places, size = _places(layout)
        left = iter(others)
        target: Target = {}
        for name, dtype, shape, at in places:
            target[name] = (
                next(left)
                if dtype is None
                else torch.from_numpy(np.ndarray(shape, dtype, content, begin + at))
            )
        targets.append(target)
        begin += size
    return targets
