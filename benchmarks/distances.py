"""How far an animal is, where its length is known: by its 2D box, and by bodies put into it.

    OMP_NUM_THREADS=1 python benchmarks/distances.py --n 300
    OMP_NUM_THREADS=1 python benchmarks/distances.py --n 60 --seed 7
    OMP_NUM_THREADS=1 python benchmarks/distances.py --n 320 --only learned

One picture tells a distance only beside a known size. Here it is the length of this very animal
from its nose over neck or withers to its tail base, in the pose that it stands in, as SpeciesScale
takes it from a table. Every method gives the distance from the camera to the box's centre:

    2D box     f c L / w,   w its width or its diagonal in px, c from `--calibrated` other animals
    a body     d L / l,     d and l the distance and the length of the body in its own unit

with L the known length. Keypoints are off by 2 px and there is a mask; species are unknown. Without
K, a 2D box is taken with the guessed focal length, and bodies with the one that labelling
estimates. The error is that of the distance, in percent of the true one, without its sign.

learned: fitted bodies before and after `learn_bodies` from the 2D of other animals of the same
dataset, on the datasets of "learn, foreign" in fit_bodies.py; no length is learned from.
"""

import argparse
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import torch
from fit_bodies import CLASSES, FIRST_TAUGHT, LEARNED, class_arguments, some_animals
from numpy.typing import NDArray
from torch import Tensor

from animal3dbox.datasets.labelling.scale import head_and_body
from animal3dbox.datasets.synthetic.foreign.animals import ForeignAnimal
from animal3dbox.evaluate.confidence_mix import preset_arguments
from animal3dbox.evaluate.fit_study import (
    FIRST_SEED,
    WORLDS,
    animals_of,
    box_of_fit,
    fit_arguments,
)
from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.fit.fit import fit_animal, fit_many
from animal3dbox.labels.fit.fitted_body import FittedBody
from animal3dbox.labels.fit.learning.rounds import learn_bodies
from animal3dbox.labels.label import label_animal
from animal3dbox.labels.types import CuboidLabel, Rejection

CALIBRATION_SEED = 500
"""Seed of the animals whose 2D boxes tell what a box's width or diagonal is worth."""
QUICK = LabelConfig(surface_share=False, mask_iou=False)
SpanPx = Callable[[ForeignAnimal], float]
Estimate = Callable[[ForeignAnimal, bool], float | None]
Pair = tuple[float | None, float]
"""An estimate of a distance, None where there is none, and the true one."""


def length_of(animal: ForeignAnimal, landmarks: Tensor | NDArray[np.float64]) -> float:
    """The length of a body that stands for an animal, of its landmarks (J, 3), in their unit."""
    length = head_and_body(animal.vocabulary, landmarks)
    if length is None:
        raise SystemExit(f"{animal.sample_id} has no nose, no withers or no tail base")
    return length


def true_length(animal: ForeignAnimal) -> float:
    """The animal's own length, wherever its dataset places keypoints."""
    landmarks = animal.model.read_keypoints(animal.vocabulary, animal.vertices)
    return length_of(animal, landmarks)


def true_distance(animal: ForeignAnimal) -> float:
    """From the camera's centre to that of the true box."""
    return float(torch.linalg.vector_norm(animal.cuboid.center))


def sides_px(animal: ForeignAnimal) -> tuple[float, float]:
    """Width and height of the 2D box around the animal's mask, px."""
    rows, columns = torch.nonzero(animal.mask, as_tuple=True)
    return (
        float(columns.max() - columns.min() + 1),
        float(rows.max() - rows.min() + 1),
    )


SPANS: Mapping[str, SpanPx] = {
    "2D box, width": lambda animal: sides_px(animal)[0],
    "2D box, diagonal": lambda animal: float(np.hypot(*sides_px(animal))),
}
"""Name -> what of a 2D box stands for the animal's length."""


def focal_px(animal: ForeignAnimal, K_known: bool) -> float:
    """The focal length that a 2D box is read with, px."""
    if K_known:
        return float(animal.camera.K[0, 0])
    return QUICK.focal_guess * max(animal.camera.image_hw)


def by_span(span: SpanPx, calibrated: list[ForeignAnimal]) -> Estimate:
    """The estimate by a span of the 2D box, its constant the median over other animals."""

    def raw(animal: ForeignAnimal, K_known: bool) -> float:
        return focal_px(animal, K_known) * true_length(animal) / span(animal)

    constants = {
        K_known: float(np.median([true_distance(one) / raw(one, K_known) for one in calibrated]))
        for K_known in (True, False)
    }
    return lambda animal, K_known: constants[K_known] * raw(animal, K_known)


