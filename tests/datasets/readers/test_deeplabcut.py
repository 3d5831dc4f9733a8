"""Reading DeepLabCut.

The same animals from csv and both layouts of h5, nothing unpickled, every fault with sample and
field.
"""

import csv
import importlib.util
import json
import pickle
import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest
from deeplabcut_files import (
    DLC_FAULTS,
    NAMES,
    Table,
    superanimal_view,
    table,
    write_appendable,
    write_csv,
    write_fixed,
    write_images,
)  # fmt: skip
from photo_dataset import HW

from animal3dbox.cli.main import main
from animal3dbox.datasets.formats import read_dataset, recognised_format
from animal3dbox.datasets.read_options import ReadOptions
from animal3dbox.datasets.readers.deeplabcut.reader import LEAST_LIKELIHOOD, read_deeplabcut
from animal3dbox.datasets.records import RecordSet
from animal3dbox.errors import ConfigError, DatasetFormatError, DatasetNotFoundError
from animal3dbox.smal.keypoints.vocabularies import VOCABULARIES
from animal3dbox.smal.keypoints.vocabulary import vocabulary_from_names

PANDAS = Path(__file__).parent / "pandas_h5"
WRITERS = {"csv": write_csv, "fixed": write_fixed, "table": write_appendable}


def written(folder: Path, made: Table, writer: str = "csv") -> Path:
    """A project's folder of labels with its images, and its table."""
    write_images(folder / "labeled-data" / "zoo", len(made.index))
    return WRITERS[writer](
        folder / "labeled-data" / "zoo" / f"CollectedData_me.{'csv' if writer == 'csv' else 'h5'}",
        made,
    )


class Victim:
    """A pickle of it creates a file when it is unpickled."""

    def __init__(self, path: str) -> None:
        self.path = path

    def __reduce__(self) -> tuple[object, ...]:
        return Path.touch, (Path(self.path),)


def same(a: RecordSet, b: RecordSet) -> bool:
    """Whether both have the same animals in the same places."""
    pairs = list(zip(a.records, b.records, strict=True))
    return all(
        x.sample_id == y.sample_id
        and np.allclose(x.keypoints_2d, y.keypoints_2d)
        and x.image_path == y.image_path
        for x, y in pairs
    )


@pytest.mark.parametrize("writer", WRITERS)
def test_labels_by_hand_are_read_from_every_kind_of_file(tmp_path: Path, writer: str) -> None:
    found = read_deeplabcut(written(tmp_path, table([[60], [250]], likelihood=None), writer))
    assert (found.faults, found.notes) == ((), ())
    first, second = found.records
    assert (first.sample_id, first.image_hw, first.vocabulary.name) == (
        "labeled-data/zoo/img000.png",
        HW,
        "superanimal39",
    )
    assert first.image_path == (tmp_path / "labeled-data" / "zoo" / "img000.png").resolve()
    assert np.allclose(first.keypoints_2d, superanimal_view(60).joints)
    assert np.allclose(second.keypoints_2d, superanimal_view(250).joints)
    assert (first.mask, first.K) == (None, None)


def test_files_that_pandas_wrote_are_read(tmp_path: Path) -> None:
    write_images(tmp_path / "labeled-data" / "zoo", 2)
    for file in PANDAS.glob("*.h5"):
        shutil.copy(file, tmp_path / "labeled-data" / "zoo")
    hand = read_deeplabcut(tmp_path / "labeled-data" / "zoo" / "labels_fixed.h5")
    first, second = (
        {k: row for k, row in zip(NAMES, r.keypoints_2d.tolist(), strict=True) if row[2]}
        for r in hand.records
    )
    assert first == {
        "tail_base": [0, 1, 1],
        "nose": [2, 3, 1],
        "neck_base": [4, 5, 1],
        "front_left_paw": [6, 7, 1],
    }
    assert second == {
        "tail_base": [8, 9, 1],
        "neck_base": [12, 13, 1],
        "front_left_paw": [14, 15, 1],
    }
    net = read_deeplabcut(tmp_path / "labeled-data" / "zoo" / "network_table.h5")
    assert [record.sample_id.rpartition("/")[2] for record in net.records] == [
        "img000.png",
        "img001.png",
        "img001.png#1",
    ]
    assert net.records[2].keypoints_2d[NAMES.index("nose")].tolist() == [39, 40, 0.75]


def test_values_may_be_stored_by_columns(tmp_path: Path) -> None:
    made = table([[60], [250]])
    file = written(tmp_path, made, "fixed")
    by_rows = read_deeplabcut(file)
    write_fixed(file, made, transposed=False)
    assert same(read_deeplabcut(file), by_rows)


