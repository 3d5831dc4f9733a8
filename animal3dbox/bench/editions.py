"""The editions and tracks of a benchmark by name, without anything that `--help` would wait for."""

from typing import Literal, get_args

Edition = Literal["full", "small"]
"""The edition to train and report with, and the one of 300 images to try things with."""
EDITIONS: tuple[Edition, ...] = get_args(Edition)
Track = Literal["image", "K", "box", "keypoints"]
"""What a method may look at: the image alone, or K too, or 2D boxes too, or keypoints too."""
Baseline = Literal["constant", "nearest", "labels-fit", "labels-preset"]
"""Methods that come with the benchmark; see baselines.py."""
