"""Keypoints beside their animal: found, told with the likely cause, an error or a flag."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from animal3dbox.datasets.bodies.sources import preset_body
from animal3dbox.datasets.format_datasets import AnnotatedDataset
from animal3dbox.datasets.labelling.keypoint_places import keypoints_problem
from animal3dbox.datasets.labelling.label_records import label_records
from animal3dbox.datasets.labelling.label_requests import request_of_record
from animal3dbox.datasets.labelling.skipped import Skipped
from animal3dbox.datasets.records import AnimalRecord
from animal3dbox.datasets.synthetic.stanfordextra_writer import write_stanfordextra
from animal3dbox.datasets.synthetic.synthetic_set import SyntheticSet
from animal3dbox.datasets.synthetic.world.config import WorldConfig
from animal3dbox.errors import ConfigError, SampleError
from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.types import CuboidLabel
from animal3dbox.smal.keypoints.vocabularies import VOCABULARIES

Array = NDArray[np.float64]
QUICK = LabelConfig(surface_share=False, mask_iou=False)


@pytest.fixture(scope="module")
def record() -> AnimalRecord:
    """An animal far from its picture's middle and diagonal."""
    records = SyntheticSet(seed=0, images=12).records().records
    return max(records, key=_off_middle)


def _off_middle(record: AnimalRecord) -> float:
    x, y = record.keypoints_2d[record.keypoints_2d[:, 2] > 0, :2].mean(0)
    return float(min(abs(x - y), abs(y - 240)))


def moved(record: AnimalRecord, change: Callable[[Array], Array]) -> AnimalRecord:
    keypoints = record.keypoints_2d.copy()
    marked = keypoints[:, 2] > 0
    keypoints[marked, :2] = change(keypoints[marked, :2])
    return replace(record, keypoints_2d=keypoints)


def test_clean_keypoints_pass() -> None:
    for one in SyntheticSet(seed=1, images=20).records().records:
        assert keypoints_problem(one, one.mask) is None, one.sample_id


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda xy: xy / [640, 480], "look normalised"),
        (lambda xy: 2 * xy, "they were of an image 2 times as large"),
        (lambda xy: xy / 2, "they were of an image 0.5 times as large"),
        (lambda xy: xy[:, ::-1], "x and y were exchanged"),
        (lambda xy: xy * [1, -1] + [0, 479], "y were counted from the bottom"),
        (lambda xy: xy + 5000, "are they pixels of this image, and of this animal?"),
    ],
)
def test_a_mistake_is_told_with_its_likely_cause(
    record: AnimalRecord, change: Callable[[Array], Array], words: str
) -> None:
    problem = keypoints_problem(moved(record, change), record.mask)
    assert problem is not None
    assert words in problem


def test_the_box_alone_tells_keypoints_counted_from_its_corner(record: AnimalRecord) -> None:
    xy = record.keypoints_2d[record.keypoints_2d[:, 2] > 0, :2]
    box = np.concatenate((xy.min(0), xy.max(0)))
    shifted = moved(replace(record, box=box), lambda xy: xy - box[:2])
    problem = keypoints_problem(shifted, None)
    assert problem is not None
    assert "counted from the corner of the box" in problem


def test_two_keypoints_tell_nothing(record: AnimalRecord) -> None:
    keypoints = moved(record, lambda xy: xy + 5000).keypoints_2d
    keypoints[np.flatnonzero(keypoints[:, 2])[2:], 2] = 0
    assert keypoints_problem(replace(record, keypoints_2d=keypoints), record.mask) is None


def test_points_a_little_beside_the_mask_pass(record: AnimalRecord) -> None:
    mask = record.mask
    assert mask is not None
    xy = record.keypoints_2d[record.keypoints_2d[:, 2] > 0, :2]
    little = 0.05 * float(np.ptp(xy, axis=0).max())
    assert keypoints_problem(moved(record, lambda xy: xy + little), mask) is None


def test_misplaced_keypoints_are_an_error_or_a_flag(record: AnimalRecord) -> None:
    wrong = moved(record, lambda xy: xy * [1, -1] + [0, 479])
    request = request_of_record(wrong, preset_body("dog"))
    (fault,) = label_records([request], QUICK)
    assert isinstance(fault, SampleError)
    assert (fault.sample_id, fault.field) == (wrong.sample_id, "keypoints_2d")
    (label,) = label_records([request], QUICK, misplaced="flag")
    assert isinstance(label, CuboidLabel)
    assert "misplaced" in label.quality.flags
    assert any("counted from the bottom" in warning for warning in label.quality.warnings)


def test_a_mask_that_cannot_be_read_costs_the_animal_or_only_itself(
    record: AnimalRecord, tmp_path: Path
) -> None:
    (tmp_path / "mask.png").write_bytes(b"words")
    spoilt = replace(record, mask_runs=None, mask_path=tmp_path / "mask.png")
    request = request_of_record(spoilt, preset_body("dog"))
    (fault,) = label_records([request], QUICK)
    assert isinstance(fault, SampleError)
    (label,) = label_records([request], QUICK, optional="drop")
    assert isinstance(label, CuboidLabel)
    assert any("the mask is left out: mask" in one for one in label.quality.warnings)
    (bare,) = label_records(
        [request_of_record(replace(record, mask_runs=None), preset_body("dog"))], QUICK
    )
    assert isinstance(bare, CuboidLabel)
    assert np.array_equal(label.corners_3d.numpy(), bare.corners_3d.numpy())


@pytest.mark.parametrize(
    ("value", "words"), [(np.nan, "finite"), (np.inf, "finite"), (1e300, "ten image sizes")]
)
def test_a_number_that_is_none_keeps_the_error_that_names_it(
    record: AnimalRecord, value: float, words: str
) -> None:
    keypoints = record.keypoints_2d.copy()
    keypoints[np.flatnonzero(keypoints[:, 2])[0], 0] = value
    request = request_of_record(replace(record, keypoints_2d=keypoints), preset_body("dog"))
    (fault,) = label_records([request], QUICK)
    assert isinstance(fault, SampleError)
    assert words in fault.problem


def test_a_dataset_raises_skips_or_flags(tmp_path: Path) -> None:
    world = WorldConfig((120, 160), VOCABULARIES["stanfordextra24"])
    write_stanfordextra(SyntheticSet(0, 1, world), tmp_path)
    file = tmp_path / "annotations.json"
    entries = json.loads(file.read_text())
    for entry in entries:
        entry["joints"] = [[x, 119 - y, v] if v else [x, y, v] for x, y, v in entry["joints"]]
    file.write_text(json.dumps(entries))
    options: dict[str, Any] = {"body": "preset", "config": QUICK}
    with pytest.raises(SampleError, match="counted from the bottom"):
        AnnotatedDataset(tmp_path, **options)[0]
    assert isinstance(AnnotatedDataset(tmp_path, on_bad="skip", **options)[0], Skipped)
    sample = AnnotatedDataset(tmp_path, misplaced="flag", **options)[0]
    assert not isinstance(sample, Skipped)
    quality = sample[1]["meta"]["quality"][0]
    assert any("counted from the bottom" in one for one in quality["warnings"])
    with pytest.raises(ConfigError, match="misplaced must be 'fault' or 'flag'"):
        AnnotatedDataset(tmp_path, misplaced="error", **options)  # type: ignore[arg-type]
