"""Learning from a dataset's 2D: places of keypoints, shapes of classes, and fits that use them."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from animal3dbox.datasets.synthetic.foreign.animals import ForeignAnimal, foreign_animal
from animal3dbox.datasets.synthetic.foreign.config import ALONE, ForeignConfig
from animal3dbox.datasets.synthetic.foreign.places import drawn_offsets
from animal3dbox.datasets.synthetic.world.config import world_generator
from animal3dbox.errors import ConfigError
from animal3dbox.labels.calibration import Calibration
from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.fit.descent import keypoint_terms
from animal3dbox.labels.fit.fit import fit_animal, fit_many
from animal3dbox.labels.fit.fit_body import FitBody, body_of_prior
from animal3dbox.labels.fit.fitted_body import FittedBody
from animal3dbox.labels.fit.learning.found_fits import found_fits
from animal3dbox.labels.fit.learning.lessons import Lessons, first_lessons
from animal3dbox.labels.fit.learning.mirrored_offsets import offset_basis
from animal3dbox.labels.fit.learning.rounds import learn_bodies, solve_from_fits, with_means_of
from animal3dbox.labels.fit.learning.shared_equations import (
    marginalised,
    offset_slopes,
    shared_equations,
)
from animal3dbox.labels.fit.learning.solved_lessons import LessonSums
from animal3dbox.labels.fit.problem import FitState, joined
from animal3dbox.labels.fit.request import fit_request
from animal3dbox.labels.fit.schedule import NARROW_LOSS, refined_fits
from animal3dbox.labels.label import label_animal
from animal3dbox.labels.types import CuboidLabel
from animal3dbox.smal.keypoints.vocabularies import VOCABULARIES
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped

Array = NDArray[np.float64]
AP10K = VOCABULARIES["ap10k17"]
WORLD = ForeignConfig(
    world=replace(ALONE, fill=(0.5, 0.9), vocabulary=AP10K, presets=("horse",)),
    proportions=0.0,
    places=0.05,
    places_of_animal=0.0,
    individual=0.2,
)
SEED, ANIMALS = 5, 14


def arguments(one: ForeignAnimal, **changes: Any) -> dict[str, Any]:
    return {
        "image_hw": one.camera.image_hw,
        "keypoints_2d": one.keypoints_2d.numpy(),
        "K": one.camera.K.numpy(),
        "vocabulary": one.vocabulary,
        "sample_id": one.sample_id,
        "category": "pony",
        **changes,
    }


@pytest.fixture(scope="module")
def animals() -> list[dict[str, Any]]:
    every = (foreign_animal(SEED, index, WORLD, dataset=0) for index in range(3 * ANIMALS))
    seen = [one for one in every if int((one.keypoints_2d[:, 2] > 0).sum()) >= 11]
    return [arguments(one) for one in seen[:ANIMALS]]


def lessons_of(animals: Sequence[dict[str, Any]], *, places: bool, shapes: bool) -> Lessons:
    first = first_lessons(
        load_quadruped(),
        AP10K,
        places=places,
        presets={"pony": None} if shapes else {},
        animals={"pony": len(animals)},
    )
    bodies = [fit for fit in fit_many(animals) if isinstance(fit, FittedBody)]
    fits = found_fits(bodies)
    lessons = with_means_of(first, animals, fits)
    for _ in range(3):
        lessons, fits = solve_from_fits(lessons, animals, fits, LabelConfig())
    return lessons


@pytest.fixture(scope="module")
def lessons(animals: list[dict[str, Any]]) -> Lessons:
    return lessons_of(animals, places=True, shapes=True)


def offsets_of(calibration: Calibration) -> Array:
    return np.array(calibration.places[0].offsets)


def test_offsets_are_mirrored_and_those_in_the_middle_do_not_go_sideways() -> None:
    basis = offset_basis(AP10K)
    rng = np.random.default_rng(0)
    offsets = (basis @ rng.standard_normal(basis.shape[1])).reshape(-1, 3)
    assert np.array_equal(offsets[list(AP10K.flip)], offsets * [1, -1, 1])
    assert np.linalg.matrix_rank(basis) == basis.shape[1] == 1.5 * (17 - 3) + 2 * 3


def test_marginalising_is_the_inverse_of_the_block_of_the_inverse() -> None:
    rng = np.random.default_rng(1)
    root = rng.standard_normal((2, 7, 7))
    A, b = root @ root.swapaxes(1, 2), rng.standard_normal((2, 7))
    H, h, _ = marginalised(A, b, 4)
    assert np.allclose(H, np.linalg.inv(np.linalg.inv(A)[:, 4:, 4:]), rtol=1e-9)
    least = np.linalg.solve(A, b[..., None])[:, 4:, 0]
    assert np.allclose(np.linalg.solve(H, h[..., None])[..., 0], least)


def at_rest(animals: Sequence[dict[str, Any]], lessons: Lessons) -> tuple[FitBody, FitState]:
    """The body of the ponies, and fits at which no number of their own can gain."""
    body = lessons.body("pony", None)
    fits = found_fits([fit for fit in fit_many(animals) if isinstance(fit, FittedBody)])
    problem = problem_of(animals, body)
    return body, refined_fits(body, problem, {}, fits.in_body(body), rounds=150)


def problem_of(animals: Sequence[dict[str, Any]], body: FitBody) -> Any:
    requests = [fit_request(config=LabelConfig(), **animal) for animal in animals]
    return joined([replace(request, body=body).problem for request in requests])


def cost_of(body: FitBody, problem: Any, state: FitState) -> Array:
    width = np.full(len(state), NARROW_LOSS)
    return keypoint_terms(body, problem, state, width=width, counts=body.sizes, by_kind=True).cost


def moved_body(body: FitBody, lessons: Lessons, k: int, by: float) -> FitBody:
    """The body with the free number k of its offsets moved."""
    places = lessons.places
    assert places is not None
    moved = (offset_basis(AP10K)[:, k] * by).reshape(-1, 3)
    rows = (np.array(places.offsets) + moved).tolist()
    offsets = tuple((x, y, z) for x, y, z in rows)
    return body_of_prior(body.model, AP10K, body.shape_prior, replace(places, offsets=offsets))


def test_slopes_of_landmarks_by_their_offsets_are_finite_differences(lessons: Lessons) -> None:
    body, rng = lessons.body("pony", None), np.random.default_rng(3)
    pose, shape = (rng.standard_normal((2, size)) for size in body.sizes)
    _, frames = body.frames(pose, shape)
    slopes = offset_slopes(body, frames, shape)
    for k in range(slopes.shape[1]):
        ahead, behind = (moved_body(body, lessons, k, sign * 1e-5) for sign in (1, -1))
        numeric = (ahead.landmarks(pose, shape) - behind.landmarks(pose, shape)) / 2e-5
        assert np.abs(slopes[:, k] - numeric).max() < 1e-5


def test_slopes_of_the_cost_by_places_and_by_the_class_are_finite_differences(
    animals: list[dict[str, Any]], lessons: Lessons
) -> None:
    some = animals[1:3]
    body, state = at_rest(some, lessons)
    problem = problem_of(some, body)
    whole = lessons.whole_body("pony")
    assert whole is not None
    equations = shared_equations(body, whole, problem, {}, state=state)
    count = offset_basis(AP10K).shape[1]
    root = np.linalg.lstsq(whole.shape_prior.directions, body.shape_prior.directions, rcond=None)[0]

    def slope(costs: list[Array]) -> Array:
        return np.asarray((costs[0] - costs[1]) / 2e-5)

    for k in (0, 4, count - 1):
        bodies = [moved_body(body, lessons, k, sign * 1e-5) for sign in (1, -1)]
        numeric = slope([cost_of(one, problem, state) for one in bodies])
        assert np.allclose(equations.h[:, k], numeric, rtol=1e-3, atol=1e-3)
    for k in (0, 5):
        # A step of the mean moves shapes, and the deviations from it stay
        step = 1e-5 * np.linalg.inv(root)[:, k]
        moved = [replace(state, shape=state.shape + sign * step) for sign in (1, -1)]
        numeric = slope([cost_of(body, problem, one) - (one.shape**2).sum(1) / 2 for one in moved])
        assert np.allclose(equations.h[:, count + k], numeric, rtol=1e-3, atol=1e-3)


def test_places_that_a_dataset_moved_are_found(lessons: Lessons) -> None:
    rng = world_generator(SEED, 0, "foreign-dataset")
    truth = WORLD.places * drawn_offsets(rng, AP10K).numpy()
    learned = offsets_of(lessons.calibration)
    known = np.abs(learned).max(1) > 0
    assert np.corrcoef(learned[known].ravel(), truth[known].ravel())[0, 1] > 0.7
    assert np.abs(learned - truth).mean() < 0.75 * np.abs(truth).mean()


def test_fits_with_what_was_learned_lie_nearer_to_their_keypoints(
    animals: list[dict[str, Any]], lessons: Lessons
) -> None:
    calibration = lessons.calibration
    before = [fit.misfit for fit in fit_many(animals) if isinstance(fit, FittedBody)]
    after = [
        fit.misfit
        for fit in fit_many([{**animal, "calibration": calibration} for animal in animals])
        if isinstance(fit, FittedBody)
    ]
    assert np.mean(after) < 0.8 * np.mean(before)


def test_a_class_without_scatter_has_its_shape_and_other_classes_do_not(
    animals: list[dict[str, Any]], lessons: Lessons
) -> None:
    stiff = Calibration(shapes=(replace(lessons.shapes["pony"], scatter=1e-4),))
    pony, okapi = fit_many(
        [
            {**animals[0], "calibration": stiff, "category": category}
            for category in ("pony", "okapi")
        ]
    )
    assert isinstance(pony, FittedBody)
    assert isinstance(okapi, FittedBody)
    betas = np.array(stiff.shapes[0].betas)
    assert np.abs(pony.betas - betas).max() < 1e-3
    assert np.abs(okapi.betas - betas).max() > 0.05


def test_doubtful_fits_count_for_nothing(animals: list[dict[str, Any]], lessons: Lessons) -> None:
    some = animals[:2]
    body, state = at_rest(some, lessons)
    problem = problem_of(some, body)
    equations = shared_equations(body, body, problem, {}, state=state)

    def summed(sureness: Sequence[float], misfit: Sequence[float]) -> Array:
        sums = LessonSums(offset_basis(AP10K).shape[1])
        sums.add(
            replace(equations, misfit=np.array(misfit)),
            category="pony",
            sureness=np.array(sureness),
            noise=np.full((2, 17), 2.0),
            extent=problem.extent,
        )
        return sums.H["pony"]

    assert np.array_equal(summed([1, 0], [1, 1]), equations.H[0])
    assert np.array_equal(summed([1, 1], [2, 4]), equations.H[0] + equations.H[1] / 4)


def test_the_calibrations_landmarks_are_where_the_fit_puts_them(
    animals: list[dict[str, Any]], lessons: Lessons
) -> None:
    fit = fit_animal(**{**animals[0], "calibration": lessons.calibration})
    assert isinstance(fit, FittedBody)
    body = lessons.body("pony", None)
    state = found_fits([fit]).in_body(body)
    own = body.landmarks(state.pose, state.shape)[0].T + body.skeleton.origin
    # apart but for pose correctives
    assert np.nanmax(np.abs(own - fit.landmarks)) < 5e-3
    assert np.nanmax(np.abs(fit.moved_places)) > 0.02
    assert fit.calibration == lessons.calibration.digest


def test_a_label_by_what_was_learned_is_the_fits_and_says_so(
    animals: list[dict[str, Any]], lessons: Lessons
) -> None:
    calibration = lessons.calibration
    fit = fit_animal(**{**animals[1], "calibration": calibration})
    given = {name: value for name, value in animals[1].items() if name != "category"}
    label = label_animal(**given, species="pony", calibration=calibration, body="fit")
    plain = label_animal(**given, species="pony", body="fit")
    shapes = Calibration(shapes=calibration.shapes)
    other = label_animal(**given, species="okapi", calibration=shapes, body="fit")
    assert isinstance(label, CuboidLabel)
    assert isinstance(fit, FittedBody)
    assert isinstance(plain, CuboidLabel)
    assert np.array_equal(label.R.numpy(), fit.R)
    assert label.quality.calibration == calibration.digest
    assert plain.quality.calibration is None
    assert isinstance(other, CuboidLabel)
    assert other.quality.calibration is None
    assert np.array_equal(other.R.numpy(), plain.R.numpy())


def test_fits_by_what_was_learned_are_the_same_alone_and_among_others(
    animals: list[dict[str, Any]], lessons: Lessons
) -> None:
    some = [
        {**animal, "calibration": lessons.calibration, "category": category}
        for animal, category in zip(animals[:3], ("pony", "okapi", "pony"), strict=True)
    ]
    for one, among_others in zip(some, fit_many(some), strict=True):
        alone = fit_many([one])[0]
        assert isinstance(alone, FittedBody)
        assert isinstance(among_others, FittedBody)
        assert np.array_equal(alone.vertices, among_others.vertices)
        assert np.array_equal(alone.landmarks, among_others.landmarks, equal_nan=True)


def test_what_was_learned_with_another_body_or_other_keypoints_is_refused(
    animals: list[dict[str, Any]], lessons: Lessons
) -> None:
    places = lessons.places
    assert places is not None
    other_body = Calibration(places=(replace(places, body="0" * 12),))
    with pytest.raises(ConfigError, match="were learned with another body"):
        fit_animal(**{**animals[0], "calibration": other_body})
    names = ("x", *places.keypoints[1:])
    with pytest.raises(ConfigError, match="are of other keypoints"):
        fit_animal(
            **{**animals[0], "calibration": Calibration(places=(replace(places, keypoints=names),))}
        )


def test_a_vocabulary_whose_keypoints_have_moved_on_the_body_refuses_what_was_learned(
    animals: list[dict[str, Any]], lessons: Lessons
) -> None:
    places = (("left_mouth",), ("right_mouth",), *AP10K.landmarks[2:])
    elsewhere = replace(AP10K, landmarks=places)
    with pytest.raises(ConfigError, match="ap10k17's keypoints elsewhere"):
        fit_animal(**{**animals[0], "vocabulary": elsewhere, "calibration": lessons.calibration})
    short = replace(lessons.shapes["pony"], betas=(0.0,))
    with pytest.raises(ConfigError, match="shape of pony has 1 betas, the model 41"):
        fit_animal(**{**animals[0], "calibration": Calibration(shapes=(short,))})


def test_another_model_is_learned_from_and_its_calibration_is_not_the_quadrupeds(
    animals: list[dict[str, Any]],
) -> None:
    own = load_quadruped()
    mixed = np.linalg.qr(np.random.default_rng(3).standard_normal((41, 25)))[0]
    model = replace(own, shapedirs=own.shapedirs @ torch.from_numpy(mixed))
    some = [{**animal, "model": model} for animal in animals[:4]]
    first = first_lessons(
        model, AP10K, places=True, presets={"pony": None}, animals={"pony": len(some)}
    )
    fits = found_fits([fit for fit in fit_many(some) if isinstance(fit, FittedBody)])
    lessons, _ = solve_from_fits(with_means_of(first, some, fits), some, fits, LabelConfig())
    calibration = lessons.calibration
    assert len(calibration.shapes[0].betas) == model.beta_count
    assert isinstance(fit_animal(**{**some[0], "calibration": calibration}), FittedBody)
    with pytest.raises(ConfigError, match="were learned with another body"):
        fit_animal(**{**animals[0], "calibration": calibration})


def test_few_animals_or_nothing_to_learn_are_refused(animals: list[dict[str, Any]]) -> None:
    with pytest.raises(ConfigError, match=f"{ANIMALS} animals: places and shapes are learned from"):
        learn_bodies(animals)
    with pytest.raises(ConfigError, match="give places or shapes"):
        learn_bodies([animals[0]] * 30, places=False, shapes=False)
