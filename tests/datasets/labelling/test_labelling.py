"""Labels of many records at once.

The same as one by one, and one that is unusable spoils no other.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from one_label import label_of
from small_animals import model_of

from animal3dbox.datasets.bodies.sources import BodySource, preset_body
from animal3dbox.datasets.formats import read_dataset
from animal3dbox.datasets.labelling.label_records import label_records
from animal3dbox.datasets.labelling.label_requests import request_of_record
from animal3dbox.datasets.labelling.scale import KnownScale
from animal3dbox.datasets.read_options import ReadOptions
from animal3dbox.datasets.records import AnimalRecord
from animal3dbox.errors import SampleError
from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.types import CuboidLabel

CONFIG = LabelConfig(surface_share=False, mask_iou=False)


@pytest.fixture(scope="module")
def read(animals: Path) -> tuple[list[AnimalRecord], BodySource]:
    source = read_dataset(animals, options=ReadOptions(model=model_of(animals)))
    assert source.bodies is not None
    known = [replace(record, pose=record.stored_pose) for record in source.records.records]
    return known, source.bodies


def test_many_labels_are_those_made_one_by_one(read: tuple[list[AnimalRecord], BodySource]) -> None:
    records, bodies = read
    scale = KnownScale(0.7)
    together = label_records(
        [request_of_record(record, bodies) for record in records], CONFIG, scale=scale
    )
    for record, label in zip(records, together, strict=True):
        alone = label_of(record, bodies, CONFIG, scale=scale)
        assert isinstance(label, CuboidLabel)
        assert isinstance(alone, CuboidLabel)
        assert torch.allclose(label.corners_3d, alone.corners_3d, rtol=1e-9, atol=1e-9)
        assert torch.allclose(label.face_area, alone.face_area, rtol=1e-7)
        assert (label.sample_id, label.scale_source, label.quality.K_source) == (
            record.sample_id,
            "user",
            "dataset",
        )


def test_unusable_records_are_told_and_spoil_no_other(
    read: tuple[list[AnimalRecord], BodySource], tmp_path: Path
) -> None:
    records, bodies = read
    spoiled = list(records)
    spoiled[1] = replace(records[1], K=np.zeros((3, 3)))
    spoiled[3] = replace(records[3], sample_id="stranger")
    spoiled[4] = replace(records[4], mask_path=tmp_path / "none.png")
    spoiled[5] = replace(
        records[5], pose=None, stored_pose=None, keypoints_2d=records[5].keypoints_2d * 0
    )
    found = label_records([request_of_record(record, bodies) for record in spoiled], CONFIG)
    said = {
        place: outcome
        for place, outcome in enumerate(found)
        if not isinstance(outcome, CuboidLabel)
    }
    assert {
        place: getattr(outcome, "field", getattr(outcome, "reason", ""))
        for place, outcome in said.items()
    } == {
        1: "K",
        3: "parameters",
        4: "mask",
        5: "too_few_keypoints",
    }
    assert [one.sample_id for one in said.values() if isinstance(one, SampleError)] == [
        records[1].sample_id,
        "stranger",
        records[4].sample_id,
    ]


def test_one_body_for_all_can_be_labelled_together_too(
    read: tuple[list[AnimalRecord], BodySource],
) -> None:
    records, _ = read
    dog = preset_body("dog")
    few = [
        request_of_record(replace(record, pose=None, stored_pose=None), dog)
        for record in records[:2]
    ]
    assert all(isinstance(label, CuboidLabel) for label in label_records(few, CONFIG))
    assert label_records([], CONFIG) == []