@pytest.mark.parametrize("writer", WRITERS)
def test_several_animals_keep_their_numbers_where_one_is_absent(
    tmp_path: Path, writer: str
) -> None:
    made = table([[60, None, 250], [None, 110, None]], ["tom", "kit", "single"])
    found = read_deeplabcut(written(tmp_path, made, writer))
    assert [record.sample_id for record in found.records] == [
        "labeled-data/zoo/img000.png",
        "labeled-data/zoo/img001.png#1",
    ]
    assert {record.image_id for record in found.records} == {
        "labeled-data/zoo/img000.png",
        "labeled-data/zoo/img001.png",
    }
    assert np.allclose(
        found.records[1].keypoints_2d[:, :2], np.array(superanimal_view(110).joints)[:, :2]
    )
    assert (
        found.notes[0]
        == "2 times an animal is not in an image: no bodypart is marked, or of a likelihood of 0.6"
        " or more"
    )
    assert found.notes[1].startswith("the bodyparts of 'single' (nose, ")


def test_a_bodypart_the_network_is_not_sure_of_is_missing(tmp_path: Path) -> None:
    made = table([[60], [60]], likelihood=LEAST_LIKELIHOOD)
    made.rows[0, 2], made.rows[0, 3 * NAMES.index("neck_base") + 1] = (
        LEAST_LIKELIHOOD - 0.01,
        np.nan,
    )
    record, whole = read_deeplabcut(written(tmp_path, made)).records
    assert record.keypoints_2d[0].tolist() == [0, 0, 0]
    assert record.keypoints_2d[NAMES.index("neck_base")].tolist() == [0, 0, 0]
    assert whole.keypoints_2d[0, 2] == LEAST_LIKELIHOOD
    assert (
        int((record.keypoints_2d[:, 2] > 0).sum()) == int((whole.keypoints_2d[:, 2] > 0).sum()) - 2
    )


def test_bodyparts_are_matched_by_name_and_may_be_few(tmp_path: Path) -> None:
    made = table([[60]])
    keep = [
        i
        for part in ("tail_base", "nose", "front_left_paw", "neck_base")
        for i in range(3 * NAMES.index(part), 3 * NAMES.index(part) + 3)
    ]
    few = Table([made.columns[i] for i in keep], made.index, made.rows[:, keep])
    record = read_deeplabcut(written(tmp_path, few)).records[0]
    marked = [
        name
        for name, row in zip(record.vocabulary.keypoints, record.keypoints_2d, strict=True)
        if row[2] > 0
    ]
    assert marked == ["nose", "neck_base", "tail_base", "front_left_paw"]
    places = {
        "tail_base": "tail_base",
        "nose": "nose",
        "neck_base": "neck",
        "front_left_paw": None,
        "front_right_paw": None,
    }
    own = vocabulary_from_names("mine", places)
    record = read_dataset(
        tmp_path / "labeled-data" / "zoo", options=ReadOptions(vocabulary=own)
    ).records.records[0]
    assert record.vocabulary is own
    assert np.allclose(record.keypoints_2d[1, :2], superanimal_view(60).joints[0][:2])


@pytest.mark.parametrize("writer", ["csv", "table", "fixed"])
def test_a_videos_frames_are_matched_with_images_by_their_numbers(
    tmp_path: Path, writer: str
) -> None:
    made = table([[60], [110], [250]])
    made.index = [1, 2, 300]
    write_images(tmp_path, 3)
    found = read_deeplabcut(
        WRITERS[writer](tmp_path / f"video.{'csv' if writer == 'csv' else 'h5'}", made)
    )
    assert [record.sample_id for record in found.records] == ["img001.png", "img002.png"]
    assert found.notes == ("1 of 3 rows are frames without an image",)
    (tmp_path / "other_2.png").write_bytes((tmp_path / "img002.png").read_bytes())
    with pytest.raises(DatasetFormatError, match=r"other_2\.png and img002\.png are both frame 2"):
        read_deeplabcut(tmp_path)
    (tmp_path / "empty").mkdir()
    with pytest.raises(DatasetFormatError, match="has the frames of a video, but"):
        read_deeplabcut(tmp_path, tmp_path / "empty")


@pytest.mark.parametrize("place", ["project", "folder", "moved", "given", "windows"])
def test_images_are_found_where_the_labels_were_moved_to(tmp_path: Path, place: str) -> None:
    made = table([[60]], likelihood=None)
    if place == "windows":
        made.index = ["labeled-data\\zoo\\img000.png"]
    file = written(tmp_path / "project", made)
    images = None
    if place in ("moved", "given"):
        write_images(tmp_path / "else", 1)
        file = file.rename(tmp_path / ("else" if place == "moved" else "") / "labels.csv")
        images = tmp_path / "else" if place == "given" else None
    if place == "folder":
        file = file.parent
    (record,) = read_deeplabcut(file, images).records
    assert record.sample_id == "labeled-data/zoo/img000.png"
    assert record.image_path is not None
    assert record.image_path.name == "img000.png"


