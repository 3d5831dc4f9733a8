"""Reading StanfordExtra.

What is there, and every fault with its sample, its field and its reason.
"""

from pathlib import Path

import numpy as np
import pytest
from photo_dataset import (
    FAULTS,
    HW,
    Entry,
    View,
    add_fault,
    add_photo,
    as_text,
    entry_of,
    toy_scene,
    view_of,
    write_annotations,
)

from animal3dbox.datasets.images.rle import decode_counts, encode_mask
from animal3dbox.datasets.readers.stanfordextra import find_annotations, read_stanfordextra
from animal3dbox.errors import DatasetFormatError, DatasetNotFoundError


@pytest.fixture(scope="module")
def view() -> View:
    return view_of(toy_scene(), 60)


@pytest.fixture
def good(tmp_path: Path, view: View) -> Entry:
    return add_photo(tmp_path, view, "n02/good.jpg")


def wider(entry: Entry, by: int) -> Entry:
    """Another dog of the same image, as far as the reader can tell."""
    x, y, width, height = entry["img_bbox"]
    joints = [[u + 3 * by * bool(v), w, v] for u, w, v in entry["joints"]]
    return {**entry, "img_bbox": [x, y, width + by, height], "joints": joints}


# What is there
# --------------------------------------------------------------------------------------------------


def test_a_record_holds_what_the_entry_says(tmp_path: Path, view: View, good: Entry) -> None:
    found = read_stanfordextra(write_annotations(tmp_path, [good]))
    (record,) = found.records
    assert (found.name, found.faults) == ("stanfordextra", ())
    assert (record.sample_id, record.image_id, record.image_hw, record.category) == (
        "n02/good.jpg",
        "n02/good.jpg",
        HW,
        "dog",
    )
    assert record.image_path == (tmp_path / "images" / "n02" / "good.jpg").resolve()
    assert record.keypoints_2d.tolist() == good["joints"]
    assert record.keypoints_2d.dtype == np.float64
    assert record.mask is not None
    assert np.array_equal(record.mask, view.mask)
    assert record.vocabulary.keypoints[:3] == (
        "Left front leg: paw",
        "Left front leg: middle joint",
        "Left front leg: top",
    )


def test_records_keep_the_order_of_the_file(tmp_path: Path, view: View) -> None:
    names = ["b.jpg", "a.jpg", "c.jpg"]
    found = read_stanfordextra(
        write_annotations(tmp_path, [add_photo(tmp_path, view, name) for name in names])
    )
    assert [record.image_id for record in found.records] == names


def test_unknown_keys_are_left_alone(tmp_path: Path, good: Entry) -> None:
    assert (
        len(
            read_stanfordextra(
                write_annotations(tmp_path, [{**good, "breed": {"x": [1, None]}}])
            ).records
        )
        == 1
    )


@pytest.mark.parametrize("row", [[None, None, 0], [12.0, None, 0.0], [None, None, None]])
def test_a_joint_with_null_counts_as_missing(
    tmp_path: Path, good: Entry, row: list[float | None]
) -> None:
    (record,) = read_stanfordextra(
        write_annotations(tmp_path, [{**good, "joints": [row, *good["joints"][1:]]}])
    ).records
    assert record.keypoints_2d[0].tolist() == [0.0, 0.0, 0.0]
    assert record.keypoints_2d[1].tolist() == good["joints"][1]


def test_the_mask_may_be_a_dict_of_size_and_counts(tmp_path: Path, view: View, good: Entry) -> None:
    runs = decode_counts(good["seg"])
    for seg in (
        {"size": list(HW), "counts": good["seg"]},
        {"counts": good["seg"]},
        {"size": list(HW), "counts": runs},
    ):
        (record,) = read_stanfordextra(write_annotations(tmp_path, [{**good, "seg": seg}])).records
        assert record.mask is not None
        assert np.array_equal(record.mask, view.mask)


@pytest.mark.parametrize("drop", [True, False])
def test_a_dog_without_a_mask_is_read_without_one(tmp_path: Path, good: Entry, drop: bool) -> None:
    entry = {k: v for k, v in good.items() if k != "seg"} if drop else {**good, "seg": None}
    (record,) = read_stanfordextra(write_annotations(tmp_path, [entry])).records
    assert record.mask is None


