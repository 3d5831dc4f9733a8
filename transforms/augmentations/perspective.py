"""Random perspective: four corners moved at will.

No real camera takes such pictures, so it has to be asked for.
"""

import numpy as np

from animal3dbox.errors import ConfigError
from animal3dbox.transforms.draw_context import DrawContext
from animal3dbox.transforms.randomness import check_probability
from animal3dbox.transforms.steps import Step, Warp
from animal3dbox.transforms.transform import Transform


class RandomPerspective(Transform):
    """Move the four corners of the picture inwards at random.

    K: changes in all its entries, skew included, exactly; the camera frame is turned.

    Args:
        distortion_scale: how far a corner moves at most, as part of half the side, in [0, 1).
        p: probability.
        allow_skew: must be True: the camera gets a skew K[0, 1], which most detectors ignore.
            RandomVirtualCamera gives perspective without it.

    Example:
        >>> move = RandomPerspective(0.3, p=1, allow_skew=True)
        >>> image, target = move(np.zeros((60, 80, 3), np.uint8), {}, key=(0, 0))
        >>> image.shape, bool(target["H_out_in"][2, :2].any())
        ((60, 80, 3), True)
    """

    geometric = True

    def __init__(
        self, distortion_scale: float = 0.3, p: float = 0.5, *, allow_skew: bool = False
    ) -> None:
        super().__init__(p)
        self.distortion_scale = check_probability("distortion_scale", distortion_scale)
        if distortion_scale >= 1:
            raise ConfigError(f"distortion_scale must lie in [0, 1), got {distortion_scale!r}")
        if not allow_skew:
            raise ConfigError(
                "RandomPerspective gives the camera a skew, which most detectors ignore: pass"
                " allow_skew=True if yours reads K[0, 1], or take RandomVirtualCamera, which gives"
                " perspective without skew"
            )
        self.allow_skew = allow_skew

    def steps(self, rng: np.random.Generator, context: DrawContext) -> tuple[Step, ...]:
        """Draw four corners, and the map that takes the picture's own to them."""
        height, width = context.image_hw
        edges = np.array(
            [[-0.5, -0.5], [width - 0.5, -0.5], [width - 0.5, height - 0.5], [-0.5, height - 0.5]]
        )
        inwards = (
            np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
            * rng.random((4, 2))
            * self.distortion_scale
            * (width / 2, height / 2)
        )
        return (Warp(four_points(edges, edges + inwards), context.image_hw),)


def four_points(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """The map (3, 3) that takes four pixels (4, 2) to four others, no three in a line."""
    rows = []
    for (x, y), (u, v) in zip(before, after, strict=True):
        rows += [[x, y, 1, 0, 0, 0, -u * x, -u * y], [0, 0, 0, x, y, 1, -v * x, -v * y]]
    return np.append(np.linalg.solve(np.array(rows), after.reshape(-1)), 1.0).reshape(3, 3)
