"""The schedule of the fit: many starts under a wide loss, few under a narrow one, one by the mask.

Of each animal the same number of hypotheses takes the same number of rounds, so that an animal's
fit is the same to the byte alone and among others.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from animal3dbox.labels.fit.choice import EXCHANGED_COST, ChoiceCosts, choice_costs
from animal3dbox.labels.fit.descent import descend_fit, keypoint_terms
from animal3dbox.labels.fit.fit_body import FitBody
from animal3dbox.labels.fit.local_fit import LocalFit
from animal3dbox.labels.fit.mask_target import MaskTarget
from animal3dbox.labels.fit.mask_term import MaskWeights, mask_terms
from animal3dbox.labels.fit.problem import FitProblem, FitState
from animal3dbox.labels.fit.view_scan import scan_starts

Array = NDArray[np.float64]
COARSE = (14, 6)
"""Pose and shape directions that are free at first."""
STAGE_ROUNDS = (3, 3, 4)
SURVIVING = (8, 4)
"""Hypotheses of an animal that go on after the first stages."""
FIT_APART = (0.35, 0.5)
"""Rotations that differ by less then, in the Frobenius norm, are one."""
LOSS_WIDTHS = (0.12, 0.05)
"""Widths of the loss of the first stages, by the keypoints' extent."""
NARROW_LOSS = 3.0
"""Width of the loss at the end, in standard deviations."""
CHOICE_LOSS = 1.0
"""Its width where hypotheses are chosen between: what fits none of them counts little."""
MASKED = 2
"""Hypotheses of an animal that are compared with its mask."""
LIGHT_MASK, LIGHT_ROUNDS = (40.0, 80.0), 6
"""Weights of the mask's two parts, see MaskWeights, before the choice is made."""
HEAVY_MASK, HEAVY_ROUNDS = (120.0, 240.0), 10
"""Weights and rounds once the choice between hypotheses is made."""
MASK_VOTE = 0.25
"""Part of the mask's cost that counts in the choice: things that hide an animal cut its mask."""


@dataclass(frozen=True)
class Ranking:
    """The hypotheses of A animals, the same number H of each, and the best of each animal.

    Attributes:
        state: of A * H hypotheses, those of one animal together.
        score: (A, H) what each costs in all.
        chosen: (A,) the column of the best.
        best: A states, these refined by the mask where there is one.
        local: the cost near them.
        extras: what they cost beside that.
    """

    state: FitState
    score: Array
    chosen: NDArray[np.intp]
    best: FitState
    local: LocalFit
    extras: ChoiceCosts


def ranked_fits(
    body: FitBody,
    problem: FitProblem,
    targets: Mapping[int, MaskTarget],
    *,
    exchanges: bool = True,
) -> Ranking:
    """The fits of all animals.

    Args:
        body: the one model, vocabulary and species of all.
        problem: of A animals.
        targets: animal -> its mask, of those that have one.
        exchanges: whether left and right may have been exchanged.

    """
    animals = len(problem.pixels)
    state, _ = _by_keypoints(body, problem, exchanges=exchanges)
    score = _keypoint_terms(body, problem, CHOICE_LOSS)(state).cost
    score = score + choice_costs(body, problem, state).total
    order = _ranked(score, state, animals)
    state, score = state[order], score[order].reshape(animals, -1)
    masked = np.array(sorted(targets), dtype=np.intp)
    if len(masked):
        first = (masked[:, None] * score.shape[1] + np.arange(MASKED)).ravel()
        lightly, cost = _lightly_masked(body, problem, state[first], targets)
        state = state.replaced(first, lightly)
        labeling, cost = lightly.exchanged.reshape(-1, MASKED), cost.reshape(-1, MASKED)
        # The others stay as far behind as they were, and so does the other labeling
        same = labeling == labeling[:, :1]
        gain = np.where(same, cost, np.inf).min(1) - score[masked].min(1)
        score[masked] += gain[:, None]
        score[masked, :MASKED] = np.where(same, cost, score[masked, :MASKED])
    chosen = score.argmin(1)
    best = state[np.arange(animals) * score.shape[1] + chosen]
    local = _keypoint_terms(body, problem)(best)
    if len(masked):
        terms = _terms(body, problem, targets, weights=MaskWeights(*HEAVY_MASK))
        refined, by_mask = descend_fit(terms, best[masked], HEAVY_ROUNDS, body.sizes[0])
        best, local = best.replaced(masked, refined), local.replaced(masked, by_mask)
    return Ranking(state, score, chosen, best, local, choice_costs(body, problem, best))


def refined_fits(
    body: FitBody,
    problem: FitProblem,
    targets: Mapping[int, MaskTarget],
    state: FitState,
    *,
    rounds: int,
) -> FitState:
    """States, one of each animal, after some more rounds of the last stage.

    Args:
        body: of all animals.
        problem: of A animals.
        targets: animal -> its mask, of those that have one.
        state: of A hypotheses, in the animals' order.
        rounds: how many.

    """
    masked = np.array(sorted(targets), dtype=np.intp)
    plain = np.setdiff1d(np.arange(len(state)), masked)
    if len(plain):
        terms = _keypoint_terms(body, problem)
        state = state.replaced(plain, descend_fit(terms, state[plain], rounds, body.sizes[0])[0])
    if len(masked):
        terms = _terms(body, problem, targets, weights=MaskWeights(*HEAVY_MASK))
        state = state.replaced(masked, descend_fit(terms, state[masked], rounds, body.sizes[0])[0])
    return state


