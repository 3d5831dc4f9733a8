"""Steps: what transforms draw, and what a pipeline fuses so that the pixels are read once.

A step holds the drawn values and no randomness, so the same steps give the same result on any image
of the same size.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from animal3dbox.errors import ConfigError

IDENTITY = np.eye(3)


@dataclass(frozen=True)
class Warp:
    """A map of pixels, to a picture of some size.

    Attributes:
        H_out_in: (3, 3) float64, w > 0 on the part that stays in the picture.
        image_hw: height and width after.
    """

    H_out_in: np.ndarray
    image_hw: tuple[int, int]


@dataclass(frozen=True)
class Colour:
    """An affine map of colours in [0, 1].

    Attributes:
        matrix: (3, 4) float64: rgb' = matrix[:, :3] rgb + matrix[:, 3], clipped to [0, 1] once at
            the end.
    """

    matrix: np.ndarray


@dataclass(frozen=True)
class Standardise:
    """(x - mean) / std of colours in [0, 1]; the image is float32 from here on.

    Attributes:
        mean: per channel.
        std: per channel, > 0.
    """

    mean: tuple[float, ...]
    std: tuple[float, ...]


@dataclass(frozen=True)
class Keep:
    """The animals that stay; all others are dropped.

    Attributes:
        indices: into the animals of the target that came in.
        min_visible: the part that decided; the pipeline decides again by it for the final picture,
            since a later map may show more (pipeline.returning_animals).
    """

    indices: tuple[int, ...]
    min_visible: float = 0.0


@dataclass(frozen=True)
class Blur:
    """A Gaussian blur; sigma_px > 0."""

    sigma_px: float


@dataclass(frozen=True)
class Noise:
    """Additive Gaussian noise; sigma in [0, 1] colour, and the seed that draws it."""

    sigma: float
    seed: int


@dataclass(frozen=True)
class Erase:
    """Rectangles that are painted over.

    Attributes:
        boxes: (x least, y least, x past, y past) in whole pixels.
        value: colour in [0, 1] per channel, or None for noise.
        seed: draws the noise.
    """

    boxes: tuple[tuple[int, int, int, int], ...]
    value: tuple[float, ...] | None
    seed: int = 0


@dataclass(frozen=True)
class KorniaPixels:
    """A kornia operation on colours, with its drawn parameters; it moves no pixel."""

    op: Any
    params: dict[str, Any]


Step = Warp | Colour | Standardise | Keep | Blur | Noise | Erase | KorniaPixels
Local = Blur | Noise | Erase | KorniaPixels


@dataclass(frozen=True)
class Pass:
    """One reading of the pixels: warp, then colours, then standardisation; each may be absent.

    Attributes:
        H_out_in: (3, 3); None leaves every pixel where it is.
        image_hw: height and width after.
        colour: (3, 4) or None.
        standardise: or None.
    """

    H_out_in: np.ndarray | None
    image_hw: tuple[int, int]
    colour: np.ndarray | None = None
    standardise: Standardise | None = None

    @property
    def idle(self) -> bool:
        """Whether this reading changes no pixel."""
        return self.H_out_in is None and self.colour is None and self.standardise is None


@dataclass(frozen=True)
class Plan:
    """Everything that was drawn for one sample; apply it again to replay the sample.

    Attributes:
        image_hw: height and width of the image that it was drawn for.
        steps: in order.

    Example:
        >>> from animal3dbox.transforms import Compose, RandomHorizontalFlip, Resize
        >>> plan = Compose([RandomHorizontalFlip(1), Resize(30)]).sample_params((60, 80), {})
        >>> plan.H_out_in[0].tolist(), len(plan.steps), len(plan.stages())
        ([-0.5, 0.0, 39.25], 2, 1)
    """

    image_hw: tuple[int, int]
    steps: tuple[Step, ...] = field(default=())

    @property
    def H_out_in(self) -> np.ndarray:
        """All maps of pixels together, (3, 3)."""
        H = IDENTITY
        for step in self.steps:
            H = step.H_out_in @ H if isinstance(step, Warp) else H
        return H

    @property
    def keep(self) -> tuple[int, ...] | None:
        """The animals that stay, or None for all."""
        indices = [step.indices for step in self.steps if isinstance(step, Keep)]
        return indices[-1] if indices else None

    def stages(self) -> tuple[Pass | Local, ...]:
        """The steps, fused into as few readings of the pixels as their order allows."""
        return tuple(fused(self.steps, self.image_hw))


def fused(steps: Iterable[Step], image_hw: tuple[int, int]) -> list[Pass | Local]:
    """The stages of some steps: neighbouring maps and colour matrices are multiplied.

    Blur, noise, erasing and kornia's pixel operations stay where they are. Maps of pixels and
    affine maps of colours commute, but for the border: the fused pass colours the fill as well.

    Raises:
        ConfigError: a colour change comes after the standardisation, which has no [0, 1] any more.

    """
    stages: list[Pass | Local] = []
    pending = Pass(None, image_hw)
    standardised = False
    for step in steps:
        if isinstance(step, Keep):
            continue
        if standardised and not isinstance(step, Warp):
            raise ConfigError(f"{type(step).__name__} comes after Normalize: put Normalize last")
        if isinstance(step, Warp):
            H = step.H_out_in if pending.H_out_in is None else step.H_out_in @ pending.H_out_in
            pending = Pass(H, step.image_hw, pending.colour, pending.standardise)
        elif isinstance(step, Colour):
            matrix = (
                step.matrix
                if pending.colour is None
                else compose_colours(step.matrix, pending.colour)
            )
            pending = Pass(pending.H_out_in, pending.image_hw, matrix)
        elif isinstance(step, Standardise):
            standardised = True
            pending = Pass(pending.H_out_in, pending.image_hw, pending.colour, step)
        else:
            stages += [step] if pending.idle else [pending, step]
            pending = Pass(None, pending.image_hw)
    return stages if pending.idle else [*stages, pending]


def compose_colours(after: np.ndarray, before: np.ndarray) -> np.ndarray:
    """The (3, 4) colour map that does first before, then after."""
    return np.concatenate(
        (after[:, :3] @ before[:, :3], after[:, :3] @ before[:, 3:] + after[:, 3:]), axis=1
    )
