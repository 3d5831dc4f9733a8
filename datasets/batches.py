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
from animal3dbox.errors import ConfigError, SampleError

BY_VALUE_BYTES = 1 << 16
"""Tensors up to this size travel from a worker inside the message.

A larger one gets shared memory, and a file descriptor, of its own.
"""
ALIGNMENT = 8
_PADDING = tuple(bytes(-size % ALIGNMENT) for size in range(ALIGNMENT))
Layout = tuple[tuple[str, str, tuple[int, ...]], ...]
"""The fields of a target: name, code of the type, and shape; the code is empty of those that travel
by themselves, not in the block of numbers."""


class Targets(list[Target]):
    """The targets of a batch, in order, and what was left out of it.

    A plain list of dicts that crosses processes cheaply: of twenty small tensors an image, each
    would cost a file descriptor.

    Attributes:
        skipped: samples that cannot be used; their reasons are in the Dataset's report().

    Example:
        >>> batch = Targets([{"size": torch.ones(1, 3), "image_id": "a.jpg"}])
        >>> moved = batch.to("meta", torch.float64)
        >>> moved[0]["size"].device.type, moved[0]["size"].dtype, moved[0]["image_id"]
        ('meta', torch.float64, 'a.jpg')
    """

    def __init__(self, targets: Iterable[Target] = (), skipped: Sequence[Skipped] = ()) -> None:
        super().__init__(targets)
        self.skipped = tuple(skipped)

    def to(
        self,
        device: torch.device | str | int | torch.dtype | None = None,
        dtype: torch.dtype | None = None,
        *,
        non_blocking: bool = False,
    ) -> "Targets":
        """The same targets with every tensor on a device; all that is no tensor stays as it is.

        Args:
            device: where to; None: where each tensor is. A type alone may stand here, as in
                torch's ``to(torch.float16)``.
            dtype: of the tensors of floating point, such as torch.float64; whole numbers, flags and
                masks keep theirs. None: as they are.
            non_blocking: see torch.Tensor.to; it helps from pinned memory.

        Returns:
            A new batch; this one is left as it is. A tensor that is there already is shared.

        Raises:
            ConfigError: dtype is given twice, or is no type of floating point.

        """
        if isinstance(device, torch.dtype):
            if dtype is not None:
                raise ConfigError(f"dtype is given twice, as {device} and {dtype}: give one")
            device, dtype = None, device
        if dtype is not None and not dtype.is_floating_point:
            raise ConfigError(
                f"dtype must be of floating point, as torch.float16, got {dtype}: lengths, cameras"
                " and rotations would be cut to whole numbers"
            )
        to_device = device

        def moved(value: Any) -> Any:
            if isinstance(value, Tensor):
                kind = dtype if value.is_floating_point() else None
                return value.to(device=to_device, dtype=kind, non_blocking=non_blocking)
            if isinstance(value, dict):
                return {name: moved(one) for name, one in value.items()}
            return [moved(one) for one in value] if type(value) is list else value

        return Targets(map(moved, self), self.skipped)

    def __reduce__(self) -> tuple[Any, ...]:
        numbers: list[bytes] = []
        layouts: dict[Layout, Layout] = {}
        targets = [_serialise(target, numbers, layouts) for target in self]
        return _deserialise, (targets, bytearray(b"".join(numbers)), self.skipped)


def collate(samples: Sequence[tuple[Tensor, Target] | Skipped]) -> tuple[list[Tensor], Targets]:
    """A batch for a DataLoader's collate_fn: images of any size in a list, and their targets.

    Args:
        samples: of a LabelDataset.

    Returns:
        images: B tensors (3, H, W); samples that were skipped are left out, so B may be smaller
            than the batch size, or 0.
        targets: B dicts; ``targets.skipped`` says what was left out.

    Example:
        >>> from animal3dbox.datasets import SyntheticDataset
        >>> dataset = SyntheticDataset(2, image_hw=(60, 80))
        >>> images, targets = collate([dataset[0], dataset[1]])
        >>> len(images), targets[0]["corners_3d"].shape
        (2, torch.Size([1, 8, 3]))
    """
    used = [sample for sample in samples if not isinstance(sample, Skipped)]
    return [image for image, _ in used], Targets(
        (target for _, target in used),
        [sample for sample in samples if isinstance(sample, Skipped)],
    )


