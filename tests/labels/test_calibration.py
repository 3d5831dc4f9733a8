"""A calibration: its file, what it changes in labels, and how it is learned."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from foreign_capture import capture_animal, write_capture

from animal3dbox.cli.calibrate import run_calibrate
from animal3dbox.cli.exit_codes import ExitCode
from animal3dbox.cli.jobs import CalibrateJob
from animal3dbox.cli.main import main
from animal3dbox.cli.options import BodyOptions, KeypointDatasetOptions
from animal3dbox.datasets import LabelDataset, MeshFolderDataset
from animal3dbox.datasets.format_datasets import AnnotatedDataset
from animal3dbox.datasets.labelling.skipped import Skipped
from animal3dbox.datasets.synthetic import SyntheticSet, WorldConfig, write_stanfordextra
from animal3dbox.errors import ConfigError
from animal3dbox.labels.axes.placement import LearnedAngle, learned_placement
from animal3dbox.labels.calibration import Calibration, PlacementPitch, densest, load_calibration
from animal3dbox.labels.label import label_animal
from animal3dbox.labels.types import CuboidLabel
from animal3dbox.report.label_reading import read_labels_json
from animal3dbox.smal.keypoints.vocabularies import VOCABULARIES

LINE = "tail_base to shoulder_blade"
LIFTED = Calibration((PlacementPitch("animal3d26", None, LINE, 12.0, 20),))


PLACES = (
    '{"vocabulary": "own", "body": "0123", "keypoints": ["nose"], "offsets": [[0.1, 0, 0]],'
    ' "sd": [0.01], "animals": 40}'
)
SHAPE = (
    '{"vocabulary": "own", "body": "0123", "category": "okapi", "preset": null, "betas": [0, 0.5],'
    ' "scatter": 0.6, "animals": 40}'
)


def told(section: str) -> str:
    """A file with no placement and one further section."""
    return f'{{"schema": "animal3dbox-calibration", "version": 2, "placement": [], {section}}}'


def told_places(entry: str) -> str:
    return told(f'"places": [{entry}]')


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_capture(tmp_path_factory.mktemp("capture") / "set", 12)


def target_of(dataset: LabelDataset, index: int) -> dict[str, Any]:
    sample = dataset[index]
    assert not isinstance(sample, Skipped)
    return sample[1]


def digest_of(dataset: LabelDataset) -> object:
    return target_of(dataset, 0)["meta"]["quality"][0]["calibration"]


def label(**options: Any) -> CuboidLabel:
    given = capture_animal(1).arguments()
    given["pose"] = (np.eye(3), np.array([0.0, 0.0, 5.0]))
    outcome = label_animal(**given, **options)
    assert isinstance(outcome, CuboidLabel)
    return outcome


def test_a_file_holds_what_was_saved_under_the_same_digest(tmp_path: Path) -> None:
    LIFTED.save(tmp_path / "c.json")
    again = load_calibration(tmp_path / "c.json")
    assert again == LIFTED
    assert again.digest == LIFTED.digest != Calibration().digest


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("{", "is no calibration file"),
        ('{"schema": "x", "version": 1, "placement": []}', "schema and version must be"),
        ('{"schema": "animal3dbox-calibration", "version": 9, "placement": []}', "version"),
        ('{"schema": "animal3dbox-calibration", "version": 1}', "placement"),
        (
            '{"schema": "animal3dbox-calibration", "version": 1, "placement": [{"vocabulary": "a",'
            ' "species": null, "line": "l", "pitch_deg": 99, "animals": 3}]}',
            "placement[0].pitch_deg",
        ),
        (
            '{"schema": "animal3dbox-calibration", "version": 1, "placement": [{"vocabulary": "a",'
            ' "species": null, "line": "l", "pitch_deg": 9, "animals": 0}]}',
            "placement[0].animals",
        ),
        (told_places(PLACES.replace("0.01", "0")), "places[0].sd"),
        (told_places(PLACES.replace('["nose"]', "[]")), "places[0].offsets must have"),
        (told_places(PLACES.replace("0.1", "3")), "places[0].offsets must lie within"),
        (told_places(PLACES.replace("40", "0")), "places[0].animals"),
        (told(f'"shapes": [{SHAPE.replace("0.6", "0")}]'), "shapes[0].scatter"),
    ],
)
def test_a_bad_file_is_refused_by_its_name_and_field(
    tmp_path: Path, content: str, words: str
) -> None:
    file = tmp_path / "c.json"
    file.write_text(content)
    with pytest.raises(ConfigError) as error:
        load_calibration(file)
    assert words in str(error.value)
    assert "c.json" in str(error.value)


def test_a_file_of_version_1_is_read_and_one_of_version_2_gives_places_and_shapes(
    tmp_path: Path,
) -> None:
    old, new = tmp_path / "old.json", tmp_path / "new.json"
    old.write_text('{"schema": "animal3dbox-calibration", "version": 1, "placement": []}')
    assert load_calibration(old) == Calibration()
    new.write_text(told(f'"places": [{PLACES}], "shapes": [{SHAPE}]'))
    calibration = load_calibration(new)
    places, shape = calibration.places_of("own"), calibration.shape_of("own", "okapi")
    assert places is not None
    assert shape is not None
    assert (places.offsets, shape.betas) == (((0.1, 0.0, 0.0),), (0.0, 0.5))
    assert calibration.places_of("ap10k17") is None
    assert calibration.shape_of("own", "horse") is None
    calibration.save(old)
    assert load_calibration(old) == calibration


def test_a_missing_file_is_refused_by_its_name() -> None:
    with pytest.raises(ConfigError, match=r"nowhere\.json cannot be read"):
        label(calibration="nowhere.json")


def test_a_species_own_pitch_comes_before_that_of_all() -> None:
    both = Calibration((*LIFTED.placement, PlacementPitch("animal3d26", "horse", LINE, 3.0, 10)))
    assert both.pitch_deg("animal3d26", "horse", LINE) == 3.0
    assert both.pitch_deg("animal3d26", "cow", LINE) == 12.0
    assert both.pitch_deg("ap10k17", "horse", LINE) is None


def test_the_densest_angle_is_where_standing_animals_agree() -> None:
    assert densest([2.0, 3.0, 4.0, 30.0, -25.0, 50.0]) == pytest.approx(3.0, abs=0.2)


def test_a_species_with_few_animals_has_no_pitch_of_its_own() -> None:
    angles = [LearnedAngle("ap10k17", "cow", LINE, 5.0, True)] * 9
    angles += [LearnedAngle("ap10k17", "pig", LINE, 8.0, True)] * 10
    learned = learned_placement(angles).placement
    assert [(entry.species, entry.animals) for entry in learned] == [(None, 19), ("pig", 10)]


def test_angles_of_paws_count_only_where_no_surface_tells() -> None:
    by_paws = LearnedAngle("ap10k17", "", LINE, 20.0, False)
    by_surface = LearnedAngle("ap10k17", "", LINE, 5.0, True)
    assert learned_placement([by_paws] * 3).placement[0].pitch_deg == 20.0
    assert learned_placement([by_paws] * 3 + [by_surface]).placement[0].pitch_deg == 5.0


def test_nothing_is_learned_unless_asked() -> None:
    assert label().quality.calibration is None


def test_a_calibration_turns_the_axes_and_signs_the_label(tmp_path: Path) -> None:
    LIFTED.save(tmp_path / "c.json")
    by_file, by_value, plain = (
        label(calibration=tmp_path / "c.json"),
        label(calibration=LIFTED),
        label(),
    )
    assert np.array_equal(by_file.row, by_value.row)
    assert by_file.quality.calibration == LIFTED.digest
    assert not torch.equal(by_file.rotation, plain.rotation)


def test_a_calibration_of_other_keypoints_changes_nothing() -> None:
    other = Calibration((PlacementPitch("ap10k17", None, LINE, 12.0, 20),))
    assert np.array_equal(label(calibration=other).row, label().row)
    assert label(calibration=other).quality.calibration is None


def test_calibrate_label_dataset_and_label_animal_agree(
    capture: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "calibration.json"
    with pytest.raises(SystemExit) as ended:
        main(["calibrate", str(capture), "--out", str(file)])
    assert ended.value.code == ExitCode.OK
    assert "12 animals: 12 used" in capsys.readouterr().out
    with pytest.raises(SystemExit):
        main(["label", str(capture), "--out", str(tmp_path / "out"), "--calibration", str(file)])
    rows = read_labels_json(tmp_path / "out" / "labels.json").animals
    dataset = MeshFolderDataset(capture, calibration=file)
    digest = load_calibration(file).digest
    for index, row in enumerate(rows):
        target = target_of(dataset, index)
        assert row.quality["calibration"] == target["meta"]["quality"][0]["calibration"] == digest
        assert torch.allclose(target["rotation"][0], torch.tensor(row.rotation).float())


def test_auto_learns_the_same_from_ten_animals_on(capture: Path, tmp_path: Path) -> None:
    auto = AnnotatedDataset(capture, calibration="auto")
    assert "learned from 12 animals" in auto.notes[-1]
    few = AnnotatedDataset(write_capture(tmp_path / "few", 2), calibration="auto")
    assert "2 animals tell where their keypoints lie, and 10 are needed" in few.notes[-1]
    assert digest_of(few) is None
    assert digest_of(auto) is not None


def test_the_cache_tells_calibrations_apart(capture: Path, tmp_path: Path) -> None:
    digests = []
    for calibration in (None, LIFTED, None):
        dataset = AnnotatedDataset(capture, calibration=calibration, cache=tmp_path / "cache")
        digests.append(digest_of(dataset))
    assert digests == [None, LIFTED.digest, None]


def test_a_dataset_whose_bodies_have_templates_teaches_nothing(tmp_path: Path) -> None:
    world = WorldConfig(image_hw=(48, 64), vocabulary=VOCABULARIES["stanfordextra24"])
    write_stanfordextra(SyntheticSet(0, 2, world), tmp_path / "dogs")
    job = CalibrateJob(path=tmp_path / "dogs", dataset=KeypointDatasetOptions(), body=BodyOptions())
    with pytest.raises(ConfigError, match="teaches nothing about its keypoints' placement"):
        run_calibrate(job)
