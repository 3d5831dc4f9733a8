"""The flank model: fitted on one foreign world, measured on another that it has not seen.

Run: python benchmarks/flank.py fit [--animals 1000]
     python benchmarks/flank.py report [--animals 2000]

The body is the standing preset of the animal's species, rigid, whatever the animal does; K is
known. Azimuths of cameras are uniform. The truth is the sign of the camera's y in the true trunk's
frame. `fit` takes seeds from 0 on and TUNED, and writes animal3dbox/labels/assets/flank.json;
`report` takes seeds from 2000 on and UNSEEN, and prints a table by 15 degrees of azimuth.
"""

import argparse
import json
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from animal3dbox import CuboidLabel, label_animal
from animal3dbox.datasets.bodies.sources import model_mobility, standing_vertices
from animal3dbox.datasets.synthetic.faults import FaultConfig
from animal3dbox.datasets.synthetic.foreign.animals import ForeignAnimal, foreign_animal
from animal3dbox.datasets.synthetic.foreign.config import ForeignConfig
from animal3dbox.evaluate.tables import wilson_bounds
from animal3dbox.labels.flank import UNKNOWN_SD_RAD, FlankModel, flank_model, lateral_angle
from animal3dbox.smal.keypoints.vocabulary import Vocabulary
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped, preset_betas

TUNED = ForeignConfig()
UNSEEN = ForeignConfig(
    faults=FaultConfig(noise_px=3.0, missing=0.1),
    standing=0.6,
    proportions=0.8,
    places=0.06,
    places_of_animal=0.03,
    mask_jitter_px=1.5,
)
PER_SEED = 100
"""Animals of one seed."""
FIRST_UNSEEN_SEED = 2000
UNDECIDED = 0.1
"""Part of the tuned world's animals that the fitted model leaves undecided."""
FILE = Path(__file__).resolve().parents[1] / "animal3dbox" / "labels" / "assets" / "flank.json"

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Seen:
    """What labels say of the flanks of N animals, and the truth.

    Attributes:
        camera: (N, 3) where the camera stands in the true trunk's frame.
        theta: (N,) radians, lateral_angle of the label.
        shares: (N, 6) of the visible surface.
        sigma: (N,) radians, deviation of the pose's rotation.
        flank: (N,) as labels have it now: 0, 1, 2.
        rejected: how many animals got no label.
    """

    camera: Array
    theta: Array
    shares: Array
    sigma: Array
    flank: NDArray[np.int64]
    rejected: int

    @property
    def is_left(self) -> NDArray[np.bool_]:
        """Whether the camera stands on the animal's left, (N,)."""
        return self.camera[:, 1] > 0


def preset_arguments(preset: str, vocabulary: Vocabulary) -> dict[str, Any]:
    """label_animal's arguments of a preset that stands for the animal."""
    model, betas = load_quadruped(), tuple(preset_betas(preset).tolist())
    vertices = standing_vertices(model, betas)
    return {
        "vertices": vertices,
        "faces": model.faces,
        "template": model,
        "keypoints_3d": model.read_keypoints(vocabulary, vertices),
        "landmark_sigma": model_mobility(model, betas, vocabulary),
        "vocabulary": vocabulary,
    }


def labelled(animal: ForeignAnimal, *, mask: bool) -> CuboidLabel | None:
    """The label of an animal by the standing preset of its species; None if it is rejected."""
    outcome = label_animal(
        animal.camera.image_hw,
        animal.keypoints_2d,
        K=animal.camera.K,
        mask=animal.mask if mask else None,
        sample_id=animal.sample_id,
        **preset_arguments(animal.preset, animal.vocabulary),
    )
    return outcome if isinstance(outcome, CuboidLabel) else None


