"""The table of labels: every animal is a row, once, in whatever parts and order it is made."""

import csv
import gzip
import io
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from cuboid_sets import random_set
from fault_table import KINDS as FAULT_KINDS
from hypothesis import given
from hypothesis import strategies as st
from photo_dataset import toy_scene, view_of
from planted_file_faults import ENTRY_FAULTS, FILE_FAULTS, plant_many
from small_animals import small_dataset
from table_rows import entries_of, sorted_rows
from thorough import thorough
from written_otherwise import json_set

from animal3dbox.datasets import AnnotatedDataset, FileSource, LabelFilter
from animal3dbox.datasets.label_dataset import LabelDataset
from animal3dbox.errors import ConfigError, DatasetFormatError
from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.types import CuboidLabel
from animal3dbox.report import label_table, missing_indices, table_plan, write_part
from animal3dbox.report.label_files import animal_row
from animal3dbox.report.labels_csv import CSV_COLUMNS, FORMULA_SIGNS, csv_values
from animal3dbox.report.summary import flags_of
from animal3dbox.report.table.columns import KINDS, columns_table
from animal3dbox.report.table.keys import row_keys, table_length
from animal3dbox.report.table.parts import (
    arrow_table,
    check_part,
    locked_shard,
    parts_of,
    read_part,
)
from animal3dbox.target_schema import FILE_FIELDS

DOCS = Path(__file__).parents[3] / "docs" / "formats.md"
FAULT_CELLS = [(name, format) for name, kind in FAULT_KINDS.items() for format in kind.formats]


@pytest.fixture(scope="module")
def dataset(animals: Path) -> LabelDataset:
    return small_dataset(animals)


def whole_table(dataset: LabelDataset) -> dict[str, list[object]]:
    return label_table(dataset, range(table_length(dataset)))


