"""The base of all transforms: draw once, then apply what was drawn."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from animal3dbox.transforms.randomness import check_probability
from animal3dbox.transforms.rendering.images import AnyImage
from animal3dbox.transforms.steps import Step
from animal3dbox.transforms.view import View


class Transform:
    """One augmentation.

    A subclass draws in steps(); a pipeline (Compose) asks each of its transforms for steps, fuses
    them, and touches the pixels once. Called on its own, a transform is a pipeline of one.

    Attributes:
        p: probability of doing anything.
        mirrors: whether it may mirror the picture.
        geometric: whether it may move pixels.
    """

    p: float = 1.0
    mirrors: bool = False
    geometric: bool = False

    def __init__(self, p: float = 1.0) -> None:
        self.p = check_probability("p", p)

    def sample(self, rng: np.random.Generator, view: View) -> tuple[Step, ...]:
        """Draw this transform's steps for one picture; the only random line.

        Args:
            rng: of the sample.
            view: the picture by now.

        """
        if self.p < 1 and rng.random() >= self.p:
            return ()
        return self.steps(rng, view)

    def steps(self, rng: np.random.Generator, view: View) -> tuple[Step, ...]:
        """The steps, once it is decided that the transform happens."""
        raise NotImplementedError

    def __call__(
        self, image: AnyImage, target: Mapping[str, Any]
    ) -> tuple[AnyImage, dict[str, Any]]:
        """Transform one image and its target; see Compose."""
        from animal3dbox.transforms.compose import Compose  # Compose is itself made of transforms

        return Compose([self])(image, target)

    def __repr__(self) -> str:
        options = ", ".join(
            f"{name}={value!r}" for name, value in vars(self).items() if not name.startswith("_")
        )
        return f"{type(self).__name__}({options})"
