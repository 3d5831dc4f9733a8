"""Animals whose keypoints lie beside them teach nothing about their dataset."""

from dataclasses import replace
from pathlib import Path

from animal3dbox.datasets.bodies.fitted import FittedBodies
from animal3dbox.datasets.labelling.learned_bodies import learn_from_records
from animal3dbox.datasets.synthetic.synthetic_set import SyntheticSet
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
