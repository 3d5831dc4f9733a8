"""Every 2D operation of the installed kornia.

Its pixels are where its matrix says and our warp puts them there, or it is refused.
"""

import inspect
import subprocess
import sys
from typing import Any

import kornia.augmentation as kornia
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from kornia_cases import (
    COLOURS,
    CROPS,
    ELSEWHERE,
    GEOMETRIC,
    HW,
    NEEDS_A_DOWNLOAD,
    RAMP_PX,
    REFUSED,
    SAMPLED,
    WHOLE,
    Make,
    ids,
    photo,
    ramps,
    recorded,
)
from opencv_version import RAMP_PX as READ_PX
from scenes import scene
from thorough import thorough
from torch.testing import assert_close

from animal3dbox.errors import ConfigError, SampleError
from animal3dbox.geometry.camera import project
from animal3dbox.geometry.cuboid import MIRRORED_CORNERS
from animal3dbox.geometry.homography import apply_homography
from animal3dbox.transforms import Compose, KorniaTransform
from animal3dbox.transforms.kornia_bridge.probe import measure

SMOOTH = [case for case in GEOMETRIC if case[2].get("resample") != "nearest"]


def test_every_augmentation_of_the_installed_kornia_is_verified_or_refused() -> None:
    bases = {"AugmentationBase2D", "AugmentationBase3D", "MixAugmentationBaseV2"} | {
        f"{kind}AugmentationBase{dim}D"
        for kind in ("Geometric", "Intensity", "RigidAffine")
        for dim in (2, 3)
    }
    namespace = {name for name in kornia.__all__ if inspect.isclass(getattr(kornia, name))} - bases
    geometric = {name.split()[0] for name in (*SAMPLED, *CROPS, *WHOLE)}
    known = (
        geometric
        | set(COLOURS)
        | (set(REFUSED) - {"AutoAugment", "RandAugment", "TrivialAugment"})
        | ELSEWHERE
        | NEEDS_A_DOWNLOAD
    )
    assert namespace == known


@pytest.mark.parametrize(("name", "make", "options"), GEOMETRIC, ids=ids(GEOMETRIC))
def test_kornias_pixels_are_where_its_matrix_says(
    name: str, make: Make, options: dict[str, Any]
) -> None:
    allowed = RAMP_PX[options.get("resample", "bilinear")]
    for image_hw in (HW, (131, 90)):
        if name.startswith("PadTo reflects"):
            image_hw = (min(image_hw[0], 100), min(image_hw[1], 128))
        for seed in range(2):
            result = measure(make(**options), image_hw, seed)
            assert result.pixels > 500
            assert result.off_px <= allowed
            assert result.image_hw == result.claimed_hw


@pytest.mark.parametrize(("name", "make", "options"), SMOOTH, ids=ids(SMOOTH))
def test_our_warp_puts_every_pixel_where_kornia_puts_it(
    name: str, make: Make, options: dict[str, Any]
) -> None:
    op = make(**options)
    draws = recorded(op)
    image = ramps(HW)
    ours, _ = Compose([op], interpolation=options.get("resample", "bilinear"), allow_skew=True)(
        image, {}, key=(3, 1)
    )
    theirs = op(image[None], params=draws[0])[0]
    assert ours.shape == theirs.shape
    painted = ((theirs[2] - 0.5).abs() < 1e-5) & (
        (torch.as_tensor(ours)[2] - 0.5).abs() < 1e-5
    )  # borders differ
    x, y = theirs[0] * 256, theirs[1] * 256
    inner = painted & (x > 3) & (x < HW[1] - 4) & (y > 3) & (y < HW[0] - 4)
    down, across = (int(0.15 * side) + 1 for side in theirs.shape[1:])
    inner[:down], inner[-down:], inner[:, :across], inner[:, -across:] = False, False, False, False
    assert int(inner.sum()) > 300
    off_px = (torch.as_tensor(ours) - theirs).abs()[:2].amax(0) * 256
    assert (
        float(off_px[inner].max())
        < {"bilinear": READ_PX, "bicubic": 0.2 + READ_PX}[options.get("resample", "bilinear")]
    )


@pytest.mark.parametrize("name", REFUSED)
def test_what_has_no_matrix_is_refused_with_a_reason(name: str) -> None:
    make, reason = REFUSED[name]
    op = make()
    with pytest.raises(ConfigError, match=reason):
        KorniaTransform(op)
    with pytest.raises(ConfigError, match=reason):
        Compose([op])


def test_modules_that_are_not_kornias_are_refused() -> None:
    for module in (torch.nn.Identity(), torch.nn.Sequential(kornia.RandomRotation(3.0))):
        with pytest.raises(ConfigError, match="cannot say what it does to the camera"):
            Compose([module])
    with pytest.raises(ConfigError, match="is no transform"):
        Compose([len])


