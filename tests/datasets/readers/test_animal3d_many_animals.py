"""Entries of several animals, as SMAL+'s files have them: one an image, a row an animal."""

import json
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from animal3d_copies import Content, copy_with

from animal3dbox.datasets.format_datasets import AnnotatedDataset
from animal3dbox.datasets.formats import ReadDataset, read_dataset, recognised_format
from animal3dbox.datasets.inspection.inspect import inspect_dataset
from animal3dbox.datasets.labelling.skipped import Skipped
from animal3dbox.datasets.read_options import ReadOptions
from animal3dbox.datasets.readers.animal3d.many_animals import ASSUMED_FOCAL, animals_of_entry
from animal3dbox.datasets.synthetic.animal3d_writer import write_animal3d
from animal3dbox.datasets.synthetic.faults import FaultConfig
from animal3dbox.datasets.synthetic.synthetic_set import SyntheticSet, animal3d_world
from animal3dbox.datasets.synthetic.world.config import WorldConfig
from animal3dbox.errors import ConfigError, DatasetFormatError, SampleError
from animal3dbox.labels.config import LabelConfig

QUICK = LabelConfig(surface_share=False, mask_iou=False)
FILE = "train_multi_animal.json"
BETAS = 145


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the dataset "animals", of single animals, and its model beside it."""
    home = tmp_path_factory.mktemp("many")
    config = animal3d_world(
        WorldConfig(image_hw=(120, 160), fill=(0.5, 0.9), occluded=0.0, truncated=0.0)
    )
    faults = FaultConfig(noise_px=0.3)
    write_animal3d(SyntheticSet(9, 3, config, faults), home / "animals", home / "body.pkl")
    return home


def row_of(entry: dict[str, Any]) -> dict[str, Any]:
    """The rows of one animal, in SMAL+'s widths."""
    betas = [*entry["shape"], *entry["shape_extra"]]
    return {
        "bbox": entry["bbox"],
        "keypoint_2d": entry["keypoint_2d"],
        "keypoint_3d": [[*row, 1.0] for row in entry["keypoint_3d"]],
        "pose": entry["pose"],
        "shape": betas + [0.0] * (BETAS - len(betas)),
        "trans": entry["trans"],
    }


def beside(rows: list[list[float]], px: float) -> list[list[float]]:
    """Keypoints so much to the right that they are another animal's."""
    return [[x + px * bool(v), y, v] for x, y, v in rows]


def zeros_like(row: Any) -> Any:
    return [zeros_like(part) for part in row] if isinstance(row, list) else 0.0


def as_many(counts: tuple[int, ...]) -> Callable[[Content], None]:
    """Write each entry as of so many animals, which stand in the same place."""

    def change(content: Content) -> None:
        content["data"] = [
            {
                "img_path": entry["img_path"],
                "mask_path": entry["mask_path"],
                "category": entry["category"],
                "num_animals": count,
                **{key: [row] * count for key, row in row_of(entry).items()},
                "keypoint_2d": [beside(entry["keypoint_2d"], 1.2 * k) for k in range(count)],
            }
            for entry, count in zip(content["data"], counts, strict=False)
        ]

    return change


def many(
    home: Path,
    folder: Path,
    counts: tuple[int, ...] = (2, 1),
    change: Callable[[Content], object] = lambda content: None,
) -> Path:
    """The file of some images with several animals."""

    def both(content: Content) -> None:
        as_many(counts)(content)
        change(content)

    folder.mkdir(exist_ok=True)
    root = copy_with(home, folder / "set", both)
    (root / "train.json").rename(root / FILE)
    return root / FILE


def read(path: Path, home: Path | None = None, **options: Any) -> ReadDataset:
    model = None if home is None else home / "body.pkl"
    return read_dataset(path, options=ReadOptions(model=model, **options))