@pytest.mark.parametrize("seed", range(2))
def test_every_animal_is_a_row_whatever_is_wrong_with_it(copied: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    faults = [str(name) for name in rng.permutation([*FILE_FAULTS, *ENTRY_FAULTS])[:6]]
    spoilt = plant_many(copied, faults, rng)
    dataset = small_dataset(copied, on_bad="skip")
    table = whole_table(dataset)
    assert len(table["key"]) == len({*table["key"]}) == entries_of(copied)
    status = dict(zip(table["sample_id"], table["status"], strict=True))
    for image, fault in zip(spoilt, faults, strict=True):
        own = [state for name, state in status.items() if str(name).startswith(image)]
        assert "faulty" in own, (fault, image, status)
    assert {*table["status"]} == {"labelled", "faulty"}
    assert all(table["reason"][i] and table["problem"][i] for i in places(table, "faulty"))


def places(table: dict[str, list[object]], status: str) -> list[int]:
    return [place for place, one in enumerate(table["status"]) if one == status]


@thorough(20)
@given(cell=st.sampled_from(FAULT_CELLS))
def test_a_planted_mistake_costs_no_row(
    cell: tuple[str, str], tmp_path_factory: pytest.TempPathFactory
) -> None:
    name, format = cell
    root = tmp_path_factory.mktemp("set")
    made = json_set(format, root, view_of(toy_scene(), 70))
    FAULT_KINDS[name].plant(made)
    dataset = AnnotatedDataset(
        made.write(),
        images=root / "images",
        body="preset",
        on_bad="skip",
        config=LabelConfig(method="basic", surface_share=False, mask_iou=False),
    )
    table = whole_table(dataset)
    # Of COCO an element of an image that cannot be used is a row of its own, too.
    of_images = sum(
        format == "coco" and "annotation" not in f"{one.sample_id}{one.problem}"
        for one in dataset.source.faults
    )
    assert of_images <= 1
    assert len(table["key"]) == len({*table["key"]}) == len(made.animals) + of_images


def test_a_label_s_row_is_that_of_labels_json_and_labels_csv(dataset: LabelDataset) -> None:
    table = label_table(dataset, [2])
    assert [*table] == [*KINDS]
    (one, *_) = dataset.outcomes([2])
    assert isinstance(one.outcome, CuboidLabel)
    row = animal_row(
        one.outcome,
        image=one.image_id,
        animal=one.number,
        category=one.entry.category,
        sighting=one.sighting,
    )
    cells = csv_values(row, flags_of(one.outcome))
    assert [table[name][0] for name in CSV_COLUMNS] == [
        cells.get(name) or (cells.get(name) if cells.get(name) == 0 else None)
        for name in CSV_COLUMNS
    ]
    assert table["corners_3d_7_2"][0] == row.corners_3d[7][2]
    assert table["face_area_left"][0] == row.face_area[2]
    assert table["orientation_rule"][0] == row.quality["orientation_rule"]
    assert (table["image_height"][0], table["image_width"][0]) == row.image_hw


def test_every_field_of_the_schema_has_its_columns() -> None:
    own = {"box": ["x0"], "face_share": ["share_front"], "surface_share": ["surface_front"]}
    for field in FILE_FIELDS:
        name = field.label_name or field.name
        columns = own.get(name) or [
            one for one in KINDS if one == name or one.startswith(f"{name}_")
        ]
        assert columns, name
        assert {*columns} <= {*KINDS}


def test_the_docs_list_the_columns() -> None:
    assert columns_table() in DOCS.read_text()


def test_labels_that_a_filter_refuses_are_rows_with_their_numbers(
    animals: Path, dataset: LabelDataset
) -> None:
    filtered = small_dataset(animals, filters=LabelFilter(min_box_px=1000))
    table = label_table(filtered, [0])
    assert {*table["status"]} == {"filtered"}
    assert table["reason"][0] == "min_box_px"
    assert table["center_2"][0] is not None
    assert table["labels_digest"] != label_table(dataset, [0])["labels_digest"]


def test_an_animal_without_a_label_is_told_with_what_its_file_says(animals: Path) -> None:
    dataset = small_dataset(
        animals, config=LabelConfig(min_keypoints=26), stored_cameras="hypothesis"
    )
    table = label_table(dataset, [0])
    assert (table["status"][0], table["reason"][0]) == ("rejected", "too_few_keypoints")
    assert "min_keypoints is 26" in str(table["problem"][0])
    assert table["category"][0] is not None
    assert table["center_0"][0] is None


def test_an_index_beyond_the_table_is_refused(dataset: LabelDataset) -> None:
    with pytest.raises(IndexError, match="index 8 of 8"):
        label_table(dataset, [8])


def test_labels_of_the_cache_give_the_same_rows(
    animals: Path, dataset: LabelDataset, tmp_path: Path
) -> None:
    cached = small_dataset(animals, cache=tmp_path)
    for _ in range(2):
        assert label_table(cached, [0, 1]) == label_table(dataset, [0, 1])


# Parts and plans
# -------------------------------------------------------------------------------------------------


def written(dataset: LabelDataset, folder: Path, shard: tuple[int, int], *, at_once: int) -> None:
    with locked_shard(folder, shard):
        plan = table_plan(dataset, folder, shard=shard, resume=True)
        for first in range(0, len(plan.indices), at_once):
            plan.write(label_table(dataset, plan.indices[first : first + at_once]))


def test_shards_and_batches_of_any_size_make_the_same_table(
    animals: Path, dataset: LabelDataset, tmp_path: Path
) -> None:
    written(dataset, tmp_path / "whole", (1, 1), at_once=8)
    for number in (3, 1, 2):
        written(dataset, tmp_path / "shards", (number, 3), at_once=2)
    assert sorted_rows(tmp_path / "shards") == sorted_rows(tmp_path / "whole")
    assert len(sorted_rows(tmp_path / "whole")) == entries_of(animals)


def test_what_is_missing_is_made_whatever_the_parts_were(
    dataset: LabelDataset, tmp_path: Path
) -> None:
    written(dataset, tmp_path / "whole", (1, 1), at_once=8)
    written(dataset, tmp_path / "again", (2, 3), at_once=1)
    written(dataset, tmp_path / "again", (1, 1), at_once=3)
    parts_of(tmp_path / "again")[0].path.unlink()
    written(dataset, tmp_path / "again", (1, 2), at_once=3)
    written(dataset, tmp_path / "again", (2, 2), at_once=3)
    assert sorted_rows(tmp_path / "again") == sorted_rows(tmp_path / "whole")


def test_keys_tell_what_is_missing_without_a_picture_being_read(copied: Path) -> None:
    dataset = small_dataset(copied)
    table = label_table(dataset, [0, 3])
    for image in copied.rglob("*.jpg"):
        image.unlink()
    assert missing_indices(dataset, range(8), {*table["key"]}) == [1, 2, 4, 5, 6, 7]
    assert [key for _, key in row_keys(dataset, [0, 3])] == table["key"]


def test_a_table_of_other_labels_is_not_gone_on_with(copied: Path, tmp_path: Path) -> None:
    written(small_dataset(copied), tmp_path / "t", (1, 1), at_once=8)
    with pytest.raises(ConfigError, match="go on with --resume, or give another folder"):
        table_plan(small_dataset(copied), tmp_path / "t")
    other = small_dataset(copied, config=LabelConfig(method="basic"))
    with pytest.raises(ConfigError, match="with other options or bodies"):
        table_plan(other, tmp_path / "t", resume=True)
    content = json.loads((copied / "train.json").read_text())
    content["data"][0]["keypoint_2d"][0][0] += 1
    (copied / "train.json").write_text(json.dumps(content))
    with pytest.raises(ConfigError, match="1 rows of animals that the dataset does not have"):
        table_plan(small_dataset(copied), tmp_path / "t", resume=True)


def test_a_part_that_is_damaged_or_there_twice_is_named(
    dataset: LabelDataset, tmp_path: Path
) -> None:
    written(dataset, tmp_path, (1, 1), at_once=4)
    first, second = parts_of(tmp_path)
    whole = first.path.read_bytes()
    copy = first.path.with_name(f"shard-1-of-1-0000000000000000.{first.format}")
    copy.write_bytes(whole)
    with pytest.raises(ConfigError, match="holds rows that another part"):
        table_plan(dataset, tmp_path, resume=True)
    copy.unlink()
    first.path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(DatasetFormatError, match=f"{first.path.name} cannot be read.*delete it"):
        table_plan(dataset, tmp_path, resume=True)
    first.path.unlink()
    assert len(table_plan(dataset, tmp_path, resume=True).indices) == 4
    assert second.path.exists()


def test_the_same_rows_are_the_same_file_to_the_byte(dataset: LabelDataset, tmp_path: Path) -> None:
    table = label_table(dataset, [0, 1])
    one, two = write_part(tmp_path / "a", table), write_part(tmp_path / "b", table)
    assert one is not None
    assert two is not None
    assert (one.name, one.read_bytes()) == (two.name, two.read_bytes())
    assert write_part(tmp_path / "c", label_table(dataset, [])) is None


def test_text_comes_back_from_a_part_and_is_no_formula(
    dataset: LabelDataset, tmp_path: Path
) -> None:
    table = label_table(dataset, [0])
    count = len(table["key"])
    names = ['=1+1, "a"\nb', None][:count] + ["x"] * (count - 2)
    write_part(tmp_path, {**table, "category": names})
    (part,) = parts_of(tmp_path)
    back = read_part(part, [*KINDS])
    assert back["category"] == names
    assert back == {**table, "category": names}


TEXTS = ["a\rb", "a\r\nb\n", '"\r"', "a\r", "=x", "'=x", "''=x", "'x", "'", "''", "-", "'\r"]


@pytest.mark.parametrize("text", TEXTS)
def test_any_text_comes_back_from_csv_and_is_no_formula(
    dataset: LabelDataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str
) -> None:
    monkeypatch.setattr("animal3dbox.report.table.parts.find_spec", lambda name: None)
    table = label_table(dataset, [0])
    table["category"] = [text] * len(table["key"])
    path = write_part(tmp_path, table)
    assert path is not None
    assert read_part(parts_of(tmp_path)[0], [*KINDS]) == table
    lines = gzip.decompress(path.read_bytes()).decode()
    assert lines.endswith("\n")
    assert not lines.endswith("\r\n")
    cells = {row["category"] for row in csv.DictReader(io.StringIO(lines))}
    assert cells == {f"'{text}" if text.lstrip("'").startswith(FORMULA_SIGNS) else text}


def with_changed_byte(data: bytes, place: int) -> bytes:
    changed = bytearray(data)
    changed[place] ^= 0xFF
    return bytes(changed)


def with_flipped_bit(data: bytes, place: int, bit: int) -> bytes:
    changed = bytearray(data)
    changed[place] ^= 1 << bit
    return bytes(changed)


CSV_DAMAGES: dict[str, Callable[[bytes], bytes]] = {
    "head": lambda data: with_changed_byte(data, 0),
    "first block": lambda data: with_changed_byte(data, 12),
    "rows": lambda data: with_changed_byte(data, 200),
    "checksum": lambda data: with_changed_byte(data, -6),
    "cut": lambda data: data[:-9],
    "empty": lambda data: b"",
}


@pytest.mark.parametrize("damage", CSV_DAMAGES)
def test_a_damaged_csv_part_is_named(
    dataset: LabelDataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, damage: str
) -> None:
    monkeypatch.setattr("animal3dbox.report.table.parts.find_spec", lambda name: None)
    path = write_part(tmp_path, label_table(dataset, [0]))
    assert path is not None
    path.write_bytes(CSV_DAMAGES[damage](path.read_bytes()))
    with pytest.raises(DatasetFormatError, match=f"{path.name} cannot be read.*delete it"):
        read_part(parts_of(tmp_path)[0], [*KINDS])


def test_no_flipped_bit_of_a_csv_part_makes_another_row(
    dataset: LabelDataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("animal3dbox.report.table.parts.find_spec", lambda name: None)
    path = write_part(tmp_path, label_table(dataset, [0]))
    assert path is not None
    (part,), whole, rng = parts_of(tmp_path), path.read_bytes(), np.random.default_rng(0)
    rows = read_part(part, ["key", "center_2"])
    refused = 0
    for place in rng.integers(10, len(whole), 40):  # behind gzip's header, which says nothing
        path.write_bytes(with_flipped_bit(whole, place, int(rng.integers(8))))
        for read in (check_part, lambda part: read_part(part, [*rows])):
            try:
                assert read(part) in (None, rows)
            except DatasetFormatError:
                refused += 1
    assert refused >= 78  # of 80; a bit that pads the last block says nothing


def test_a_flipped_bit_in_a_page_of_parquet_is_refused_where_it_is_read(
    dataset: LabelDataset, tmp_path: Path
) -> None:
    parquet = pytest.importorskip("pyarrow.parquet", reason="make test-extras installs it")
    path = write_part(tmp_path, whole_table(dataset))
    assert path is not None
    (part,), whole = parts_of(tmp_path), path.read_bytes()
    row_group = parquet.ParquetFile(path).metadata.row_group(0)
    end = row_group.column([*KINDS].index("center_2")).data_page_offset  # of its dictionary
    damaged = f"{path.name} cannot be read.*delete it and --resume"
    for place in range(end - 40, end, 9):
        path.write_bytes(with_flipped_bit(whole, place, place % 8))
        assert read_part(part, ["key", "center_1"])["key"]
        with pytest.raises(DatasetFormatError, match=damaged):
            read_part(part, ["key", "center_2"])
        with pytest.raises(DatasetFormatError, match=damaged):
            table_plan(dataset, tmp_path, resume=True)


def test_boxes_that_come_as_they_are_have_rows_too() -> None:
    boxes = random_set(seed=1)
    table = whole_table(LabelDataset(FileSource(boxes), on_bad="skip"))
    assert len({*table["key"]}) == len(boxes.records) > 0
    assert {*table["reason"]} == {"image"}  # there are no files of their pictures


def test_parquet_has_one_type_a_column_known_or_not(dataset: LabelDataset, tmp_path: Path) -> None:
    pyarrow = pytest.importorskip("pyarrow", reason="make test-extras installs it")
    table = label_table(dataset, [0, 1])
    arrow = arrow_table(table)
    assert arrow.schema.field("place").type == pyarrow.string()  # where nobody says a place
    assert arrow.to_pydict() == table
    path = write_part(tmp_path, table)
    assert path is not None
    assert path.suffix == ".parquet"
    (part,) = parts_of(tmp_path)
    assert read_part(part, [*KINDS]) == table


def test_parquet_without_pyarrow_names_the_extra(
    dataset: LabelDataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "shard-1-of-1-0123456789abcdef.parquet").write_bytes(b"PAR1")
    monkeypatch.setattr("animal3dbox.report.table.parts.find_spec", lambda name: None)
    with pytest.raises(ConfigError, match=r"pip install 'animal3dbox\[parquet\]'"):
        table_plan(dataset, tmp_path, resume=True)
