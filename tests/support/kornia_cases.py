"""Every 2D operation of kornia, as the tests make it.

Geometric ones, those on colours, and those that must be refused.
"""

from collections.abc import Callable
from typing import Any

import kornia.augmentation as kornia
import numpy as np
import torch
from kornia.augmentation.auto import AutoAugment, RandAugment, TrivialAugment
from torch import Tensor

Make = Callable[..., Any]
HW = (96, 128)
RAMP_PX = {"nearest": 0.5 + 1e-9, "bilinear": 1e-6, "bicubic": 0.05}
"""What each interpolation does to a ramp.

Torch's cubic kernel (a = -0.75) bends ramps by 0.048 px.
"""
SAMPLED: dict[str, Make] = {
    "RandomAffine": lambda **o: kornia.RandomAffine(
        20.0, (0.1, 0.1), (0.7, 1.3), (-10.0, 10.0, -5.0, 5.0), p=1.0, **o
    ),
    "RandomPerspective": lambda **o: kornia.RandomPerspective(0.3, p=1.0, **o),
    "RandomPerspective area": lambda **o: kornia.RandomPerspective(
        0.3, p=1.0, sampling_method="area_preserving", **o
    ),
    "RandomRotation": lambda **o: kornia.RandomRotation(40.0, p=1.0, **o),
    "RandomRotation90": lambda **o: kornia.RandomRotation90((1, 3), p=1.0, **o),
    "RandomShear": lambda **o: kornia.RandomShear((-10.0, 10.0, -5.0, 5.0), p=1.0, **o),
    "RandomTranslate": lambda **o: kornia.RandomTranslate((-0.2, 0.2), (-0.1, 0.1), p=1.0, **o),
    "Resize": lambda **o: kornia.Resize((70, 150), **o),
    "Resize one side": lambda **o: kornia.Resize(64, **o),
    "Resize antialias": lambda **o: kornia.Resize((30, 43), antialias=True, **o),
    "LongestMaxSize": lambda **o: kornia.LongestMaxSize(64, **o),
    "SmallestMaxSize": lambda **o: kornia.SmallestMaxSize(150, **o),
}
CROPS: dict[str, Make] = {
    "RandomResizedCrop": lambda **o: kornia.RandomResizedCrop((60, 90), **o),
    "RandomCrop": lambda **o: kornia.RandomCrop((50, 60), **o),
    "RandomCrop padding": lambda **o: kornia.RandomCrop((90, 100), padding=(7, 11, 3, 5), **o),
    "RandomCrop pad_if_needed": lambda **o: kornia.RandomCrop((120, 140), pad_if_needed=True, **o),
    "RandomCrop oversize": lambda **o: kornia.RandomCrop((120, 140), **o),
    "RandomCrop oversize in height": lambda **o: kornia.RandomCrop((120, 100), **o),
    "CenterCrop": lambda **o: kornia.CenterCrop((51, 60), **o),
}
WHOLE: dict[str, Make] = {
    "RandomHorizontalFlip": lambda: kornia.RandomHorizontalFlip(p=1.0),
    "RandomVerticalFlip": lambda: kornia.RandomVerticalFlip(p=1.0),
    "PadTo": lambda: kornia.PadTo((150, 160)),
    "PadTo crops": lambda: kornia.PadTo((50, 60)),
    "PadTo keeps": lambda: kornia.PadTo((50, 160), crop_if_exceeds=False),
    "PadTo reflects": lambda: kornia.PadTo((120, 140), pad_mode="reflect"),
}
MODES = [
    {"resample": resample, "align_corners": align}
    for resample in RAMP_PX
    for align in (True, False)
]
GEOMETRIC = [
    *[(name, make, {}) for name, make in WHOLE.items()],
    *[(name, make, mode) for name, make in SAMPLED.items() for mode in MODES],
    *[
        (name, make, {**mode, "cropping_mode": cropping})
        for name, make in CROPS.items()
        for mode in MODES
        for cropping in ("slice", "resample")
    ],
]
COLOURS: dict[str, Make] = {
    "ColorJiggle": lambda: kornia.ColorJiggle(0.2, 0.2, 0.2, 0.1, p=1.0),
    "ColorJitter": lambda: kornia.ColorJitter(0.2, 0.2, 0.2, 0.1, p=1.0),
    "RandomAutoContrast": lambda: kornia.RandomAutoContrast(p=1.0),
    "RandomBoxBlur": lambda: kornia.RandomBoxBlur((3, 5), p=1.0),
    "RandomBrightness": lambda: kornia.RandomBrightness((0.8, 1.3), p=1.0),
    "RandomChannelDropout": lambda: kornia.RandomChannelDropout(p=1.0),
    "RandomChannelShuffle": lambda: kornia.RandomChannelShuffle(p=1.0),
    "RandomClahe": lambda: kornia.RandomClahe(p=1.0),
    "RandomContrast": lambda: kornia.RandomContrast((0.7, 1.3), p=1.0),
    "RandomEqualize": lambda: kornia.RandomEqualize(p=1.0),
    "RandomGamma": lambda: kornia.RandomGamma((0.7, 1.5), p=1.0),
    "RandomGaussianBlur": lambda: kornia.RandomGaussianBlur((5, 5), (0.5, 1.5), p=1.0),
    "RandomGaussianIllumination": lambda: kornia.RandomGaussianIllumination(p=1.0),
    "RandomGaussianNoise": lambda: kornia.RandomGaussianNoise(std=0.1, p=1.0),
    "RandomGrayscale": lambda: kornia.RandomGrayscale(p=1.0),
    "RandomHue": lambda: kornia.RandomHue((-0.2, 0.2), p=1.0),
    "RandomInvert": lambda: kornia.RandomInvert(p=1.0),
    "RandomJPEG": lambda: kornia.RandomJPEG((40.0, 60.0), p=1.0),
    "RandomLinearCornerIllumination": lambda: kornia.RandomLinearCornerIllumination(p=1.0),
    "RandomLinearIllumination": lambda: kornia.RandomLinearIllumination(p=1.0),
    "RandomMedianBlur": lambda: kornia.RandomMedianBlur((3, 3), p=1.0),
    "RandomMotionBlur": lambda: kornia.RandomMotionBlur(5, 30.0, 0.0, p=1.0),
    "RandomPlanckianJitter": lambda: kornia.RandomPlanckianJitter(p=1.0),
    "RandomPlasmaBrightness": lambda: kornia.RandomPlasmaBrightness(p=1.0),
    "RandomPlasmaContrast": lambda: kornia.RandomPlasmaContrast(p=1.0),
    "RandomPlasmaShadow": lambda: kornia.RandomPlasmaShadow(p=1.0),
    "RandomPosterize": lambda: kornia.RandomPosterize(3, p=1.0),
    "RandomRGBShift": lambda: kornia.RandomRGBShift(p=1.0),
    "RandomRain": lambda: kornia.RandomRain((20, 30), (5, 10), (-3, 3), p=1.0),
    "RandomSaltAndPepperNoise": lambda: kornia.RandomSaltAndPepperNoise(p=1.0),
    "RandomSaturation": lambda: kornia.RandomSaturation((0.5, 1.5), p=1.0),
    "RandomSharpness": lambda: kornia.RandomSharpness(0.5, p=1.0),
    "RandomSnow": lambda: kornia.RandomSnow((0.3, 0.6), (1.0, 2.0), p=1.0),
    "RandomSolarize": lambda: kornia.RandomSolarize(p=1.0),
}
REFUSED: dict[str, tuple[Make, str]] = {
    "Denormalize": (lambda: kornia.Denormalize(0.5, 0.5), "undoes a Normalize"),
    "RandomElasticTransform": (kornia.RandomElasticTransform, "no matrix"),
    "RandomFisheye": (
        lambda: kornia.RandomFisheye(
            torch.tensor([-0.3, 0.3]), torch.tensor([-0.3, 0.3]), torch.tensor([0.9, 1.0])
        ),
        "no matrix",
    ),
    "RandomThinPlateSpline": (kornia.RandomThinPlateSpline, "no matrix"),
    "PatchMix": (kornia.PatchMix, "mixes the pictures"),
    "RandomCutMixV2": (
        lambda: kornia.RandomCutMixV2(use_correct_lambda=True),
        "mixes the pictures",
    ),
    "RandomJigsaw": (kornia.RandomJigsaw, "mixes the pictures"),
    "RandomMixUpV2": (kornia.RandomMixUpV2, "mixes the pictures"),
    "RandomMosaic": (kornia.RandomMosaic, "mixes the pictures"),
    "RandomTransplantation": (kornia.RandomTransplantation, "mixes the pictures"),
    "RandomTransplantation3D": (kornia.RandomTransplantation3D, "mixes the pictures"),
    "AugmentationSequential": (
        lambda: kornia.AugmentationSequential(kornia.RandomRotation(3.0)),
        "list its members in Compose",
    ),
    "ImageSequential": (
        lambda: kornia.ImageSequential(kornia.RandomRotation(3.0)),
        "list its members in Compose",
    ),
    "PatchSequential": (
        lambda: kornia.PatchSequential(kornia.RandomInvert(), patchwise_apply=False),
        "list its members in Compose",
    ),
    "VideoSequential": (
        lambda: kornia.VideoSequential(kornia.RandomInvert()),
        "list its members in Compose",
    ),
    "ManyToManyAugmentationDispather": (
        lambda: kornia.ManyToManyAugmentationDispather(
            kornia.AugmentationSequential(kornia.RandomInvert())
        ),
        "no kornia 2D augmentation",
    ),
    "ManyToOneAugmentationDispather": (
        lambda: kornia.ManyToOneAugmentationDispather(
            kornia.AugmentationSequential(kornia.RandomInvert())
        ),
        "no kornia 2D",
    ),
    "RandomDepthicalFlip3D": (kornia.RandomDepthicalFlip3D, "volumes"),
    "RandomEqualize3D": (kornia.RandomEqualize3D, "volumes"),
    "RandomHorizontalFlip3D": (kornia.RandomHorizontalFlip3D, "volumes"),
    "RandomVerticalFlip3D": (kornia.RandomVerticalFlip3D, "volumes"),
    "RandomAffine3D": (lambda: kornia.RandomAffine3D((3.0, 3.0, 3.0)), "volumes"),
    "RandomRotation3D": (lambda: kornia.RandomRotation3D((3.0, 3.0, 3.0)), "volumes"),
    "RandomPerspective3D": (kornia.RandomPerspective3D, "volumes"),
    "RandomCrop3D": (lambda: kornia.RandomCrop3D((2, 2, 2)), "volumes"),
    "CenterCrop3D": (lambda: kornia.CenterCrop3D(2), "volumes"),
    "RandomMotionBlur3D": (lambda: kornia.RandomMotionBlur3D(3, 3.0, 0.5), "volumes"),
    "AutoAugment": (AutoAugment, "policy"),
    "RandAugment": (lambda: RandAugment(2, 5), "policy"),
    "TrivialAugment": (TrivialAugment, "policy"),
}
ELSEWHERE = {"Normalize", "RandomErasing"}  # become our own steps, tested below
NEEDS_A_DOWNLOAD = {"RandomDissolving"}  # a diffusion model paints it; it cannot be made here


