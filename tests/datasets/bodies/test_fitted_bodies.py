"""The body source "fit"."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from animal3dbox import CuboidLabel, LabelConfig
from animal3dbox.datasets.bodies.fitted import FittedBodies
from animal3dbox.datasets.bodies.options import body_source
from animal3dbox.datasets.bodies.sources import preset_body
from animal3dbox.datasets.labelling.label_records import label_records
from animal3dbox.datasets.labelling.label_requests import LabelRequest, request_of_record
from animal3dbox.datasets.labelling.targets import target_of
from animal3dbox.datasets.records import AnimalRecord
from animal3dbox.datasets.synthetic.faults import FaultConfig
from animal3dbox.datasets.synthetic.synthetic_set import SyntheticSet
from animal3dbox.datasets.synthetic.world.config import CLEAR
from animal3dbox.geometry.rigid_transforms import rotation_angle
from animal3dbox.labels.label import label_animal
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped

SET = SyntheticSet(3, 4, CLEAR, faults=FaultConfig(noise_px=2.0))


@pytest.fixture(scope="module")
def records() -> list[AnimalRecord]:
    return [record for record in SET.records().records if isinstance(record, AnimalRecord)]


def source() -> FittedBodies:
    fitted = body_source("fit")
    assert isinstance(fitted, FittedBodies)
    return fitted


def requests(records: list[AnimalRecord]) -> list[LabelRequest]:
    return [request_of_record(record, source()) for record in records]


def few(record: AnimalRecord, count: int) -> AnimalRecord:
    """The record with so many keypoints."""
    keypoints = record.keypoints_2d.copy()
    keypoints[np.flatnonzero(keypoints[:, 2])[count:]] = 0.0
    return replace(record, keypoints_2d=keypoints)


def test_animals_get_labels_of_bodies_fitted_to_them(records: list[AnimalRecord]) -> None:
    labels = label_records(requests(records), LabelConfig())
    for label, sample in zip(labels, SET.samples(), strict=True):
        assert isinstance(label, CuboidLabel)
        assert label.quality.body == "fit"
        apart = rotation_angle(label.rotation, sample.animal.cuboid.rotation)
        assert float(torch.rad2deg(apart)) < 25


def test_they_are_label_animals_labels(records: list[AnimalRecord]) -> None:
    (label,) = label_records(requests(records[:1]), LabelConfig())
    record = records[0]
    own = label_animal(
        record.image_hw,
        record.keypoints_2d,
        K=record.K,
        mask=record.mask,
        species=record.category,
        sample_id=record.sample_id,
        body="fit",
    )
    assert isinstance(label, CuboidLabel)
    assert isinstance(own, CuboidLabel)
    assert np.array_equal(label.row, own.row)


def test_a_label_is_the_same_whatever_else_is_labelled(records: list[AnimalRecord]) -> None:
    mixed = [records[0], few(records[1], 8), records[2], few(records[3], 4)]
    together = label_records(requests(mixed), LabelConfig())
    for record, label in zip(mixed, together, strict=True):
        (alone,) = label_records(requests([record]), LabelConfig())
        if isinstance(label, CuboidLabel):
            assert isinstance(alone, CuboidLabel)
            assert np.array_equal(alone.row, label.row)
        else:
            assert alone == label


def test_few_keypoints_get_a_rigid_preset_and_a_warning(records: list[AnimalRecord]) -> None:
    record = few(records[1], 8)
    (label,) = label_records(requests([record]), LabelConfig())
    (rigid,) = label_records(
        [request_of_record(record, preset_body(record.category))], LabelConfig()
    )
    assert isinstance(label, CuboidLabel)
    assert isinstance(rigid, CuboidLabel)
    assert label.quality.body == "preset"
    assert any("8 keypoints" in warning for warning in label.quality.warnings)
    assert np.array_equal(label.field("corners_3d"), rigid.field("corners_3d"))


def test_the_fingerprint_is_the_models_and_not_a_presets() -> None:
    assert source().fingerprint == FittedBodies(load_quadruped()).fingerprint
    assert source().fingerprint != preset_body("dog").fingerprint
    assert (source().name, source().lasting, source().content("a")) == ("fit", True, b"")


def test_a_target_tells_the_fits_parameters_and_of_no_other_body(
    records: list[AnimalRecord],
) -> None:
    labels = label_records(requests([records[0], few(records[1], 8)]), LabelConfig())
    fitted, rigid = (one for one in labels if isinstance(one, CuboidLabel))
    quality = target_of("a", [fitted, rigid], [0, 0])["meta"]["quality"]
    assert fitted.fit is not None
    assert quality[0]["fit"]["betas"] == fitted.fit.betas.tolist()
    assert quality[0]["fit"]["digest"] == load_quadruped().digest
    assert "fit" not in quality[1]
