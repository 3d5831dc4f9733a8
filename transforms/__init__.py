"""Augmentations that keep the camera true, for any dataset of oriented boxes.

The rooms, in their order; each imports only from those above it (tests/transforms/test_rooms.py):

- `camera_law`: fields of a target, and how a map of pixels changes each.
- `steps`, `randomness`: the values that a transform draws, and the generator that it draws from.
- `draw_context`: the picture by then, which a transform may look at when it draws.
- `rendering`: executors that read the pixels of images, masks and depth maps.
- `target_maps`: the law on a whole target, for pixels that another library has moved.
- `pipeline`: one picture's way, from drawing to rendering.
- `transform`: the base of all transforms; derive your own from it.
- `augmentations`: the transforms, a kind a file.
- `kornia_bridge`: kornia's augmentations as transforms; kornia is imported only if it is used.
- `compose`: pipelines of all of these.

The names below are loaded when first used (PEP 562).
"""

if __name__ != "animal3dbox.transforms":
    raise ImportError(
        "import animal3dbox.transforms, not the folder transforms of its checkout: take the"
        " checkout's root off sys.path"
    )

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from animal3dbox.geometry.camera import project_in_front as project_in_front
    from animal3dbox.geometry.homography import update_camera as update_camera
    from animal3dbox.transforms.augmentations.affine import RandomAffine as RandomAffine
    from animal3dbox.transforms.augmentations.affine import RandomRotation as RandomRotation
    from animal3dbox.transforms.augmentations.colour import ColorJitter as ColorJitter
    from animal3dbox.transforms.augmentations.colour import Normalize as Normalize
    from animal3dbox.transforms.augmentations.colour import RandomGrayscale as RandomGrayscale
    from animal3dbox.transforms.augmentations.crops import RandomResizedCrop as RandomResizedCrop
    from animal3dbox.transforms.augmentations.erasing import RandomErasing as RandomErasing
    from animal3dbox.transforms.augmentations.flips import (
        RandomHorizontalFlip as RandomHorizontalFlip,
    )
    from animal3dbox.transforms.augmentations.flips import RandomVerticalFlip as RandomVerticalFlip
    from animal3dbox.transforms.augmentations.noise import RandomGaussianBlur as RandomGaussianBlur
    from animal3dbox.transforms.augmentations.noise import (
        RandomGaussianNoise as RandomGaussianNoise,
    )
    from animal3dbox.transforms.augmentations.perspective import (
        RandomPerspective as RandomPerspective,
    )
    from animal3dbox.transforms.augmentations.resizing import CenterCrop as CenterCrop
    from animal3dbox.transforms.augmentations.resizing import LetterBox as LetterBox
    from animal3dbox.transforms.augmentations.resizing import PadTo as PadTo
    from animal3dbox.transforms.augmentations.resizing import Resize as Resize
    from animal3dbox.transforms.augmentations.virtual_camera import (
        PerspectiveCrop as PerspectiveCrop,
    )
    from animal3dbox.transforms.augmentations.virtual_camera import (
        RandomVirtualCamera as RandomVirtualCamera,
    )
    from animal3dbox.transforms.camera_law.relabel import Relabelling as Relabelling
    from animal3dbox.transforms.compose import Compose as Compose
    from animal3dbox.transforms.kornia_bridge.kornia_transform import (
        KorniaTransform as KorniaTransform,
    )
    from animal3dbox.transforms.kornia_bridge.sequential import (
        CameraAugmentationSequential as CameraAugmentationSequential,
    )
    from animal3dbox.transforms.steps import Plan as Plan
    from animal3dbox.transforms.target_maps import inverse as inverse
    from animal3dbox.transforms.target_maps import transform_target as transform_target
    from animal3dbox.transforms.transform import Transform as Transform

_HOMES = {
    "CameraAugmentationSequential": "kornia_bridge.sequential",
    "CenterCrop": "augmentations.resizing",
    "ColorJitter": "augmentations.colour",
    "Compose": "compose",
    "KorniaTransform": "kornia_bridge.kornia_transform",
    "LetterBox": "augmentations.resizing",
    "Normalize": "augmentations.colour",
    "PadTo": "augmentations.resizing",
    "PerspectiveCrop": "augmentations.virtual_camera",
    "Plan": "steps",
    "RandomAffine": "augmentations.affine",
    "RandomErasing": "augmentations.erasing",
    "RandomGaussianBlur": "augmentations.noise",
    "RandomGaussianNoise": "augmentations.noise",
    "RandomGrayscale": "augmentations.colour",
    "RandomHorizontalFlip": "augmentations.flips",
    "RandomPerspective": "augmentations.perspective",
    "RandomResizedCrop": "augmentations.crops",
    "RandomRotation": "augmentations.affine",
    "RandomVerticalFlip": "augmentations.flips",
    "RandomVirtualCamera": "augmentations.virtual_camera",
    "Resize": "augmentations.resizing",
    "Transform": "transform",
    "inverse": "target_maps",
    "transform_target": "target_maps",
    "Relabelling": "camera_law.relabel",
    "project_in_front": "animal3dbox.geometry.camera",
    "update_camera": "animal3dbox.geometry.homography",
}

__all__ = sorted(_HOMES)


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'animal3dbox.transforms' has no attribute {name!r}")
    home = _HOMES[name]
    return getattr(
        import_module(
            home if home.startswith("animal3dbox.") else f"animal3dbox.transforms.{home}"
        ),
        name,
    )


def __dir__() -> list[str]:
    return __all__
