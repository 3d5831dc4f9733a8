"""Labels for ecologists: Camtrap DP, wildlife-datasets and WBIA, by function and command."""

import csv
import json
import math
from pathlib import Path
from typing import Any

import msgspec
import pytest
from commands import labels_of_one_animal, ran

from animal3dbox.datasets.sightings import Sighting
from animal3dbox.errors import ConfigError, DatasetFormatError, DatasetNotFoundError
from animal3dbox.report import write_camtrap_dp, write_wbia, write_wildlife_datasets
from animal3dbox.report.ecology.camtrap_observations import FIELDS
from animal3dbox.report.ecology.camtrap_package import read_camtrap_package
from animal3dbox.report.label_files import AnimalRow
from animal3dbox.report.label_reading import read_labels_json

PROFILE = "https://raw.githubusercontent.com/tdwg/camtrap-dp/{}/camtrap-dp-profile.json"
MEDIA = (
    "mediaID,deploymentID,timestamp,filePath,fileName",
    "m1,d1,2024-05-01T06:10:00+02:00,media/herd/a.jpg,a.jpg",
    "m2,d1,2024-05-01T06:10:01+02:00,media/herd/b.jpg,b.jpg",
    "m3,d2,2024-05-01T06:10:01+02:00,media/lake/b.jpg,b.jpg",
    "m4,,2024-05-01T06:10:01+02:00,media/c.jpg,c.jpg",
    "m5,d2,2024-05-01 06:10:01,media/e.jpg,e.jpg",
    "m6,d2,2024-13-41T00:00:00Z,media/f.jpg,f.jpg",
)