def test_of_a_csv_and_an_h5_of_one_name_the_csv_is_read(tmp_path: Path) -> None:
    made = table([[60]], likelihood=None)
    file = written(tmp_path, made)
    write_fixed(file.with_suffix(".h5"), table([[250]], likelihood=None))
    assert (
        recognised_format(file.parent)
        == recognised_format(file)
        == recognised_format(file.with_suffix(".h5"))
        == "deeplabcut"
    )
    assert same(read_deeplabcut(file.parent), read_deeplabcut(file))
    assert not same(read_deeplabcut(file.parent), read_deeplabcut(file.with_suffix(".h5")))
    write_csv(file.parent / "machine.csv", made)
    with pytest.raises(
        DatasetNotFoundError,
        match=r"found CollectedData_me\.csv, machine\.csv: give the file itself",
    ):
        read_deeplabcut(file.parent)


# Faults
# --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", DLC_FAULTS)
def test_a_fault_is_named_with_sample_field_and_reason_and_spoils_no_other(
    tmp_path: Path, name: str
) -> None:
    fault, file = DLC_FAULTS[name], written(tmp_path, table([[60], [110], [250]]))
    lines = list(csv.reader(file.read_text().splitlines()))
    fault.spoil(lines)
    fault.folder(file.parent)
    with file.open("w", newline="") as out:
        csv.writer(out).writerows(lines)
    if not fault.field:
        with pytest.raises((DatasetFormatError, ConfigError)) as caught:
            read_deeplabcut(file)
        assert fault.reason in str(caught.value)
        return
    found = read_deeplabcut(file)
    (error,) = found.faults
    assert (error.field, len(found.records)) == (fault.field, 2)
    assert fault.reason in error.problem
    assert str(error.sample_id).startswith("labeled-data/zoo/")


def test_what_is_no_h5_of_pandas_is_refused_with_a_remedy(tmp_path: Path) -> None:
    made, remedy = table([[60]]), "give DeepLabCut's csv of the same table instead"
    path = tmp_path / "a.h5"
    path.write_bytes(b"no HDF5 at all")
    with pytest.raises(DatasetFormatError, match=remedy):
        read_deeplabcut(path)
    h5py.File(path, "w").close()
    with pytest.raises(DatasetFormatError, match="must hold one table, it holds 0"):
        read_deeplabcut(path)
    for blocks, missing in ((2, ["block0_values"]), (1, ["axis0_level1"]), (1, ["axis1_label0"])):
        write_fixed(path, made, nblocks=blocks)
        with h5py.File(path, "a") as file:
            for name in missing:
                del file["df_with_missing"][name]
        with pytest.raises(DatasetFormatError, match=remedy):
            read_deeplabcut(path)
    write_fixed(path, made)
    with h5py.File(path, "a") as file:  # PyTables' objects: pickles in an array of bytes
        del file["df_with_missing"]["axis1_level0"]
        file["df_with_missing"].create_dataset("axis1_level0", data=np.zeros(1), dtype=np.float64)
    with pytest.raises(DatasetFormatError, match="holds pickled values"):
        read_deeplabcut(path)


def test_nothing_that_a_tables_pickle_names_is_called(tmp_path: Path) -> None:
    ran = tmp_path / "ran"
    pickle.loads(pickle.dumps(Victim(str(tmp_path / "shown")), 0))
    assert (tmp_path / "shown").exists()
    calls = b"cos\nsystem\n(S'touch " + str(ran).encode() + b"'\ntR."
    for names in (
        pickle.dumps(Victim(str(ran)), 0),
        pickle.dumps([("a", i, "x") for i in range(117)], 0),
        calls,
    ):
        with pytest.raises(DatasetFormatError, match="cannot be read as pandas writes tables"):
            read_deeplabcut(write_appendable(tmp_path / "a.h5", table([[60]]), names))
    assert not ran.exists()


def test_without_h5py_the_error_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = written(tmp_path, table([[60]]), "fixed")
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(
        ConfigError, match=r"pip install 'animal3dbox\[deeplabcut\]', or give DeepLabCut's csv"
    ):
        read_deeplabcut(path)


def test_options_and_folders_that_do_not_fit_are_refused(tmp_path: Path) -> None:
    file = written(tmp_path, table([[60]]))
    with pytest.raises(ConfigError, match="DeepLabCut has none"):
        read_dataset(file, options=ReadOptions(model=Path("smal.pkl")))
    with pytest.raises(DatasetNotFoundError, match="no folder of images"):
        read_deeplabcut(file, tmp_path / "nowhere")
    with pytest.raises(DatasetNotFoundError, match="found none"):
        read_deeplabcut(tmp_path)


def test_label_reads_deeplabcut(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = written(tmp_path, table([[60, 250]], ["tom", "kit"]), "fixed")
    with pytest.raises(SystemExit) as caught:
        main(["label", str(file), "--out", str(tmp_path / "out"), "--json"])
    assert caught.value.code == 0
    assert json.loads(capsys.readouterr().out)["animals"] == 2
    labels = json.loads((tmp_path / "out" / "labels.json").read_text())["animals"]
    assert [(label["sample_id"], label["side"]) for label in labels] == [
        ("labeled-data/zoo/img000.png", "left"), ("labeled-data/zoo/img000.png#1", "right"),
    ]  # fmt: skip
    assert VOCABULARIES["superanimal39"].keypoints == NAMES
