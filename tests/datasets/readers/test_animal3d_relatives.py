"""Relatives of Animal3D in its layout.

2D-only sets, and sets such as CtrlAni3D that have only the keys their loader reads.
"""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from animal3d_copies import Content, copy_with
from one_label import label_of
from torch.testing import assert_close

from animal3dbox.datasets.bodies.sources import preset_body
from animal3dbox.datasets.formats import recognised_format
from animal3dbox.datasets.inspection.inspect import inspect_dataset
from animal3dbox.datasets.readers.animal3d.reader import Animal3D, read_animal3d
from animal3dbox.datasets.synthetic.animal3d_writer import write_animal3d
from animal3dbox.datasets.synthetic.faults import FaultConfig
from animal3dbox.datasets.synthetic.synthetic_set import SyntheticSet, animal3d_world
from animal3dbox.datasets.synthetic.world.config import WorldConfig
from animal3dbox.errors import ConfigError
from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.types import CuboidLabel

LOADED = (
    "img_path",
    "mask_path",
    "supercategory",
    "keypoint_2d",
    "keypoint_3d",
    "bbox",
    "pose",
    "shape",
    "shape_extra",
    "trans",
)
"""All that AniMer's loader of Animal3D and CtrlAni3D asks of an entry; "bone" may be there."""
BODY = (
    "pose",
    "shape",
    "shape_extra",
    "trans",
    "keypoint_3d",
    "joints_3d",
    "joints_2d",
    "reproj_kp_2d",
    "rd_mask_path",
    "with_tail",
)


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the dataset "animals" and its model beside it."""
    home = tmp_path_factory.mktemp("animal3d")
    config = animal3d_world(
        WorldConfig(image_hw=(120, 160), fill=(0.5, 0.9), occluded=0.0, truncated=0.0)
    )
    write_animal3d(
        SyntheticSet(7, 4, config, FaultConfig(noise_px=0.3)), home / "animals", home / "body.pkl"
    )
    return home


@pytest.fixture(scope="module")
def whole(home: Path) -> Animal3D:
    """As Animal3D itself."""
    return read_animal3d(home / "animals" / "train.json", home / "body.pkl")


def only(*keys: str, top: tuple[str, ...] = ("data", "keypoint_vids")) -> Callable[[Content], None]:
    """Leave out all other keys of entries and files."""

    def change(content: Content) -> None:
        content["data"] = [
            {key: value for key, value in entry.items() if key in keys} for entry in content["data"]
        ]
        for key in set(content) - set(top):
            del content[key]

    return change


def without(*keys: str) -> Callable[[Content], None]:
    """Leave keys of entries out."""

    def change(content: Content) -> None:
        for entry in content["data"]:
            for key in keys:
                entry.pop(key, None)

    return change


def test_a_set_with_only_what_its_loader_reads_gives_the_same_boxes(
    home: Path, whole: Animal3D, tmp_path: Path
) -> None:
    root = copy_with(
        home, tmp_path / "ctrl", only(*LOADED, top=("data", "keypoint_vids", "flength"))
    )
    assert recognised_format(root) == "animal3d"
    found = read_animal3d(root, home / "body.pkl")
    assert found.records.faults == ()
    assert [record.category for record in found.records.records] == ["animal"] * len(
        whole.records.records
    )
    assert found.bodies is not None
    assert whole.bodies is not None
    for here, there in zip(found.records.records[:3], whole.records.records, strict=False):
        assert here.image_hw == there.image_hw  # not in the file, but the image's
        a, b = (
            label_of(here, found.bodies, LabelConfig()),
            label_of(there, whole.bodies, LabelConfig()),
        )
        assert isinstance(a, CuboidLabel)
        assert isinstance(b, CuboidLabel)
        assert_close(a.corners_3d, b.corners_3d)


def test_without_a_focal_length_it_is_guessed_and_the_stored_camera_left_alone(
    home: Path, tmp_path: Path
) -> None:
    found = read_animal3d(copy_with(home, tmp_path / "ctrl", only(*LOADED)), home / "body.pkl")
    assert found.records.faults == ()
    assert all(record.K is None and record.stored_pose is None for record in found.records.records)
    assert "there is no focal length to project by" in found.records.notes[-1]
    facts = inspect_dataset(tmp_path / "ctrl").animal3d
    assert facts is not None
    assert facts.flength is None
    assert facts.cameras[0].focal_px == pytest.approx(
        1000, rel=0.02
    )  # what a user would want to know


def test_a_model_of_other_vertices_needs_the_files_landmarks(home: Path, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="the dataset no keypoint_vids"):
        read_animal3d(
            copy_with(home, tmp_path / "ctrl", only(*LOADED, top=("data",))), home / "body.pkl"
        )


def test_betas_may_be_whole_and_few(home: Path, whole: Animal3D, tmp_path: Path) -> None:
    def joined(content: Content) -> None:
        for entry in content["data"]:
            entry["shape"] += entry.pop("shape_extra")

    found = read_animal3d(copy_with(home, tmp_path / "joined", joined), home / "body.pkl")
    few = read_animal3d(
        copy_with(home, tmp_path / "few", without("shape_extra")), home / "body.pkl"
    )
    record = found.records.records[0]
    assert found.bodies is not None
    assert few.bodies is not None
    assert whole.bodies is not None
    assert_close(found.bodies.body(record).vertices, whole.bodies.body(record).vertices)
    assert few.bodies.body(record).vertices.shape == whole.bodies.body(record).vertices.shape


@pytest.mark.parametrize("rest", [None, []])
@pytest.mark.parametrize("masks", [True, False])
def test_a_2d_only_set_is_labelled_with_a_body_for_all(
    home: Path, tmp_path: Path, masks: bool, rest: list[float] | None
) -> None:
    def flat(content: Content) -> None:
        without(*BODY, *([] if masks else ["mask_path"]), "flength")(content)
        for entry in content["data"]:
            entry["keypoint_2d"] = [[x, y, 2 * v] for x, y, v in entry["keypoint_2d"]]
            if rest is not None:
                entry.update(pose=rest, shape=rest, trans=rest)

    found = read_animal3d(copy_with(home, tmp_path / "flat", flat), home / "body.pkl")
    assert found.bodies is None
    assert found.records.faults == ()
    assert all((record.mask is not None) is masks for record in found.records.records)
    assert set(np.concatenate([record.keypoints_2d[:, 2] for record in found.records.records])) == {
        0.0,
        1.0,
    }
    outcomes = [
        label_of(record, preset_body("dog"), LabelConfig()) for record in found.records.records[:2]
    ]
    assert any(isinstance(outcome, CuboidLabel) for outcome in outcomes)


def test_scaled_limbs_are_a_fault_where_the_body_would_be_wrong(home: Path, tmp_path: Path) -> None:
    def boned(content: Content) -> None:
        for i, entry in enumerate(content["data"]):
            entry["bone"] = [0.0] * 23 + [0.1 if i == 1 else 0.0]

    root = copy_with(home, tmp_path / "boned", boned)
    second: dict[str, Any] = json.loads((root / "train.json").read_text())["data"][1]
    found = read_animal3d(root, home / "body.pkl").records
    (fault,) = found.faults
    assert (fault.field, fault.sample_id) == (
        "bone",
        next(iter({second["img_path"], f"{second['img_path']}#1"} & {str(fault.sample_id)})),
    )
    assert "the body would be wrong. Leave --model out" in fault.problem
    flat = read_animal3d(root).records
    assert len(flat.records) == len(found.records) + 1
    assert flat.faults == ()
