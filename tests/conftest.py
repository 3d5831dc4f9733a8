"""What every test shares: one thread each, so that two workers do not fight for two cores."""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import cv2
import hypothesis
import torch

torch.set_num_threads(1)
cv2.setNumThreads(1)
hypothesis.settings.register_profile("ci", deadline=None, derandomize=True, max_examples=100, database=None)
hypothesis.settings.register_profile("nightly", deadline=None, max_examples=10_000)
hypothesis.settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "ci"))
