"""Resizing, padding and cropping without randomness."""

import numpy as np

from animal3dbox.errors import ConfigError
from animal3dbox.transforms.camera_law.maps import Size, check_size, cropping, scaling, shifting
from animal3dbox.transforms.draw_context import DrawContext
from animal3dbox.transforms.randomness import check_probability
from animal3dbox.transforms.steps import Keep, Step, Warp
from animal3dbox.transforms.transform import Transform


class Resize(Transform):
    """Resize the picture to a fixed size.

    K: x' = (x + 1/2) s - 1/2, so fx' = s fx and cx' = (cx + 1/2) s - 1/2; likewise y.

    Args:
        size: (height, width); or one number for the shorter side, keeping the aspect up to the
            rounding to whole pixels.

    Example:
        >>> image, target = Resize(30)(np.zeros((60, 80, 3), np.uint8), {})
        >>> image.shape, target["H_out_in"][0].tolist()  # x' = (x + 1/2) / 2 - 1/2
        ((30, 40, 3), [0.5, 0.0, -0.25])
    """

    geometric = True

    def __init__(self, size: Size) -> None:
        super().__init__()
        self.size = size
        check_size("size", size)

    def steps(self, rng: np.random.Generator, context: DrawContext) -> tuple[Step, ...]:
        """The map to the size, which depends on the picture's own if one number was given."""
        height, width = context.image_hw
        if isinstance(self.size, int | np.integer):
            factor = self.size / min(height, width)
            size = (max(1, round(height * factor)), max(1, round(width * factor)))
        else:
            size = check_size("size", self.size)
        return (Warp(scaling((size[1] / width, size[0] / height)), size),)


class LetterBox(Transform):
    """Fit the whole picture into a size, keeping its aspect, and fill the rest.

    K: one scale for x and y, and a shift.

    Args:
        size: (height, width), or one number for both.
        enlarge: also enlarge pictures that are smaller.

    Example:
        >>> image, target = LetterBox(40)(np.full((60, 80), 9, np.uint8), {})
        >>> image.shape, image[:, 0].tolist().index(9)  # five rows of border, then the picture
        ((40, 40), 5)
    """

    geometric = True

    def __init__(self, size: Size, enlarge: bool = True) -> None:
        super().__init__()
        self.size = check_size("size", size)
        self.enlarge = enlarge

    def steps(self, rng: np.random.Generator, context: DrawContext) -> tuple[Step, ...]:
        """The map that fits the picture into the size."""
        return (Warp(fitting(context.image_hw, self.size, enlarge=self.enlarge), self.size),)


def fitting(
    image_hw: tuple[int, int], size: tuple[int, int], *, enlarge: bool = True
) -> np.ndarray:
    """The map (3, 3) that puts a whole picture into the middle of another size."""
    factor = min(size[0] / image_hw[0], size[1] / image_hw[1])
    factor = factor if enlarge else min(factor, 1.0)
    left, top = (size[1] - factor * image_hw[1]) / 2, (size[0] - factor * image_hw[0]) / 2
    if factor == 1:
        left, top = float(int(left)), float(int(top))  # whole pixels stay whole
    H: np.ndarray = shifting(left, top) @ scaling((factor, factor))
    return H


class PadTo(Transform):
    """Fill up to a size without resizing; the picture keeps its pixels.

    K: the principal point shifts with the picture.

    Args:
        size: (height, width), or one number for both; not smaller than the picture.
        position: "center", or "top_left" to fill on the right and at the bottom only, which leaves
            K as it is.

    Example:
        >>> image, target = PadTo((64, 96))(np.zeros((60, 80, 3), np.uint8), {})
        >>> image.shape, target["H_out_in"][:2, 2].tolist()
        ((64, 96, 3), [8.0, 2.0])
    """

    geometric = True

    def __init__(self, size: Size, position: str = "center") -> None:
        super().__init__()
        self.size = check_size("size", size)
        if position not in ("center", "top_left"):
            raise ConfigError(f"position must be 'center' or 'top_left', got {position!r}")
        self.position = position

    def steps(self, rng: np.random.Generator, context: DrawContext) -> tuple[Step, ...]:
        """The shift to the place in the greater picture."""
        room = (self.size[0] - context.image_hw[0], self.size[1] - context.image_hw[1])
        if min(room) < 0:
            raise ConfigError(
                f"PadTo({self.size}) cannot hold an image of {context.image_hw} (height, width):"
                " resize or crop it first"
            )
        shift = (room[1] // 2, room[0] // 2) if self.position == "center" else (0, 0)
        return (Warp(shifting(*shift), self.size),)


class CenterCrop(Transform):
    """Cut out the middle; where the picture is smaller, the rest is filled.

    K: the principal point shifts.

    Args:
        size: (height, width), or one number for both.
        min_visible: drop animals of which less than this part of what was visible remains; None
            keeps all.

    Example:
        >>> image, target = CenterCrop(40)(np.zeros((60, 80, 3), np.uint8), {})
        >>> image.shape, target["H_out_in"][:2, 2].tolist()
        ((40, 40, 3), [-20.0, -10.0])
    """

    geometric = True

    def __init__(self, size: Size, min_visible: float | None = None) -> None:
        super().__init__()
        self.size = check_size("size", size)
        self.min_visible = (
            None if min_visible is None else check_probability("min_visible", min_visible)
        )

    def steps(self, rng: np.random.Generator, context: DrawContext) -> tuple[Step, ...]:
        """The shift that puts the middle first, and which animals stay."""
        left, top = (
            (context.image_hw[1] - self.size[1]) // 2,
            (context.image_hw[0] - self.size[0]) // 2,
        )
        box = (left - 0.5, top - 0.5, left + self.size[1] - 0.5, top + self.size[0] - 0.5)
        warp = Warp(cropping(box, self.size), self.size)
        parts = None if self.min_visible is None else context.visible_parts(np.array([box]))
        return (warp, *keep_visible(context, None if parts is None else parts[0], self.min_visible))


def keep_visible(
    context: DrawContext, parts: np.ndarray | None, min_visible: float | None
) -> tuple[Keep, ...]:
    """The step that keeps the animals of which at least a given part is left.

    Args:
        context: the picture before the crop.
        parts: (N,) of each animal in the picture, what the crop leaves of it; NaN keeps it.
        min_visible: the least part; None keeps all, as does None for parts.

    Returns:
        One step, or none if all stay.
    """
    if parts is None or min_visible is None:
        return ()
    indices = tuple(
        index for index, part in zip(context.alive, parts, strict=True) if not part < min_visible
    )
    return (Keep(indices, min_visible),) if indices != context.alive else ()
