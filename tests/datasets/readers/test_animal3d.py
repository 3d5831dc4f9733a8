"""Animal3D folders, written from the synthetic world and read back, and every way in which a copy
can be off."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from animal3d_copies import TURN, copy_with, in_pytorch3d_frame
from one_label import label_of
from PIL import Image
from torch.testing import assert_close

from animal3dbox.datasets.formats import read_dataset, recognised_format
from animal3dbox.datasets.read_options import ReadOptions
from animal3dbox.datasets.readers.animal3d.reader import Animal3D, read_animal3d
from animal3dbox.datasets.synthetic.animal3d_writer import write_animal3d
from animal3dbox.datasets.synthetic.faults import FaultConfig
from animal3dbox.datasets.synthetic.synthetic_set import SyntheticSet, animal3d_world
from animal3dbox.datasets.synthetic.world.config import WorldConfig
from animal3dbox.errors import ConfigError, DatasetFormatError, DatasetNotFoundError, SampleError
from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.types import CuboidLabel

Entry = dict[str, Any]
KEYS = {
    "img_path": None, "mask_path": None, "rd_mask_path": None, "bbox": (4,), "keypoint_2d": (26, 3),
    "reproj_kp_2d": (26, 3), "joints_2d": (35, 2),
    "keypoint_3d": (26, 3), "joints_3d": (35, 3), "pose": (105,), "shape": (20,),
    "shape_extra": (21,), "trans": (3,), "supercategory": (),
    "category": (), "height": (), "width": (), "with_tail": (),
}  # fmt: skip


@pytest.fixture(scope="module")
def made() -> SyntheticSet:
    config = animal3d_world(
        WorldConfig(image_hw=(120, 160), fill=(0.5, 0.9), occluded=0.2, truncated=0.0)
    )
    return SyntheticSet(6, 5, config, FaultConfig(noise_px=0.5, joint_deg=1.0))


@pytest.fixture(scope="module")
def home(made: SyntheticSet, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the dataset "animals" and its model beside it."""
    home = tmp_path_factory.mktemp("animal3d")
    write_animal3d(made, home / "animals", home / "body.pkl")
    return home


@pytest.fixture(scope="module")
def read(home: Path) -> Animal3D:
    return read_animal3d(home / "animals", home / "body.pkl")


# The way there and back
# -----------------------------------------------------------------------------------------------


def test_a_written_folder_gives_the_same_labels_as_the_world_in_memory(
    made: SyntheticSet, read: Animal3D
) -> None:
    by_split = sorted(
        made.records(stored_pose=True).records, key=lambda r: int(r.image_id.split("-")[1]) % 5 == 4
    )  # train first
    bodies, labelled = made.bodies(), 0
    assert read.bodies is not None
    assert len(by_split) == len(read.records.records) >= 5
    assert read.records.faults == ()
    for ours, theirs in zip(by_split, read.records.records, strict=True):
        assert ours.image_id in theirs.image_id
        outcome, again = (
            label_of(ours, bodies, LabelConfig()),
            label_of(theirs, read.bodies, LabelConfig()),
        )
        if not isinstance(outcome, CuboidLabel) or not isinstance(again, CuboidLabel):
            assert type(outcome) is type(again)
            continue
        labelled += 1
        for field in (
            "corners_3d",
            "center",
            "rotation",
            "size",
            "K",
            "R",
            "t",
            "box",
            "face_area",
            "face_share",
            "surface_share",
        ):
            assert_close(
                getattr(again, field),
                getattr(outcome, field),
                rtol=1e-6,
                atol=1e-6,
                msg=f"{ours.sample_id} {field}",
            )
        assert again.quality.K_source == "dataset"
        assert again.side == outcome.side
    assert labelled >= 4


def test_all_keys_are_there_in_their_shapes_and_the_files_too(home: Path) -> None:
    for split in ("train", "test"):
        content = json.loads((home / "animals" / f"{split}.json").read_text())
        assert content["flength"] == 1000.0
        assert [
            len(content[key]) for key in ("supercategories", "categories", "keypoint_vids")
        ] == [5, 10, 26]
        for entry in content["data"]:
            assert set(entry) == set(KEYS)
            for key, shape in KEYS.items():
                assert shape is None or np.shape(entry[key]) == shape, key
            for key in ("img_path", "mask_path", "rd_mask_path"):
                assert (home / "animals" / entry[key]).is_file()
            assert entry["img_path"].startswith(f"images/{split}/")
            mask = np.asarray(Image.open(home / "animals" / entry["mask_path"]))
            assert set(np.unique(mask).tolist()) == {0, 255}
            x, y, w, h = (int(value) for value in entry["bbox"])
            assert mask[y : y + h, x : x + w].sum() == mask.sum()
            assert all(mask[:, c].any() for c in (x, x + w - 1))
    assert not list((home / "animals").rglob("*.pkl"))


