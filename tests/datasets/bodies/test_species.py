"""Categories of datasets and the presets that are built like them."""

from dataclasses import replace

import pytest

from animal3dbox.datasets import SyntheticSet
from animal3dbox.datasets.bodies.fitted import FittedBodies
from animal3dbox.datasets.bodies.options import body_source
from animal3dbox.datasets.bodies.species import CATEGORIES, preset_of_category
from animal3dbox.datasets.records import AnimalRecord
from animal3dbox.errors import ConfigError
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped, quadruped_names


def record_of(category: str) -> AnimalRecord:
    record = SyntheticSet(0, 1).records().records[0]
    assert isinstance(record, AnimalRecord)
    return replace(record, category=category)


def test_every_preset_has_words_and_no_word_has_two_presets() -> None:
    assert set(CATEGORIES) == set(quadruped_names().presets)
    words = [word for words in CATEGORIES.values() for word in words]
    assert len(words) == len(set(words))


@pytest.mark.parametrize(
    ("category", "preset"),
    [
        ("dog", "dog"),
        ("Arctic Fox", "dog"),
        ("snow-leopard", "lion"),
        ("polar_bear", "bear"),
        ("red panda", None),
        ("giraffe", None),
        ("", None),
        (None, None),
    ],
)
def test_a_category_is_read_by_all_of_its_words_or_the_last(
    category: str | None, preset: str | None
) -> None:
    assert preset_of_category(category) == preset


def test_a_species_given_stands_for_all_and_an_unknown_one_for_none() -> None:
    record = record_of("zebra")
    by_option = {
        species: FittedBodies(load_quadruped(), species) for species in ("auto", "unknown", "cow")
    }
    told = {name: source.species_of(record) for name, source in by_option.items()}
    assert told == {"auto": "zebra", "unknown": None, "cow": "cow"}
    assert len({source.fingerprint for source in by_option.values()}) == 3


def test_a_species_that_there_is_not_or_that_nothing_is_fitted_for_is_refused() -> None:
    with pytest.raises(ConfigError, match="species must be one of auto, unknown, dog"):
        body_source("fit", species="unicorn")
    with pytest.raises(ConfigError, match="is for bodies 'fit' and 'preset'"):
        body_source("dog", species="cow")