def _ranked(score: Array, state: FitState, animals: int) -> NDArray[np.intp]:
    """The order of all hypotheses of each animal: first those of the labeling of the least score.

    A mask does not tell left from right, so the labeling is chosen before. Within a labeling those
    whose orientations differ come first.

    Args:
        score: (B,).
        state: B hypotheses.
        animals: how many there are.

    """
    count = len(state) // animals
    order = _cheapest(score, state, animals, most=count, apart=FIT_APART[-1])
    by_animal = order.reshape(animals, count)
    labeling = state.exchanged[by_animal]
    other = labeling != labeling[:, :1]  # the first is the one of the least score
    return np.take_along_axis(by_animal, np.argsort(other, axis=1, kind="stable"), 1).ravel()


def _lightly_masked(
    body: FitBody, problem: FitProblem, state: FitState, targets: Mapping[int, MaskTarget]
) -> tuple[FitState, Array]:
    """States refined by their masks, and what each then costs in all, (B,)."""
    weights = MaskWeights(*LIGHT_MASK)
    state, _ = descend_fit(
        _terms(body, problem, targets, weights=weights), state, LIGHT_ROUNDS, body.sizes[0]
    )
    by_mask = mask_terms(
        body, problem, state, targets=targets, weights=weights, counts=body.sizes
    ).cost
    cost = _keypoint_terms(body, problem, CHOICE_LOSS)(state).cost + MASK_VOTE * by_mask
    return state, cost + choice_costs(body, problem, state).total


def _keypoint_terms(
    body: FitBody, problem: FitProblem, width: float = NARROW_LOSS
) -> Callable[[FitState], LocalFit]:
    """The cost by keypoints alone, under a loss of one width."""

    def terms(state: FitState) -> LocalFit:
        widths = np.full(len(state), width)
        return keypoint_terms(body, problem, state, width=widths, counts=body.sizes, by_kind=True)

    return terms


def _terms(
    body: FitBody,
    problem: FitProblem,
    targets: Mapping[int, MaskTarget],
    *,
    weights: MaskWeights,
) -> Callable[[FitState], LocalFit]:
    """The cost by keypoints, under the narrow loss, and masks."""

    def terms(state: FitState) -> LocalFit:
        joints = body.joints(state.pose, state.shape, body.sizes[0])
        width = np.full(len(state), NARROW_LOSS)
        return keypoint_terms(
            body, problem, state, width=width, counts=body.sizes, joints=joints, by_kind=True
        ) + mask_terms(
            body,
            problem,
            state,
            targets=targets,
            weights=weights,
            counts=body.sizes,
            joints=joints,
        )

    return terms


def _by_keypoints(
    body: FitBody, problem: FitProblem, *, exchanges: bool
) -> tuple[FitState, LocalFit]:
    """SURVIVING[-1] hypotheses of each animal, refined by its keypoints; those of one together."""
    animals = len(problem.pixels)
    state = scan_starts(body, problem, exchanges)
    sigma = 1 / problem.weights.max(1)
    counts = COARSE
    for stage, rounds in enumerate(STAGE_ROUNDS):
        width = np.full(animals, NARROW_LOSS)
        if stage < len(LOSS_WIDTHS):
            width = np.maximum(LOSS_WIDTHS[stage] * problem.extent / sigma, NARROW_LOSS)
        by_kind = stage == len(STAGE_ROUNDS) - 1
        terms = partial(keypoint_terms, body, problem, counts=counts, by_kind=by_kind)
        state, local = descend_fit(
            partial(terms, width=width[state.animal]), state, rounds, counts[0]
        )
        if stage < len(SURVIVING):
            cost = local.cost + EXCHANGED_COST * state.exchanged
            most, apart = SURVIVING[stage], FIT_APART[stage]
            state = state[_cheapest(cost, state, animals, most=most, apart=apart)]
            counts = body.sizes
    return state, local


def _cheapest(
    cost: Array, state: FitState, animals: int, *, most: int, apart: float
) -> NDArray[np.intp]:
    """The indices of the least costs of each animal, first those whose orientations differ.

    Args:
        cost: (B,); the hypotheses of one animal stand together, as many of each.
        state: B hypotheses.
        animals: how many there are.
        most: hypotheses of each that are taken.
        apart: least difference of rotations, in the Frobenius norm.

    """
    count, ids = len(cost) // animals, []
    for animal in range(animals):
        own = slice(animal * count, (animal + 1) * count)
        R = state.R[own].reshape(count, 9)
        square = ((R[:, None] - R) ** 2).sum(-1)
        labelings = state.exchanged[own]
        differ = (square > apart**2) | (labelings[:, None] != labelings)
        order = np.argsort(cost[own], kind="stable").tolist()
        chosen: list[int] = []
        for i in order:
            if len(chosen) < most and differ[i, chosen].all():
                chosen.append(i)
        chosen += [i for i in order if i not in chosen][: most - len(chosen)]
        ids.append(np.array(chosen) + animal * count)
    return np.concatenate(ids)
