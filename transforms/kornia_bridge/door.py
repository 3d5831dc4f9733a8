"""Anything that a pipeline may be made of, as one of our transforms.

kornia is imported only for those who use it.
"""

from typing import Any

from animal3dbox.errors import ConfigError
from animal3dbox.transforms.transform import Transform


def as_transform(transform: Any) -> Transform:
    """One of ours as it is, or a kornia augmentation in its adapter.

    Raises:
        ConfigError: it is neither, or kornia cannot say what it does to the camera.

    """
    if isinstance(transform, Transform):
        return transform
    homes = {kind.__module__.split(".")[0] for kind in type(transform).__mro__}
    if "kornia" in homes:
        from animal3dbox.transforms.kornia_bridge.kornia_transform import KorniaTransform

        return KorniaTransform(transform)
    if "torch" in homes:
        raise ConfigError(
            f"{type(transform).__name__} is a module that cannot say what it does to the camera;"
            " take a transform of animal3dbox.transforms, or derive it from kornia's"
            " IntensityAugmentationBase2D if it changes colours only"
        )
    raise ConfigError(
        f"{transform!r} is no transform: take one of animal3dbox.transforms, or an augmentation of"
        " kornia"
    )