def test_each_animal_is_labelled_as_if_it_had_an_entry_of_its_own(
    home: Path, tmp_path: Path
) -> None:
    path = many(home, tmp_path)
    assert recognised_format(path) == recognised_format(path.parent) == "animal3d"
    options: dict[str, Any] = {"model": home / "body.pkl", "stored_cameras": "exact"}
    dataset = AnnotatedDataset(path.parent, config=QUICK, **options)
    single = AnnotatedDataset(home / "animals" / "train.json", config=QUICK, **options)
    assert len(dataset) == 2
    for place, count in ((0, 2), (1, 1)):
        found, alone = dataset[place], single[place]
        assert not isinstance(found, Skipped)
        assert not isinstance(alone, Skipped)
        assert found[1]["image_id"] == alone[1]["image_id"]
        name = alone[1]["image_id"]
        assert found[1]["meta"]["sample_ids"] == [name, f"{name}#1"][:count]
        for corners in found[1]["corners_3d"]:
            assert np.abs((corners - alone[1]["corners_3d"][0]).numpy()).max() < 1e-5


def test_a_mask_of_several_animals_is_nobodys(home: Path, tmp_path: Path) -> None:
    found = read(many(home, tmp_path)).records
    assert [record.mask_path is not None for record in found.records] == [False, False, True]
    note = next(note for note in found.notes if "mask of several animals" in note)
    assert note.startswith("1 images have one mask")
    assert found.records[0].image_id in note


@pytest.mark.parametrize("path", ["", None])
def test_no_name_is_no_mask(home: Path, tmp_path: Path, path: str | None) -> None:
    def change(content: Content) -> None:
        for entry in content["data"]:
            entry["mask_path"] = path

    found = read(many(home, tmp_path, change=change)).records
    assert found.faults == ()
    assert [record.mask_path for record in found.records] == [None] * 3
    assert not any("mask of several" in note for note in found.notes)


def test_masks_of_their_own_stay_with_their_animals(home: Path, tmp_path: Path) -> None:
    def change(content: Content) -> None:
        entry = content["data"][0]
        entry["mask_path"] = ["", entry["mask_path"]]

    found = read(many(home, tmp_path, change=change)).records.records
    assert [record.mask_path is not None for record in found] == [False, True, True]


def test_a_row_of_zeros_stands_for_no_parameters(home: Path, tmp_path: Path) -> None:
    def change(content: Content) -> None:
        entry = content["data"][0]
        for key in ("pose", "shape", "trans", "bbox"):
            entry[key] = [entry[key][0], zeros_like(entry[key][1])]

    path = many(home, tmp_path, change=change)
    found = read(path, home)
    first, second, third = found.records.records
    assert found.bodies is not None
    assert found.bodies.body(first).vertices.shape == found.bodies.body(third).vertices.shape
    with pytest.raises(SampleError, match="zeros, which stand for none: fit a body"):
        found.bodies.body(second)
    assert first.stored_pose is not None
    assert second.stored_pose is None
    assert first.box is not None
    assert second.box is None
    assert any("of 1 animals is all zero" in note for note in found.records.notes)


def second_without_parameters(content: Content) -> None:
    entry = content["data"][0]
    for key in ("pose", "shape", "trans"):
        entry[key] = [entry[key][0], zeros_like(entry[key][1])]


def test_an_animal_without_parameters_gets_a_fit_of_the_same_model(
    home: Path, tmp_path: Path
) -> None:
    path = many(home, tmp_path, change=second_without_parameters)
    dataset = AnnotatedDataset(
        path, model=home / "body.pkl", config=QUICK, cache=tmp_path / "cache"
    )
    sample = dataset[0]
    assert not isinstance(sample, Skipped)
    qualities = sample[1]["meta"]["quality"]
    assert [quality["body"] for quality in qualities] == ["given", "fit"]
    whole = dataset[1]
    assert not isinstance(whole, Skipped)
    assert [quality["body"] for quality in whole[1]["meta"]["quality"]] == ["given"]
    # The same animal twice: what the fit finds is near what the file has.
    own, fitted = sample[1]["center"]
    assert float((own - fitted).norm()) < 0.1 * float(own.norm())
    again = pickle.loads(pickle.dumps(dataset))[0]
    assert again[1]["meta"]["quality"][1]["body"] == "fit"
    image = dataset.source.sample(0)
    assert image.bodies is not None
    assert image.bodies.name.endswith("1 others fitted")
    contents = {image.bodies.content(one.sample_id) for one in image.animals}
    assert len(contents) == 2