def test_kornia_is_imported_only_for_those_who_use_it() -> None:
    program = (
        "import sys; from animal3dbox.transforms import Compose, RandomAffine;"
        " Compose([RandomAffine(3)]); assert not any(name.split('.')[0] == 'kornia' for name in"
        " sys.modules)"
    )
    subprocess.run([sys.executable, "-c", program], check=True)


def test_draws_depend_on_the_key_alone_and_leave_torchs_generator_as_it_was() -> None:
    compose = Compose(
        [kornia.RandomAffine(20.0, (0.1, 0.1), p=0.7), kornia.RandomGaussianNoise(std=0.1, p=0.7)]
    )
    image = photo()
    torch.manual_seed(1)
    before = torch.random.get_rng_state()
    first, target = compose(image, {}, key=(0, 5))
    assert torch.equal(torch.random.get_rng_state(), before)
    torch.manual_seed(2)
    again, target_again = compose(image, {}, key=(0, 5))
    assert torch.equal(torch.as_tensor(first), torch.as_tensor(again))
    assert torch.equal(target["H_out_in"], target_again["H_out_in"])
    others = [compose(image, {}, key=(0, index))[1]["H_out_in"] for index in range(8)]
    assert len({str(H.tolist()) for H in others}) > 3


def test_skipped_operations_leave_everything_as_it_is() -> None:
    image = photo()
    ops = [
        kornia.RandomHorizontalFlip(p=0.0),
        kornia.RandomAffine(20.0, p=0.0),
        kornia.RandomCrop((20, 20), p=0.0),
        kornia.Resize((9, 9), p=0.0),
        kornia.RandomInvert(p=0.0),
    ]
    result, target = Compose(ops)(image, {}, key=(0, 0))
    assert torch.equal(torch.as_tensor(result), image)
    assert torch.equal(target["H_out_in"], torch.eye(3, dtype=torch.float64))


@thorough(60)
@given(
    st.lists(
        st.sampled_from(sorted({*SAMPLED, *CROPS, *WHOLE} - {"PadTo reflects"})),
        min_size=1,
        max_size=5,
    ),
    st.integers(0, 10**6),
)
def test_corners_stay_where_any_chain_of_kornia_operations_puts_them(
    names: list[str], index: int
) -> None:
    target = scene(image_hw=(160, 170), seed=index % 7)
    compose = Compose(
        [{**SAMPLED, **CROPS, **WHOLE}[name]() for name in names if name != "CenterCrop"],
        allow_skew=True,
    )
    _, after = compose(torch.zeros(3, 160, 170), target, key=(0, index))
    H = after["H_out_in"]
    w = target["corners_2d"] @ H[2, :2] + H[2, 2]
    order = list(MIRRORED_CORNERS) if after["mirrored"] else list(range(8))
    expected = apply_homography(H, target["corners_2d"])[:, order]
    seen = (w > 0.05)[:, order]
    assert_close(
        project(after["K"], after["corners_3d"])[0][seen], expected[seen], atol=1e-6, rtol=0
    )
    assert_close(after["corners_2d"][seen], expected[seen], atol=1e-6, rtol=0)
    assert_close(torch.linalg.det(after["rotation"]), torch.ones(2, dtype=torch.float64))


def test_affine_operations_stay_affine() -> None:
    for name in ("Resize", "RandomResizedCrop", "RandomAffine"):
        _, target = Compose([{**SAMPLED, **CROPS}[name]()], allow_skew=True)(
            photo(), {}, key=(0, 2)
        )
        assert target["H_out_in"][2].tolist() == [0, 0, 1]
    _, target = Compose([kornia.RandomRotation90((1, 1), p=1.0)])(photo(), {}, key=(0, 2))
    assert target["H_out_in"][[0, 1], [0, 1]].tolist() == [0, 0]  # upright boxes stay upright boxes


def test_mirror_forbid_refuses_kornias_flips() -> None:
    for op in (kornia.RandomHorizontalFlip(), kornia.RandomVerticalFlip(p=0.1)):
        with pytest.raises(ConfigError, match="may mirror"):
            Compose([op], mirror="forbid")
    Compose(
        [
            kornia.RandomHorizontalFlip(p=0.0),
            kornia.RandomRotation(3.0),
            kornia.RandomRotation90((0, 3)),
        ],
        mirror="forbid",
    )


def test_rotation_with_unequal_focal_lengths_says_that_it_gives_skew() -> None:
    target = scene(image_hw=HW)
    with pytest.raises(SampleError, match="skew"):
        Compose([kornia.RandomRotation((30.0, 31.0), p=1.0)])(photo(), target, key=(0, 0))
