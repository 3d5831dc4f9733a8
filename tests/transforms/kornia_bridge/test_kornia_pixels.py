"""Kornia's operations on colours inside our pipelines.

Kornia's own pixels, and marks where something is hidden.
"""

from typing import Any

import kornia.augmentation as kornia
import pytest
import torch
from kornia_cases import COLOURS, HW, photo, recorded
from scenes import scene
from torch import Tensor
from torch.testing import assert_close

from animal3dbox.errors import ConfigError
from animal3dbox.transforms import Compose, KorniaTransform, Normalize
from animal3dbox.transforms.steps import KorniaPixels


@pytest.mark.parametrize("name", COLOURS)
def test_operations_on_colours_give_kornias_own_pixels_and_leave_the_target(name: str) -> None:
    op = COLOURS[name]()
    draws = recorded(op)
    image, target = photo(), scene(image_hw=HW)
    compose = Compose([op])
    ours, moved = compose(image, target, key=(0, 1))
    theirs = (op(image[None].float() / 255, params=dict(draws[-1]))[0] * 255).clamp(0, 255)
    assert float((torch.as_tensor(ours).float() - theirs).abs().max()) <= 0.5 + 1e-3
    (batched,), _ = compose.batch((image[None], [target]), keys=[(0, 1)])
    assert torch.equal(batched, torch.as_tensor(ours))
    assert all(
        torch.equal(moved[field], value)
        for field, value in target.items()
        if isinstance(value, Tensor)
    )
    assert torch.equal(moved["H_out_in"], torch.eye(3, dtype=torch.float64))


@pytest.mark.parametrize(
    "name", ["RandomGaussianNoise", "RandomBrightness", "RandomChannelShuffle"]
)
def test_grey_images_get_draws_of_their_own_number_of_channels(name: str) -> None:
    image = photo(channels=1)
    result, _ = Compose([COLOURS[name]()])(image, {}, key=(0, 1))
    assert result.shape == image.shape


def test_a_plan_replays_kornias_pixels() -> None:
    compose = Compose([COLOURS["RandomGaussianNoise"](), kornia.RandomAffine(10.0, p=1.0)])
    image = photo()
    plan = compose.sample_params(HW, {}, key=(0, 1))
    assert isinstance(plan.steps[0], KorniaPixels)
    assert torch.equal(
        torch.as_tensor(compose.apply(image, {}, plan)[0]),
        torch.as_tensor(compose.apply(image, {}, plan)[0]),
    )


def test_random_erasing_paints_what_kornia_paints_and_marks_what_it_hides() -> None:
    op = kornia.RandomErasing((0.1, 0.3), value=0.5, p=1.0)
    draws = recorded(op)
    image, target = photo(), scene(image_hw=HW)
    ours, after = Compose([op])(
        image, {**target, "masks": torch.ones(2, *HW, dtype=torch.uint8)}, key=(0, 3)
    )
    theirs = op(image[None].float() / 255, params=dict(draws[-1]))[0]
    assert torch.equal(torch.as_tensor(ours), (theirs * 255).round().to(torch.uint8))
    hidden = (theirs == 0.5).all(0)
    assert int(hidden.sum()) > 500
    assert torch.equal(after["masks"][0] == 0, hidden)
    assert (after["occlusion"] > 0).any()

    class Blackout(kornia.RandomErasing):  # type: ignore[misc]  # kornia's names are Any where it is imported lazily
        def apply_transform(
            self, input: Tensor, params: Any, flags: Any, transform: Any = None
        ) -> Tensor:
            return torch.zeros_like(input)

    with pytest.raises(ConfigError, match="hides is not known"):
        KorniaTransform(Blackout())


def test_normalize_becomes_our_normalisation() -> None:
    mean, std = (0.4, 0.5, 0.3), (0.2, 0.3, 0.25)
    image = photo()
    ours, _ = Compose([kornia.Normalize(torch.tensor(mean), torch.tensor(std))])(
        image, {}, key=(0, 0)
    )
    theirs = kornia.Normalize(torch.tensor(mean), torch.tensor(std))(image[None].float() / 255)[0]
    assert_close(torch.as_tensor(ours), theirs, atol=1e-5, rtol=0)
    assert_close(
        torch.as_tensor(Compose([Normalize(mean, std)])(image, {})[0]),
        torch.as_tensor(ours),
        atol=1e-6,
        rtol=0,
    )
    grey, _ = Compose([kornia.Normalize(0.5, 0.25)])(image, {}, key=(0, 0))
    assert_close(torch.as_tensor(grey), (image.float() / 255 - 0.5) / 0.25, atol=1e-5, rtol=0)
    with pytest.raises(ConfigError, match="two kinds"):
        KorniaTransform(kornia.Normalize(0.5, 0.5, p=0.5))
    with pytest.raises(ConfigError, match="put Normalize last"):
        Compose([kornia.Normalize(0.5, 0.5), kornia.RandomInvert(p=1.0)])(image, {}, key=(0, 0))


def test_blurs_that_move_the_picture_are_refused() -> None:
    for op in (
        kornia.RandomBoxBlur((4, 4)),
        kornia.RandomBoxBlur((3, 2)),
        kornia.RandomMotionBlur(9, 30.0, 0.8),
    ):
        with pytest.raises(ConfigError, match="moves the picture"):
            KorniaTransform(op)