def test_an_animal_of_unknown_camera_gets_none_beside_bodies_of_their_own(
    home: Path, tmp_path: Path
) -> None:
    def change(content: Content) -> None:
        second_without_parameters(content)
        del content["flength"]

    path = many(home, tmp_path, change=change)
    dataset = AnnotatedDataset(path, model=home / "body.pkl", config=QUICK, on_bad="skip")
    for place in range(len(dataset)):
        dataset[place]
    (case,) = dataset.report().of("fault")
    assert case.sample_id.endswith("#1")
    assert case.field == "parameters"
    assert "fit a body to it" in case.problem


@pytest.mark.parametrize(
    "key", ["bbox", "keypoint_2d", "keypoint_3d", "pose", "shape", "trans", "mask_path"]
)
def test_a_list_of_another_length_is_a_fault_that_spoils_no_other_image(
    home: Path, tmp_path: Path, key: str
) -> None:
    def change(content: Content) -> None:
        entry = content["data"][0]
        entry[key] = [row_of_many(entry[key])] * 3

    def row_of_many(value: Any) -> Any:
        return value if isinstance(value, str) else value[0]

    found = read(many(home, tmp_path, change=change)).records
    (fault,) = found.faults
    name = json.loads((tmp_path / "set" / FILE).read_text())["data"][0]["img_path"]
    assert (fault.sample_id, fault.field) == (name, key)
    assert "for each of 2 animals (num_animals), got 3" in fault.problem
    assert len(found.records) == 1


@pytest.mark.parametrize("count", [-1, 2.5, "two", True, None])
def test_a_number_of_animals_that_is_none_is_a_fault(
    home: Path, tmp_path: Path, count: object
) -> None:
    def change(content: Content) -> None:
        content["data"][0]["num_animals"] = count

    found = read(many(home, tmp_path, change=change)).records
    assert [fault.field for fault in found.faults] == ["num_animals"]
    assert len(found.records) == 1


def test_one_bad_row_costs_its_animal_only(home: Path, tmp_path: Path) -> None:
    def change(content: Content) -> None:
        entry = content["data"][0]
        entry["keypoint_2d"] = [entry["keypoint_2d"][0], entry["keypoint_2d"][1][:25]]

    found = read(many(home, tmp_path, change=change)).records
    (fault,) = found.faults
    assert fault.field == "keypoint_2d"
    assert str(fault.sample_id).endswith(".jpg#1")
    assert "must be 26 x 3" in fault.problem
    assert len(found.records) == 2


def test_an_image_without_animals_is_counted(home: Path, tmp_path: Path) -> None:
    found = read(many(home, tmp_path, (1, 0))).records
    assert (len(found.records), found.faults) == (1, ())
    assert any("1 entries say that no animal is in their image" in note for note in found.notes)


def test_keypoints_of_two_numbers_are_read(home: Path, tmp_path: Path) -> None:
    def change(content: Content) -> None:
        for entry in content["data"]:
            entry["keypoint_2d"] = [
                [[x, y] if v else [0.0, 0.0] for x, y, v in rows] for rows in entry["keypoint_2d"]
            ]

    found = read(many(home, tmp_path / "two", change=change)).records
    plain = read(many(home, tmp_path / "three")).records
    assert found.faults == ()
    for one, other in zip(found.records, plain.records, strict=True):
        assert np.array_equal(one.keypoints_2d, other.keypoints_2d)


def test_an_entry_twice_is_a_fault(home: Path, tmp_path: Path) -> None:
    def change(content: Content) -> None:
        content["data"].append(content["data"][0])

    found = read(many(home, tmp_path, change=change)).records
    assert len(found.records) == 3
    assert len(found.faults) == 2
    assert all("once more" in fault.problem for fault in found.faults)


# The focal length
# --------------------------------------------------------------------------------------------------


