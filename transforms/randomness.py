"""One generator a sample, a function of (seed, epoch, index) alone, and checks of options."""

from collections.abc import Sequence

import numpy as np
import torch

from animal3dbox.errors import ConfigError

SampleKey = tuple[int, ...]
"""The name of a draw, usually (epoch, index); whole numbers >= 0."""
SEEDS = 2**62
"""How many seeds there are for a step that draws by itself, such as noise."""


def sample_generator(seed: int, key: SampleKey | None) -> np.random.Generator:
    """The generator of one sample, from which all its transforms draw.

    Args:
        seed: of the pipeline, >= 0.
        key: (epoch, index) of the sample, or any whole numbers; the result depends on nothing else,
            so batch size and workers do not matter. None draws the key from torch's default
            generator, which a DataLoader seeds for each worker and epoch.

    Raises:
        ConfigError: a number is negative or not whole.

    """
    numbers = (int(torch.randint(SEEDS, ()).item()),) if key is None else key
    if any(isinstance(n, bool) or int(n) != n or n < 0 for n in (seed, *numbers)):
        raise ConfigError(
            f"seed and sample_key must be whole numbers >= 0, got seed {seed!r} and sample_key"
            f" {key!r}"
        )
    return np.random.default_rng([int(n) for n in (seed, *numbers)])


def check_range(
    name: str,
    value: float | Sequence[float],
    *,
    about: float | None = 0.0,
    least: float | None = None,
) -> tuple[float, float]:
    """A range of draws: a number x means [about - x, about + x]; without about it must be a pair.

    Args:
        name: of the option, for the message.
        value: a number or a (low, high) pair.
        about: the value that changes nothing.
        least: the least value that the range may reach.

    Raises:
        ConfigError: the range is reversed, not finite, or reaches below least.

    """
    pair = tuple(value) if isinstance(value, tuple | list) else None
    if (pair is None and (about is None or isinstance(value, str | bool))) or (
        pair is not None and len(pair) != 2
    ):
        raise ConfigError(
            f"{name} must be a (low, high) pair{'' if about is None else ' or a number'}, got"
            f" {value!r}"
        )
    middle, reach = about or 0.0, float(value) if pair is None else 0.0  # type: ignore[arg-type]
    low, high = pair or (middle - reach, middle + reach)
    if pair is None and least is not None:
        low = max(low, least)
    if (
        not (np.isfinite(low) and np.isfinite(high))
        or low > high
        or (least is not None and low < least)
    ):
        order = "finite and in order" + (f", not below {least}" if least is not None else "")
        raise ConfigError(f"{name} must be a number or a (low, high) pair, {order}, got {value!r}")
    return float(low), float(high)


def check_probability(name: str, value: float) -> float:
    """A probability, or a ConfigError that names the option."""
    if not 0 <= value <= 1:
        raise ConfigError(f"{name} must lie in [0, 1], got {value!r}")
    return float(value)
