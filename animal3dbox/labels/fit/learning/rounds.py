"""The rounds of learning: fits of all animals, then solving for what they share, and again."""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from animal3dbox.errors import ConfigError
from animal3dbox.labels.calibration import Calibration
from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.fit.fit import AT_ONCE, fit_many
from animal3dbox.labels.fit.fit_body import FitBody
from animal3dbox.labels.fit.fitted_body import FittedBody
from animal3dbox.labels.fit.learning.found_fits import FoundFits, found_fits, joined_fits
from animal3dbox.labels.fit.learning.lessons import Lessons, first_lessons
from animal3dbox.labels.fit.learning.mirrored_offsets import offset_basis
from animal3dbox.labels.fit.learning.shared_equations import shared_equations
from animal3dbox.labels.fit.learning.solved_lessons import LessonSums, solved_lessons
from animal3dbox.labels.fit.mask_target import mask_target
from animal3dbox.labels.fit.problem import joined
from animal3dbox.labels.fit.request import FitRequest, fit_request
from animal3dbox.labels.fit.schedule import refined_fits
from animal3dbox.labels.fit.shape_prior import shape_prior

Array = NDArray[np.float64]
Animals = Sequence[Mapping[str, Any]]
FitBatch = Callable[[Animals, LabelConfig, Calibration], FoundFits]
LEAST_TAUGHT, LEAST_OF_CLASS = 30, 10
"""Fewest animals of a vocabulary that teach, and of a class that has a shape of its own."""
FIT_ROUNDS = 2
"""How often all animals are fitted from the start."""
SOLVE_ROUNDS, REFINE_ROUNDS = 4, 3
"""How often the shared numbers are solved for after that, and before each time the rounds of the
descent by which every animal is refined."""


def learn_bodies(
    animals: Animals,
    config: LabelConfig | None = None,
    *,
    places: bool = True,
    shapes: bool = True,
    fit_batch: FitBatch | None = None,
    watch: Callable[[int], None] | None = None,
) -> Calibration:
    """Learn from a dataset's 2D where its keypoints lie, and what shapes its classes have.

    Every animal's own camera, pose and shape are marginalised exactly, as far as its cost is a
    quadratic form near its fit. Doubtful fits count less. docs/solver.md has the formulas.

    Args:
        animals: fit_animal's arguments by name, without config and calibration, of one vocabulary
            and one model; `category` tells the classes. Read several times, some at once: a
            sequence may make them when asked.
        config: as fit_animal's.
        places: whether keypoints' places are learned.
        shapes: whether the shapes of classes with LEAST_OF_CLASS animals or more are learned.
        fit_batch: makes the fits of some animals, as fits_of_batch does: to keep them in files.
        watch: told, again and again, how many animals more have been fitted or solved for; in all
            it is work_of(len(animals)).

    Returns:
        A calibration with places and shapes.

    Raises:
        ConfigError: fewer than LEAST_TAUGHT animals, or nothing is to be learned.
        SampleError: an animal's arguments are wrong, or no body can be fitted to it.

    Example:
        >>> learn_bodies([])
        Traceback (most recent call last):
        ...
        animal3dbox.errors.ConfigError: 0 animals: places and shapes are learned from 30 on
    """
    config, fit = config or LabelConfig(), fit_batch or fits_of_batch
    if len(animals) < LEAST_TAUGHT:
        raise ConfigError(
            f"{len(animals)} animals: places and shapes are learned from {LEAST_TAUGHT} on"
        )
    lessons = _first_lessons(animals, config, places=places, shapes=shapes)
    for number in range(FIT_ROUNDS):
        calibration = lessons.calibration if number else Calibration()
        parts = []
        for batch in _batches(list(range(len(animals)))):
            parts.append(fit([animals[i] for i in batch], config, calibration))
            if watch is not None:
                watch(len(batch))
        fits = joined_fits(parts)
        if not number:
            lessons = with_means_of(lessons, animals, fits)
        for _ in range(SOLVE_ROUNDS):
            lessons, fits = solve_from_fits(lessons, animals, fits, config)
            if watch is not None:
                watch(len(animals))
    return lessons.calibration


def work_of(count: int) -> int:
    """What learn_bodies's `watch` is told in all for so many animals."""
    return count * FIT_ROUNDS * (1 + SOLVE_ROUNDS)


