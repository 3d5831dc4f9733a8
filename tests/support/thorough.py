"""How many examples the laws get, by the profile that HYPOTHESIS_PROFILE names (tests/conftest.py).

"ci", the default: as many as a law asks for; "fast": ten; "nightly": ten times as many.
"""

import os
from collections.abc import Callable
from typing import Any

from hypothesis import settings

PROFILE = os.environ.get("HYPOTHESIS_PROFILE", "ci")
FAST_EXAMPLES = 10
NIGHTLY_FACTOR = 10


def examples_under(profile: str, examples: int) -> int:
    """How many examples a law gets that asks for so many."""
    if profile == "nightly":
        return NIGHTLY_FACTOR * examples
    return min(examples, FAST_EXAMPLES) if profile == "fast" else examples


def thorough(examples: int) -> Callable[[Any], Any]:
    """Give a law so many examples, in the profile's measure."""
    return settings(max_examples=examples_under(PROFILE, examples))
