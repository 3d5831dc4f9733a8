"""How many examples the laws get.

What is asked for in CI, ten times that in the nightly profile (HYPOTHESIS_PROFILE=nightly).
"""

import os
from collections.abc import Callable
from typing import Any

from hypothesis import settings


def thorough(examples: int) -> Callable[[Any], Any]:
    return settings(
        max_examples=examples * (10 if os.environ.get("HYPOTHESIS_PROFILE") == "nightly" else 1)
    )