def test_several_dogs_in_one_image_get_a_number_each(tmp_path: Path, good: Entry) -> None:
    dogs = [wider(good, k) for k in (1, 2, 3)]
    found = read_stanfordextra(write_annotations(tmp_path, dogs))
    assert [record.sample_id for record in found.records] == [
        "n02/good.jpg",
        "n02/good.jpg#1",
        "n02/good.jpg#2",
    ]
    assert {record.image_id for record in found.records} == {"n02/good.jpg"}


@pytest.mark.parametrize("spoilt", [{"img_bbox": [0, 0, 0, 0]}, {"joints": None}])
def test_a_faulty_dog_keeps_its_number_and_shifts_no_other(
    tmp_path: Path, good: Entry, spoilt: Entry
) -> None:
    found = read_stanfordextra(write_annotations(tmp_path, [{**good, **spoilt}, wider(good, 1)]))
    assert [fault.sample_id for fault in found.faults] == ["n02/good.jpg"]
    assert [record.sample_id for record in found.records] == ["n02/good.jpg#1"]


def test_an_entry_that_comes_twice_is_a_fault_that_names_the_first(
    tmp_path: Path, view: View, good: Entry
) -> None:
    other = add_photo(tmp_path, view, "other.jpg")
    found = read_stanfordextra(write_annotations(tmp_path, [other, good, good]))
    assert [record.sample_id for record in found.records] == ["other.jpg", "n02/good.jpg"]
    assert [str(fault) for fault in found.faults] == [
        "n02/good.jpg#1: entry 2: is entry 1 once more; remove one, or it counts twice"
    ]


def test_joints_a_little_outside_their_box_and_joints_at_zero_are_no_fault(
    tmp_path: Path, good: Entry
) -> None:
    x, y, width, height = good["img_bbox"]
    tight = {**good, "img_bbox": [x + width / 10, y + height / 10, 0.8 * width, 0.8 * height]}
    unmarked = {**good, "joints": [*good["joints"][:8], *[[0, 0, 1]] * 16]}
    assert read_stanfordextra(write_annotations(tmp_path, [tight, unmarked])).faults == ()


# Faults of one sample
# -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", [name for name, fault in FAULTS.items() if fault.when_read])
def test_a_faulty_sample_is_named_with_field_and_reason_and_spoils_no_other(
    tmp_path: Path, view: View, good: Entry, name: str
) -> None:
    fault, spoilt = FAULTS[name], add_fault(tmp_path, view, name)
    last = add_photo(tmp_path, view, "last.jpg")
    found = read_stanfordextra(write_annotations(tmp_path, [good, spoilt.entry, last]))
    assert [record.sample_id for record in found.records] == ["n02/good.jpg", "last.jpg"]
    (error,) = found.faults
    expected = "entry 1" if fault.sample == "entry " else spoilt.sample_id
    assert error.sample_id == expected
    assert fault.field in error.field
    assert fault.reason in error.problem
    assert str(error) == f"{expected}: {error.field}: {error.problem}"


@pytest.mark.parametrize("name", [name for name, fault in FAULTS.items() if not fault.when_read])
def test_what_only_pixels_or_sense_can_tell_is_left_to_labelling(
    tmp_path: Path, view: View, name: str
) -> None:
    found = read_stanfordextra(write_annotations(tmp_path, [add_fault(tmp_path, view, name).entry]))
    assert (len(found.records), found.faults) == (1, ())


@pytest.mark.parametrize(("row", "column"), [(0, 0), (0, -1), (-1, 0), (-1, -1)])
def test_a_mask_of_one_pixel_in_a_corner_is_read(
    tmp_path: Path, good: Entry, row: int, column: int
) -> None:
    mask = np.zeros(HW, dtype=bool)
    mask[row, column] = True
    (record,) = read_stanfordextra(
        write_annotations(tmp_path, [{**good, "seg": encode_mask(mask)}])
    ).records
    assert record.mask is not None
    assert np.array_equal(record.mask, mask)


