"""The body source "preset": the rigid body of each animal's own species, as its category says."""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache

from animal3dbox.datasets.bodies.sources import ModelBody, preset_body
from animal3dbox.datasets.bodies.species import (
    AUTO,
    CATEGORIES,
    UNKNOWN,
    check_species,
    preset_of_category,
)
from animal3dbox.datasets.records import AnimalRecord
from animal3dbox.datasets.storage.fingerprint import content_digest, digest
from animal3dbox.labels.body import Body

PRESET = "preset"
"""The source's name for --body and in reports."""
STAND_IN = "dog"
"""The preset of animals whose category is none of the presets."""


@dataclass(frozen=True)
class PresetBodies:
    """A body source that gives each animal the rigid preset of its category, else a dog.

    Attributes:
        species: one preset of all animals; "auto": by each one's category (see species.py);
            "unknown": a dog.

    Raises:
        ConfigError: there is no such species.

    Example:
        >>> PresetBodies().preset("snow leopard"), PresetBodies().preset("okapi")
        ('lion', 'dog')
    """

    species: str = AUTO

    def __post_init__(self) -> None:
        check_species(self.species)

    @property
    def name(self) -> str:
        """The source's name in reports."""
        return PRESET if self.species == AUTO else f"{PRESET}:{self.species}"

    @property
    def fingerprint(self) -> bytes:
        """Digest of the embedded quadruped and of the table of categories."""
        return digest(_preset(STAND_IN).fingerprint, content_digest(dict(CATEGORIES)), self._word)

    @property
    def _word(self) -> bytes:
        return self.species.encode()

    @property
    def lasting(self) -> bool:
        """True: the presets are part of the package."""
        return True

    def content(self, sample_id: str) -> bytes:
        """Empty: which preset it is follows from the animal's category."""
        return b""

    def preset(self, category: str) -> str:
        """The preset of a category."""
        if self.species not in (AUTO, UNKNOWN):
            return self.species
        return (preset_of_category(category) if self.species == AUTO else None) or STAND_IN

    def body(self, record: AnimalRecord) -> Body:
        """The standing body of the record's category, with its vocabulary's landmarks."""
        return _preset(self.preset(record.category)).body(record)


def species_notes(species: str, animals: Iterable[str]) -> tuple[str, ...]:
    """A sentence on which presets stand for the animals' categories; none if all are dogs.

    Args:
        species: see PresetBodies.
        animals: their categories.

    """
    categories = Counter(animals)
    if species != AUTO or not categories:
        return ()
    counts = Counter[str]()
    for category, count in categories.items():
        counts[preset_of_category(category) or ""] += count
    if set(counts) == {STAND_IN}:
        return ()
    known = ", ".join(f"{count} {name}" for name, count in counts.most_common() if name)
    others = [category for category in categories if preset_of_category(category) is None]
    if not others:
        return (f"species by category: {known}",)
    named = ", ".join(repr(category) for category in others[:5])
    return (
        f"species by category: {known or 'none'}; no preset is like {counts['']} of the animals:"
        f" {named}{', ...' if len(others) > 5 else ''} (--species names one for all)",
    )


@cache
def _preset(name: str) -> ModelBody:
    return preset_body(name)