def fits_of_batch(animals: Animals, config: LabelConfig, calibration: Calibration) -> FoundFits:
    """The fits of some animals with what has been learned so far.

    Raises:
        ConfigError: no body can be fitted to one of them.

    """
    fits = fit_many([{**animal, "calibration": calibration} for animal in animals], config)
    bodies = [fit for fit in fits if isinstance(fit, FittedBody)]
    if len(bodies) < len(fits):
        raise ConfigError("animals to which no body can be fitted teach nothing: leave them out")
    return found_fits(bodies)


def solve_from_fits(
    lessons: Lessons, animals: Animals, fits: FoundFits, config: LabelConfig
) -> tuple[Lessons, FoundFits]:
    """The lessons one step further, and the fits refined with the lessons that were given.

    Args:
        lessons: those so far.
        animals: as learn_bodies's.
        fits: of these animals.
        config: as fit_animal's.

    """
    sums = LessonSums(offset_basis(lessons.vocabulary).shape[1])
    for category, species, members in _groups(animals):
        body, whole = lessons.body(category, species), lessons.whole_body(category)
        for batch in _batches(members):
            ids = np.array(batch)
            requests = [_request(animals[i], body, config) for i in batch]
            refined = _studied(requests, fits[ids], whole, sums=sums, category=category)
            fits = fits.replaced(ids, refined)
    return solved_lessons(lessons, sums), fits


def with_means_of(lessons: Lessons, animals: Animals, fits: FoundFits) -> Lessons:
    """The lessons, each class's mean being the median of its animals' fits for a start."""
    prior = shape_prior(lessons.model)
    coefficients = (fits.betas - prior.mean) @ np.linalg.pinv(prior.directions).T
    categories = np.array([animal.get("category") or "" for animal in animals])
    medians = {name: np.median(coefficients[categories == name], axis=0) for name in lessons.means}
    return replace(lessons, means=medians)


def _first_lessons(animals: Animals, config: LabelConfig, *, places: bool, shapes: bool) -> Lessons:
    """What is known before the first fit."""
    if not places and not shapes:
        raise ConfigError("there is nothing to learn: give places or shapes")
    body = fit_request(config=config, **animals[0]).body
    counts = Counter(animal.get("category") or "" for animal in animals)
    species = {animal.get("category") or "": animal.get("species") for animal in animals}
    learned = [name for name, n in counts.items() if shapes and name and n >= LEAST_OF_CLASS]
    return first_lessons(
        body.model,
        body.vocabulary,
        places=places,
        presets={name: species[name] for name in sorted(learned)},
        animals=counts,
    )


def _batches(members: Sequence[int]) -> Iterator[list[int]]:
    for start in range(0, len(members), AT_ONCE):
        yield list(members[start : start + AT_ONCE])


def _groups(animals: Animals) -> list[tuple[str, str | None, list[int]]]:
    """Category, species and indices of the animals that share a body, in a fixed order."""
    groups: dict[tuple[str, str], list[int]] = {}
    for i, animal in enumerate(animals):
        key = (animal.get("category") or "", animal.get("species") or "")
        groups.setdefault(key, []).append(i)
    return [(key[0], key[1] or None, groups[key]) for key in sorted(groups)]


def _request(animal: Mapping[str, Any], body: FitBody, config: LabelConfig) -> FitRequest:
    return replace(fit_request(config=config, **animal), body=body)


def _studied(
    requests: Sequence[FitRequest],
    fits: FoundFits,
    whole: FitBody | None,
    *,
    sums: LessonSums,
    category: str,
) -> FoundFits:
    """The fits of animals of one body, refined; their equations are added to the sums."""
    body = requests[0].body
    problem = joined([request.problem for request in requests])
    targets = {
        a: mask_target(request.mask, request.K[:2, 2])
        for a, request in enumerate(requests)
        if request.mask is not None
    }
    state = refined_fits(body, problem, targets, fits.in_body(body), rounds=REFINE_ROUNDS)
    own, order = np.arange(len(body.exchanged)), np.array(body.exchanged)
    noise = [
        request.noise_px[order if exchanged else own]
        for request, exchanged in zip(requests, state.exchanged.tolist(), strict=True)
    ]
    sums.add(
        shared_equations(body, whole or body, problem, targets, state=state),
        category="" if whole is None else category,
        sureness=fits.sureness,
        noise=np.stack(noise),
        extent=problem.extent,
    )
    return fits.moved(body, state)
