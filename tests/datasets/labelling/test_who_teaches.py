"""Animals whose keypoints lie beside them teach nothing about their dataset."""

from dataclasses import replace
from pathlib import Path

import pytest
from PIL import Image

from animal3dbox.datasets.bodies.fitted import FittedBodies
from animal3dbox.datasets.images.remote_files import PictureUrl
from animal3dbox.datasets.labelling.label_requests import request_of_record
from animal3dbox.datasets.labelling.learned_bodies import learn_from_records
from animal3dbox.datasets.synthetic.synthetic_set import SyntheticSet
from animal3dbox.errors import SampleError
from animal3dbox.labels.config import LabelConfig
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped


def test_misplaced_keypoints_teach_nothing_and_are_told(tmp_path: Path) -> None:
    bodies = FittedBodies(load_quadruped())
    sound = [one for one in SyntheticSet(0, 8).records().records if bodies.can_fit(one)]
    wrong = sound[0].keypoints_2d.copy()
    wrong[:, :2] /= 1000
    records = [replace(sound[0], keypoints_2d=wrong), *sound[1:]]
    learned = learn_from_records(records, bodies, LabelConfig(), learn=("places",), folder=tmp_path)
    assert [fault.sample_id for fault in learned.faults] == [sound[0].sample_id]
    assert "normalised" in learned.faults[0].problem
    assert sum(learned.few.values()) == len(sound) - 1


def test_animals_whose_picture_cannot_be_read_teach_nothing_and_are_told(tmp_path: Path) -> None:
    bodies = FittedBodies(load_quadruped())
    first, second, third, *others = (
        one for one in SyntheticSet(0, 8).records().records if bodies.can_fit(one)
    )
    (tmp_path / "words.jpg").write_text("words")
    height, width = third.image_hw
    Image.new("RGB", (width, height)).save(tmp_path / "sound.jpg")
    Image.new("RGB", (width + 1, height)).save(tmp_path / "other.jpg")
    pictures = [
        replace(first, image_path=tmp_path / "words.jpg"),
        replace(second, image_path=tmp_path / "words.jpg"),
        replace(third, image_path=tmp_path / "sound.jpg"),
        replace(others[0], image_path=tmp_path / "other.jpg"),
        replace(others[1], image_path=PictureUrl("memory://nowhere/a.jpg")),
    ]
    fits = tmp_path / "fits"
    learned = learn_from_records(pictures, bodies, LabelConfig(), learn=("places",), folder=fits)
    faults = {fault.sample_id: fault.problem for fault in learned.faults}
    assert len(learned.faults) == 4
    assert "words.jpg cannot be decoded" in faults[first.sample_id]
    assert faults[second.sample_id] == faults[first.sample_id]
    assert f"its pixels are {width + 1} x {height}" in faults[others[0].sample_id]
    assert "memory://nowhere/a.jpg cannot be read" in faults[others[1].sample_id]
    assert sum(learned.few.values()) == 1
    with pytest.raises(SampleError, match=r"words.jpg cannot be decoded"):
        request_of_record(pictures[0], bodies)
