"""calibrate --learn places,shapes: from photographs to a file, resumed and in any order."""

import json
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from animal3dbox.cli import calibrate
from animal3dbox.cli.calibrate import run_calibrate, sections
from animal3dbox.cli.exit_codes import ExitCode
from animal3dbox.cli.jobs import CalibrateJob
from animal3dbox.cli.main import main
from animal3dbox.cli.options import BodyOptions, KeypointDatasetOptions
from animal3dbox.datasets.format_datasets import AnnotatedDataset
from animal3dbox.datasets.labelling import learned_bodies
from animal3dbox.datasets.labelling.skipped import Skipped
from animal3dbox.datasets.records import AnimalRecord
from animal3dbox.datasets.synthetic import SyntheticSet, WorldConfig, write_stanfordextra
from animal3dbox.errors import ConfigError
from animal3dbox.labels.calibration import Calibration, load_calibration
from animal3dbox.labels.fit.learning import rounds
from animal3dbox.report.label_reading import read_labels_json
from animal3dbox.smal.keypoints.vocabularies import VOCABULARIES

WORLD = WorldConfig(
    image_hw=(120, 160),
    vocabulary=VOCABULARIES["stanfordextra24"],
    presets=("dog", "cat"),
    animals=(1, 1),
    occluded=0.0,
    truncated=0.0,
    fill=(0.6, 0.9),
)


@pytest.fixture(scope="module")
def dogs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("dogs") / "dogs"
    write_stanfordextra(SyntheticSet(0, 12, WORLD), root)
    return root


@pytest.fixture(autouse=True)
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    """Learning from a handful of animals, in few rounds."""
    for name, value in (("LEAST_TAUGHT", 6), ("LEAST_OF_CLASS", 5), ("SOLVE_ROUNDS", 1)):
        monkeypatch.setattr(rounds, name, value)
    for name, value in (("LEAST_TAUGHT", 6), ("LEAST_OF_CLASS", 5)):
        monkeypatch.setattr(learned_bodies, name, value)


def job(path: Path, out: Path, learn: str = "places,shapes") -> CalibrateJob:
    return CalibrateJob(
        path=path,
        out=out,
        learn=learn,
        dataset=KeypointDatasetOptions(),
        body=BodyOptions(),
    )


@pytest.fixture(scope="module")
def file(dogs: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("calibration") / "calibration.json"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rounds, "LEAST_TAUGHT", 6)
        patch.setattr(rounds, "LEAST_OF_CLASS", 5)
        patch.setattr(rounds, "SOLVE_ROUNDS", 1)
        patch.setattr(learned_bodies, "LEAST_TAUGHT", 6)
        assert run_calibrate(job(dogs, out)) == ExitCode.OK
    return out


def test_the_file_has_places_of_every_keypoint_and_shapes_of_classes(file: Path) -> None:
    calibration = load_calibration(file)
    (places,) = calibration.places
    assert places.vocabulary == "stanfordextra24"
    assert places.keypoints == VOCABULARIES["stanfordextra24"].keypoints
    assert places.animals >= 6
    assert any(value for offset in places.offsets for value in offset)
    assert not file.with_name("calibration.json.fits").exists()


