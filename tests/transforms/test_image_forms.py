"""Images: the forms in which they come and leave, and the pixels that are read."""

from typing import Any

import numpy as np
import pytest
import torch
from opencv_version import LEVELS
from pictures import HW, picture
from scenes import F64
from torch import Tensor
from torch.testing import assert_close

from animal3dbox.errors import ShapeError
from animal3dbox.transforms import (
    CenterCrop,
    Compose,
    Normalize,
    PadTo,
    RandomErasing,
    RandomGaussianBlur,
    RandomGaussianNoise,
    RandomHorizontalFlip,
    RandomRotation,
    RandomVirtualCamera,
    Resize,
)


@pytest.mark.parametrize("dtype", ["uint8", "float32", "float64"])
@pytest.mark.parametrize("layout", ["chw", "hwc", "hw"])
@pytest.mark.parametrize("tensor", [True, False])
def test_images_leave_in_the_form_in_which_they_came(dtype: str, layout: str, tensor: bool) -> None:
    base = picture().numpy()
    array = base[0] if layout == "hw" else base if layout == "chw" else base.transpose(1, 2, 0)
    array = array if dtype == "uint8" else (array / 255).astype(dtype)
    image: Any = torch.from_numpy(np.ascontiguousarray(array)) if tensor else array
    kept = array.copy()
    out, _ = Compose([RandomRotation((7, 7)), Resize((60, 70)), RandomGaussianNoise(p=1)])(
        image, {}, key=(0,)
    )
    assert type(out) is type(image)
    assert out.dtype == image.dtype
    assert tuple(out.shape) == {"chw": (3, 60, 70), "hwc": (60, 70, 3), "hw": (60, 70)}[layout]
    assert (np.asarray(image) == kept).all()  # the image that came in is as it was
    reference, _ = Compose([RandomRotation((7, 7)), Resize((60, 70))])(picture(), {}, key=(0,))
    plain, _ = Compose([RandomRotation((7, 7)), Resize((60, 70))])(image, {}, key=(0,))
    values = np.asarray(plain, dtype=float) * (1 if dtype == "uint8" else 255)
    values = values if layout != "hwc" else values.transpose(2, 0, 1)
    difference = np.abs(
        values - (np.asarray(reference[0] if layout == "hw" else reference, dtype=float))
    )
    assert difference.max() <= 1.001


def test_flips_and_whole_pixel_crops_are_lossless() -> None:
    image = picture()
    flipped, _ = Compose([RandomHorizontalFlip(1)])(image, {})
    assert torch.equal(flipped, image.flip(-1))
    cropped, _ = Compose([CenterCrop((60, 50))])(image, {})
    assert torch.equal(cropped, image[:, 30:90, 55:105])
    padded, _ = Compose([PadTo((130, 170))], fill=(10, 20, 30))(image, {})
    assert torch.equal(padded[:, 5:125, 5:165], image)
    assert padded[:, 0, 0].tolist() == [10, 20, 30]


def test_strong_shrinking_averages_instead_of_aliasing() -> None:
    checks = ((np.indices((240, 320)).sum(axis=0) % 2) * 255).astype(np.uint8)
    for compose in (Compose([Resize(40)]), Compose([RandomRotation((20, 20)), Resize(40)])):
        small, _ = compose(checks, {})
        inside = np.asarray(small)[8:-8, 8:-8]
        assert inside.min() > 120
        assert inside.max() < 136


def test_nothing_is_read_from_beyond_the_horizon() -> None:
    target = {"K": torch.tensor([[80.0, 0, 79.5], [0, 80, 59.5], [0, 0, 1]], dtype=F64)}
    compose = Compose([RandomVirtualCamera((80, 80), 0.0, 0.0)], fill=7.0)
    white = torch.full((3, *HW), 200, dtype=torch.uint8)
    turned, _ = compose(white, target)
    batched, _ = compose.batch((white[None], [target]))
    for image in (turned, batched[0]):
        assert isinstance(image, Tensor)
        assert set(image.flatten().tolist()) >= {7, 200}
        assert set(image[:, :, 80:].flatten().tolist()) == {
            7
        }  # the picture ends 45 degrees to the right of where it looked


@pytest.mark.parametrize(
    ("image", "says"),
    [
        ([[1]], "tensor or a numpy array"),
        (np.zeros((5, 6, 7)), "shape"),
        (np.zeros((5, 6, 3), dtype=np.int32), "uint8"),
        (torch.zeros(3, 0, 5), "empty"),
        (torch.zeros(2, 3, 4, 5), "shape"),
    ],
)
def test_unusable_images_are_refused(image: Any, says: str) -> None:
    with pytest.raises(ShapeError, match=f"image must .*{says}"):
        Compose([Resize(5)])(image, {})


def test_rgba_and_grey_images_go_through_both_executors_alike() -> None:
    for channels in (1, 4):
        image = torch.cat((picture(), picture(1)))[:channels]
        compose = Compose(
            [RandomRotation((20, 20))], fill=(9.0, 9.0, 9.0) if channels == 4 else 9.0
        )
        one, _ = compose(image, {})
        batched, _ = compose.batch((image[None], [{}]))
        assert int((batched[0].int() - one.int()).abs().max()) <= LEVELS
    with pytest.raises(ShapeError, match="image has 1 channels, but RandomErasing's value has 3"):
        Compose([RandomErasing(1, value=(0.0, 0.5, 1.0))])(image[:1], {})


def test_floats_outside_their_range_are_treated_alike_by_both_executors() -> None:
    image = torch.randn(3, 30, 40)
    compose = Compose([RandomGaussianBlur((1, 1), p=1), RandomErasing(1)])
    one, _ = compose(image, {}, key=(0,))
    batched, _ = compose.batch((image[None], [{}]), keys=[(0,)])
    assert_close(batched[0], one, atol=1e-5, rtol=0)
    assert float(one.min()) < 0


@pytest.mark.parametrize("dtype", ["uint8", "float32"])
def test_images_with_channels_last_in_memory_are_read_like_others(dtype: str) -> None:
    # As datasets give them: (3, H, W), a view of the decoder's (H, W, 3)
    planes = picture() if dtype == "uint8" else picture().float() / 255
    channels_last = planes.permute(1, 2, 0).contiguous().permute(2, 0, 1)
    assert channels_last.stride(0) == 1 != planes.stride(0)
    augment = Compose([RandomRotation((7, 7)), Resize((60, 70)), Normalize()])
    for chain in (augment, Compose([RandomHorizontalFlip(1)]), Compose([])):
        before = channels_last.clone()
        out, _ = chain(channels_last, {}, key=(0,))
        assert_close(out, chain(planes, {}, key=(0,))[0], atol=0, rtol=0)
        out.zero_()  # nothing of the result is the caller's memory
        assert_close(channels_last, before, atol=0, rtol=0)


def test_every_grey_level_is_standardised_by_its_formula() -> None:
    levels = torch.arange(256, dtype=torch.uint8).reshape(1, 16, 16).repeat(3, 1, 1)
    out, _ = Normalize((0.1, 0.2, 0.3), (0.4, 0.5, 0.6))(levels, {})
    for channel, (mean, std) in enumerate(((0.1, 0.4), (0.2, 0.5), (0.3, 0.6))):
        expected = (levels[channel].double() / 255 - mean) / std
        assert_close(out[channel].double(), expected, atol=3e-7, rtol=0)