def ids(cases: list[tuple[str, Make, dict[str, Any]]]) -> list[str]:
    return [
        " ".join([name, *(str(option) for option in options.values())])
        for name, _, options in cases
    ]


def ramps(image_hw: tuple[int, int]) -> Tensor:
    """A smooth picture in [0, 1] (3, H, W): x over 256, y over 256, and one half."""
    y, x = torch.meshgrid(torch.arange(image_hw[0]), torch.arange(image_hw[1]), indexing="ij")
    return torch.stack((x, y, torch.full_like(x, 128))).float() / 256


def recorded(op: Any) -> list[dict[str, Any]]:
    """A list into which every draw of the operation goes."""
    draws: list[dict[str, Any]] = []
    original = op.forward_parameters

    def forward_parameters(shape: torch.Size) -> dict[str, Any]:
        draws.append(original(shape))
        return dict(draws[-1])

    op.forward_parameters = forward_parameters
    return draws


def photo(image_hw: tuple[int, int] = HW, channels: int = 3) -> Tensor:
    """A smooth uint8 picture with noise."""
    rng = np.random.default_rng(0)
    coarse = torch.from_numpy(rng.random((1, channels, 6, 8))).float()
    fine = torch.from_numpy(rng.random((1, channels, *image_hw))).float()
    smooth = torch.nn.functional.interpolate(coarse, image_hw, mode="bicubic")
    return ((0.15 + 0.7 * smooth + 0.05 * fine).clamp(0, 1) * 255).round().to(torch.uint8)[0]
