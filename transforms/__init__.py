"""Augmentations that keep the camera true, for any dataset of oriented boxes.

The rooms, in their order; each imports only from those above it (tests/transforms/test_rooms.py):

- `camera_law`: fields of a target, and how a map of pixels changes each.
- `steps`, `randomness`: the values that a transform draws, and the generator that it draws from.
- `draw_context`: the picture by then, which a transform may look at when it draws.
- `rendering`: executors that read the pixels of images, masks and depth maps.
- `target_maps`: the law on a whole target, for pixels that another library has moved.
- `conventions_door`: targets and pictures as other libraries have them, at the door.
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

from typing import TYPE_CHECKING

from animal3dbox.lazy_exports import lazy_exports

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

__getattr__, __dir__, __all__ = lazy_exports(
    __name__,
    {
        "augmentations.affine": ("RandomAffine", "RandomRotation"),
        "augmentations.colour": ("ColorJitter", "Normalize", "RandomGrayscale"),
        "augmentations.crops": ("RandomResizedCrop",),
        "augmentations.erasing": ("RandomErasing",),
        "augmentations.flips": ("RandomHorizontalFlip", "RandomVerticalFlip"),
        "augmentations.noise": ("RandomGaussianBlur", "RandomGaussianNoise"),
        "augmentations.perspective": ("RandomPerspective",),
        "augmentations.resizing": ("CenterCrop", "LetterBox", "PadTo", "Resize"),
        "augmentations.virtual_camera": ("PerspectiveCrop", "RandomVirtualCamera"),
        "camera_law.relabel": ("Relabelling",),
        "target_maps": ("inverse", "transform_target"),
        "compose": ("Compose",),
        "kornia_bridge.kornia_transform": ("KorniaTransform",),
        "kornia_bridge.sequential": ("CameraAugmentationSequential",),
        "steps": ("Plan",),
        "transform": ("Transform",),
        "animal3dbox.geometry.camera": ("project_in_front",),
        "animal3dbox.geometry.homography": ("update_camera",),
    },
)
