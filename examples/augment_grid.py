"""One picture of an animal under every augmentation, its cuboid drawn from the updated target.

The box must stay glued.

Run: python examples/augment_grid.py [FILE]
"""

import sys
from pathlib import Path
from typing import Any

import cv2
import kornia.augmentation as kornia
import numpy as np
import torch

from animal3dbox.datasets.synthetic.scenes import synthetic_animal
from animal3dbox.geometry.cuboid import Cuboid
from animal3dbox.report.overlay import draw_cuboid
from animal3dbox.transforms import (
    CenterCrop,
    ColorJitter,
    Compose,
    LetterBox,
    PadTo,
    PerspectiveCrop,
    RandomAffine,
    RandomErasing,
    RandomGaussianBlur,
    RandomGaussianNoise,
    RandomHorizontalFlip,
    RandomPerspective,
    RandomResizedCrop,
    RandomRotation,
    RandomVerticalFlip,
    RandomVirtualCamera,
    Resize,
)

SIZE = (300, 400)
GRID: list[tuple[str, list[Any]]] = [
    ("as it is", []),
    ("RandomHorizontalFlip: left is right", [RandomHorizontalFlip(1)]),
    ("RandomVerticalFlip", [RandomVerticalFlip(1)]),
    ("RandomRotation, fx != fy", [Resize((480, 480)), RandomRotation((30, 30))]),
    ("RandomAffine", [RandomAffine((-12, -12), (0.1, 0.1), (1.2, 1.2))]),
    ("RandomAffine, shear", [RandomAffine(0, shear=(20, 20))]),
    ("RandomResizedCrop", [RandomResizedCrop(SIZE, (0.4, 0.4))]),
    ("RandomResizedCrop, ratio", [RandomResizedCrop(SIZE, (0.6, 0.6), ratio=(0.6, 0.6))]),
    ("CenterCrop", [CenterCrop(SIZE)]),
    ("LetterBox", [LetterBox(SIZE)]),
    ("PadTo", [PadTo((600, 800))]),
    ("RandomVirtualCamera, yaw", [RandomVirtualCamera((12, 12), 0.0, 0.0)]),
    ("RandomVirtualCamera, all", [RandomVirtualCamera((-8, -8), (8, 8), (-20, -20), (1.2, 1.2))]),
    ("PerspectiveCrop", [PerspectiveCrop(SIZE)]),
    ("RandomPerspective", [RandomPerspective(0.5, p=1, allow_skew=True)]),
    ("ColorJitter", [ColorJitter((1.2, 1.2), (1.3, 1.3), (1.5, 1.5), (0.08, 0.08))]),
    ("blur and noise", [RandomGaussianBlur((3, 3), p=1), RandomGaussianNoise((0.08, 0.08), p=1)]),
    ("RandomErasing", [RandomErasing(1, scale=(0.1, 0.1), value="random")]),
    (
        "kornia: affine, hue",
        [
            kornia.RandomAffine((20.0, 20.0), scale=(0.8, 0.8), p=1),
            kornia.RandomHue((0.3, 0.3), p=1),
        ],
    ),
    (
        "a chain of five",
        [
            RandomHorizontalFlip(1),
            RandomAffine(10),
            RandomVirtualCamera(6, 6, 10),
            RandomResizedCrop(SIZE, (0.5, 0.7)),
            ColorJitter(0.3),
        ],
    ),
]


def target_of(animal: Any) -> dict[str, Any]:
    """Camera and box of a synthetic animal, as a target."""
    box = animal.cuboid
    return {
        "K": animal.camera.K,
        "center": box.center[None],
        "rotation": box.rotation[None],
        "size": box.size[None],
    }


def main() -> None:
    """Augment one animal in every way, and write the grid of pictures."""
    animal = synthetic_animal(0, 12, preset="horse", pose="trot")
    image, target = animal.image.permute(2, 0, 1).contiguous(), target_of(animal)
    panels = []
    for words, steps in GRID:
        augmented, after = Compose(steps, allow_skew=True, fill=40.0)(image, target, key=(0, 4))
        canvas = np.ascontiguousarray(augmented.permute(1, 2, 0).numpy())
        box = Cuboid(*(torch.as_tensor(after[name][0]) for name in ("center", "rotation", "size")))
        draw_cuboid(canvas, box, after["K"])
        scale = min(SIZE[1] / canvas.shape[1], SIZE[0] / canvas.shape[0])
        small = cv2.resize(
            canvas,
            (round(canvas.shape[1] * scale), round(canvas.shape[0] * scale)),
            interpolation=cv2.INTER_AREA,
        )
        panel = np.full((*SIZE, 3), 15, dtype=np.uint8)
        panel[: small.shape[0], : small.shape[1]] = small
        cv2.putText(
            panel,
            words,
            (8, SIZE[0] - 10),
            cv2.FONT_HERSHEY_SIMPLEX,
            0.55,
            (255, 255, 255),
            1,
            cv2.LINE_AA,
        )
        panels.append(panel)
    rows = [np.concatenate(panels[start : start + 5], axis=1) for start in range(0, len(panels), 5)]
    out = Path(sys.argv[1] if len(sys.argv) > 1 else "docs/images/augment_grid.jpg")
    cv2.imwrite(
        str(out),
        cv2.resize(np.concatenate(rows), (1000, 600), interpolation=cv2.INTER_AREA)[..., ::-1],
    )


if __name__ == "__main__":
    main()
