"""How much an evaluation does, and which methods it compares.

Example:
    >>> list(METHODS)
    ['basic', 'paper (vector)', 'paper (literal)', 'default']
    >>> METHODS["paper (literal)"].residual
    'literal'
"""

from dataclasses import dataclass, field

from animal3dbox.datasets.synthetic.world.config import WorldConfig
from animal3dbox.errors import ConfigError
from animal3dbox.labels.config import LabelConfig

METHODS = {
    "basic": LabelConfig(method="basic"),
    "paper (vector)": LabelConfig(method="paper", residual="vector"),
    "paper (literal)": LabelConfig(method="paper", residual="literal"),
    "default": LabelConfig(),
}
"""Camera poses that are compared: the baseline, the paper's in both readings of E_total, ours."""


@dataclass(frozen=True)
class EvaluateConfig:
    """How much is evaluated.

    The protocols themselves are fixed in their modules, so that results can be compared.

    Attributes:
        animals: how many; each is the one that a scene's camera aims at, with its neighbours and
            occluders.
        seed: of the world, of its faults and of all noise.
        every: each so many-th animal goes through the costly parts too: the whole dial of faults,
            and noise through the whole pipeline.
        world: what the scenes are like.
        fits: so many of the first animals are also fitted, on worlds of their own; costly.

    Example:
        >>> config = EvaluateConfig(animals=20)
        >>> config.every, config.world.image_hw  # two animals go through the costly parts
        (10, (480, 640))
    """

    animals: int = 500
    seed: int = 0
    every: int = 10
    world: WorldConfig = field(default_factory=WorldConfig)
    fits: int = 0

    def __post_init__(self) -> None:
        if self.animals < 1 or self.every < 1 or self.seed < 0:
            raise ConfigError(
                f"animals and every must be at least 1 and seed not negative, got {self.animals},"
                f" {self.every} and {self.seed}"
            )
        if not 0 <= self.fits <= self.animals:
            raise ConfigError(
                f"fits must be 0 to {self.animals}, which is the number of animals, got {self.fits}"
            )
