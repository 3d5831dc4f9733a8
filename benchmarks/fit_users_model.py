"""Fits of a user's SMAL model beside the quadruped's, on a stand-in that is nothing of SMAL's.

    OMP_NUM_THREADS=1 python benchmarks/fit_users_model.py --n 100

The stand-in (tests/support/smal_stand_in.py) is the quadruped in another rest pose and shape basis,
written as a SMAL pickle and converted. Animals and columns are those of fit_bodies.py, own world,
species unknown. "quadruped, one Gaussian" has the shape prior that a user's model has. The last
line poses the stand-in by the quadruped's own angles, which its rest pose makes another posture.
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import torch
from fit_bodies import animals_of, report, row_of

from animal3dbox.datasets.synthetic.foreign.animals import ForeignAnimal
from animal3dbox.geometry.rigid_transforms import rotation_angle
from animal3dbox.labels.bounds import tight_cuboid
from animal3dbox.labels.fit import fit_body
from animal3dbox.labels.fit.fit import fit_many
from animal3dbox.labels.fit.fitted_body import FittedBody
from animal3dbox.labels.fit.shape_prior import ShapePrior, shape_prior
from animal3dbox.smal.model import SmalModel

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "support"))


def one_gaussian(model: SmalModel, species: str | None = None) -> ShapePrior:
    """The shape prior without the kinds that the presets make."""
    prior = shape_prior(model, species)
    count = prior.directions.shape[1]
    return ShapePrior(prior.mean, prior.directions, np.zeros((1, count)), np.eye(count))


def fits(animals: Sequence[ForeignAnimal], model: SmalModel | None) -> list[FittedBody]:
    """The fits of a model, or of the quadruped, to all animals."""
    outcomes = fit_many(
        {
            "image_hw": animal.camera.image_hw,
            "keypoints_2d": animal.keypoints_2d,
            "K": animal.camera.K,
            "mask": animal.mask,
            "vocabulary": animal.vocabulary,
            "model": model,
        }
        for animal in animals
    )
    return [fit for fit in outcomes if isinstance(fit, FittedBody)]


def differences(ours: Sequence[FittedBody], theirs: Sequence[FittedBody]) -> str:
    """Trunks and vertices of two bodies fitted to the same animals, brought to one distance."""
    turns, apart = [], []
    for one, other in zip(ours, theirs, strict=True):
        R, R_other = torch.from_numpy(one.rotation), torch.from_numpy(other.rotation)
        turns.append(float(torch.rad2deg(rotation_angle(R, R_other))))
        v, w = (fit.vertices_cam / np.linalg.norm(fit.vertices_cam.mean(0)) for fit in (one, other))
        apart.append(100 * np.linalg.norm(v - w, axis=1).mean() / np.linalg.norm(np.ptp(v, axis=0)))
    deg, percent = (np.quantile(values, (0.5, 0.95)).round(2) for values in (turns, apart))
    return f"trunks {deg[0]} / {deg[1]} deg, vertices {percent[0]} / {percent[1]} % of the diagonal"


def fits_otherwise(
    animals: Sequence[ForeignAnimal], model: SmalModel | None, **replaced: Any
) -> list[FittedBody]:
    """The fits with some functions of fit_body.py replaced."""
    fit_body.fit_body.cache_clear()
    with patch.multiple(fit_body, **replaced):
        outcomes = fits(animals, model)
    fit_body.fit_body.cache_clear()
    return outcomes


def main() -> None:
    """Fit, and print a line a body and a line a pair."""
    from smal_stand_in import converted_stand_in

    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--n", type=int, default=100)
    parser.add_argument("--seed", type=int, default=5000)
    options = parser.parse_args()
    torch.set_num_threads(1)
    animals, model = list(animals_of("own", options.seed, options.n)), converted_stand_in()
    bodies = {
        "quadruped": fits(animals, None),
        "quadruped, one Gaussian": fits_otherwise(animals, None, shape_prior=one_gaussian),
        "stand-in": fits(animals, model),
        "stand-in, rest pose ignored": fits_otherwise(
            animals, model, rest_alignment=lambda *arguments: None
        ),
    }
    for name, some in bodies.items():
        rows = []
        for fit, animal in zip(some, animals, strict=True):
            vertices, rotation = (torch.from_numpy(x) for x in (fit.vertices_cam, fit.rotation))
            rows.append(row_of(tight_cuboid(vertices, rotation), animal.cuboid))
        report(name, rows, 0)
    for name in list(bodies)[1:]:
        print(f"quadruped beside {name}: {differences(bodies['quadruped'], bodies[name])}")
    pair = differences(bodies["quadruped, one Gaussian"], bodies["stand-in"])
    print(f"quadruped, one Gaussian beside stand-in: {pair}")


if __name__ == "__main__":
    main()