def far_camera(noise_px: float) -> Callable[[Content], None]:
    """Without flength: keypoints as a camera of 5000 px sees the stored landmarks, nearly."""

    def change(content: Content) -> None:
        del content["flength"]
        for entry in content["data"]:
            for k in range(entry["num_animals"]):
                x, y, z = entry["trans"][k]
                entry["trans"] = [*entry["trans"]]
                entry["trans"][k] = [x, y, 5 * z]
                points = np.array(entry["keypoint_3d"][k])[:, :3] + entry["trans"][k]
                px = ASSUMED_FOCAL * points[:, :2] / points[:, 2:] + [80 + noise_px, 60 + 1.2 * k]
                rows = np.concatenate((px, np.ones((26, 1))), axis=1)
                entry["keypoint_2d"] = [*entry["keypoint_2d"]]
                entry["keypoint_2d"][k] = rows.tolist()

    return change


def test_the_files_own_focal_length_comes_first(home: Path, tmp_path: Path) -> None:
    for options in ({}, {"focal_px": 700.0}):
        found = read(many(home, tmp_path / str(len(options))), home, **options).records.records
        assert [record.K[0, 0] for record in found if record.K is not None] == [1000.0] * 3


def test_without_one_5000_px_are_believed_where_the_landmarks_fit(
    home: Path, tmp_path: Path
) -> None:
    path = many(home, tmp_path, change=far_camera(noise_px=4.0))
    found = read(path, home).records
    for record in found.records:
        assert record.K is not None
        assert record.K.tolist() == [[5000, 0, 80], [0, 5000, 60], [0, 0, 1]]
        assert record.K_source == "dataset"
        assert record.stored_pose is not None
    assert any("2 images have no focal length, and 5000 px is taken" in n for n in found.notes)
    users = read(path, home, focal_px=700.0).records
    assert [one.K[0, 0] for one in users.records if one.K is not None] == [700.0] * 3
    assert not any("is taken" in note for note in users.notes)
    assert any("and 700 px is given for it; with 5000 px their" in note for note in users.notes)


def test_landmarks_that_do_not_fit_leave_the_focal_length_unknown(
    home: Path, tmp_path: Path
) -> None:
    path = many(home, tmp_path, change=far_camera(noise_px=6.0))
    found = read(path, home).records
    assert [record.K for record in found.records] == [None] * 3
    assert [record.stored_pose for record in found.records] == [None] * 3
    assert any("2 images have no focal length, and 5000 px does not fit" in n for n in found.notes)
    users = read(path, home, focal_px=700.0).records
    assert [one.K[0, 0] for one in users.records if one.K is not None] == [700.0] * 3
    assert not any("5000 px" in note for note in users.notes)


def test_one_animal_that_does_not_fit_keeps_its_image_on_one_camera(
    home: Path, tmp_path: Path
) -> None:
    def change(content: Content) -> None:
        far_camera(noise_px=0.0)(content)
        entry = content["data"][0]
        entry["trans"][1] = [0.0, 0.0, 3.0]

    found = read(many(home, tmp_path, change=change), home).records.records
    cameras = {record.image_id: {str(record.K)} for record in found}
    for record in found:
        cameras[record.image_id].add(str(record.K))
    assert all(len(of_image) == 1 for of_image in cameras.values())
    assert [record.K is None for record in found] == [True, True, False]
    assert [record.stored_pose is None for record in found] == [True, True, False]


# 145 betas
# --------------------------------------------------------------------------------------------------


def with_further(value: float) -> Callable[[Content], None]:
    def change(content: Content) -> None:
        rows = content["data"][0]["shape"]
        content["data"][0]["shape"] = [rows[0], [*rows[1][:-1], value]]

    return change


def test_further_betas_of_zero_are_left_out_with_a_note(home: Path, tmp_path: Path) -> None:
    found = read(many(home, tmp_path), home)
    note = next(note for note in found.records.notes if "more betas than the model's 41" in note)
    assert note.startswith("3 animals")
    assert "all further ones 0" in note


