"""Boxes of two corners, among animals of several vocabularies and without boxes."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from animal3dbox.datasets.readers.distinct_animals import distinct_animals, has_evident_corners
from animal3dbox.datasets.readers.tolerance import Tolerance
from animal3dbox.datasets.records import AnimalRecord
from animal3dbox.smal.keypoints.vocabularies import VOCABULARIES

HW = (300, 500)


def animal(number: int, vocabulary: str, box: tuple[float, ...] | None) -> AnimalRecord:
    """An animal from (200, 100) to (400, 200), its other keypoints between."""
    words = VOCABULARIES[vocabulary]
    rng = np.random.default_rng(number)
    points = rng.uniform((200, 100), (400, 200), (len(words), 2))
    points[:2] = (200, 100), (400, 200)
    keypoints = np.column_stack((points, np.ones(len(words))))
    record = AnimalRecord(
        str(number), str(number), Path(f"{number}.jpg"), HW, words, keypoints, None, "dog"
    )
    return record if box is None else replace(record, box=np.array(box))


RIGHT = (189.5, 89.5, 409.5, 209.5)
CORNERS = (189.5, 89.5, 599.5, 299.5)
"""The corners (190, 90) and (410, 210), read as a corner, a width and a height."""


@pytest.mark.parametrize("place", range(5))
def test_a_box_of_two_corners_is_refused_whatever_the_others_are(place: int) -> None:
    kinds = ["stanfordextra24", "ap10k17", "stanfordextra24", "animal3d26", "ap10k17"]
    animals = [animal(number, kind, RIGHT) for number, kind in enumerate(kinds)]
    animals[(place + 1) % 5] = animal((place + 1) % 5, kinds[(place + 1) % 5], None)
    assert not has_evident_corners(animals)
    animals[place] = animal(place, kinds[place], CORNERS)
    assert has_evident_corners(animals)
    kept, faults = distinct_animals(animals, Tolerance())
    assert [fault.sample_id for fault in faults] == [str(place)]
    assert len(kept) == 4


def test_there_are_no_corners_without_animals() -> None:
    assert not has_evident_corners([])
