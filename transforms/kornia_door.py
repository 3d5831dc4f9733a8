"""Anything that a pipeline may be made of, as one of our transforms."""

from typing import Any

from animal3dbox.errors import ConfigError
from animal3dbox.transforms.transform import Transform


def as_transform(transform: Any) -> Transform:
    """One of ours as it is.

    Raises:
        ConfigError: it is none.

    """
    if isinstance(transform, Transform):
        return transform
    raise ConfigError(f"{transform!r} is no transform: take one of animal3dbox.transforms")
