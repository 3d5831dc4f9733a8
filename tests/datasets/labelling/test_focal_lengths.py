"""Focal lengths of images whose camera nothing tells: one for all animals of an image."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from animal3dbox.datasets.bodies.fitted import FittedBodies
from animal3dbox.datasets.bodies.sources import BodySource, preset_body
from animal3dbox.datasets.images.exif import PhotoFacts
from animal3dbox.datasets.labelling.image_index import entry_of
from animal3dbox.datasets.labelling.image_samples import ImageSample
from animal3dbox.datasets.labelling.label_records import label_records
from animal3dbox.datasets.labelling.label_requests import LabelRequest
from animal3dbox.datasets.labelling.label_store import LabelStore
from animal3dbox.datasets.records import AnimalRecord
from animal3dbox.datasets.synthetic.synthetic_set import SyntheticSet
from animal3dbox.datasets.synthetic.world.config import CLEAR
from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.types import CuboidLabel
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped

QUICK = LabelConfig(surface_share=False, mask_iou=False)


@pytest.fixture(scope="module")
def records() -> tuple[AnimalRecord, ...]:
    world = replace(CLEAR, image_hw=(240, 320), presets=("dog",), poses=("stand",))
    made = SyntheticSet(seed=4, images=2, config=world).records().records
    animals = [one for one in made if isinstance(one, AnimalRecord)]
    return tuple(
        replace(one, K=None, stored_pose=None, mask_runs=None, image_id="both") for one in animals
    )


def sample_of(records: tuple[AnimalRecord, ...], bodies: BodySource) -> ImageSample:
    entries = tuple(entry_of(one, np.asarray(one.keypoints_2d).tobytes()) for one in records)
    return ImageSample("both", "", False, entries, lambda: records, bodies)


def labelled(requests: list[LabelRequest], config: LabelConfig = QUICK) -> list[CuboidLabel]:
    labels = label_records(requests, config)
    assert all(isinstance(one, CuboidLabel) for one in labels)
    return [one for one in labels if isinstance(one, CuboidLabel)]


def test_all_animals_of_an_image_share_its_focal_length_asked_for_or_not(
    records: tuple[AnimalRecord, ...],
) -> None:
    sample = sample_of(records, preset_body("dog"))
    requests = [LabelRequest(sample, place, PhotoFacts()) for place in range(len(records))]
    together = labelled(requests)
    assert len(together) == 2
    assert together[0].K.tolist() == together[1].K.tolist()
    assert {one.quality.K_source for one in together} == {"estimated"}
    for place, request in enumerate(requests):
        alone = labelled([request])
        assert len(alone) == 1
        assert alone[0].row.tobytes() == together[place].row.tobytes()
    apart = labelled([LabelRequest(sample_of(records[:1], preset_body("dog")), 0, PhotoFacts())])
    assert apart[0].K.tolist() != together[0].K.tolist()


def test_a_guess_is_kept_where_it_is_asked_for(records: tuple[AnimalRecord, ...]) -> None:
    sample = sample_of(records, preset_body("dog"))
    label = labelled([LabelRequest(sample, 0, PhotoFacts())], replace(QUICK, focal="guess"))[0]
    assert label.quality.K_source == "guessed"
    assert float(label.K[0, 0]) == 1.2 * 320
    assert label.quality.log_focal_sd is None


def test_a_cached_label_depends_on_the_other_animals_of_its_image(
    records: tuple[AnimalRecord, ...], tmp_path: Path
) -> None:
    def key(config: LabelConfig, second: AnimalRecord) -> bytes:
        store = LabelStore(
            b"", config, scale=None, stored_cameras="hypothesis", cache=tmp_path / "cache"
        )
        sample = sample_of((records[0], second), preset_body("dog"))
        return store.request(sample, 0, PhotoFacts()).key

    moved = replace(records[1], keypoints_2d=np.asarray(records[1].keypoints_2d) + 1.0)
    assert key(QUICK, records[1]) != key(QUICK, moved)
    guess = replace(QUICK, focal="guess")
    assert key(guess, records[1]) == key(guess, moved)


def test_an_unusable_animal_does_not_change_the_others_focal_length(
    records: tuple[AnimalRecord, ...],
) -> None:
    broken = replace(records[0], keypoints_2d=np.full((len(records[0].keypoints_2d), 3), np.nan))
    bodies = preset_body("dog")
    three = sample_of((*records, broken), bodies)
    other = sample_of((replace(broken, image_id="other"),), bodies)
    together = [LabelRequest(three, place, PhotoFacts()) for place in range(3)]
    outcomes = label_records([*together, LabelRequest(other, 0, PhotoFacts())], QUICK)
    assert [isinstance(one, CuboidLabel) for one in outcomes] == [True, True, False, False]
    both = labelled([LabelRequest(sample_of(records, bodies), i, PhotoFacts()) for i in (0, 1)])
    for outcome, label in zip(outcomes[:2], both, strict=True):
        assert isinstance(outcome, CuboidLabel)
        assert outcome.row.tobytes() == label.row.tobytes()


def few(record: AnimalRecord, count: int) -> AnimalRecord:
    """The record with so many keypoints."""
    keypoints = record.keypoints_2d.copy()
    keypoints[np.flatnonzero(keypoints[:, 2])[count:]] = 0.0
    return replace(record, keypoints_2d=keypoints)


@pytest.mark.parametrize("keypoints", [26, 8])
def test_fitted_animals_of_an_image_share_its_focal_length_with_each_other_and_rigid_ones(
    records: tuple[AnimalRecord, ...], keypoints: int
) -> None:
    sample = sample_of((records[0], few(records[1], keypoints)), FittedBodies(load_quadruped()))
    requests = [LabelRequest(sample, place, PhotoFacts()) for place in range(2)]
    together = labelled(requests)
    assert [one.quality.body for one in together] == ["fit", "fit" if keypoints > 8 else "preset"]
    assert together[0].K.tolist() == together[1].K.tolist()
    assert {one.quality.K_source for one in together} == {"estimated"}
    sd = {one.quality.log_focal_sd for one in together}
    assert len(sd) == 1
    assert None not in sd
    for place, request in enumerate(requests):
        (alone,) = labelled([request])
        assert alone.row.tobytes() == together[place].row.tobytes()
    lonely = sample_of(records[:1], FittedBodies(load_quadruped()))
    apart = labelled([LabelRequest(lonely, 0, PhotoFacts())])[0]
    assert (apart.K.tolist() != together[0].K.tolist()) == (keypoints > 8)


def test_a_guess_is_kept_by_fits_too(records: tuple[AnimalRecord, ...]) -> None:
    sample = sample_of(records, FittedBodies(load_quadruped()))
    requests = [LabelRequest(sample, place, PhotoFacts()) for place in range(2)]
    for label in labelled(requests, replace(QUICK, focal="guess")):
        assert label.quality.body == "fit"
        assert label.quality.K_source == "guessed"
        assert float(label.K[0, 0]) == 1.2 * 320
        assert label.quality.log_focal_sd is None
