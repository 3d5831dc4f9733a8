"""Images whose colours lie side by side in memory, through transforms and into batches."""

from typing import Any

import pytest
import torch
from pictures import picture
from torch import Tensor

from animal3dbox.datasets import collate_stacked
from animal3dbox.errors import ConfigError
from animal3dbox.transforms import (
    ColorJitter,
    Compose,
    Normalize,
    RandomHorizontalFlip,
    RandomResizedCrop,
)

MEMBERS: dict[str, list[Any]] = {
    "nothing": [],
    "flip": [RandomHorizontalFlip(p=1)],
    "crop and colours": [RandomResizedCrop(40), ColorJitter(0.2)],
    "normalise": [RandomHorizontalFlip(p=1), Normalize()],
}


def is_channels_last(image: Tensor) -> bool:
    return image.permute(1, 2, 0).is_contiguous()


@pytest.mark.parametrize("name", MEMBERS)
@pytest.mark.parametrize("kind", ["contiguous", "channels last", "float", "gradient"])
def test_the_memory_format_is_as_asked_for_and_the_values_stay(name: str, kind: str) -> None:
    image = picture()
    if kind == "channels last":
        image = image.permute(1, 2, 0).contiguous().permute(2, 0, 1)
    elif kind != "contiguous":
        image = (image / 255).requires_grad_(kind == "gradient")
    plain, _ = Compose(MEMBERS[name], seed=1)(image, {}, key=(0, 0))
    asked, _ = Compose(MEMBERS[name], seed=1, channels_last=True)(image, {}, key=(0, 0))
    assert torch.equal(asked, plain)
    assert asked.dtype == plain.dtype
    assert is_channels_last(asked)
    assert asked.untyped_storage().data_ptr() != image.untyped_storage().data_ptr()
    if name != "nothing":
        assert plain.is_contiguous()


def test_a_whole_batch_may_be_asked_for_too() -> None:
    images = [picture() / 255, picture() / 255]
    keys = [(0, 0), (0, 1)]
    asked, _ = Compose(MEMBERS["flip"], channels_last=True).batch((images, [{}, {}]), keys)
    plain, _ = Compose(MEMBERS["flip"]).batch((images, [{}, {}]), keys)
    assert all(map(is_channels_last, asked))
    assert all(map(torch.equal, asked, plain))


def test_stacking_keeps_channels_last_and_mixes_nothing_up() -> None:
    augment = Compose(MEMBERS["crop and colours"], channels_last=True)
    samples = [augment(picture(), {}, key=(0, index)) for index in range(3)]
    stacked, _ = collate_stacked(samples)
    assert stacked.is_contiguous(memory_format=torch.channels_last)
    assert torch.equal(stacked, torch.stack([image for image, _ in samples]))
    mixed, _ = collate_stacked([samples[0], (samples[1][0].contiguous(), {})])
    assert torch.equal(mixed, stacked[:2])


def test_other_forms_are_left_as_they_are() -> None:
    array = picture().permute(1, 2, 0).numpy()
    out, _ = Compose(MEMBERS["flip"], channels_last=True)(array, {})
    assert out.flags.c_contiguous
    assert (out == array[:, ::-1]).all()


def test_a_pipeline_inside_another_may_not_lose_it() -> None:
    inner = Compose(MEMBERS["flip"], channels_last=True)
    with pytest.raises(ConfigError, match="channels_last"):
        Compose([inner])