def test_the_truth_stands_beside_it_and_is_not_the_annotation(
    home: Path, made: SyntheticSet
) -> None:
    truth = json.loads((home / "animals" / "truth.json").read_text())
    samples = list(made.samples())
    assert (truth["schema"], truth["version"], truth["seed"], len(truth["animals"])) == (
        "animal3dbox.truth",
        1,
        6,
        len(samples),
    )
    for told, sample in zip(truth["animals"], samples, strict=True):
        assert_close(
            torch.tensor(told["corners_3d"], dtype=torch.float64), sample.animal.cuboid.corners()
        )
        assert told["keypoint_visible"] == sample.animal.keypoint_visible.tolist()
        assert told["face_share_in_image"] == pytest.approx(
            told["face_share_in_image_by_rays"], abs=0.03
        )  # a ray a pixel
        assert told["K"] == sample.animal.K.tolist()
        exact = [point for point in told["keypoints"] if point is not None]
        assert len(exact) == int((sample.animal.keypoints_2d[:, 2] > 0).sum())
    assert truth["faults"]["noise_px"] == 0.5
    assert {told["sample_id"] for told in truth["animals"]} == {
        record.sample_id for record in read_animal3d(home / "animals").records.records
    }


def test_a_model_inside_the_folder_and_cameras_that_cannot_be_told_are_refused(
    made: SyntheticSet, tmp_path: Path
) -> None:
    with pytest.raises(ConfigError, match="must lie beside"):
        write_animal3d(made, tmp_path / "animals", tmp_path / "animals" / "body.pkl")
    (tmp_path / "smal.pkl").write_bytes(b"somebody's own")
    with pytest.raises(ConfigError, match="is there already"):
        write_animal3d(made, tmp_path / "animals", tmp_path / "smal.pkl")
    assert (tmp_path / "smal.pkl").read_bytes() == b"somebody's own"
    assert not (tmp_path / "animals").exists()
    with pytest.raises(ConfigError, match="animal3d_world"):
        write_animal3d(SyntheticSet(0, 1), tmp_path / "animals", tmp_path / "body.pkl")
    with pytest.raises(ConfigError, match="at least one image"):
        SyntheticSet(0, 0)


# What is found out
# --------------------------------------------------------------------------------------------------


def test_the_stored_camera_is_recognised_in_our_frame(read: Animal3D) -> None:
    assert any("x right, y down, z forward" in note for note in read.records.notes)
    pose = read.records.records[0].stored_pose
    assert pose is not None
    assert pose[0].tolist() == np.eye(3).tolist()


def test_the_stored_camera_is_recognised_in_pytorch3ds_frame(
    home: Path, read: Animal3D, tmp_path: Path
) -> None:
    def turned(content: dict[str, Any]) -> None:
        in_pytorch3d_frame(content)
        for entry in content["data"]:
            entry["keypoint_3d"] = (np.array(entry["keypoint_3d"]) * 2).tolist()

    found = read_animal3d(copy_with(home, tmp_path / "turned", turned), home / "body.pkl")
    assert found.bodies is not None
    record, before = found.records.records[0], read.records.records[0]
    assert record.stored_pose is not None
    assert record.stored_pose[0].tolist() == TURN.tolist()
    assert any("x left, y up, z forward" in note for note in found.records.notes)
    assert any("keypoint_3d differs" in note for note in found.records.notes)
    assert not any("keypoint_3d" in note for note in read.records.notes)
    assert read.bodies is not None
    outcome, again = (
        label_of(before, read.bodies, LabelConfig()),
        label_of(record, found.bodies, LabelConfig()),
    )
    assert isinstance(outcome, CuboidLabel)
    assert isinstance(again, CuboidLabel)
    assert_close(
        again.corners_3d, outcome.corners_3d, rtol=1e-3, atol=1e-3
    )  # the same box in the camera frame


