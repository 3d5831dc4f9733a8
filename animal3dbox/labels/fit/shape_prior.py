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
from animal3dbox.labels.calibration import ClassShape
from animal3dbox.smal.model import SmalModel
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped, preset_betas, quadruped_names

Array = NDArray[np.float64]
SHAPE_DIRECTIONS = 18
MEASURE_SD, VARIATION_SD = 0.5, 0.3
"""Standard deviations of the quadruped's measures and of its smaller variations."""
KIND_SHARE = 0.3
"""Part of the variance between species that each has about itself where none is known."""
KNOWN_SPECIES = 0.04
"""Part of the variance between species that remains where the species is known."""

WITHIN_SHARE = 0.3
"""Part of the variance of another model's shapes that remains where the species is known."""


@dataclass(frozen=True)
class ShapePrior:
    """A Gaussian over betas, whitened: betas = mean + directions s, with s standard normal.

    It is one wide Gaussian over all species; the narrow ones of each species are about the kinds.

    Attributes:
        mean: (S',) betas.
        directions: (S', S) betas per unit of each coefficient, those that move most first.
        kinds: (C, S) coefficients of the species; one, zero, where there is nothing to choose.
        precision: (S, S) inverse covariance of the coefficients within a species.
    """

    mean: Array
    directions: Array
    kinds: Array
    precision: Array


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
    directions = np.ascontiguousarray(root @ vectors)
    if model is not load_quadruped() or species is not None:
        nothing = np.zeros((1, len(order)))
        return ShapePrior(mean, directions, nothing, np.eye(len(order)))
    whitening = vectors.T @ np.linalg.pinv(root, hermitian=True)
    presets, between, within = _species()
    covariance = whitening @ (KIND_SHARE * between + within) @ whitening.T
    return ShapePrior(mean, directions, (presets - mean) @ whitening.T, np.linalg.inv(covariance))


@lru_cache(maxsize=256)
def class_prior(model: SmalModel, shape: ClassShape) -> ShapePrior:
    """The prior of a class's shapes, about its learned mean."""
    whole = shape_prior(model)
    root = shape.scatter * _square_root(within_species(model))
    count = len(root)
    return ShapePrior(
        mean=np.array(shape.betas),
        directions=whole.directions @ root,
        kinds=np.zeros((1, count)),
        precision=np.eye(count),
    )


@lru_cache(maxsize=16)
def within_species(model: SmalModel) -> Array:
    """The covariance (S, S) of a known species' animals in shape_prior's coefficients."""
    prior = shape_prior(model)
    if model is not load_quadruped():
        return WITHIN_SHARE * np.eye(prior.directions.shape[1])
    _, between, within = _species()
    whitening = np.linalg.pinv(prior.directions)
    covariance: Array = whitening @ (KNOWN_SPECIES * between + within) @ whitening.T
    return covariance


def _quadruped_shapes(species: str | None) -> tuple[Array, Array]:
    """Mean (S',) and covariance (S', S') of the quadruped's betas."""
    presets, between, within = _species()
    if species is None:
        return presets.mean(0), between + within
    return as_numpy(preset_betas(species)), KNOWN_SPECIES * between + within


def _species() -> tuple[Array, Array, Array]:
    """The presets' betas (C, S'), their covariance, and that within each, (S', S')."""
    names = quadruped_names()
    presets = np.stack([as_numpy(preset_betas(name)) for name in names.presets])
    deviations = np.array(
        [
            0.0
            if name == "size" or name in names.presets
            else (MEASURE_SD if name in names.measures else VARIATION_SD)
            for name in names.columns
        ]
    )
    return presets, np.cov(presets.T, bias=True), np.diag(deviations**2)


def _square_root(covariance: Array) -> Array:
    """The symmetric root of a covariance."""
    values, vectors = np.linalg.eigh(covariance)
    root: Array = (vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T
    return root
