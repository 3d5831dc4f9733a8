"""How far predictions that found their animal are from it, pair by pair.

Each function gives numbers (P,) of P pairs; NaN where a pair does not say.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from animal3dbox.training.metrics.box_table import BoxTable, Floats, Whole

LATERAL_SINE = 0.35
"""The sine of the azimuth from which on an animal shows a flank: 20.5 degrees off its axis."""
Pairs = tuple[Whole, Whole]
"""The predictions (P,) and the truths (P,) of pairs."""


def heading_errors_deg(predictions: BoxTable, truths: BoxTable, pairs: Pairs) -> Floats:
    """The angle between the forward axes, 0 to 180 degrees; NaN where a front is not known."""
    of_prediction, of_truth = pairs
    a, b = predictions.rotation[of_prediction, :, 0], truths.rotation[of_truth, :, 0]
    # From sine and cosine: exact near 0 and near 180
    sine, cosine = np.linalg.norm(np.cross(a, b), axis=1), (a * b).sum(1)
    return np.where(headings_known(predictions, truths, pairs), _degrees(sine, cosine), np.nan)


def headings_known(predictions: BoxTable, truths: BoxTable, pairs: Pairs) -> NDArray[np.bool_]:
    """Which pairs (P,) know the front of both boxes."""
    return np.asarray(predictions.heading_known[pairs[0]] & truths.heading_known[pairs[1]])


def _degrees(sine: Floats, cosine: Floats) -> Floats:
    return np.degrees(np.arctan2(sine, cosine))


def corner_errors(predictions: BoxTable, truths: BoxTable, pairs: Pairs) -> Floats:
    """The mean distance of the same corners over the truth's diagonal; NaN without a front."""
    of_prediction, of_truth = pairs
    apart = predictions.corners[of_prediction] - truths.corners[of_truth]
    mean = np.linalg.norm(apart, axis=2).mean(1) / _diagonals(truths, of_truth)
    return np.where(headings_known(predictions, truths, pairs), mean, np.nan)


def hungarian_distances(predictions: BoxTable, truths: BoxTable, pairs: Pairs) -> Floats:
    """The mean distance of corners over the truth's diagonal, under the cheapest assignment."""
    of_prediction, of_truth = pairs
    a, b = predictions.corners[of_prediction], truths.corners[of_truth]
    costs = np.linalg.norm(a[:, :, None] - b[:, None], axis=3)  # (P, 8, 8)
    means = [cost[linear_sum_assignment(cost)].mean() for cost in costs]
    return np.asarray(means, dtype=np.float64) / _diagonals(truths, of_truth)


def _diagonals(truths: BoxTable, of_truth: Whole) -> Floats:
    """The space diagonals (P,) of the true boxes."""
    return np.asarray(np.linalg.norm(truths.size[of_truth], axis=1))


def size_errors(predictions: BoxTable, truths: BoxTable, pairs: Pairs) -> Floats:
    """How much too large or small length, width and height are, as parts of the truth's, (P, 3)."""
    true = truths.size[pairs[1]]
    return np.asarray(np.abs(predictions.size[pairs[0]] - true) / true)


def distance_errors(predictions: BoxTable, truths: BoxTable, pairs: Pairs) -> Floats:
    """The difference of the distances from the camera, in the unit of the boxes."""
    return np.asarray(np.abs(predictions.distance[pairs[0]] - truths.distance[pairs[1]]))


def flanks_right(predictions: BoxTable, truths: BoxTable, pairs: Pairs) -> Floats:
    """Whether a prediction names the flank that is seen, 1 or 0.

    NaN where the camera stands within 20.5 degrees of the animal's axis, |sin azimuth| < 0.35, or
    the truth is undecided, or a front is not known.
    """
    of_prediction, of_truth = pairs
    forward, left = _towards_camera(truths)
    level = np.hypot(forward, left)
    lateral = np.abs(left) >= np.maximum(LATERAL_SINE * level, np.finfo(np.float64).tiny)
    true = _flanks(truths)
    known = headings_known(predictions, truths, pairs) & (lateral & (true > 0))[of_truth]
    right = _flanks(predictions)[of_prediction] == true[of_truth]
    return np.where(known, right, np.nan)


def _towards_camera(boxes: BoxTable) -> tuple[Floats, Floats]:
    """How far forward and to the left of each animal the camera stands, (N,) each, in its axes."""
    in_box = -(boxes.rotation.mT @ boxes.center[:, :, None])[:, :, 0]
    return in_box[:, 0], in_box[:, 1]


def _flanks(boxes: BoxTable) -> Floats:
    """The flanks (N,) that boxes say are seen, 0, 1 left, 2 right; else those they turn to us."""
    _, left = _towards_camera(boxes)
    return np.where(np.isnan(boxes.flank), np.where(left > 0, 1.0, 2.0), boxes.flank)


def share_errors(predictions: BoxTable, truths: BoxTable, pairs: Pairs) -> Floats:
    """The part of the visible area that lies on other faces: half the sum of differences."""
    apart = np.abs(predictions.face_share[pairs[0]] - truths.face_share[pairs[1]])
    return np.asarray(apart.sum(1) / 2)
