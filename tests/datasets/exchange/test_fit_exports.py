"""Fits of a user's SMAL model in Animal3D's keys, and the quadruped's in a file of their own."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands import ran
from PIL import Image
from smal_stand_in import LANDMARKS, converted_stand_in, stand_in

from animal3dbox import CuboidLabel, LabelConfig, label_many
from animal3dbox.datasets.exchange.animal3d_writer import write_animal3d_fits
from animal3dbox.datasets.exchange.fitted_animals import FittedAnimal
from animal3dbox.datasets.exchange.quadruped_file import read_quadruped, write_quadruped
from animal3dbox.datasets.labelling.scale import in_metres
from animal3dbox.datasets.readers.animal3d.reader import read_animal3d
from animal3dbox.datasets.synthetic.scenes import SyntheticAnimal, synthetic_animal
from animal3dbox.errors import ConfigError, DatasetFormatError
from animal3dbox.labels.fit_parameters import fitted_vertices
from animal3dbox.report.label_files import LabelFile, animal_row, write_labels_json
from animal3dbox.report.label_fits import read_label_fits
from animal3dbox.smal.files.pickle_writer import write_smal_pickle
from animal3dbox.smal.files.safetensors_file import save_safetensors
from animal3dbox.smal.model import SmalModel
from animal3dbox.smal.parameters import posed_body

CONFIG = LabelConfig(surface_share=False, mask_iou=False)


def animals() -> list[SyntheticAnimal]:
    return [synthetic_animal(seed=0, index=index) for index in (2, 4)]


def labels_in_memory(model: SmalModel | None) -> list[CuboidLabel]:
    """Labels of fits of a model, without a scale; the second one's focal length is free."""
    outcomes = label_many(
        [
            {
                "image_hw": animal.image_hw,
                "keypoints_2d": animal.keypoints_2d,
                "K": animal.K if i == 0 else None,
                "template": model,
                "sample_id": f"{i}.jpg",
                "body": "fit",
            }
            for i, animal in enumerate(animals())
        ],
        CONFIG,
    )
    return [one for one in outcomes if isinstance(one, CuboidLabel)]


def labels_of(folder: Path, model: SmalModel | None) -> list[CuboidLabel]:
    """A folder as ``label`` writes it, of fits of a model; the second label is metric."""
    folder.mkdir()
    labels = labels_in_memory(model)
    labels[1] = in_metres(labels[1], 0.7, "user")
    rows = [
        animal_row(label, image=f"{i}.jpg", animal=0, category="dog")
        for i, label in enumerate(labels)
    ]
    for i, animal in enumerate(animals()):
        Image.fromarray(animal.image.numpy()).save(folder / f"{i}.jpg")
    write_labels_json(
        folder / "labels.json", LabelFile(body="fit", config={}, animals=rows, rejected=[])
    )
    return labels


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Labels of fits of the stand-in and of the quadruped, and the stand-in's files."""
    folder = tmp_path_factory.mktemp("fits")
    labels_of(folder / "model", converted_stand_in())
    labels_of(folder / "ours", None)
    save_safetensors(converted_stand_in(), folder / "smal.safetensors")
    write_smal_pickle(stand_in(), folder / "smal.pkl")
    return folder


def fits_of(folder: Path) -> tuple[FittedAnimal, ...]:
    animals, faults, without = read_label_fits(folder)
    assert (len(animals), faults, without) == (2, (), 0)
    return animals


def test_our_reader_poses_an_export_where_the_fit_is(home: Path, tmp_path: Path) -> None:
    code, printed = ran(
        "export", home / "model", "--to", "animal3d", "--model", home / "smal.safetensors",
        "--out", tmp_path / "train.json",
    )  # fmt: skip
    assert code == 0, printed
    assert "another camera" in printed
    read = read_animal3d(tmp_path / "train.json", home / "smal.safetensors", home / "model")
    assert read.records.faults == ()
    assert read.bodies is not None
    model = read.bodies.model
    for fit, record in zip(fits_of(home / "model"), read.records.records, strict=True):
        assert record.stored_pose is not None
        R, t = record.stored_pose
        vertices = posed_body(model, read.bodies.parameters[record.sample_id]).vertices[0].numpy()
        assert np.abs(vertices @ R.T + t - fit.vertices_cam(model)).max() < 1e-6
        assert record.K is not None
        assert np.abs(record.K - fit.K).max() < 1e-6
        seen = fit.keypoints_2d[:, 2] > 0
        assert np.array_equal(record.keypoints_2d[seen, :2], fit.keypoints_2d[seen, :2])


def test_a_pickle_without_landmarks_gets_those_of_the_export(home: Path, tmp_path: Path) -> None:
    write_animal3d_fits(fits_of(home / "model"), tmp_path / "train.json", converted_stand_in())
    read = read_animal3d(tmp_path / "train.json", home / "smal.pkl", home / "model")
    assert read.bodies is not None
    nose = read.bodies.model.landmarks["nose"]
    assert nose == tuple(LANDMARKS["nose"])


def test_keys_are_animal3ds(home: Path, tmp_path: Path) -> None:
    write_animal3d_fits(fits_of(home / "model"), tmp_path / "train.json", converted_stand_in())
    content = json.loads((tmp_path / "train.json").read_text())
    entry: dict[str, Any] = content["data"][0]
    sizes = {name: len(entry[name]) for name in ("pose", "shape", "shape_extra", "trans")}
    assert sizes == {"pose": 105, "shape": 20, "shape_extra": 21, "trans": 3}
    assert (len(entry["keypoint_2d"]), len(entry["bbox"])) == (26, 4)
    assert content["categories"][entry["category"]]["name"] == "dog"