# Faults of the whole file
# ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"", "is empty"),
        (b" \n\t", "is empty"),
        (b"img_path,img_width\n", "is not valid JSON"),
        (b'[{"img_path": "a.jpg"', "is not valid JSON"),
        (b"[1, 2] tail", "is not valid JSON"),
        (b'[{"joints": [[NaN, 1, 1]]}]', "it holds NaN, which JSON does not have: write null"),
        (
            b'[{"joints": [[-Infinity, 1, 1]]}]',
            "it holds Infinity, which JSON does not have: write null",
        ),
        (b'{"data": []}', "annotations.json: Expected `array`, got `object`"),
        (b'"annotations"', "annotations.json: Expected `array`, got `str`"),
        (b"null", "annotations.json: Expected `array`, got `null`"),
        (b"7", "annotations.json: Expected `array`, got `int`"),
        (b"[" * 100_000, "nested too deeply"),
        (b"[" * 100_000 + b"]" * 100_000, "nested too deeply"),
        (b"\xff\xfe[\x00]\x00", "is not valid JSON"),  # UTF-16, as some Windows programs save it
    ],
    ids=[
        "empty",
        "blank",
        "csv",
        "cut_off",
        "tail",
        "nan",
        "infinity",
        "object",
        "string",
        "null",
        "number",
        "open",
        "deep",
        "utf16",
    ],
)
def test_a_file_that_is_no_json_list_is_refused_by_name(
    tmp_path: Path, data: bytes, reason: str
) -> None:
    (tmp_path / "annotations.json").write_bytes(data)
    with pytest.raises(DatasetFormatError) as caught:
        read_stanfordextra(tmp_path)
    assert str(tmp_path / "annotations.json") in str(caught.value)
    assert reason in str(caught.value)


def test_a_lone_surrogate_is_refused_as_a_format_error(tmp_path: Path, good: Entry) -> None:
    text = as_text(b"n02/good.jpg", b"\\ud800.jpg")(good, tmp_path, tmp_path)
    with pytest.raises(DatasetFormatError):
        read_stanfordextra(write_annotations(tmp_path, [text]))


@pytest.mark.parametrize(
    ("files", "found"),
    [
        ([], "found none"),
        (["other.json"], "found none"),
        (
            ["annotations.json", "StanfordExtra_v12.json"],
            "StanfordExtra_v12.json, annotations.json",
        ),
    ],
)
def test_a_folder_without_one_annotation_file_is_refused(
    tmp_path: Path, files: list[str], found: str
) -> None:
    for name in files:
        (tmp_path / name).write_text("[]")
    with pytest.raises(DatasetNotFoundError) as caught:
        find_annotations(tmp_path)
    assert str(tmp_path) in str(caught.value)
    assert found in str(caught.value)


@pytest.mark.parametrize(
    "name", ["annotations.json", "StanfordExtra_v12.json", "stanfordextra.json"]
)
def test_the_annotation_file_of_a_folder_is_found(tmp_path: Path, name: str) -> None:
    for other in (name, "keypoint_definitions.json"):
        (tmp_path / other).write_text("[]")
    assert find_annotations(tmp_path) == tmp_path / name
    assert find_annotations(tmp_path / name) == tmp_path / name


def test_a_path_that_does_not_exist_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DatasetNotFoundError, match=r"there is no file or folder .*nowhere"):
        read_stanfordextra(tmp_path / "nowhere")


def test_images_may_lie_elsewhere_but_must_be_there(tmp_path: Path, view: View) -> None:
    (tmp_path / "a").mkdir()
    add_photo(tmp_path / "b", view, "dog.jpg")
    annotations = write_annotations(tmp_path / "a", [entry_of(view, "dog.jpg")])
    assert len(read_stanfordextra(annotations, tmp_path / "b" / "images").records) == 1
    assert len(read_stanfordextra(annotations).faults) == 1  # the json's own folder has none
    with pytest.raises(DatasetNotFoundError, match="there is no folder of images"):
        read_stanfordextra(annotations, tmp_path / "c")


def test_images_beside_the_json_are_found_without_a_folder_of_their_own(
    tmp_path: Path, view: View
) -> None:
    add_photo(tmp_path, view, "dog.jpg")
    (tmp_path / "images" / "dog.jpg").rename(tmp_path / "dog.jpg")
    (tmp_path / "images").rmdir()
    assert (
        len(read_stanfordextra(write_annotations(tmp_path, [entry_of(view, "dog.jpg")])).records)
        == 1
    )


def test_a_list_without_an_entry_is_refused(tmp_path: Path) -> None:
    (tmp_path / "annotations.json").write_text("[]")
    with pytest.raises(DatasetFormatError, match="without an entry"):
        read_stanfordextra(tmp_path)
