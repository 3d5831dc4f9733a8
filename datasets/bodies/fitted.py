"""The body source "fit": each animal's own body, fitted to its picture with its camera."""

from dataclasses import dataclass

from animal3dbox.datasets.bodies.presets import PresetBodies
from animal3dbox.datasets.bodies.sources import ModelBody, model_digest
from animal3dbox.datasets.bodies.species import (
    AUTO,
    UNKNOWN,
    check_species,
    preset_of_category,
)
from animal3dbox.datasets.records import AnimalRecord
from animal3dbox.datasets.storage.fingerprint import digest
from animal3dbox.errors import ConfigError
from animal3dbox.labels.body import Body
from animal3dbox.labels.fit.fitted_observation import ENOUGH_KEYPOINTS
from animal3dbox.smal.model import SmalModel
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped

FIT = "fit"
"""The source's name for --body and in reports."""


@dataclass(frozen=True)
class FittedBodies:
    """A body source that leaves it to labelling to fit a body to each animal.

    Its own bodies, rigid ones, are for animals that cannot be fitted: those with fewer than
    ENOUGH_KEYPOINTS keypoints, and those behind a lens.

    Attributes:
        model: whose pose and shape are fitted; the embedded quadruped or a model of the user's.
        species: of all animals, a preset of the quadruped; "auto": by each one's category (see
            species.py); "unknown": of none.

    Raises:
        ConfigError: there is no such species, or a species is given of a model of the user's, which
            has no presets, or the model has no landmarks.

    Example:
        >>> FittedBodies(load_quadruped()).name
        'fit'
    """

    model: SmalModel
    species: str = AUTO

    def __post_init__(self) -> None:
        check_species(self.species)
        ModelBody(self.model, FIT)  # which refuses a model without landmarks
        if self.model is not load_quadruped() and self.species not in (AUTO, UNKNOWN):
            raise ConfigError(
                f"species={self.species!r} is a preset of the embedded quadruped's, which another"
                " model has not: leave it out"
            )

    @property
    def name(self) -> str:
        """The source's name in reports."""
        return FIT

    @property
    def fingerprint(self) -> bytes:
        """Digest of the model, and that it is fitted."""
        return digest(model_digest(self.model), FIT.encode(), self.species.encode())

    @property
    def lasting(self) -> bool:
        """True: the model is held in memory and does not change."""
        return True

    def content(self, sample_id: str) -> bytes:
        """Empty: what a fit depends on is the animal's own annotation."""
        return b""

    def can_fit(self, record: AnimalRecord) -> bool:
        """Whether a body is fitted to an animal, or a rigid one stands in."""
        count = int((record.keypoints_2d[:, 2] > 0).sum())
        return count >= ENOUGH_KEYPOINTS and record.distortion is None

    def species_of(self, record: AnimalRecord) -> str | None:
        """The preset that is an animal's; None if it is not known, or of another model."""
        if self.model is not load_quadruped() or self.species == UNKNOWN:
            return None
        return preset_of_category(record.category) if self.species == AUTO else self.species

    def body(self, record: AnimalRecord) -> Body:
        """The rigid body that stands in for an animal that cannot be fitted."""
        if self.model is load_quadruped():
            return PresetBodies(self.species).body(record)
        return ModelBody(self.model, FIT).body(record)
