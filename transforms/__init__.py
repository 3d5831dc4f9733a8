"""Augmentations that keep the camera true, for any dataset of oriented boxes.

The names below are loaded when first used (PEP 562).
"""

if __name__ != "animal3dbox.transforms":
    raise ImportError("import animal3dbox.transforms, not the folder transforms of its checkout: take the checkout's root off sys.path")

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from animal3dbox.geometry.camera import project_in_front as project_in_front
    from animal3dbox.geometry.homography import update_camera as update_camera
    from animal3dbox.transforms.affine import RandomAffine as RandomAffine
    from animal3dbox.transforms.affine import RandomRotation as RandomRotation
    from animal3dbox.transforms.colour import ColorJitter as ColorJitter
    from animal3dbox.transforms.colour import Normalize as Normalize
    from animal3dbox.transforms.colour import RandomGrayscale as RandomGrayscale
    from animal3dbox.transforms.compose import Compose as Compose
    from animal3dbox.transforms.crops import RandomResizedCrop as RandomResizedCrop
    from animal3dbox.transforms.erasing import RandomErasing as RandomErasing
    from animal3dbox.transforms.flips import RandomHorizontalFlip as RandomHorizontalFlip
    from animal3dbox.transforms.flips import RandomVerticalFlip as RandomVerticalFlip
    from animal3dbox.transforms.kornia_ops import KorniaTransform as KorniaTransform
    from animal3dbox.transforms.kornia_sequential import CameraAugmentationSequential as CameraAugmentationSequential
    from animal3dbox.transforms.noise import RandomGaussianBlur as RandomGaussianBlur
    from animal3dbox.transforms.noise import RandomGaussianNoise as RandomGaussianNoise
    from animal3dbox.transforms.perspective import RandomPerspective as RandomPerspective
    from animal3dbox.transforms.relabel import Relabelling as Relabelling
    from animal3dbox.transforms.resizing import CenterCrop as CenterCrop
    from animal3dbox.transforms.resizing import LetterBox as LetterBox
    from animal3dbox.transforms.resizing import PadTo as PadTo
    from animal3dbox.transforms.resizing import Resize as Resize
    from animal3dbox.transforms.steps import Plan as Plan
    from animal3dbox.transforms.target import inverse as inverse
    from animal3dbox.transforms.target import transform_target as transform_target
    from animal3dbox.transforms.transform import Transform as Transform
    from animal3dbox.transforms.virtual_camera import PerspectiveCrop as PerspectiveCrop
    from animal3dbox.transforms.virtual_camera import RandomVirtualCamera as RandomVirtualCamera

_HOMES = {
    "CameraAugmentationSequential": "kornia_sequential", "CenterCrop": "resizing", "ColorJitter": "colour", "Compose": "compose",
    "KorniaTransform": "kornia_ops", "LetterBox": "resizing", "Normalize": "colour", "PadTo": "resizing", "PerspectiveCrop": "virtual_camera",
    "Plan": "steps", "RandomAffine": "affine", "RandomErasing": "erasing", "RandomGaussianBlur": "noise", "RandomGaussianNoise": "noise",
    "RandomGrayscale": "colour", "RandomHorizontalFlip": "flips", "RandomPerspective": "perspective", "RandomResizedCrop": "crops",
    "RandomRotation": "affine", "RandomVerticalFlip": "flips", "RandomVirtualCamera": "virtual_camera", "Resize": "resizing",
    "Transform": "transform", "inverse": "target", "transform_target": "target", "Relabelling": "relabel",
    "project_in_front": "animal3dbox.geometry.camera", "update_camera": "animal3dbox.geometry.homography",
}  # fmt: skip

__all__ = sorted(_HOMES)


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'animal3dbox.transforms' has no attribute {name!r}")
    home = _HOMES[name]
    return getattr(import_module(home if "." in home else f"animal3dbox.transforms.{home}"), name)


def __dir__() -> list[str]:
    return __all__
