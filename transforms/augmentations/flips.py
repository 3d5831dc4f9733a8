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
    """A mirror in one of the picture's axes."""

    geometric = True
    horizontal = True

    def __init__(self, p: float = 0.5, mirror: str = "relabel") -> None:
        super().__init__(p)
        if mirror not in ("relabel", "forbid"):
            raise ConfigError(f"mirror must be 'relabel' or 'forbid', got {mirror!r}")
        self.mirror = mirror

    @property
    def mirrors(self) -> bool:  # type: ignore[override]
        """Whether it may mirror the picture: always, unless that is forbidden."""
        return self.mirror == "relabel"

    def steps(self, rng: np.random.Generator, context: DrawContext) -> tuple[Step, ...]:
        """The mirror, which is not random any more once the coin is tossed."""
        if self.mirror == "forbid":
            return ()
        return (Warp(flipping(context.image_hw, horizontal=self.horizontal), context.image_hw),)


class RandomHorizontalFlip(_RandomFlip):
    """Mirror the picture's left and right.

    K: cx' = W - 1 - cx. The camera frame is mirrored in x; corners, faces and keypoints are
    renamed.

    Args:
        p: probability.
        mirror: "relabel", or "forbid" for re-identification, where a mirrored left flank is not the
            right flank of any animal: the picture is then never mirrored, whatever p is.

    Example:
        >>> target = {"face_share": np.array([[0.5, 0, 0.25, 0, 0.25, 0]])}
        >>> image, target = RandomHorizontalFlip(p=1)(np.zeros((60, 80, 3), np.uint8), target)
        >>> target["H_out_in"][0].tolist(), target["face_share"].tolist()  # left is right now
        ([-1.0, 0.0, 79.0], [[0.5, 0.0, 0.0, 0.25, 0.25, 0.0]])
    """


class RandomVerticalFlip(_RandomFlip):
    """Mirror the picture's top and bottom.

    It swaps the animal's left and right too, and leaves its own top and bottom: the picture shows
    the mirrored animal upside down. K: cy' = H - 1 - cy.

    Args:
        p: probability.
        mirror: see RandomHorizontalFlip.

    Example:
        >>> image, target = RandomVerticalFlip(p=1)(np.zeros((60, 80, 3), np.uint8), {})
        >>> target["H_out_in"][1].tolist(), target["mirrored"]
        ([0.0, -1.0, 59.0], True)
    """

    horizontal = False