def test_a_camera_that_agrees_with_nothing_is_not_used(home: Path, tmp_path: Path) -> None:
    def moved(content: dict[str, Any]) -> None:
        for entry in content["data"]:
            entry["trans"][0] += 5.0

    found = read_animal3d(copy_with(home, tmp_path / "moved", moved), home / "body.pkl")
    assert all(record.stored_pose is None for record in found.records.records)
    (note,) = [
        note
        for note in found.records.notes
        if note.startswith("the pose of the dataset's own camera is not used: in no known frame")
    ]
    assert "its focal length is used" in note
    assert all(
        record.K is not None and record.K[0, 0] == 1000.0 for record in found.records.records
    )

    def without_focal(content: dict[str, Any]) -> None:
        del content["flength"]

    found = read_animal3d(copy_with(home, tmp_path / "unknown", without_focal), home / "body.pkl")
    assert all(record.K is None for record in found.records.records)
    assert any("no focal length" in note for note in found.records.notes)


def test_bodies_fitted_without_their_tail_are_told_of(
    home: Path, read: Animal3D, tmp_path: Path
) -> None:
    found = read_animal3d(
        copy_with(home, tmp_path / "tails", lambda c: c["data"][0].update(with_tail=0)),
        home / "body.pkl",
    )
    count = len(found.records.records)
    assert any(
        note.startswith(f"1 of {count} bodies") and "--tail drop" in note
        for note in found.records.notes
    )
    assert not any("tail" in note for note in read.records.notes)


def test_sets_of_keypoints_alone_are_read_without_bodies(home: Path, tmp_path: Path) -> None:
    def flat(content: dict[str, Any]) -> None:
        for key in list(content):
            if key != "data":
                del content[key]
        for entry in content["data"]:
            for key in (
                "pose",
                "shape",
                "shape_extra",
                "trans",
                "keypoint_3d",
                "joints_3d",
                "rd_mask_path",
                "category",
            ):
                del entry[key]
            entry["keypoint_2d"] = [[x, y, 2 * v] for x, y, v in entry["keypoint_2d"]]

    root = copy_with(home, tmp_path / "flat", flat)
    found = read_animal3d(root, home / "body.pkl")
    assert found.bodies is None
    assert found.records.faults == ()
    assert {record.category for record in found.records.records} == {"animal"}
    assert all(
        set(record.keypoints_2d[:, 2].tolist()) <= {0.0, 1.0} for record in found.records.records
    )
    with pytest.raises(ConfigError, match="has no parameters"):
        read_dataset(root, options=ReadOptions(model=home / "body.pkl"))


def test_masks_may_be_of_0_and_1_and_the_rendered_one_stands_in_for_a_missing_one(
    home: Path, read: Animal3D, tmp_path: Path
) -> None:
    def nothing(content: dict[str, Any]) -> None:
        pass

    root = copy_with(home, tmp_path / "masks", nothing)
    entries = json.loads((root / "train.json").read_text())["data"]
    first, second = root / entries[0]["mask_path"], root / entries[1]["mask_path"]
    Image.fromarray((np.asarray(Image.open(first)) > 0).astype(np.uint8)).save(first)
    second.unlink()
    records = read_animal3d(root).records.records
    assert np.array_equal(records[0].mask, read.records.records[0].mask)  # type: ignore[arg-type]
    rendered = np.asarray(Image.open(root / entries[1]["rd_mask_path"])) > 0
    assert np.array_equal(records[1].mask, rendered)  # type: ignore[arg-type]
    Image.fromarray(np.zeros((120, 160), np.uint8)).save(first)
    with pytest.raises(SampleError, match=r"mask: .* has no pixel above 0"):
        _ = records[0].mask
    Image.fromarray(np.full((12, 16), 255, np.uint8)).save(first)
    with pytest.raises(
        SampleError, match="mask: its pixels are 16 x 12, but the annotations are for 160 x 120"
    ):
        _ = records[0].mask


def test_parameters_that_are_all_wrong_are_told_from_none(home: Path, tmp_path: Path) -> None:
    def short(content: dict[str, Any]) -> None:
        for entry in content["data"]:
            entry["pose"] = entry["pose"][:72]

    root = copy_with(home, tmp_path / "short", short)
    entries = json.loads((root / "train.json").read_text())["data"]
    with pytest.raises(
        ConfigError,
        match=(
            rf"{len(entries)} entries are faulty, the first: .* must have 105 or 99 and 3"
            r" numbers, got 72 and 3"
        ),
    ):
        read_dataset(root, options=ReadOptions(model=home / "body.pkl"))


