"""COCO files opened by an index: what it says is what reading every annotation plainly says."""

import json
import os
import pickle
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
from coco_dataset import AP10K_NAMES, Content, coco_content, write_coco
from photo_dataset import HW as HW_OF_PICTURES
from PIL import Image

from animal3dbox.datasets import CocoKeypointsDataset, RecordSet
from animal3dbox.datasets.readers.coco import reader as coco
from animal3dbox.datasets.readers.coco.animal import with_confidence
from animal3dbox.datasets.readers.coco.indexed_animals import IndexedAnimals
from animal3dbox.datasets.readers.coco.opening import OpenedCoco, opened_coco, opened_plainly
from animal3dbox.datasets.readers.tolerance import BadParts, Tolerance
from animal3dbox.datasets.records import AnimalRecord
from animal3dbox.datasets.storage import index_folder, json_ranges
from animal3dbox.datasets.storage.fingerprint import content_digest
from animal3dbox.datasets.storage.index_folder import IndexFolder
from animal3dbox.errors import DatasetFormatError

HW = (240, 320)
COUNT = len(AP10K_NAMES)
Spoil = Callable[[Content, int, np.random.Generator], object]


def large_content(rng: np.random.Generator, animals: int = 120) -> Content:
    """Animals in images of one or two, keypoints anywhere, nothing odd."""
    annotations: list[Content] = []
    for number in range(animals):
        points = rng.uniform(20, 220, (COUNT, 2)).round(2)
        marks = rng.choice([0, 1, 2], COUNT).tolist()
        low, size = points.min(0) - 5, np.ptp(points, axis=0) + 10
        annotations.append(
            {
                "id": number,
                "image_id": 7 * (number * 2 // 3),
                "category_id": 1 + number % 2,
                "keypoints": np.column_stack((points, marks)).ravel().tolist(),
                "num_keypoints": sum(mark > 0 for mark in marks),
                "bbox": [*low.tolist(), *size.tolist()],
                "iscrowd": 0,
            }
        )
    rng.shuffle(annotations)
    images = [
        {"id": 7 * i, "file_name": f"sub{i % 3}/{i}.jpg", "height": HW[0], "width": HW[1]}
        for i in range(animals)
    ]
    categories = [
        {"id": 1, "name": "dog", "keypoints": AP10K_NAMES},
        {"id": 2, "name": "cow", "keypoints": AP10K_NAMES[::-1]},
        {"id": 3, "name": "chair", "keypoints": ["left leg", "right leg"]},
    ]
    return {"images": images, "annotations": annotations, "categories": categories}


def other(content: Content, place: int) -> Content:
    """Another annotation than the one at a place."""
    one: Content = content["annotations"][(place + 5) % len(content["annotations"])]
    return one


def annotation(**changes: Any) -> Spoil:
    return lambda content, place, rng: content["annotations"][place].update(changes)


def image(**changes: Any) -> Spoil:
    return lambda content, place, rng: content["images"][place].update(changes)


def keypoint(value: Any) -> Spoil:
    return lambda content, place, rng: content["annotations"][place]["keypoints"].__setitem__(
        slice(6, 9), value
    )


def copied(**changes: Any) -> Spoil:
    """One annotation once more, with some changes."""
    return lambda content, place, rng: content["annotations"].append(
        {**content["annotations"][place], "id": 10_000 + place, **changes}
    )


def moved_slightly(content: Content, place: int, rng: np.random.Generator) -> None:
    """One animal once more, each keypoint moved by less than a pixel."""
    points = np.array(content["annotations"][place]["keypoints"]).reshape(-1, 3)
    points[:, :2] += rng.uniform(-0.9, 0.9, (COUNT, 2)) * (points[:, 2:] > 0)
    copied(keypoints=points.ravel().tolist(), num_keypoints=None)(content, place, rng)


def corners(content: Content, place: int, rng: np.random.Generator) -> None:
    """A box of two corners."""
    x, y, width, height = content["annotations"][place]["bbox"]
    content["annotations"][place]["bbox"] = [x, y, x + width, y + height]


SPOILS: dict[str, Spoil] = {
    "id of another": lambda content, place, rng: content["annotations"][place].update(
        id=other(content, place)["id"]
    ),
    "id as text": lambda content, place, rng: content["annotations"][place].update(
        id=str(other(content, place)["id"])
    ),
    "id as a float": annotation(id=3.0),
    "no id": annotation(id=None),
    "image unknown": annotation(image_id=5),
    "image as text": lambda content, place, rng: content["annotations"][place].update(
        image_id=str(content["annotations"][place]["image_id"])
    ),
    "image as a float": lambda content, place, rng: content["annotations"][place].update(
        image_id=float(content["annotations"][place]["image_id"])
    ),
    "category unknown": annotation(category_id=9),
    "category without an animal's keypoints": annotation(category_id=3),
    "category as text": annotation(category_id="1"),
    "keypoints of another length": annotation(keypoints=[1.0, 2.0, 2]),
    "no keypoints": annotation(keypoints=None),
    "keypoints empty": annotation(keypoints=[0] * (3 * COUNT)),
    "keypoint null": keypoint([None, None, 0]),
    "keypoint at minus one": keypoint([-1, -1, 2]),
    "visibility 3": keypoint([10, 10, 3]),
    "visibility -1": keypoint([10, 10, -1]),
    "keypoints in words": annotation(keypoints="none"),
    "miscounted": annotation(num_keypoints=99),
    "no box": annotation(bbox=None),
    "box of three": annotation(bbox=[1, 2, 3]),
    "box outside": annotation(bbox=[1000, 1000, 5, 5]),
    "box without area": annotation(bbox=[10, 10, 0, 5]),
    "box of corners": corners,
    "crowd": annotation(iscrowd=1),
    "segmentation": annotation(segmentation=[[10, 10, 60, 10, 60, 60]]),
    "segmentation outside": annotation(segmentation=[[900, 900, 960, 900, 960, 960]]),
    "segmentation empty": annotation(segmentation=[]),
    "twice": copied(),
    "twice without keypoints": lambda content, place, rng: (
        content["annotations"][place].update(keypoints=[0] * (3 * COUNT), num_keypoints=0),
        copied()(content, place, rng),
    ),
    "twice, with another box": copied(bbox=[30, 30, 100, 100]),
    "twice, keypoints moved a little": moved_slightly,
    "track and place": annotation(track_id=3, location="here"),
    "image's place": image(location="there", datetime="2024-01-01 10:00:00"),
    "image without a name": image(file_name=" "),
    "image of another's id": image(id=0),
    "image's id as text": lambda content, place, rng: content["images"][place].update(
        id=str(content["images"][place]["id"])
    ),
    "image of another's name": image(file_name="sub0/0.jpg"),
    "image of a height as a float": image(height=240.0),
    "image of no height": image(height=0),
    "image of a huge height": image(height=10**12),
    "image of a height in words": image(height="high"),
    "no animal": lambda content, place, rng: content["annotations"].append(3),
    "no image": lambda content, place, rng: content["images"].append("3.jpg"),
}


def opened_both_ways(
    path: Path, tolerance: Tolerance | None = None, categories: tuple[str, ...] = ()
) -> tuple[OpenedCoco, OpenedCoco, list[tuple[str, ...]]]:
    """A file opened fast and plainly, and the notes of both."""
    opened, notes = [], []
    for way in (opened_coco, opened_plainly):
        own = replace(tolerance or Tolerance(), left_out=[], minus_ones=[])
        options = coco.CocoReading(path, path.parent, None, own, categories)
        content = coco.CocoContent(options, checks=False)
        opened.append(way(content.ranges, content.reading, content.read))
        notes.append(content.notes(opened[-1]))
    return opened[0], opened[1], notes


def assert_same(path: Path, **options: Any) -> OpenedCoco:
    """A file says the same opened fast and plainly; gives the former."""
    fast, plain, notes = opened_both_ways(path, **options)
    assert [str(fault) for fault in fast.plain.faults] == [
        str(fault) for fault in plain.plain.faults
    ]
    for name in ("image", "number", "annotation", "without_box", "image_hw"):
        assert np.array_equal(getattr(fast, name), getattr(plain, name)), name
    assert fast.names == plain.names
    assert (fast.counts, fast.with_place) == (plain.counts, plain.with_place)
    assert notes[0] == notes[1]
    return fast


def plain_records(path: Path, tolerance: Tolerance | None = None) -> list[AnimalRecord]:
    """The records of a file that was read plainly, their pictures not looked up."""
    options = coco.CocoReading(path, path.parent, None, tolerance or Tolerance(), ())
    content = coco.CocoContent(options, checks=False)
    opened = opened_plainly(content.ranges, content.reading, content.read)
    graded = opened.counts.graded > 0
    return [with_confidence(animal.record, graded) for animal in opened.plain.animals]


def assert_same_records(path: Path, optional: BadParts = "fault") -> None:
    """The records that are made on demand are those that are read plainly."""
    found = coco.read_coco(
        path, path.parent, tolerance=Tolerance(optional=optional), check_paths=False
    )
    plain = plain_records(path, Tolerance(optional=optional))
    assert len(found.records) == len(plain) > 0
    for record, expected in zip(found.records, plain, strict=True):
        assert content_digest(record) == content_digest(expected)


def spoilt(rng: np.random.Generator, spoils: list[Spoil], animals: int = 120) -> Content:
    content = large_content(rng, animals)
    for place, spoil in zip(rng.permutation(animals).tolist(), spoils, strict=False):
        spoil(content, place, rng)
    return content


@pytest.mark.parametrize("name", SPOILS)
def test_one_odd_element_is_read_as_plainly(tmp_path: Path, name: str) -> None:
    content = spoilt(np.random.default_rng(1), [SPOILS[name]], 30)
    fast = assert_same(write_coco(tmp_path, content))
    if name not in ("image's id as text", "no image", "no animal"):  # these concern few or none
        assert len(fast.plain.animals) < 10, "most are read fast"


@pytest.mark.parametrize("seed", range(3))
def test_many_odd_elements_at_once_are_read_as_plainly(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    spoils = [SPOILS[name] for name in rng.permutation([*SPOILS]).tolist()]
    path = write_coco(tmp_path, spoilt(rng, spoils, 240))
    for tolerance in (Tolerance(), Tolerance(optional="drop"), Tolerance(visibility="scores")):
        assert_same(path, tolerance=tolerance)
    assert_same(path, categories=("Dog",))


def test_boxes_that_all_may_be_corners_are_faults_in_both_ways(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    path = write_coco(tmp_path, spoilt(rng, [corners] * 30, 30))
    fast = assert_same(path)
    assert any("two corners" in fault.problem for fault in fast.plain.faults)


def content_with_corners() -> Content:
    """Animals; the first has a box that evidently is two corners, its neighbour one that may be."""
    content = large_content(np.random.default_rng(0), 30)
    evident, possible = content["annotations"][:2]
    for one, size, begin in ((evident, 0.5, 110), (possible, 0.2, 0)):
        points = np.array(one["keypoints"]).reshape(-1, 3)
        points = np.where(points[:, 2:] > 0, points * (size, size, 1) + (begin, begin, 0), 0.0)
        marked = points[points[:, 2] > 0, :2]
        one |= {
            "image_id": evident["image_id"],
            "keypoints": points.ravel().tolist(),
            "bbox": [*(marked.min(0) - 1).tolist(), *(marked.max(0) + 1).tolist()],
        }
    return content


def test_one_box_of_corners_casts_no_doubt_on_what_others_may_be(tmp_path: Path) -> None:
    fast = assert_same(write_coco(tmp_path, content_with_corners()))
    assert ["two corners" in fault.problem for fault in fast.plain.faults] == [True]


def test_a_box_that_was_left_out_stays_out_of_the_record(tmp_path: Path) -> None:
    path = write_coco(tmp_path, content_with_corners())
    assert_same_records(path, "drop")
    found = coco.read_coco(path, tmp_path, tolerance=Tolerance(optional="drop"), check_paths=False)
    assert sum(record.box is None for record in found.records) == 1


@pytest.mark.parametrize("optional", get_args(BadParts))
def test_records_made_on_demand_are_those_read_plainly(tmp_path: Path, optional: BadParts) -> None:
    rng = np.random.default_rng(5)
    path = write_coco(tmp_path, spoilt(rng, [*SPOILS.values()], 120))
    assert_same_records(path, optional)


def test_records_of_a_file_without_visibility_2_are_those_read_plainly(tmp_path: Path) -> None:
    content = large_content(np.random.default_rng(0), 20)
    for one in content["annotations"]:
        one["keypoints"][2::3] = [min(mark, 1) for mark in one["keypoints"][2::3]]
    assert_same_records(write_coco(tmp_path, content))


@pytest.mark.parametrize("separators", [(",",), (",", " ,\n", ",  "), (",\n\t",)])
def test_places_are_found_whatever_stands_between_elements(
    tmp_path: Path, separators: tuple[str, ...]
) -> None:
    content = large_content(np.random.default_rng(0), 20)
    lists = []
    for name in ("images", "annotations"):
        elements = [json.dumps(one) for one in content[name]]
        between = (separators[k % len(separators)] for k in range(len(elements)))
        text = "".join(part for pair in zip(between, elements, strict=True) for part in pair)
        lists.append(f'"{name}": [ {text.lstrip(", ")} ]')
    lists.append(f'"categories": {json.dumps(content["categories"])}')
    path = tmp_path / "separated.json"
    path.write_text("\ufeff{" + ", ".join(lists) + "}", encoding="utf-8")
    assert_same_records(path)


def opened(path: Path, folder: Path | None) -> RecordSet:
    return coco.read_coco(path, path.parent, check_paths=False, index_folder=folder)


def no_reading(path: Path) -> bytes:
    raise AssertionError(f"{path} is read")


def clean_file(tmp_path: Path, seed: int = 0) -> Path:
    content = large_content(np.random.default_rng(seed), 20)
    return write_coco(tmp_path, content, f"{seed}.json")


def sample_ids(records: RecordSet) -> list[str]:
    return [record.sample_id for record in records.records]


def test_a_later_opening_reads_the_index_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, folder = clean_file(tmp_path), tmp_path / "indexes"
    first = opened(path, folder)
    monkeypatch.setattr(coco, "read_json_bytes", no_reading)
    later = opened(path, folder)
    assert sample_ids(later) == sample_ids(first)
    assert (later.notes, later.categories) == (first.notes, first.categories)
    with pytest.raises(AssertionError, match="is read"):
        opened(path, tmp_path / "others")


def test_an_index_is_the_same_bytes_each_time(tmp_path: Path) -> None:
    path = clean_file(tmp_path)
    for name in "ab":
        opened(path, tmp_path / name)
    (one,), (two,) = ([*(tmp_path / name).glob("*.index")] for name in "ab")
    assert (one.name, one.read_bytes()) == (two.name, two.read_bytes())


def test_a_changed_file_is_read_anew_even_with_its_old_size_and_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(index_folder, "SETTLED_S", -1.0)
    path, folder = clean_file(tmp_path), tmp_path / "indexes"
    opened(path, folder)
    text, stat = path.read_text(), path.stat()
    path.write_text(text.replace("sub1/1.jpg", "sub1/X.jpg"))
    os.utime(path, ns=(stat.st_atime_ns, stat.st_mtime_ns))
    assert "sub1/X.jpg" in sample_ids(opened(path, folder))


def test_another_version_of_the_reader_makes_its_own_index(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, folder = clean_file(tmp_path), tmp_path / "indexes"
    opened(path, folder)
    monkeypatch.setattr(index_folder, "code_digest", lambda: b"another")
    opened(path, folder)
    assert len([*folder.glob("*.index")]) == 2


DAMAGES: dict[str, Callable[[bytes], bytes]] = {
    "cut": lambda data: data[:-9],
    "empty": lambda data: b"",
    "one byte": lambda data: data[:99] + bytes([data[99] ^ 1]) + data[100:],
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_index_is_made_anew_with_a_note(tmp_path: Path, damage: str) -> None:
    path, folder = clean_file(tmp_path), tmp_path / "indexes"
    first = opened(path, folder)
    ids = sample_ids(first)
    (file,) = folder.glob("*.index")
    whole = file.read_bytes()
    file.unlink()
    file.write_bytes(DAMAGES[damage](whole))
    again = opened(path, folder)
    assert sample_ids(again) == ids
    assert "has been made anew" in again.notes[-1]
    assert file.read_bytes() == whole
    assert opened(path, folder).notes == first.notes


def test_openings_at_once_leave_one_whole_index(tmp_path: Path) -> None:
    path, folder = clean_file(tmp_path), tmp_path / "indexes"
    with ThreadPoolExecutor(4) as pool:
        several = [*pool.map(lambda _: sample_ids(opened(path, folder)), range(8))]
    assert all(ids == several[0] for ids in several)
    assert [file.suffix for file in folder.iterdir() if file.suffix != ".state"] == [".index"]


def test_a_folder_that_cannot_be_written_to_costs_a_note(tmp_path: Path) -> None:
    path = clean_file(tmp_path)
    (tmp_path / "file").write_text("")
    found = opened(path, tmp_path / "file")
    assert len(found.records) == 20
    assert "no index of 0.json can be kept" in found.notes[-1]


def test_a_shard_reads_no_annotation_of_another(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    content = large_content(np.random.default_rng(0), 40)
    dataset = CocoKeypointsDataset(
        write_coco(tmp_path, content), images=tmp_path, body="dog", cache=tmp_path / "cache"
    )
    pieces: list[bytes] = []
    read = json_ranges.RangeReader.read

    def noted(self: json_ranges.RangeReader, begin: int, length: int) -> bytes:
        pieces.append(read(self, begin, length))
        return pieces[-1]

    monkeypatch.setattr(json_ranges.RangeReader, "read", noted)
    shard = [dataset.source.sample(index) for index in range(0, len(dataset), 5)]
    ids = {record.image_id for sample in shard for record in sample.records}
    names = {image["id"]: image["file_name"] for image in content["images"]}
    for piece in pieces:
        element = json.loads(piece)
        assert element.get("file_name", names.get(element.get("image_id"))) in ids


def test_a_file_changed_while_it_is_open_is_told(tmp_path: Path) -> None:
    path = clean_file(tmp_path)
    found = opened(path, None)
    path.write_text(path.read_text() + " ")
    with pytest.raises(DatasetFormatError, match="has been changed since it was opened"):
        _ = found.records[0]


def test_a_pickled_dataset_is_the_path_of_its_index(tmp_path: Path) -> None:
    content = large_content(np.random.default_rng(0), 400)
    found = opened(write_coco(tmp_path, content), tmp_path / "indexes")
    sent = pickle.dumps(found.records)
    assert len(sent) < 8000 < sum(file.stat().st_size for file in (tmp_path / "indexes").iterdir())
    received: IndexedAnimals = pickle.loads(sent)
    assert content_digest(received[7]) == content_digest(found.records[7])


def test_a_missing_picture_is_a_fault_when_it_is_read(tmp_path: Path) -> None:
    path = write_coco(tmp_path, coco_content(tmp_path))
    (tmp_path / "images" / "sub" / "b.jpg").unlink()
    dataset = CocoKeypointsDataset(path, body="dog", on_bad="skip")
    assert (len(dataset), dataset.report().counts) == (2, {})
    skipped = dataset[1]
    assert "there is no file 'sub/b.jpg'" in skipped.cases[0].problem  # type: ignore[union-attr]
    assert dataset.source.photo(dataset.source.sample(0)).pixels.shape == (*HW_OF_PICTURES, 3)
    checked = CocoKeypointsDataset(path, body="dog", on_bad="skip", check_paths=True)
    assert len(checked) == 1
    assert "there is no file 'sub/b.jpg'" in checked.source.faults[0].problem


def test_pictures_in_other_folders_are_looked_up_together(tmp_path: Path) -> None:
    content = coco_content(tmp_path)
    for one in content["images"]:
        one["file_name"] = f"old/{one['file_name']}"
    path = write_coco(tmp_path, content)
    found = coco.read_coco(path, check_paths=False)
    expected = coco.read_coco(path)
    assert found.notes == expected.notes
    assert "are not where their names say" in found.notes[-1]


def test_one_picture_in_another_folder_is_not_taken(tmp_path: Path) -> None:
    content = coco_content(tmp_path)
    content["images"][1]["file_name"] = "old/sub/b.jpg"
    dataset = CocoKeypointsDataset(write_coco(tmp_path, content), body="dog", on_bad="skip")
    assert "is not taken for it" in dataset[1].cases[0].problem  # type: ignore[union-attr]
    assert "is not taken for it" in str(coco.read_coco(tmp_path).faults[0])


def test_one_picture_is_not_taken_for_two_names(tmp_path: Path) -> None:
    content = coco_content(tmp_path)
    content["images"].append({**content["images"][0], "id": 99, "file_name": "A.jpg"})
    content["annotations"].append({**content["annotations"][1], "id": 99, "image_id": 99})
    dataset = CocoKeypointsDataset(write_coco(tmp_path, content), body="dog", on_bad="skip")
    assert "is the file of 'a.jpg', too" in dataset[2].cases[0].problem  # type: ignore[union-attr]


def test_links_out_of_the_folder_are_not_followed(tmp_path: Path) -> None:
    content = coco_content(tmp_path)
    Image.new("RGB", (3, 3)).save(tmp_path / "secret.jpg")
    (tmp_path / "images" / "a.jpg").unlink()
    (tmp_path / "images" / "a.jpg").symlink_to(tmp_path / "secret.jpg")
    dataset = CocoKeypointsDataset(write_coco(tmp_path, content), body="dog", on_bad="skip")
    assert "leads out of" in dataset[0].cases[0].problem  # type: ignore[union-attr]


def test_no_index_is_kept_of_a_file_that_depends_on_its_pictures(tmp_path: Path) -> None:
    content = coco_content(tmp_path)
    del content["images"][0]["height"]
    path, folder = write_coco(tmp_path, content), tmp_path / "indexes"
    found = coco.read_coco(path, check_paths=False, index_folder=folder)
    assert "have to be looked up among the pictures" in found.notes[-1]
    assert not [*folder.glob("*.index")]


def test_a_digest_is_remembered_only_of_a_settled_file(tmp_path: Path) -> None:
    path, folder = clean_file(tmp_path), IndexFolder(tmp_path / "indexes")
    folder.file_digest(path)
    assert not folder.path.exists()