def by_label(animal: ForeignAnimal, K_known: bool, preset: str | None) -> float | None:
    """The estimate by the label of a rigid preset, or of the true body."""
    arguments: dict[str, Any] = animal.arguments(template=True)
    if preset is not None:
        arguments |= preset_arguments(preset, animal)
    if not K_known:
        arguments["K"] = None
    label = label_animal(**arguments, config=QUICK)
    if not isinstance(label, CuboidLabel):
        return None
    landmarks = torch.as_tensor(arguments["keypoints_3d"])
    length = true_length(animal) if preset is None else length_of(animal, landmarks)
    return float(label.distance) * true_length(animal) / length


def by_fit(animal: ForeignAnimal, K_known: bool) -> float | None:
    """The estimate by a fitted body."""
    arguments = fit_arguments(animal) | ({} if K_known else {"K": None})
    return distance_of_fit(animal, fit_animal(**arguments))


def distance_of_fit(animal: ForeignAnimal, fit: FittedBody | Rejection) -> float | None:
    """The distance at which a fitted body is as long as its animal."""
    if not isinstance(fit, FittedBody):
        return None
    landmarks = fit.model.read_keypoints(fit.vocabulary, torch.from_numpy(fit.vertices))
    distance = float(torch.linalg.vector_norm(box_of_fit(fit).center))
    return distance * true_length(animal) / length_of(animal, landmarks)


def methods(calibrated: list[ForeignAnimal]) -> dict[str, Estimate]:
    """Every method by its name."""
    return {name: by_span(span, calibrated) for name, span in SPANS.items()} | {
        "rigid dog": lambda animal, K_known: by_label(animal, K_known, "dog"),
        "rigid, species known": lambda animal, K_known: by_label(animal, K_known, animal.preset),
        "fitted body": by_fit,
        "true body": lambda animal, K_known: by_label(animal, K_known, None),
    }


def learned_pairs(count: int, seed: int, taught_count: int) -> dict[str, list[Pair]]:
    """Estimates and truth by fitted bodies before and after learning, of LEARNED datasets.

    Args:
        count: animals that are judged.
        seed: of the first dataset.
        taught_count: animals of each dataset that are learned from.

    """
    pairs: dict[str, list[Pair]] = {"before": [], "after": []}
    for dataset in range(seed, seed + LEARNED):
        taught = some_animals(CLASSES, dataset, range(FIRST_TAUGHT, FIRST_TAUGHT + taught_count))
        judged = some_animals(CLASSES, dataset, range(count // LEARNED))
        calibrations = {
            "before": None,
            "after": learn_bodies([class_arguments(animal, ()) for animal in taught]),
        }
        for name, calibration in calibrations.items():
            fits = fit_many(
                [{**class_arguments(one, ()), "calibration": calibration} for one in judged]
            )
            pairs[name] += [
                (distance_of_fit(animal, fit), true_distance(animal))
                for animal, fit in zip(judged, fits, strict=True)
            ]
    return pairs


def report(name: str, pairs: Sequence[Pair], *, K_known: bool) -> None:
    """Print the line of a method, of its estimates and the truth."""
    errors = [100 * abs(estimate / truth - 1) for estimate, truth in pairs if estimate is not None]
    print(
        f"{name:40} {'K known' if K_known else 'K unknown':10} n {len(errors):4d}"
        f" ({len(pairs) - len(errors)} without) | {np.median(errors):5.1f} /"
        f" {np.quantile(errors, 0.95):5.1f} %",
        flush=True,
    )


def main() -> None:
    """Print the median and the 95 % quantile of every method's error on both worlds."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--n", type=int, default=300)
    parser.add_argument("--seed", type=int, default=FIRST_SEED)
    parser.add_argument("--calibrated", type=int, default=200)
    parser.add_argument("--only", default="", help="words of a method's name, or learned")
    parser.add_argument("--taught", type=int, default=200, help="animals that are learned from")
    options = parser.parse_args()
    torch.set_num_threads(1)
    for world, config in WORLDS.items():
        others = list(animals_of(config, range(options.calibrated), CALIBRATION_SEED))
        animals = list(animals_of(config, range(options.n), options.seed))
        for name, estimate in methods(others).items():
            if options.only in name:
                for K_known in (True, False):
                    pairs = [(estimate(one, K_known), true_distance(one)) for one in animals]
                    report(f"{world}: {name}", pairs, K_known=K_known)
    if options.only in "learned":
        groups = learned_pairs(options.n, options.seed, options.taught)
        for name, pairs in groups.items():
            report(f"foreign, {name} learning: fitted body", pairs, K_known=True)


if __name__ == "__main__":
    main()
