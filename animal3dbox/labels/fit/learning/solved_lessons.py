"""From the summed equations of a dataset's animals to its lessons."""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from animal3dbox.labels.fit.fit_body import PLACES_SD
from animal3dbox.labels.fit.learning.lessons import Lessons, usual_shape
from animal3dbox.labels.fit.learning.shared_equations import SharedEquations
from animal3dbox.labels.fit.shape_prior import within_species

Array = NDArray[np.float64]
OFFSET_SD = 0.04
"""Standard deviation of a keypoint's place from the body's, in trunk lengths."""
KNOWN_CLASS_SCATTER = 2.0
"""Standard deviation of a class's mean from its preset, by that of a known species."""
SD_ANIMALS, SCATTER_ANIMALS = 10.0, 20.0
"""So many animals' evidence is what is usual worth: of a keypoint's deviation, and of the scatter
of shapes."""
LEAST_SD = 0.003
"""Least deviation that keypoints have beside their noise, by the extent."""
DOUBTFUL_MISFIT = 2.0
"""A fit whose keypoints are off by more, by what their noise lets expect, counts less."""


@dataclass
class LessonSums:
    """The equations of all animals of a dataset, added up as they come.

    Attributes:
        offsets: how many free numbers the offsets have.
        H: category -> (G, G); "" of the animals without a class that is learned.
        h: category -> (G,).
        apart: (L,) weighted squares of keypoints about their places, by the extent, less noise.
        seen: (L,) their weights.
        shape_square: weighted sum of SharedEquations.shape_square, of animals of classes.
        shaped: its weight.
    """

    offsets: int
    H: dict[str, Array] = field(default_factory=dict)
    h: dict[str, Array] = field(default_factory=dict)
    apart: Array | float = 0.0
    seen: Array | float = 0.0
    shape_square: float = 0.0
    shaped: float = 0.0

    def add(
        self,
        equations: SharedEquations,
        *,
        category: str,
        sureness: Array,
        noise: Array,
        extent: Array,
    ) -> None:
        """Add the equations of some animals of one class, each by how far it is to be trusted.

        Args:
            equations: of A animals.
            category: of all; "" if its shape is not learned.
            sureness: (A,) of their orientations.
            noise: (A, L) px, of the keypoints.
            extent: (A,) px.

        """
        trust = sureness / np.maximum(equations.misfit / DOUBTFUL_MISFIT, 1.0) ** 2
        H = (trust[:, None, None] * equations.H).sum(0)
        h = (trust[:, None] * equations.h).sum(0)
        self.H[category] = self.H[category] + H if category in self.H else H
        self.h[category] = self.h[category] + h if category in self.h else h
        weight = trust[:, None] * equations.factor
        self.apart = self.apart + (
            weight * (equations.apart - noise**2) / extent[:, None] ** 2
        ).sum(0)
        self.seen = self.seen + weight.sum(0)
        if category:
            self.shape_square += float(trust @ equations.shape_square)
            self.shaped += float(trust.sum())


def solved_lessons(lessons: Lessons, sums: LessonSums) -> Lessons:
    """The lessons after one step of Gauss-Newton, their deviations after one of EM."""
    step = _step(lessons, sums)
    count = sums.offsets if lessons.offsets is not None else 0
    means = {}
    for k, category in enumerate(sorted(lessons.means)):
        size = len(lessons.means[category])
        own = step[count + k * size : count + (k + 1) * size]
        means[category] = lessons.means[category] + own
    scatter = lessons.scatter
    if sums.shaped:
        usual = SCATTER_ANIMALS
        square = scatter**2 * sums.shape_square
        scatter = float(np.sqrt((usual + square) / (usual + sums.shaped)))
    return replace(
        lessons,
        offsets=None if lessons.offsets is None else lessons.offsets + step[:count],
        sd=lessons.sd if lessons.offsets is None else _deviations(lessons, sums),
        means=means,
        scatter=scatter,
    )


def _step(lessons: Lessons, sums: LessonSums) -> Array:
    """The step of the offsets' free numbers, if they are learned, then of each class's mean."""
    is_free = lessons.offsets is not None
    count = sums.offsets if is_free else 0
    categories = sorted(lessons.means)
    size = len(next(iter(lessons.means.values()))) if categories else 0
    H = np.zeros((count + size * len(categories), count + size * len(categories)))
    h = np.zeros(len(H))
    if lessons.offsets is not None:
        H[:count, :count] = np.eye(count) / OFFSET_SD**2
        h[:count] = lessons.offsets / OFFSET_SD**2
        for category in sorted(sums.H):
            H[:count, :count] += sums.H[category][:count, :count]
            h[:count] += sums.h[category][:count]
    for k, category in enumerate(categories):
        own = slice(count + k * size, count + (k + 1) * size)
        precision = _class_precision(lessons, category)
        H[own, own] = precision
        usual = usual_shape(lessons.model, lessons.presets[category])
        h[own] = precision @ (lessons.means[category] - usual)
        if category in sums.H:
            shared = sums.H[category]
            H[own, own] += shared[sums.offsets :, sums.offsets :]
            h[own] += sums.h[category][sums.offsets :]
            if count:
                H[own, :count] = shared[sums.offsets :, : sums.offsets]
                H[:count, own] = H[own, :count].T
    return np.asarray(-np.linalg.solve(H, h), dtype=np.float64)


def _class_precision(lessons: Lessons, category: str) -> Array:
    """The inverse covariance (S, S) of a class's mean about what is usual."""
    if lessons.presets[category] is None:
        return np.eye(len(lessons.means[category]))
    covariance = KNOWN_CLASS_SCATTER**2 * within_species(lessons.model)
    return np.asarray(np.linalg.inv(covariance), dtype=np.float64)


def _deviations(lessons: Lessons, sums: LessonSums) -> Array:
    """The deviations (L,) of keypoints about their places, alike left and right."""
    twin = list(lessons.vocabulary.flip)
    apart, seen = np.asarray(sums.apart), np.asarray(sums.seen)
    pairs = (apart + apart[twin], seen + seen[twin])
    square = (SD_ANIMALS * PLACES_SD**2 + pairs[0] / 2) / (SD_ANIMALS + pairs[1] / 2)
    deviations: Array = np.sqrt(np.maximum(square, LEAST_SD**2))
    return deviations