def collate_stacked(samples: Sequence[tuple[Tensor, Target] | Skipped]) -> tuple[Tensor, Targets]:
    """A batch whose images are of one size, stacked.

    Args:
        samples: of a LabelDataset.

    Returns:
        images: (B, C, H, W), in the memory format torch.channels_last if all images are so; (0,) if
            every sample was skipped.
        targets: see collate.

    Raises:
        SampleError: two images differ in size.

    Example:
        >>> from animal3dbox.datasets import SyntheticDataset
        >>> dataset = SyntheticDataset(2, image_hw=(60, 80))
        >>> collate_stacked([dataset[0], dataset[1]])[0].shape
        torch.Size([2, 3, 60, 80])
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
    return (_stacked(images) if images else torch.zeros(0)), targets


def _stacked(images: Sequence[Tensor]) -> Tensor:
    """Images (C, H, W) as (B, C, H, W); of images with channels last that stays so."""
    if all(image.ndim == 3 and image.permute(1, 2, 0).is_contiguous() for image in images):
        return torch.stack([image.permute(1, 2, 0) for image in images]).permute(0, 3, 1, 2)
    return torch.stack(list(images))


def _serialise(
    target: Target, numbers: list[bytes], layouts: dict[Layout, Layout]
) -> tuple[Layout, list[Any]]:
    """A target's layout and the values that travel by themselves.

    Args:
        target: of one image.
        numbers: takes the bytes of its small tensors.
        layouts: of the batch so far, so that targets of one layout share one object.

    """
    layout: list[tuple[str, str, tuple[int, ...]]] = []
    others = []
    for name, value in target.items():
        try:
            # Tensors of other classes, as torchvision's, stay what they are.
            array = value.numpy() if type(value) is Tensor else None
        except (TypeError, RuntimeError):  # bfloat16, sparse or on a device; with a gradient
            array = None
        if array is None or array.nbytes > BY_VALUE_BYTES:
            layout.append((name, "", ()))
            others.append(value)
        else:
            layout.append((name, array.dtype.char, array.shape))
            numbers += (array.tobytes(), _PADDING[array.nbytes % ALIGNMENT])
    whole = tuple(layout)
    return layouts.setdefault(whole, whole), others


@lru_cache(maxsize=256)
def _places(
    layout: Layout,
) -> tuple[list[tuple[str, np.dtype[Any] | None, tuple[int, ...], int]], int]:
    """Name, type, shape and offset of a target's fields, and the bytes that all take."""
    places: list[tuple[str, np.dtype[Any] | None, tuple[int, ...], int]] = []
    offset = 0
    for name, code, shape in layout:
        dtype = np.dtype(code) if code else None
        places.append((name, dtype, shape, offset))
        if dtype is not None:
            size = math.prod(shape) * dtype.itemsize
            offset += size + -size % ALIGNMENT
    return places, offset


def _deserialise(
    targets: list[tuple[Layout, list[Any]]], content: bytearray, skipped: tuple[Skipped, ...]
) -> Targets:
    """The targets of a batch, of the layouts, values and numbers that _serialise made of them."""
    batch = Targets(skipped=skipped)
    begin = 0
    for layout, others in targets:
        places, size = _places(layout)
        remaining = iter(others)
        target: Target = {}
        for name, dtype, shape, offset in places:
            if dtype is None:
                target[name] = next(remaining)
            else:
                array = np.ndarray(shape, dtype, content, begin + offset)
                target[name] = torch.from_numpy(array)
        batch.append(target)
        begin += size
    return batch