# Faults
# --------------------------------------------------------------------------------------------------


def spoil(**changes: Any) -> Callable[[Entry], None]:
    return lambda entry: entry.update(changes)


def drop(key: str) -> Callable[[Entry], None]:
    return lambda entry: entry.pop(key)


FAULTS = {
    "img_path": (spoil(img_path="images/none.jpg"), "img_path: there is no file"),
    "outside": (spoil(img_path="../animals/train.json"), "img_path: .* leads out of"),
    "height": (spoil(height=0), "height, width: must be positive"),
    "keypoint_2d": (spoil(keypoint_2d=[[1, 2, 1]] * 25), "keypoint_2d: must be 26 x 3"),
    "visibility": (
        spoil(keypoint_2d=[[1, 2, 0.5]] * 26),
        "keypoint_2d: visibility must be 0, 1 or 2",
    ),
    "pose": (
        spoil(pose=[0.0] * 104),
        "pose, trans: must have 105 or 99 and 3 numbers, got 104 and 3",
    ),
    "shape_extra": (
        spoil(shape=[0.0] * 10),
        "shape_extra: comes after 20 betas, but shape has 10: .*; give all betas in order in shape",
    ),
    "no shape": (spoil(shape=[]), "shape_extra: comes after 20 betas, but shape has 0"),
    "trans": (drop("trans"), "trans: is missing"),
    "shape": (drop("shape"), "shape: is missing"),
    "words": (spoil(trans=["a", "b", "c"]), "Expected `float"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_faulty_entry_is_named_with_its_field_and_spoils_no_other(
    fault: str, home: Path, tmp_path: Path
) -> None:
    change, says = FAULTS[fault]

    def second(content: dict[str, Any]) -> None:
        change(content["data"][1])

    root = copy_with(home, tmp_path / "faulty", second)
    entries = json.loads((root / "train.json").read_text())["data"]
    found = read_animal3d(root).records
    assert len(found.records) == len(entries) - 1
    assert len(found.faults) == 1
    with pytest.raises(SampleError, match=says):
        raise found.faults[0]
    assert found.faults[0].sample_id in (entries[1]["img_path"], entries[1]["img_path"] + "#1")


def test_files_that_are_no_such_dataset_are_refused_as_a_whole(home: Path, tmp_path: Path) -> None:
    with pytest.raises(DatasetNotFoundError, match=r"must hold train\.json or test\.json"):
        read_animal3d(tmp_path)
    for text, says in (
        ('{"data": []}', "empty data list"),
        ("{}", "data"),
        ("[1]", "Expected `object`"),
    ):
        (tmp_path / "train.json").write_text(text)
        with pytest.raises(DatasetFormatError, match=says):
            read_animal3d(tmp_path)
    with pytest.raises(DatasetFormatError, match="keypoint_vids do not belong to the model"):
        read_animal3d(
            copy_with(home, tmp_path / "vids", lambda c: c.update(keypoint_vids=[[10**6]] * 26)),
            home / "body.pkl",
        )


def test_the_format_is_recognised_by_the_folder_or_the_file(home: Path, tmp_path: Path) -> None:
    assert (
        recognised_format(home / "animals")
        == recognised_format(home / "animals" / "test.json")
        == "animal3d"
    )
    (tmp_path / "dogs.json").write_text("[]")
    assert recognised_format(tmp_path / "dogs.json") == "stanfordextra"
    with pytest.raises(DatasetFormatError, match=r"holds dogs\.json"):
        recognised_format(tmp_path)  # whose name tells nothing
    (tmp_path / "StanfordExtra_v12.json").write_text("[]")
    assert recognised_format(tmp_path) == "stanfordextra"
    (tmp_path / "other.json").write_text('{"images": []}')
    with pytest.raises(DatasetFormatError, match="it has images; give the path of a dataset"):
        recognised_format(tmp_path / "other.json")
    with pytest.raises(DatasetNotFoundError):
        recognised_format(tmp_path / "nothing.json")
    with pytest.raises(ConfigError, match="format must be"):
        read_dataset(home / "animals", "unheard_of")
    with pytest.raises(ConfigError, match="give it as --body"):
        read_dataset(tmp_path / "dogs.json", options=ReadOptions(model=home / "body.pkl"))