@pytest.fixture(scope="module")
def labels(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return labels_of_one_animal(tmp_path_factory.mktemp("labels"))


@pytest.fixture
def row(labels: Path) -> AnimalRow:
    return read_labels_json(labels / "labels.json").animals[0]


@pytest.fixture
def package(tmp_path: Path) -> Path:
    return written_package(tmp_path / "package")


def written_package(folder: Path, *, version: str = "1.0.1", media: Any = "media.csv") -> Path:
    folder.mkdir(exist_ok=True)
    content = {
        "profile": PROFILE.format(version),
        "resources": [{"name": "deployments"}, {"name": "media", "path": media}],
    }
    (folder / "datapackage.json").write_text(json.dumps(content))
    (folder / "media.csv").write_text("\n".join(MEDIA) + "\n", encoding="utf-8-sig")
    return folder


def changed(row: AnimalRow, **values: object) -> AnimalRow:
    return msgspec.structs.replace(row, **values)


def observations(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_an_observation_copies_its_media_and_says_side_and_box(
    row: AnimalRow, package: Path, tmp_path: Path
) -> None:
    summary = write_camtrap_dp([row], package, tmp_path / "o.csv")
    (cells,) = observations(tmp_path / "o.csv")
    assert tuple(cells) == tuple(FIELDS)
    assert (cells["mediaID"], cells["deploymentID"]) == ("m1", "d1")
    assert cells["eventStart"] == cells["eventEnd"] == "2024-05-01T06:10:00+02:00"
    assert cells["observationTags"] == f"side:{row.side}|viewpoint:{row.viewpoint}"
    width = row.image_hw[1]
    x0, _, x1, _ = row.box
    assert float(cells["bboxX"]) == pytest.approx(max(x0 + 0.5, 0) / width, abs=1e-6)
    right = float(cells["bboxX"]) + float(cells["bboxWidth"])
    assert right == pytest.approx(min(x1 + 0.5, width) / width, abs=2e-6)
    assert float(cells["bboxY"]) + float(cells["bboxHeight"]) <= 1 + 1e-9
    assert cells["scientificName"] == cells["classificationProbability"] == ""
    assert cells["individualPositionRadius"] == cells["individualPositionAngle"] == ""
    assert "scale is not known" in summary.notes[0]
    assert "category dog" in cells["observationComments"]


def test_distance_and_angle_stand_where_the_scale_is_known_with_its_source(
    row: AnimalRow, package: Path, tmp_path: Path
) -> None:
    metric = changed(row, center=[-3.0, 0.0, 4.0], scale_m_per_unit=1.0, scale_source="species")
    summary = write_camtrap_dp([metric], package, tmp_path / "o.csv")
    (cells,) = observations(tmp_path / "o.csv")
    assert float(cells["individualPositionRadius"]) == pytest.approx(5.0)
    angle = math.degrees(math.atan2(-3, 4))
    assert float(cells["individualPositionAngle"]) == pytest.approx(angle, abs=0.01)
    assert "distance by species" in cells["observationComments"]
    assert summary.notes == ()


@pytest.mark.parametrize(
    ("image", "field", "words"),
    [
        ("herd/x.jpg", "image", "no media file is called so"),
        ("b.jpg", "image", "2 media files are called so"),
        ("c.jpg", "deploymentID", "is empty, and the standard requires it"),
        ("e.jpg", "eventStart", "must be a time with its zone"),
        ("f.jpg", "eventStart", "must be a time with its zone"),
    ],
)
def test_a_label_whose_observation_the_standard_would_refuse_is_a_fault(
    row: AnimalRow, package: Path, tmp_path: Path, *, image: str, field: str, words: str
) -> None:
    other = changed(row, image=image, sample_id=image)
    summary = write_camtrap_dp([other, row], package, tmp_path / "o.csv")
    (fault,) = summary.faults
    assert (fault.sample_id, fault.field) == (image, field)
    assert words in str(fault)
    assert len(observations(tmp_path / "o.csv")) == 1


def test_the_media_file_is_found_by_the_end_of_its_path(row: AnimalRow, package: Path) -> None:
    found = read_camtrap_package(package).media_of("lake/b.jpg", "b")
    assert found["mediaID"] == "m3"


def test_a_package_that_is_no_camtrap_dp_of_version_1_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DatasetNotFoundError, match=r"datapackage\.json"):
        read_camtrap_package(tmp_path)
    old = written_package(tmp_path / "old", version="0.1.6")
    with pytest.raises(ConfigError, match=r"is of Camtrap DP 0\.1\.6"):
        read_camtrap_package(old)
    remote = written_package(tmp_path / "remote", media="https://host/media.csv")
    with pytest.raises(DatasetFormatError, match="must be one file of the package"):
        read_camtrap_package(remote)
    bare = written_package(tmp_path / "bare")
    (bare / "media.csv").write_text("mediaID,filePath\nm1,a.jpg\n")
    with pytest.raises(DatasetFormatError, match="lacks the columns deploymentID, timestamp"):
        read_camtrap_package(bare)
    empty = written_package(tmp_path / "empty")
    (empty / "media.csv").write_text("")
    with pytest.raises(DatasetFormatError, match="lacks the columns mediaID"):
        read_camtrap_package(empty)
    same = written_package(tmp_path / "same")
    (same / "media.csv").write_text("\n".join((*MEDIA, MEDIA[1].replace("a.jpg", "z.jpg"))))
    with pytest.raises(DatasetFormatError, match="line 8: mediaID 'm1'"):
        read_camtrap_package(same)
    twice = written_package(tmp_path / "twice")
    (twice / "media.csv").write_text("\n".join((*MEDIA, MEDIA[1])))
    with pytest.raises(DatasetFormatError, match="line 8: filePath"):
        read_camtrap_package(twice)


def test_wildlife_datasets_has_identity_box_and_side(row: AnimalRow, tmp_path: Path) -> None:
    known = changed(row, sample_id="b", sighting=Sighting(individual="Nala", time="2024-05-01"))
    outside = changed(row, sample_id="c", box=[-9.0, 2.0, -3.0, 9.0])
    summary = write_wildlife_datasets([row, known, outside], tmp_path / "m.csv")
    first, second = observations(tmp_path / "m.csv")
    assert (first["identity"], second["identity"]) == ("unknown", "Nala")
    assert (first["orientation"], second["date"]) == (row.side, "2024-05-01")
    assert json.loads(first["bbox"])[0] == pytest.approx(row.box[0] + 0.5, abs=0.051)
    assert [fault.sample_id for fault in summary.faults] == ["c"]
    assert "1 of 2 animals have no identity" in summary.notes[0]


@pytest.mark.parametrize(
    ("viewpoint", "elevation", "word"),
    [
        ("left", 10.0, "left"),
        ("front-left", 30.0, "frontleft"),
        ("back-right", -20.0, "backright"),
        ("left", 70.0, "up"),
        ("left", -70.0, "down"),
    ],
)
def test_wbia_says_viewpoints_in_its_words(
    row: AnimalRow, tmp_path: Path, *, viewpoint: str, elevation: float, word: str
) -> None:
    seen = changed(row, viewpoint=viewpoint, elevation_deg=elevation, upright=True)
    named = changed(seen, sample_id="b", sighting=Sighting(individual="Nala"))
    summary = write_wbia([seen, named], tmp_path / "w.json")
    content = json.loads((tmp_path / "w.json").read_text())
    first, second = content["annotations"]
    assert (first["viewpoint"], first["theta"]) == (word, 0.0)
    assert ("name" in first, second["name"]) == (False, "Nala")
    assert content["images"] == [
        {
            "id": 1,
            "file_name": row.image,
            "height": row.image_hw[0],
            "width": row.image_hw[1],
        }
    ]
    assert content["categories"] == [{"id": 1, "name": "dog"}]
    assert "2 of 2 boxes are for pictures turned" in summary.notes[0]


def test_the_command_writes_each_and_says_what_is_missing(
    labels: Path, package: Path, tmp_path: Path
) -> None:
    for to, name in (("wbia", "annotations.json"), ("wildlife-datasets", "metadata.csv")):
        code, output = ran("export", labels, "--to", to, "--out", tmp_path / to)
        assert (code, (tmp_path / to / name).is_file()) == (0, True), output
    camtrap = ("export", labels, "--to", "camtrap-dp", "--out", tmp_path / "camtrap")
    code, output = ran(*camtrap)
    assert code == 2
    assert "needs --datapackage" in output
    code, output = ran(*camtrap, "--datapackage", package)
    assert code == 0, output
    assert "1 animal in 1 image written as camtrap-dp" in output
    code, output = ran(*camtrap[:-1], package, "--datapackage", package)
    assert code == 2
    assert "is the package's own observations.csv" in output


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--datapackage", "x"), "--datapackage is for --to camtrap-dp"),
        (("--metres-per-unit", "2"), "--metres-per-unit is for cuboids"),
        (("--model", "x.pkl"), "--model is for --to animal3d"),
        (("--split", "train"), "--split is for --to omni3d or kitti"),
    ],
)
def test_options_of_other_formats_are_refused(
    labels: Path, tmp_path: Path, options: tuple[str, str], words: str
) -> None:
    code, output = ran("export", labels, "--to", "wbia", "--out", tmp_path / "w.json", *options)
    assert code == 2
    assert words in output
    assert not (tmp_path / "w.json").exists()
    code, output = ran("export", labels, "--to", "wbia", "--out", tmp_path / "w.csv")
    assert code == 2
    assert "writes a .json file" in output