def test_keypoints_of_another_vocabulary_stand_where_animal3d_has_the_same_place(
    home: Path, tmp_path: Path
) -> None:
    fit = fits_of(home / "model")[0]
    marks = np.arange(51.0).reshape(17, 3) + 1.0
    other = replace(
        fit, parameters=replace(fit.parameters, vocabulary="ap10k17"), keypoints_2d=marks
    )
    write_animal3d_fits([other], tmp_path / "train.json", converted_stand_in())
    (entry,) = json.loads((tmp_path / "train.json").read_text())["data"]
    assert entry["keypoint_2d"][0] == [1.0, 2.0, 1.0]  # left_eye is the first of both
    assert entry["keypoint_2d"][24] == [7.0, 8.0, 1.0]  # the nose AP-10K's third
    assert entry["keypoint_2d"][12] == [0.0, 0.0, 0.0]  # whose shoulder is another place
    own = replace(other, parameters=replace(fit.parameters, vocabulary="mine"))
    summary = write_animal3d_fits([fit, own], tmp_path / "two.json", converted_stand_in())
    assert [fault.field for fault in summary.faults] == ["vocabulary"]


def test_fits_of_the_quadruped_are_refused_as_animal3d_and_read_back_as_themselves(
    home: Path, tmp_path: Path
) -> None:
    for model in ((), ("--model", home / "smal.safetensors")):
        code, printed = ran(
            "export", home / "ours", "--to", "animal3d", *model, "--out", tmp_path / "a.json"
        )
        assert code == 2
        assert "0.jpg is a fit of the embedded quadruped" in printed
        assert "--to quadruped" in printed
    code, printed = ran("export", home / "ours", "--to", "quadruped", "--out", tmp_path / "out")
    assert code == 0, printed
    content = json.loads((tmp_path / "out" / "fits.json").read_text())
    assert content["body"] == "quadruped"
    back = read_quadruped(tmp_path / "out" / "fits.json")
    for read, fit in zip(back, fits_of(home / "ours"), strict=True):
        assert read.parameters.digest == content["digest"]
        assert np.array_equal(read.vertices_cam(), fit.vertices_cam())
        assert (read.sample_id, read.image_hw, read.category) == (
            fit.sample_id,
            fit.image_hw,
            "dog",
        )
        assert np.array_equal(read.K, fit.K)


def test_lengths_are_the_bodys_own_whatever_the_labels_scale(home: Path) -> None:
    (_, metric), (_, label) = fits_of(home / "ours"), labels_in_memory(None)
    assert label.fit is not None
    vertices = fitted_vertices(label.fit) @ label.R.numpy().T + label.t.numpy()
    assert np.abs(metric.vertices_cam() - vertices).max() < 1e-6


def test_what_cannot_be_is_refused_with_the_remedy(home: Path, tmp_path: Path) -> None:
    for arguments, words in (
        (("model", "animal3d"), "needs --model"),
        (("model", "quadruped"), "export --to animal3d --model"),
        (("ours", "quadruped", "--scale-free"), "--scale-free is for cuboids"),
        (("ours", "quadruped", "--model", home / "smal.pkl"), "need none"),
        (("ours", "coco", "--model", home / "smal.pkl"), "--model is for --to animal3d"),
        (("smal.pkl", "quadruped"), "writes the fits of labels"),
    ):
        folder, to, *others = arguments
        code, printed = ran(
            "export", home / str(folder), "--to", str(to), *others, "--out", tmp_path / "x.json"
        )
        assert code == 2, printed
        assert words in printed
    moved = replace(stand_in(), v_template=stand_in().v_template + 1e-3)
    with pytest.raises(ConfigError, match="the file that it was fitted with"):
        write_animal3d_fits(fits_of(home / "model"), tmp_path / "x.json", moved)
    assert list(tmp_path.iterdir()) == []


def test_a_quadruped_file_of_another_body_or_form_is_refused(home: Path, tmp_path: Path) -> None:
    path = tmp_path / "fits.json"
    write_quadruped(fits_of(home / "ours"), path)
    content = json.loads(path.read_text())
    for change, error, words in (
        ({"digest": "0" * 32}, ConfigError, "fit the animal again"),
        ({"schema": "other"}, DatasetFormatError, "schema"),
        ({"animals": [{**content["animals"][0], "betas": [1.0]}]}, DatasetFormatError, "betas"),
        (
            {"animals": [{**content["animals"][0], "R": [[2, 0, 0], [0, 2, 0], [0, 0, 2]]}]},
            DatasetFormatError,
            "R must hold",
        ),
        (
            {"animals": [{**content["animals"][0], "K": [[0, 0, 0]] * 3}]},
            DatasetFormatError,
            "K must",
        ),
        ({"joint_names": content["joint_names"][::-1]}, DatasetFormatError, "joint_names"),
    ):
        path.write_text(json.dumps({**content, **change}))
        with pytest.raises(error, match=words):
            read_quadruped(path)


def test_a_camera_of_an_entry_that_is_none_is_a_fault(home: Path, tmp_path: Path) -> None:
    write_animal3d_fits(fits_of(home / "model"), tmp_path / "train.json", converted_stand_in())
    content = json.loads((tmp_path / "train.json").read_text())
    content["data"][0]["K"] = [[1.0, 0.0], [0.0, 1.0]]
    (tmp_path / "train.json").write_text(json.dumps(content))
    (fault,) = read_animal3d(tmp_path / "train.json", None, home / "model").records.faults
    assert (fault.sample_id, fault.field) == ("0.jpg", "K")