def test_learning_that_was_interrupted_goes_on_to_the_same_file(
    dogs: Path, file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "calibration.json"
    made: list[int] = []
    fits_of_batch = rounds.fits_of_batch

    def interrupted(*args: object) -> object:
        if made:
            raise KeyboardInterrupt
        made.append(1)
        return fits_of_batch(*args)  # type: ignore[arg-type]

    monkeypatch.setattr(learned_bodies, "fits_of_batch", interrupted)
    with pytest.raises(KeyboardInterrupt):
        run_calibrate(job(dogs, out))
    assert not out.exists()
    (stored,) = (tmp_path / "calibration.json.fits").iterdir()

    def counted(*args: object) -> object:
        made.append(2)
        return fits_of_batch(*args)  # type: ignore[arg-type]

    monkeypatch.setattr(learned_bodies, "fits_of_batch", counted)
    run_calibrate(job(dogs, out))
    assert made == [1, 2]  # the first round's fits are read, the second's are made
    assert out.read_bytes() == file.read_bytes()
    assert not stored.parent.exists()


def reversed_copy(dogs: Path, other: Path) -> Path:
    """The same dataset, its annotations in the opposite order."""
    annotations = dogs / "annotations.json"
    other.mkdir()
    for path in dogs.iterdir():
        if path != annotations:
            (other / path.name).symlink_to(path)
    entries = json.loads(annotations.read_text())
    (other / annotations.name).write_text(json.dumps(entries[::-1]))
    return other


def test_the_order_of_the_annotations_does_not_matter(
    dogs: Path, file: Path, tmp_path: Path
) -> None:
    run_calibrate(job(reversed_copy(dogs, tmp_path / "dogs"), tmp_path / "c.json"))
    assert (tmp_path / "c.json").read_bytes() == file.read_bytes()


def test_animals_are_learned_from_in_the_order_of_their_names(
    dogs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    orders: list[list[str]] = []

    def learned(animals: Sequence[Mapping[str, Any]], *_: object, **__: object) -> Calibration:
        orders.append([animals[i]["sample_id"] for i in range(len(animals))])
        return Calibration()

    monkeypatch.setattr(learned_bodies, "learn_bodies", learned)
    for path in (dogs, reversed_copy(dogs, tmp_path / "dogs")):
        run_calibrate(job(path, tmp_path / "c.json"))
    assert orders[0] == orders[1] == sorted(orders[0])
    assert len(orders[0]) >= 6


def test_label_and_dataset_take_the_file_and_say_so(dogs: Path, file: Path, tmp_path: Path) -> None:
    with pytest.raises(SystemExit):
        main(["label", str(dogs), "--out", str(tmp_path / "out"), "--calibration", str(file)])
    digest = load_calibration(file).digest
    rows = read_labels_json(tmp_path / "out" / "labels.json").animals
    fitted = [row for row in rows if row.quality["body"] == "fit"]
    assert fitted
    assert {row.quality["calibration"] for row in fitted} == {digest}
    sample = AnnotatedDataset(dogs, calibration=file)[0]
    assert not isinstance(sample, Skipped)
    quality = sample[1]["meta"]["quality"][0]
    assert quality["calibration"] == (digest if quality["body"] == "fit" else None)


def test_labels_of_rigid_bodies_say_that_the_file_has_no_part_in_them(
    dogs: Path, file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, words = str(tmp_path / "out"), "they have no part in labels of the bodies of preset"
    with pytest.raises(SystemExit):
        main(["label", str(dogs), "--out", out, "--calibration", str(file), "--body", "preset"])
    assert words in capsys.readouterr().err
    notes = AnnotatedDataset(dogs, calibration=file, body="preset").notes
    assert any(words in note for note in notes)
    assert not any("no part" in note for note in AnnotatedDataset(dogs, calibration=file).notes)


def test_a_file_of_another_body_is_refused_before_the_first_sample(
    dogs: Path, file: Path, tmp_path: Path
) -> None:
    content = json.loads(file.read_text())
    content["places"][0]["body"] = "0" * 12
    (tmp_path / "other.json").write_text(json.dumps(content))
    with pytest.raises(ConfigError, match="learned with another body"):
        AnnotatedDataset(dogs, calibration=tmp_path / "other.json")


def test_it_says_in_words_what_it_learned(
    dogs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run_calibrate(job(dogs, tmp_path / "c.json"))
    words = capsys.readouterr().out
    assert "stanfordextra24: learned from" in words
    assert "places of stanfordextra24, % of the trunk's length: " in words
    assert "shape of dog" in words or "no shape of dog" in words


def test_few_animals_are_told_with_their_number(
    dogs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(learned_bodies, "LEAST_TAUGHT", 30)
    with pytest.raises(ConfigError, match=r"too few animals .*\d+ of stanfordextra24"):
        run_calibrate(job(dogs, tmp_path / "c.json"))


def unreadable_copy(dogs: Path, other: Path, count: int) -> Path:
    """The same dataset, of the first pictures of which only words are left."""
    shutil.copytree(dogs, other)
    for path in sorted(other.rglob("*.jpg"))[:count]:
        path.write_text("<html>sign in</html>")
    return other


def test_pictures_that_cannot_be_read_are_faults(
    dogs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(learned_bodies, "learn_bodies", lambda *_, **__: Calibration())
    some = replace(job(unreadable_copy(dogs, tmp_path / "some", 2), tmp_path / "c.json"), json=True)
    assert run_calibrate(some) == ExitCode.FAULTY
    faults = [line for line in capsys.readouterr().err.splitlines() if "faulty: " in line]
    assert faults
    assert all("cannot be decoded (it is no image" in fault for fault in faults)
    every = job(unreadable_copy(dogs, tmp_path / "every", 12), tmp_path / "c.json")
    with pytest.raises(ConfigError, match=r"\d+ could not be read, the first because .*no image"):
        run_calibrate(every)


def test_what_cannot_be_learned_is_refused(dogs: Path, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="--learn must be of placement, places, shapes"):
        sections("places,sizes")
    preset = CalibrateJob(
        path=dogs,
        out=tmp_path / "c.json",
        learn="places",
        dataset=KeypointDatasetOptions(),
        body=BodyOptions(name="dog"),
    )
    with pytest.raises(ConfigError, match="give --body fit"):
        run_calibrate(preset)


@pytest.mark.parametrize("focal_px", [None, 321.0])
def test_a_stated_focal_length_is_that_of_every_image(
    dogs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, focal_px: float | None
) -> None:
    seen: list[float | None] = []

    def learned(records: Sequence[AnimalRecord], *args: object, **kwargs: object) -> object:
        seen.extend(None if one.K is None else float(one.K[0, 0]) for one in records)
        raise ConfigError("enough")

    monkeypatch.setattr(calibrate, "learn_from_records", learned)
    with pytest.raises(ConfigError, match="enough"):
        run_calibrate(replace(job(dogs, tmp_path / "c.json"), focal_px=focal_px))
    assert len(seen) == 12
    assert set(seen) == {focal_px}
