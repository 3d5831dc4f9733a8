"""Batches of images with different numbers of animals."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

from animal3dbox.datasets.label_dataset import Skipped, Target
from animal3dbox.errors import SampleError

BY_VALUE_BYTES = 1 << 16
"""Tensors up to this size travel from a worker inside the message; a larger one gets shared memory, and a file descriptor, of its own."""


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
        return _received, ([{name: _sent(value) for name, value in target.items()} for target in self], self.skipped)


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
            raise SampleError(str(target.get("image_id")), "image", problem)
    return (torch.stack(images) if images else torch.zeros(0)), targets


def _sent(value: Any) -> Any:
    """A small tensor as an array, which pickles by value."""
    small = isinstance(value, Tensor) and value.nbytes <= BY_VALUE_BYTES and value.device.type == "cpu" and not value.requires_grad
    return _Array(value.numpy()) if small else value


class _Array:
    """An array that was a tensor."""

    __slots__ = ("array",)

    def __init__(self, array: np.ndarray) -> None:
        self.array = array

    def __reduce__(self) -> tuple[Any, ...]:
        return _Array, (self.array,)


def _received(targets: list[dict[str, Any]], skipped: tuple[Skipped, ...]) -> Targets:
    return Targets(({name: torch.from_numpy(v.array) if isinstance(v, _Array) else v for name, v in target.items()} for target in targets), skipped)
