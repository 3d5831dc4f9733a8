"""When, where and of whom a picture is travels from a dataset's file into every label.

What nobody asked for, the place and whatever a camera wrote into the picture, travels nowhere.
"""

import csv
import json
from pathlib import Path
from typing import Any

import pytest
from coco_dataset import coco_content, write_coco
from deeplabcut_files import table, write_csv, write_images
from PIL import ExifTags, Image

from animal3dbox.cli.main import main
from animal3dbox.datasets import AnnotatedDataset, CocoKeypointsDataset, LabelDataset, Skipped
from animal3dbox.datasets.formats import read_dataset
from animal3dbox.datasets.images.exif import facts_of
from animal3dbox.datasets.images.photos import header_facts
from animal3dbox.datasets.read_options import ReadOptions
from animal3dbox.datasets.sightings import KEYS, SightingKeys, sighting_of
from animal3dbox.errors import ConfigError

SECRETS = ("48.858", "-70.1234", "OWNER-OF-THE-CAMERA", "SERIAL-4711", "PARK-7-GATE")
"""What is planted in headers and files, and must be found in no output."""


def told_content(root: Path) -> dict[str, Any]:
    """COCO content whose images and annotations say when, where and of whom they are."""
    content = coco_content(root)
    for image in content["images"]:
        image |= {
            "datetime": "2024-05-01 06:10:00",
            "seq_id": "burst-3",
            "location": "PARK-7-GATE",
            "gps": [48.858, -70.1234],
        }
    for k, animal in enumerate(content["annotations"]):
        animal |= {"individual_id": f"Nala {k}", "track_id": k}
    return content


def with_header(path: Path) -> None:
    """Give a picture a header with a time, a position, an owner and a serial number."""
    image = Image.open(path)
    exif = image.getexif()
    camera = exif.get_ifd(ExifTags.IFD.Exif)
    camera[ExifTags.Base.DateTimeOriginal] = "2023:04:02 10:11:12"
    camera[ExifTags.Base.OffsetTimeOriginal] = "+02:00"
    camera[ExifTags.Base.CameraOwnerName] = "OWNER-OF-THE-CAMERA"
    camera[ExifTags.Base.BodySerialNumber] = "SERIAL-4711"
    position = exif.get_ifd(ExifTags.IFD.GPSInfo)
    position[ExifTags.GPS.GPSLatitude] = (48.0, 51.0, 30.0)
    position[ExifTags.GPS.GPSLatitudeRef] = "N"
    exif[ExifTags.Base.Artist] = "OWNER-OF-THE-CAMERA"
    image.save(path, exif=exif, quality=90)


def labelled(out: Path, *arguments: str) -> None:
    """Run `label` with the rigid preset."""
    with pytest.raises(SystemExit) as caught:
        main(["label", *arguments, "--body", "preset", "--out", str(out)])
    assert caught.value.code == 0


def sightings_of(dataset: LabelDataset, index: int) -> list[dict[str, str]]:
    """What a sample's target says of its animals' sightings."""
    sample = dataset[index]
    assert not isinstance(sample, Skipped)
    sightings: list[dict[str, str]] = sample[1]["meta"]["sightings"]
    return sightings


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """A COCO file that tells all, whose pictures' headers tell too much."""
    root = tmp_path / "told"
    content = told_content(root)
    for path in (root / "images").rglob("*.jpg"):
        with_header(path)
    return write_coco(root, content)


def test_a_planted_position_owner_and_place_is_in_no_output(file: Path, tmp_path: Path) -> None:
    labelled(tmp_path / "out", str(file))
    cache = tmp_path / "cache"
    CocoKeypointsDataset(file, body="preset", cache=cache).warm([0, 1])
    for kind in ("omni3d", "coco"):
        with pytest.raises(SystemExit):
            main(
                [
                    *("export", str(tmp_path / "out"), "--to", kind, "--scale-free"),
                    *("--out", str(tmp_path / f"{kind}.json")),
                ]
            )
    written = [*(tmp_path / "out").rglob("*"), *cache.rglob("*"), *tmp_path.glob("*.json")]
    contents = [path.read_bytes() for path in written if path.is_file()]
    assert len(contents) > 8  # labels, tables, pictures, pages, cache and two exports
    for secret in SECRETS:
        assert not any(secret.encode() in content for content in contents), secret
    pictures = [Image.open(path) for path in (tmp_path / "out").rglob("*.png")]
    assert len(pictures) == 3
    assert not any(picture.getexif() for picture in pictures)


def test_what_the_file_says_is_in_labels_json_and_csv(file: Path, tmp_path: Path) -> None:
    labelled(tmp_path / "out", str(file))
    rows = {
        row["sample_id"]: row
        for row in json.loads((tmp_path / "out" / "labels.json").read_text())["animals"]
    }
    assert rows["sub/b.jpg#1"]["sighting"] == {
        "time": "2024-05-01 06:10:00",
        "sequence": "burst-3",
        "individual": "Nala 2",
        "track": "2",
    }
    with (tmp_path / "out" / "labels.csv").open(newline="") as table:
        cells = {row["sample_id"]: row for row in csv.DictReader(table)}
    assert cells["a.jpg"]["individual"] == "Nala 1"
    assert (cells["a.jpg"]["time"], cells["a.jpg"]["place"]) == ("2024-05-01 06:10:00", "")
    assert "individual Nala 1" in (tmp_path / "out" / "gallery.html").read_text()