def animals(first_seed: int, count: int, config: ForeignConfig) -> Iterator[ForeignAnimal]:
    """So many animals, PER_SEED of each seed."""
    for number in range(count):
        yield foreign_animal(first_seed + number // PER_SEED, number % PER_SEED, config)


def seen_flanks(
    first_seed: int, count: int, config: ForeignConfig, *, masks: Sequence[bool] = (True,)
) -> list[Seen]:
    """What the labels of so many animals say, with the mask or without it."""
    pairs: list[list[tuple[Array, CuboidLabel]]] = [[] for _ in masks]
    for animal in animals(first_seed, count, config):
        for found, mask in zip(pairs, masks, strict=True):
            label = labelled(animal, mask=mask)
            if label is not None:
                found.append((animal.camera_in_trunk.numpy(), label))
    return [_seen(found, count - len(found)) for found in pairs]


def _seen(found: Sequence[tuple[Array, CuboidLabel]], rejected: int) -> Seen:
    """What labels say, each with where the camera truly stands."""
    labels = [label for _, label in found]
    return Seen(
        camera=np.array([camera for camera, _ in found]),
        theta=lateral_angle(
            np.array([label.field("center") for label in labels]),
            np.array([label.field("rotation") for label in labels]),
        ),
        shares=np.array([label.field("surface_share") for label in labels]),
        sigma=np.array([_sigma(label) for label in labels]),
        flank=np.array([int(label.field("flank")) for label in labels]),
        rejected=rejected,
    )


def _sigma(label: CuboidLabel) -> float:
    """Deviation of a pose's rotation, radians."""
    sd_deg = label.quality.rotation_sd_deg
    return UNKNOWN_SD_RAD if sd_deg is None else float(np.radians(sd_deg))


def fitted_model(seen: Seen) -> FlankModel:
    """The model of the greatest likelihood; with and without surface it shares all but its slope.

    decided_from is the least probability that leaves UNDECIDED of the animals undecided.
    """
    start = np.log([1.0, 0.5, 1.0, 0.005])

    def model_of(x: Array, decided_from: float = 0.5) -> FlankModel:
        lateral, surface, alone, slip = np.exp(np.clip(x, -12, 6)).tolist()
        return FlankModel(
            lateral=lateral,
            surface=surface,
            lateral_alone=alone,
            slip=min(slip, 0.5),
            decided_from=decided_from,
        )

    def loss(x: Array) -> float:
        model, total = model_of(x), 0.0
        for shares in (seen.shares, np.full_like(seen.shares, -1.0)):
            left = model.left(seen.theta, shares, seen.sigma)
            of_truth = np.where(seen.is_left, left, 1 - left)
            total -= float(np.log(np.maximum(of_truth, 1e-12)).sum())
        return total

    found = minimize(loss, start, method="Nelder-Mead", options={"maxiter": 6000, "xatol": 1e-4})
    left = model_of(found.x).left(seen.theta, seen.shares, seen.sigma)
    threshold = float(np.quantile(np.maximum(left, 1 - left), UNDECIDED))
    return model_of(found.x, round(threshold, 4))


def write_model(model: FlankModel, seen: Seen, count: int) -> None:
    """Write flank.json: the numbers, and what they were made of."""
    content = {
        "command": f"python benchmarks/flank.py fit --animals {count}",
        "mix": "benchmarks/flank.py: TUNED, seeds from 0, the standing preset of the species",
        "animals": count,
        "rejected": seen.rejected,
        "left": round(float(seen.is_left.mean()), 4),
        "model": {name: float(f"{value:.5g}") for name, value in vars(model).items()},
    }
    FILE.write_text(json.dumps(content, indent=1) + "\n")


def calibration_error(seen: Seen) -> float:
    """Mean distance of the probability of left from how often it is left, over ten equal bins."""
    left = flank_model().left(seen.theta, seen.shares, seen.sigma)
    order = np.argsort(left)
    off = [abs(left[bin_].mean() - seen.is_left[bin_].mean()) for bin_ in np.array_split(order, 10)]
    return float(np.mean(off))


def print_report(seen: Seen, title: str) -> None:
    """Decided right and undecided, of all and by 15 degrees of the true azimuth."""
    azimuth = np.degrees(np.arctan2(seen.camera[:, 1], seen.camera[:, 0]))
    decided = seen.flank > 0
    right = decided & ((seen.flank == 1) == seen.is_left)
    low, high = wilson_bounds(int(right.sum()), int(decided.sum()))
    print(f"{title}: {len(decided)} labels, {seen.rejected} rejected")
    print(
        f"  decided right {right.sum() / max(decided.sum(), 1):.4f} ({low:.4f} to {high:.4f}),"
        f" undecided {1 - decided.mean():.4f}, wrong {int((decided & ~right).sum())}"
    )
    print(f"  calibration error of the probability, 10 equal bins: {calibration_error(seen):.4f}")
    print("  | azimuth, to either side | n | undecided | decided right |")
    print("  | --- | --- | --- | --- |")
    for start in range(0, 180, 15):
        here = (np.abs(azimuth) >= start) & (np.abs(azimuth) < start + 15)
        n, sure = int(here.sum()), int((here & decided).sum())
        rate = f"{(here & right).sum() / sure:.4f}" if sure else "-"
        print(f"  | {start} to {start + 15} | {n} | {1 - sure / max(n, 1):.3f} | {rate} |")


def main() -> None:
    """Fit or report."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=("fit", "report"))
    parser.add_argument("--animals", type=int, default=None)
    arguments = parser.parse_args()
    if arguments.what == "fit":
        count = arguments.animals or 1000
        (seen,) = seen_flanks(0, count, TUNED)
        model = fitted_model(seen)
        write_model(model, seen, count)
        flank_model.cache_clear()
        left = model.left(seen.theta, seen.shares, seen.sigma)
        sure = np.maximum(left, 1 - left) >= model.decided_from
        flank = np.where(sure, np.where(left > 0.5, 1, 2), 0)
        print_report(replace(seen, flank=flank), "tuned world")
        return
    count = arguments.animals or 2000
    print(f"model: {flank_model()}")
    both = seen_flanks(FIRST_UNSEEN_SEED, count, UNSEEN, masks=(True, False))
    for seen, name in zip(both, ("with", "without"), strict=True):
        print_report(seen, f"unseen world, {name} mask")


if __name__ == "__main__":
    main()
