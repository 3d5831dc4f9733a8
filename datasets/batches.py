"""Batches of images with different numbers of animals."""

import math
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor
from torch.utils.data import get_worker_info

from animal3dbox.datasets.label_dataset import Skipped, Target
from animal3dbox.errors import SampleError

BY_VALUE_BYTES = 1 << 16
"""Tensors up to this size travel from a worker inside the message; a larger one gets shared memory, and a file descriptor, of its own."""
ALIGNMENT = 8


IN_NUMPY = frozenset((
    torch.bool, torch.uint8, torch.int8, torch.int16, torch.int32, torch.int64, torch.float16, torch.float32, torch.float64,
))  # fmt: skip
"""Types that tensors and arrays share."""


class Targets(list[Target]):
    """The targets of a batch, in order, and what was left out of it.

    A plain list of dicts that crosses processes cheaply: of twenty small tensors an image, each would cost a file descriptor.

    Attributes:
        skipped: samples that cannot be used; their reasons are in the Dataset's report().
    """

    def __init__(self, targets: Iterable[Target] = (), skipped: Sequence[Skipped] = ()) -> None:
        super().__init__(targets)
        self.skipped = tuple(skipped)

    def __reduce__(self) -> tuple[Any, ...]:
        content = bytearray()
        told = [{name: _sent(value, content) for name, value in target.items()} for target in self]
        return _received, (told, bytes(content), self.skipped)


def collate(samples: Sequence[tuple[Tensor, Target] | Skipped]) -> tuple[list[Tensor], Targets]:
    """A batch for a DataLoader's collate_fn: images of any size in a list, and their targets.

    Args:
        samples: of a LabelDataset.

    Returns:
        images: B tensors (3, H, W); samples that were skipped are left out, so B may be smaller than the batch size, or 0.
        targets: B dicts; ``targets.skipped`` says what was left out.

    """
    used = [sample for sample in samples if not isinstance(sample, Skipped)]
    return [image for image, _ in used], Targets((target for _, target in used), [sample for sample in samples if isinstance(sample, Skipped)])


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
            problem = f"is {tuple(image.shape)}, but the batch begins with {tuple(images[0].shape)}: give a transform that resizes, or use collate"
            error = SampleError(str(target.get("image_id")), "image", problem)
            if get_worker_info() is not None:
                error.note_for_parent()
            raise error
    return (torch.stack(images) if images else torch.zeros(0)), targets


class _Piece(NamedTuple):
    """Where a tensor stands in a batch's bytes."""

    dtype: str
    shape: tuple[int, ...]
    offset: int


def _sent(value: Any, content: bytearray) -> Any:
    """A small tensor's place in the content, to which it is added; any other value as it is."""
    plain = type(value) is Tensor and value.layout is torch.strided and value.dtype in IN_NUMPY  # others, as torchvision's, stay what they are
    if not plain or value.nbytes > BY_VALUE_BYTES or value.device.type != "cpu" or value.requires_grad:
        return value
    array = value.numpy()
    content.extend(bytes(-len(content) % ALIGNMENT))
    offset = len(content)
    content.extend(array.tobytes())
    return _Piece(array.dtype.str, array.shape, offset)


def _received(told: list[dict[str, Any]], content: bytes, skipped: tuple[Skipped, ...]) -> Targets:
    held = bytearray(content)  # writable, as tensors' memory must be

    def opened(value: Any) -> Any:
        if not isinstance(value, _Piece):
            return value
        count = math.prod(value.shape)
        if count == 0:
            return torch.from_numpy(np.zeros(value.shape, dtype=value.dtype))
        return torch.from_numpy(np.frombuffer(held, dtype=value.dtype, count=count, offset=value.offset).reshape(value.shape))

    return Targets(({name: opened(value) for name, value in target.items()} for target in told), skipped)