def test_the_place_travels_if_somebody_asks_for_it(file: Path, tmp_path: Path) -> None:
    labelled(tmp_path / "out", str(file), "--keep", "location")
    rows = json.loads((tmp_path / "out" / "labels.json").read_text())["animals"]
    assert {row["sighting"]["place"] for row in rows} == {"PARK-7-GATE"}
    kept = read_dataset(file, options=ReadOptions(keep=("location",))).records
    left = read_dataset(file).records
    assert not any("place" in note for note in kept.notes)
    assert any("the places of 3 animals are left behind" in note for note in left.notes)
    with pytest.raises(ConfigError, match="keep must be of location"):
        ReadOptions(keep=("gps",))  # type: ignore[arg-type]


@pytest.mark.parametrize("kind", [AnnotatedDataset, CocoKeypointsDataset])
def test_a_dataset_gives_the_same_in_its_targets_from_the_cache_too(
    kind: type[AnnotatedDataset], file: Path, tmp_path: Path
) -> None:
    for _ in range(2):
        dataset = kind(
            file, body="preset", cache=tmp_path / "cache", keep=["location"], on_bad="skip"
        )
        sightings = sightings_of(dataset, 1)
        assert [one["individual"] for one in sightings] == ["Nala 0", "Nala 2"]
        assert {one["place"] for one in sightings} == {"PARK-7-GATE"}


def test_what_is_said_of_an_animal_is_no_part_of_its_label(file: Path, tmp_path: Path) -> None:
    cache = tmp_path / "cache"
    CocoKeypointsDataset(file, body="preset", cache=cache, on_bad="skip").warm([0, 1])
    entries = {path: path.read_bytes() for path in cache.rglob("*.labels")}
    content = json.loads(file.read_text())
    for animal in content["annotations"]:
        animal["individual_id"] = "Simba"
    write_coco(file.parent, content)
    dataset = CocoKeypointsDataset(file, body="preset", cache=cache, on_bad="skip")
    assert sightings_of(dataset, 1)[0]["individual"] == "Simba"
    assert entries
    assert {path: path.read_bytes() for path in cache.rglob("*.labels")} == entries


def test_the_time_is_the_headers_where_the_file_says_none(file: Path) -> None:
    content = json.loads(file.read_text())
    for image in content["images"]:
        del image["datetime"]
    write_coco(file.parent, content)
    dataset = CocoKeypointsDataset(file, body="preset", on_bad="skip")
    assert sightings_of(dataset, 0)[0]["time"] == "2023-04-02T10:11:12+02:00"


@pytest.mark.parametrize("taken", ["0000:00:00 00:00:00", "2023:13:02 10:11:12", "soon", "", 7])
def test_a_header_without_a_time_says_none(taken: object, tmp_path: Path) -> None:
    image = Image.new("RGB", (8, 8))
    exif = image.getexif()
    exif.get_ifd(ExifTags.IFD.Exif)[ExifTags.Base.DateTimeOriginal] = str(taken)
    image.save(tmp_path / "a.jpg", exif=exif)
    assert header_facts(tmp_path / "a.jpg", "a").time is None
    assert facts_of(image).time is None


@pytest.mark.parametrize(("field", "key"), [(f, key) for f, keys in KEYS.items() for key in keys])
def test_every_key_of_the_table_is_read(field: str, key: str) -> None:
    assert sighting_of(SightingKeys(**{key: 7.0})).known == {field: "7"}


@pytest.mark.parametrize("value", [None, "", "  ", True, [1], {"lat": 1}, float("nan")])
def test_a_value_of_no_use_says_nothing_and_spoils_nothing(value: Any) -> None:
    image = sighting_of(SightingKeys(individual="Nala"))
    known = sighting_of(SightingKeys(individual_id=value), image).known
    assert known == {"individual": "Nala"}


def test_text_is_one_line_of_bounded_length() -> None:
    known = sighting_of(SightingKeys(individual="Na\nla \t of " + "the pride " * 60)).known
    assert known["individual"].startswith("Na la of the pride")
    assert len(known["individual"]) == 200


def test_deeplabcut_names_its_videos_and_individuals(tmp_path: Path) -> None:
    folder = tmp_path / "labeled-data" / "zoo"
    write_images(folder, 1)
    file = write_csv(folder / "CollectedData.csv", table([[60, 120]], individuals=("ada", "bob")))
    sightings = {one.sample_id: one.sighting.known for one in read_dataset(file).records.records}
    assert [*sightings.values()] == [
        {"sequence": "zoo", "individual": "ada"},
        {"sequence": "zoo", "individual": "bob"},
    ]
