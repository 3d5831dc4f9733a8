"""What has been learned so far of a dataset's animals: keypoints' places, classes' mean shapes."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from animal3dbox.labels.calibration import Calibration, ClassShape, KeypointPlaces
from animal3dbox.labels.fit.fit_body import PLACES_SD, FitBody, body_digest, body_of_prior, fit_body
from animal3dbox.labels.fit.learning.mirrored_offsets import offset_basis
from animal3dbox.labels.fit.shape_prior import ShapePrior, shape_prior
from animal3dbox.smal.keypoints.vocabulary import Vocabulary
from animal3dbox.smal.model import SmalModel
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped, preset_betas

Array = NDArray[np.float64]
DECIMALS = 6
"""Of the numbers in a calibration, so that its file holds exactly what was used."""


@dataclass(frozen=True)
class Lessons:
    """What has been learned so far of the animals of one vocabulary.

    Attributes:
        model: the body's.
        vocabulary: the keypoints'.
        offsets: (G,) free numbers of the keypoints' offsets, see offset_basis; None: not learned.
        sd: (L,) see KeypointPlaces.
        means: category -> (S,) the class's mean in the whole prior's shape coefficients.
        presets: category -> the preset that it is known to be, or None.
        animals: category -> how many there are; "" of those without one, and all in `total`.
        scatter: see ClassShape.
    """

    model: SmalModel
    vocabulary: Vocabulary
    offsets: Array | None
    sd: Array
    means: Mapping[str, Array]
    presets: Mapping[str, str | None]
    animals: Mapping[str, int]
    scatter: float = 1.0

    @property
    def total(self) -> int:
        """How many animals are learned from."""
        return sum(self.animals.values())

    @cached_property
    def places(self) -> KeypointPlaces | None:
        """The keypoints' places, as a calibration has them; None if they are not learned."""
        if self.offsets is None:
            return None
        offsets = (offset_basis(self.vocabulary) @ self.offsets).reshape(-1, 3)
        rows = np.round(offsets, DECIMALS).tolist()
        return KeypointPlaces(
            vocabulary=self.vocabulary.name,
            body=body_digest(self.model, self.vocabulary),
            keypoints=self.vocabulary.keypoints,
            offsets=tuple((x, y, z) for x, y, z in rows),
            sd=tuple(np.round(self.sd, DECIMALS).tolist()),
            animals=self.total,
        )

    @cached_property
    def shapes(self) -> Mapping[str, ClassShape]:
        """The classes' shapes, as a calibration has them, by category."""
        return {
            category: ClassShape(
                vocabulary=self.vocabulary.name,
                body=body_digest(self.model, self.vocabulary),
                category=category,
                preset=self.presets[category],
                betas=tuple(np.round(self._betas(category), DECIMALS).tolist()),
                scatter=round(self.scatter, DECIMALS),
                animals=self.animals[category],
            )
            for category in sorted(self.means)
        }

    @property
    def calibration(self) -> Calibration:
        """The lessons as a calibration: places of the vocabulary, and a shape a category."""
        places = () if self.places is None else (self.places,)
        return Calibration((), places, tuple(self.shapes.values()))

    def body(self, category: str, species: str | None) -> FitBody:
        """The body that is fitted to a category's animals, as fit_animal takes it."""
        shape = self.shapes.get(category)
        own = None if shape is not None else species
        return fit_body(self.model, self.vocabulary, own, places=self.places, shape=shape)

    def whole_body(self, category: str) -> FitBody | None:
        """A class's body with the directions of all shapes; None of a category without a shape."""
        shape = self.shapes.get(category)
        if shape is None:
            return None
        directions = shape_prior(self.model).directions
        count = directions.shape[1]
        prior = ShapePrior(np.array(shape.betas), directions, np.zeros((1, count)), np.eye(count))
        return body_of_prior(self.model, self.vocabulary, prior, self.places)

    def _betas(self, category: str) -> Array:
        prior = shape_prior(self.model)
        betas: Array = prior.mean + prior.directions @ self.means[category]
        return betas


def first_lessons(
    model: SmalModel,
    vocabulary: Vocabulary,
    *,
    places: bool,
    presets: Mapping[str, str | None],
    animals: Mapping[str, int],
) -> Lessons:
    """Nothing learned yet: the body's own places, and classes like what they are known to be.

    Args:
        model: the body's.
        vocabulary: the keypoints'.
        places: whether they are to be learned.
        presets: category -> its preset, of the classes whose shapes are to be learned.
        animals: category -> how many there are.

    """
    basis = offset_basis(vocabulary)
    return Lessons(
        model=model,
        vocabulary=vocabulary,
        offsets=np.zeros(basis.shape[1]) if places else None,
        sd=np.full(len(vocabulary), PLACES_SD),
        means={category: usual_shape(model, preset) for category, preset in presets.items()},
        presets=presets,
        animals=animals,
    )


def usual_shape(model: SmalModel, preset: str | None) -> Array:
    """The coefficients (S,) of a preset's shape in the whole prior; the mean's if None."""
    prior = shape_prior(model)
    if preset is None or model is not load_quadruped():
        return np.zeros(prior.directions.shape[1])
    names = np.asarray(preset_betas(preset))
    coefficients: Array = np.linalg.pinv(prior.directions) @ (names - prior.mean)
    return coefficients
