"""Mirrors.

A mirrored picture is the picture of the mirrored animal: left and right change places (relabel.py).
"""

import numpy as np

from animal3dbox.errors import ConfigError
from animal3dbox.transforms.camera_law.maps import flipping
from animal3dbox.transforms.draw_context import DrawContext
from animal3dbox.transforms.steps import Step, Warp
from animal3dbox.transforms.transform import Transform


class _RandomFlip(Transform):
    geometric = True
    horizontal = True

    def __init__(self, p: float = 0.5, mirror: str = "relabel") -> None:
        super().__init__(p)
        if mirror not in ("relabel", "forbid"):
            raise ConfigError(f"mirror must be 'relabel' or 'forbid', got {mirror!r}")
        self.mirror = mirror

    @property
    def mirrors(self) -> bool:  # type: ignore[override]
        return self.mirror == "relabel"

    def steps(self, rng: np.random.Generator, context: DrawContext) -> tuple[Step, ...]:
        if self.mirror == "forbid":
            return ()
        return (Warp(flipping(context.image_hw, horizontal=self.horizontal), context.image_hw),)


class RandomHorizontalFlip(_RandomFlip):
    """Mirror left and right.

    K: cx' = W - 1 - cx. The camera frame is mirrored in x; corners, faces and keypoints are
    renamed.

    Args:
        p: probability.
        mirror: "relabel", or "forbid" for re-identification, where a mirrored left flank is not the
            right flank of any animal: the picture is then never mirrored, whatever p is.

    """


class RandomVerticalFlip(_RandomFlip):
    """Mirror top and bottom: also swaps the animal's left and right, and leaves its top and bottom.

    K: cy' = H - 1 - cy. Arguments as of RandomHorizontalFlip.
    """

    horizontal = False
