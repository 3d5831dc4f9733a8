"""A synthetic dataset in memory, and written as StanfordExtra."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from one_label import label_of

from animal3dbox.datasets.readers.stanfordextra import read_stanfordextra
from animal3dbox.datasets.synthetic.faults import FaultConfig
from animal3dbox.datasets.synthetic.stanfordextra_writer import write_stanfordextra
from animal3dbox.datasets.synthetic.synthetic_set import SyntheticSet
from animal3dbox.datasets.synthetic.world.config import WorldConfig
from animal3dbox.errors import ConfigError
from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.types import CuboidLabel
from animal3dbox.smal.keypoints.vocabularies import VOCABULARIES

SMALL = WorldConfig(
    image_hw=(96, 128), focal_px=(150.0, 800.0), fill=(0.5, 0.9), animals=(2, 3), truncated=0.0
)
DOGS = replace(SMALL, vocabulary=VOCABULARIES["stanfordextra24"])


def test_records_need_no_files_and_their_own_bodies_and_cameras_label_them() -> None:
    made = SyntheticSet(1, 3, SMALL, hidden="marked")
    records, bodies, samples = made.records(), made.bodies(), list(made.samples())
    assert len(made) == 3
    assert len(records.records) == len(samples) > 3
    assert [record.image_id for record in records.records] == [
        sample.scene.image_id for sample in samples
    ]
    assert records.faults == ()
    for record, sample in zip(records.records, samples, strict=True):
        assert record.image_path is None
        assert record.stored_pose is None
        assert np.array_equal(record.mask, sample.animal.mask.numpy())  # type: ignore[arg-type]
    first, truth = records.records[0], samples[0].animal
    label = label_of(first, bodies, LabelConfig())
    assert isinstance(label, CuboidLabel)
    assert label.quality.K_source == "given"
    apart = (label.corners_3d - truth.cuboid.corners()).norm(dim=1).mean()
    assert (
        float(apart / truth.cuboid.diagonal) < 0.05
    )  # exact keypoints; the torso's axes are not quite the trunk's


def test_faults_and_misfits_are_in_the_records_and_bodies_and_not_in_the_truth() -> None:
    clean, spoilt = (
        SyntheticSet(1, 1, SMALL),
        SyntheticSet(1, 1, SMALL, FaultConfig(noise_px=2.0, joint_deg=5.0)),
    )
    a, b = clean.records().records[0], spoilt.records().records[0]
    assert not np.array_equal(a.keypoints_2d, b.keypoints_2d)
    assert not clean.bodies().body(a).vertices.equal(spoilt.bodies().body(b).vertices)
    assert next(clean.samples()).animal.vertices.equal(next(spoilt.samples()).animal.vertices)
    known = clean.records(stored_pose=True).records[0].stored_pose
    assert known is not None
    assert known[0].tolist() == np.eye(3).tolist()


def test_a_written_stanfordextra_json_is_read_back_as_it_was_in_memory(tmp_path: Path) -> None:
    made = SyntheticSet(2, 4, DOGS, FaultConfig(noise_px=1.0))
    count = write_stanfordextra(made, tmp_path / "dogs")
    read, ours = read_stanfordextra(tmp_path / "dogs"), made.records().records
    assert read.faults == ()
    assert len(read.records) == len(ours) == count
    for record, memory in zip(read.records, ours, strict=True):
        assert memory.image_id in record.image_id
        marked = memory.keypoints_2d[:, 2] > 0
        assert np.array_equal(record.keypoints_2d[marked], memory.keypoints_2d[marked])
        assert not record.keypoints_2d[~marked].any()
        assert np.array_equal(record.mask, memory.mask)  # type: ignore[arg-type]
        assert record.K is None
    entries = json.loads((tmp_path / "dogs" / "annotations.json").read_text())
    assert any(entry["is_multiple_dogs"] for entry in entries)
    assert {len(entry["joints"]) for entry in entries} == {24}
    truth = json.loads((tmp_path / "dogs" / "truth.json").read_text())
    assert [told["sample_id"] for told in truth["animals"]] == [
        record.sample_id for record in read.records
    ]
    with pytest.raises(ConfigError, match="stanfordextra24"):
        write_stanfordextra(SyntheticSet(0, 1, SMALL), tmp_path / "other")
