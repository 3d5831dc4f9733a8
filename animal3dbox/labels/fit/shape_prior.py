"""What shapes are likely: one Gaussian over a model's betas, whitened in what it moves.

Of the embedded quadruped it is made of its species, measures and variations; of any other model,
whose betas SMAL's authors scale to be standard normal, it is the standard normal. The overall size
is left out: one picture does not tell it from distance.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from animal3dbox.geometry.arrays import as_numpy
from animal3dbox.smal.model import SmalModel
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped, preset_betas, quadruped_names

Array = NDArray[np.float64]
SHAPE_DIRECTIONS = 18
MEASURE_SD, VARIATION_SD = 0.5, 0.3
"""Standard deviations of the quadruped's measures and of its smaller variations."""
KNOWN_SPECIES = 0.04
"""Part of the variance between species that remains where the species is known."""


@dataclass(frozen=True)
class ShapePrior:
    """A Gaussian over betas, whitened: betas = mean + directions s, with s standard normal.

    Attributes:
        mean: (S',) betas.
        directions: (S', S) betas per unit of each coefficient, those that move most first.
    """

    mean: Array
    directions: Array


@lru_cache(maxsize=64)
def shape_prior(model: SmalModel, species: str | None = None) -> ShapePrior:
    """The prior of a model's shapes; of one of the quadruped's presets if a species is given."""
    mean, covariance = (
        _quadruped_shapes(species)
        if model is load_quadruped()
        else (np.zeros(model.beta_count), np.eye(model.beta_count))
    )
    columns = as_numpy(model.shapedirs).reshape(-1, model.beta_count)
    root = _square_root(covariance)
    values, vectors = np.linalg.eigh(root @ (columns.T @ columns) @ root)
    order = np.argsort(-values, kind="stable")[:SHAPE_DIRECTIONS]
    vectors = vectors[:, order]
    vectors = vectors * np.sign(vectors[np.abs(vectors).argmax(0), range(len(order))])
    return ShapePrior(mean, np.ascontiguousarray(root @ vectors))


def _quadruped_shapes(species: str | None) -> tuple[Array, Array]:
    """Mean (S',) and covariance (S', S') of the quadruped's betas."""
    names = quadruped_names()
    presets = np.stack([as_numpy(preset_betas(name)) for name in names.presets])
    mean, between = presets.mean(0), np.cov(presets.T, bias=True)
    if species is not None:
        mean, between = as_numpy(preset_betas(species)), KNOWN_SPECIES * between
    deviations = np.array(
        [
            0.0
            if name == "size" or name in names.presets
            else (MEASURE_SD if name in names.measures else VARIATION_SD)
            for name in names.columns
        ]
    )
    return mean, between + np.diag(deviations**2)


def _square_root(covariance: Array) -> Array:
    """The symmetric root of a covariance."""
    values, vectors = np.linalg.eigh(covariance)
    root: Array = (vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T
    return root
