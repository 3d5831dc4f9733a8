"""How probable it is that a label's cuboid is right, and how far off it is to be expected.

The probability is a logistic function of what the pose says of itself (FEATURES); the expected
error is the exponential of a linear one. Their coefficients lie in assets/confidence.json beside
the command that made them, the mix of animals that they were made with, and its base rate:
`python benchmarks/fit_confidence.py`. With another share of bad labels than that base rate the
probability is off; docs/confidence.md says by how much.
"""

import math
from dataclasses import dataclass
from functools import cache
from importlib import resources

import msgspec
import numpy as np
from numpy.typing import NDArray

from animal3dbox.labels.pose.problem import AS_GIVEN
from animal3dbox.labels.types import Quality

Array = NDArray[np.float64]
FEATURES = (
    "constant",
    "log of the silhouettes' difference",
    "log of the rotation's sd",
    "runner-up",
    "hidden keypoints",
    "log of the misfit",
    "sd of the focal length",
    "exchanged sides",
    "keypoints that do not fit",
    "no template",
    "log of the number of keypoints",
    "seen from below",
    "rolled",
)
LEAST_DIFFERENCE = 0.02
"""Added to 1 - IoU before its logarithm: two renderers of one body differ by about as much."""
LEAST_SD_DEG = 0.3
"""Added to the rotation's standard deviation, in degrees, before its logarithm."""
MOST_RUNNER_UP = 20.0
"""What a runner-up costs more at most, and what one costs that was not found."""


@dataclass(frozen=True)
class Confidence:
    """How far a label may be trusted.

    Attributes:
        probability: that the cuboid is turned by less than 15 degrees from the trunk's truth.
        corner_error: expected mean distance of the corners from the true ones, as a part of the
            box's diagonal, beside distance and size, which one camera does not see; None of a pose
            that was given.
    """

    probability: float
    corner_error: float | None


def confidence_of(quality: Quality, *, has_template: bool, is_rigid: bool) -> Confidence:
    """The confidence in a label; that of its axes alone if its pose was given exactly.

    Args:
        quality: of the label, of method "default".
        has_template: whether the body's vertices correspond to a template, which tells its axes.
        is_rigid: whether the body is another animal's or in another pose, and says so by
            landmark_sigma.

    """
    stored = coefficients()
    if quality.rotation_sd_deg is None:
        return Confidence(stored.axes["template" if has_template else "landmarks"], None)
    own = stored.kinds[kind_of(quality, is_rigid=is_rigid)]
    x = features(quality, has_template=has_template)
    score = float(np.array(own.weights) @ x)
    log_error = float(np.array(own.corner_weights) @ x)
    return Confidence(
        1 / (1 + math.exp(-min(max(score, -30.0), 30.0))),
        min(own.corner_factor * math.exp(min(log_error, 2.0)), 1.0),
    )


def kind_of(quality: Quality, *, is_rigid: bool) -> str:
    """Which coefficients are a label's: of its kind of body, with a mask or without."""
    body = "fit" if quality.body == "fit" else "rigid" if is_rigid else "own"
    return body if quality.mask_iou is None else f"{body}+mask"


def features(quality: Quality, *, has_template: bool) -> Array:
    """The values of FEATURES, (F,), of a label with an estimated pose."""
    runner_up = MOST_RUNNER_UP if quality.runner_up is None else quality.runner_up
    difference = 0.0
    if quality.mask_iou is not None:
        difference = math.log(1 - quality.mask_iou + LEAST_DIFFERENCE)
    return np.array(
        [
            1.0,
            difference,
            math.log((quality.rotation_sd_deg or 0.0) + LEAST_SD_DEG),
            min(max(runner_up, 0.0), MOST_RUNNER_UP) / 10,
            quality.hidden or 0.0,
            math.log(quality.misfit or 1.0),
            quality.log_focal_sd or 0.0,
            float(quality.labeling != AS_GIVEN),
            1 - quality.n_inliers / max(quality.n_keypoints, 1),
            float(not has_template),
            math.log(max(quality.n_keypoints, 1)),
            float("from_below" in quality.flags),
            float("rolled" in quality.flags),
        ]
    )


class KindCoefficients(msgspec.Struct, forbid_unknown_fields=True):
    """The coefficients of one kind of labels, (F,) each in the order of FEATURES.

    Attributes:
        weights: of the probability's logit.
        corner_weights: of the logarithm of the corner error.
        corner_factor: by which its exponential is multiplied to be the mean.
        n: animals that they were made with.
        bad: part of these whose label was bad: the base rate.
    """

    weights: tuple[float, ...]
    corner_weights: tuple[float, ...]
    corner_factor: float
    n: int
    bad: float


class Coefficients(msgspec.Struct, forbid_unknown_fields=True):
    """What assets/confidence.json holds.

    Attributes:
        command: that made it.
        mix: of which animals.
        features: FEATURES, in the order of the weights.
        kinds: kind_of -> coefficients.
        axes: probability that the axes alone are right, with a "template" and by "landmarks".
    """

    command: str
    mix: str
    features: tuple[str, ...]
    kinds: dict[str, KindCoefficients]
    axes: dict[str, float]


@cache
def coefficients() -> Coefficients:
    """The shipped coefficients."""
    asset = resources.files("animal3dbox.labels").joinpath("assets", "confidence.json")
    return msgspec.json.decode(asset.read_bytes(), type=Coefficients)
