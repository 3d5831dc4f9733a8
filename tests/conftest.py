"""What every test shares: one thread each, so that two workers do not fight for two cores.

And a small dataset to read and to spoil.
"""

import os
import shutil
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import cv2
import hypothesis
import pytest
import torch
from small_animals import model_of, write_small_animals

torch.set_num_threads(1)
cv2.setNumThreads(1)
hypothesis.settings.register_profile(
    "ci", deadline=None, derandomize=True, max_examples=100, database=None
)
hypothesis.settings.register_profile("nightly", deadline=None, max_examples=10_000)
hypothesis.settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "ci"))


@pytest.fixture(scope="session")
def animals(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Eight pictures; leave them as they are."""
    return write_small_animals(tmp_path_factory.mktemp("animals") / "set")


@pytest.fixture
def copied(animals: Path, tmp_path: Path) -> Path:
    """A copy of your own."""
    shutil.copytree(animals, tmp_path / "set")
    shutil.copy(model_of(animals), model_of(tmp_path / "set"))
    return tmp_path / "set"
