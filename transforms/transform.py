"""The base of all transforms: draw once, then apply what was drawn."""

from collections.abc import Mapping
from typing import Any, overload

import numpy as np

from animal3dbox.transforms.draw_context import DrawContext
from animal3dbox.transforms.pipeline import PipelineOptions, run_pipeline
from animal3dbox.transforms.randomness import SampleKey, check_probability
from animal3dbox.transforms.rendering.images import AnyImage
from animal3dbox.transforms.steps import Step


class Transform:
    """The base class of all augmentations; derive your own from it.

    A transform never touches pixels or labels. It draws steps (`Warp`, `Colour`, `Erase`, ... of
    animal3dbox.transforms.steps) for one picture, and the pipeline does the rest: it fuses the
    steps of all its transforms, reads the pixels once, and moves the camera, the cuboids and every
    other field by the camera law. Called on its own, a transform is a pipeline of one.

    There are two methods to override:

    - `steps` draws. It is all that most transforms need; `p` is dealt with already.
    - `sample` decides whether to draw at all. Override it only if a coin with probability p is not
      the right question.

    Attributes:
        p: probability of doing anything.
        mirrors: whether it may mirror the picture, so that mirror="forbid" can refuse it.
        geometric: whether it may move pixels.
        allow_skew: whether it gives the camera a skew K[0, 1], which its user has agreed to.

    Example:
        >>> from animal3dbox.transforms.camera_law.maps import shifting
        >>> from animal3dbox.transforms.steps import Warp
        >>> class RandomShift(Transform):
        ...     geometric = True
        ...     def steps(self, rng, context):
        ...         shift_px = int(rng.integers(1, 9))
        ...         return (Warp(shifting(shift_px, 0), context.image_hw),)
        >>> K = np.array([[90.0, 0, 31.5], [0, 90, 23.5], [0, 0, 1]])
        >>> image, target = RandomShift()(np.zeros((48, 64, 3), np.uint8), {"K": K}, key=(0, 7))
        >>> float(target["K"][0, 2] - K[0, 2]) == float(target["H_out_in"][0, 2])
        True
    """

    p: float = 1.0
    mirrors: bool = False
    geometric: bool = False
    allow_skew: bool = False

    def __init__(self, p: float = 1.0) -> None:
        self.p = check_probability("p", p)

    def sample(self, rng: np.random.Generator, context: DrawContext) -> tuple[Step, ...]:
        """Draw this transform's steps for one picture; nothing else in a transform is random.

        Args:
            rng: the sample's own generator.
            context: the picture by now: its size, its camera, its boxes.

        Returns:
            The steps in their order; none if the coin says so.
        """
        # The coin is not tossed at p = 1: the draws of a transform that always happens shall not
        # depend on whether it could have been left out.
        if self.p < 1 and rng.random() >= self.p:
            return ()
        return self.steps(rng, context)

    def steps(self, rng: np.random.Generator, context: DrawContext) -> tuple[Step, ...]:
        """Draw the steps, once it is decided that the transform happens; to be overridden.

        Args:
            rng: the sample's own generator.
            context: the picture by now; nothing has been rendered yet.
        """
        raise NotImplementedError

    @property
    def options(self) -> PipelineOptions:
        """The options under which this transform runs when it is called on its own."""
        return PipelineOptions(allow_skew=self.allow_skew)

    @overload
    def __call__(
        self, image: AnyImage, target: None = None, key: SampleKey | None = None
    ) -> AnyImage: ...

    @overload
    def __call__(
        self, image: AnyImage, target: Mapping[str, Any], key: SampleKey | None = None
    ) -> tuple[AnyImage, dict[str, Any]]: ...

    def __call__(
        self,
        image: AnyImage,
        target: Mapping[str, Any] | None = None,
        key: SampleKey | None = None,
    ) -> AnyImage | tuple[AnyImage, dict[str, Any]]:
        """Transform one image and its target, or an image alone.

        A transform on its own counts pixels from their centres; a Compose may say otherwise
        (pixel_origin).

        Args:
            image: (C, H, W) tensor or (H, W, C) array, uint8 (0 to 255) or float (0 to 1).
            target: a plain dict, see Compose; it is left as it was. None: there is none.
            key: (epoch, index) of the sample; without it `target["meta"]["sample_key"]`; without
                that torch's default generator decides.

        Returns:
            The image and the target, in the form in which they came; the image alone without a
            target.

        Raises:
            SampleError: naming the sample and the field that is wrong or cannot follow.
        """
        given = {} if target is None else target
        result = run_pipeline(self.sample, image, given, options=self.options, key=key)
        return result[0] if target is None else result

    def __repr__(self) -> str:
        options = ", ".join(
            f"{name}={value!r}" for name, value in vars(self).items() if not name.startswith("_")
        )
        return f"{type(self).__name__}({options})"