def test_further_betas_are_left_out_where_the_landmarks_say_that_the_body_is_the_same(
    home: Path, tmp_path: Path
) -> None:
    found = read(many(home, tmp_path, change=with_further(0.5)), home)
    assert found.records.faults == ()
    assert any("1 animals have more betas" in note for note in found.records.notes)
    first, second, _ = found.records.records
    assert found.bodies is not None
    assert np.array_equal(found.bodies.body(first).vertices, found.bodies.body(second).vertices)


@pytest.mark.parametrize("landmarks", ["others", "none"])
def test_betas_of_another_space_of_shapes_are_a_fault(
    home: Path, tmp_path: Path, landmarks: str
) -> None:
    def change(content: Content) -> None:
        with_further(0.5)(content)
        entry = content["data"][0]
        if landmarks == "none":
            del entry["keypoint_3d"]
        else:
            rows = entry["keypoint_3d"]
            wide = [[1.1 * x, y, z, v] for x, y, z, v in rows[1]]
            entry["keypoint_3d"] = [rows[0], wide]

    path = many(home, tmp_path, change=change)
    found = read(path, home).records
    (fault,) = found.faults
    assert fault.field == "shape"
    assert str(fault.sample_id).endswith(".jpg#1")
    assert "has 145 betas, but --model 41" in fault.problem
    assert "leave --model out" in fault.problem
    assert len(found.records) == 2
    assert len(read(path).records.records) == 3  # without a model they are 2D


def test_a_file_whose_betas_no_model_here_has_says_so(home: Path, tmp_path: Path) -> None:
    def change(content: Content) -> None:
        for entry in content["data"]:
            del entry["keypoint_3d"]
            entry["shape"] = [[*row[:-1], 0.5] for row in entry["shape"]]

    with pytest.raises(ConfigError, match="has 145 betas, but --model 41"):
        read(many(home, tmp_path, change=change), home)


# Around it
# --------------------------------------------------------------------------------------------------


def test_inspect_counts_the_animals(home: Path, tmp_path: Path) -> None:
    path = many(home, tmp_path)
    facts = inspect_dataset(path, options=ReadOptions(model=home / "body.pkl"))
    assert (facts.animals, facts.images, facts.largest_group) == (3, 2, 2)
    assert facts.animal3d is not None
    assert facts.animal3d.keys["pose"] == 3


@pytest.mark.parametrize("counts", [(2, 1), (1, 1)])
def test_a_number_that_is_too_large_spoils_its_entry_alone(
    home: Path, tmp_path: Path, counts: tuple[int, ...]
) -> None:
    def change(content: Content) -> None:
        content["data"][0]["keypoint_2d"][0][3][0] = "TOO LARGE"

    path = many(home, tmp_path, counts, change)
    path.write_text(path.read_text().replace('"TOO LARGE"', "1e999"))
    found = read(path, home).records
    (fault,) = found.faults
    assert "Number out of range" in fault.problem
    assert "correct it in the file" in fault.problem
    (record,) = found.records
    assert record.image_id != fault.sample_id
    assert inspect_dataset(path, options=ReadOptions(model=home / "body.pkl")).animals == 1


def test_an_own_key_of_that_name_deep_inside_changes_nothing(home: Path, tmp_path: Path) -> None:
    def change(content: Content) -> None:
        for entry in content["data"]:
            entry["info"] = {"num_animals": 7}

    root = copy_with(home, tmp_path / "set", change)
    assert len(read(root).records.records) == len(
        read(home / "animals" / "train.json").records.records
    )


def test_an_empty_file_is_refused(home: Path, tmp_path: Path) -> None:
    with pytest.raises(DatasetFormatError, match="empty data list"):
        read(many(home, tmp_path, ()))


def test_categories_may_be_one_an_animal() -> None:
    entry = {"img_path": "a.jpg", "num_animals": 2, "category": [3, 4], "with_tail": 0}
    animals = animals_of_entry(entry, "a.jpg")
    assert [animal["category"] for animal in animals] == [3, 4]
    assert [animal["with_tail"] for animal in animals] == [0, 0]
