"""Parameters of Animal3D's entries that others write otherwise, or that cannot mean a body."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from animal3d_copies import Content, copy_with

from animal3dbox.datasets.formats import ReadDataset, read_dataset
from animal3dbox.datasets.read_options import ReadOptions
from animal3dbox.datasets.synthetic.animal3d_writer import write_animal3d
from animal3dbox.datasets.synthetic.faults import FaultConfig
from animal3dbox.datasets.synthetic.synthetic_set import SyntheticSet, animal3d_world
from animal3dbox.datasets.synthetic.world.config import WorldConfig
from animal3dbox.errors import ConfigError

Change = Callable[[dict[str, Any]], object]


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the dataset "animals" and its model beside it."""
    home = tmp_path_factory.mktemp("animal3d")
    config = animal3d_world(
        WorldConfig(image_hw=(120, 160), fill=(0.5, 0.9), occluded=0.0, truncated=0.0)
    )
    faults = FaultConfig(noise_px=0.3)
    write_animal3d(SyntheticSet(7, 3, config, faults), home / "animals", home / "body.pkl")
    return home


def each(change: Change) -> Callable[[Content], None]:
    """Change every entry."""

    def change_all(content: Content) -> None:
        for entry in content["data"]:
            change(entry)

    return change_all


def of_many(content: Content) -> None:
    """Write each entry as SMAL+ does, of one animal."""
    keys = ("keypoint_2d", "keypoint_3d", "pose", "shape", "shape_extra", "trans")
    for entry in content["data"]:
        entry |= {key: [entry[key]] for key in (*keys, "bbox")}
        entry["num_animals"] = 1


def read(home: Path, folder: Path, change: Change, *, many: bool = False) -> ReadDataset:
    """The changed dataset with its model."""

    def both(content: Content) -> None:
        each(change)(content)
        if many:
            of_many(content)

    path = copy_with(home, folder / "set", both) / "train.json"
    return read_dataset(path, options=ReadOptions(model=home / "body.pkl"))


def vertices_of(dataset: ReadDataset) -> torch.Tensor:
    """The bodies of all animals, which must have one."""
    assert dataset.bodies is not None
    assert dataset.records.faults == ()
    bodies = [dataset.bodies.body(record).vertices for record in dataset.records.records]
    return torch.stack([torch.as_tensor(vertices) for vertices in bodies])


@pytest.mark.parametrize("many", [False, True])
def test_trans_and_shape_may_be_nested_as_pose_may(home: Path, tmp_path: Path, many: bool) -> None:
    plain = vertices_of(read(home, tmp_path, lambda entry: None))

    def nest(entry: dict[str, Any]) -> None:
        entry["pose"] = np.array(entry["pose"]).reshape(-1, 3).tolist()
        for key in ("trans", "shape", "shape_extra"):
            entry[key] = [entry[key]]

    (tmp_path / "nested").mkdir()
    found = vertices_of(read(home, tmp_path / "nested", nest, many=many))
    assert torch.equal(found, plain)


@pytest.mark.parametrize("key", ["pose", "trans", "shape"])
def test_the_first_fault_of_parameters_is_shown(home: Path, tmp_path: Path, key: str) -> None:
    def spoil(content: Content) -> None:
        for number, entry in enumerate(content["data"]):
            entry.update({key: [["a"]]} if number else {"keypoint_2d": [[1.0, 2.0, 1.0]]})

    path = copy_with(home, tmp_path / "set", spoil) / "train.json"
    with pytest.raises(ConfigError, match=rf"the first: \S+: {key}\S*: "):
        read_dataset(path, options=ReadOptions(model=home / "body.pkl"))


@pytest.mark.parametrize("many", [False, True])
def test_a_pose_of_zeros_stands_for_no_parameters_wherever_trans_is(
    home: Path, tmp_path: Path, many: bool
) -> None:
    done: list[str] = []

    def still(entry: dict[str, Any]) -> None:
        if not done:
            entry["pose"] = [0.0] * len(entry["pose"])
        done.append(entry["img_path"])

    dataset = read(home, tmp_path, still, many=many)
    first, *others = dataset.records.records
    assert first.stored_pose is None
    assert all(record.stored_pose is not None for record in others)
    assert others
    note = (
        f"the pose of 1 animals is all zero, which stands for no parameters; the first is {done[0]}"
    )
    assert note in dataset.records.notes


def test_a_model_for_poses_of_zeros_alone_is_refused_with_the_reason(
    home: Path, tmp_path: Path
) -> None:
    with pytest.raises(ConfigError, match=r"the pose of \d+ animals is all zero.*; give a --body"):
        read(home, tmp_path, lambda entry: entry.update(pose=[0.0] * 105))


@pytest.mark.parametrize("many", [False, True])
def test_angles_in_degrees_are_a_fault_that_says_so(home: Path, tmp_path: Path, many: bool) -> None:
    def to_degrees(entry: dict[str, Any]) -> None:
        entry["pose"] = np.degrees(entry["pose"]).tolist()

    dataset = read(home, tmp_path, to_degrees, many=many)
    assert not any("focal length" in note for note in dataset.records.notes)
    assert len(dataset.records.faults) > 1
    assert not dataset.records.records
    for fault in dataset.records.faults:
        assert fault.field == "pose"
        assert "look like degrees; multiply pose by pi / 180" in fault.problem


def test_turns_of_nearly_once_round_are_no_fault(home: Path, tmp_path: Path) -> None:
    def once_round(entry: dict[str, Any]) -> None:
        root = np.array(entry["pose"][:3])
        angle = np.linalg.norm(root)
        entry["pose"][:3] = (root * (1 - 2 * np.pi / angle)).tolist()  # the same turn

    assert read(home, tmp_path, once_round).records.faults == ()


@pytest.mark.parametrize("shape", [(3, 3), (9,)])
def test_an_entrys_own_camera_may_be_flat(
    home: Path, tmp_path: Path, shape: tuple[int, ...]
) -> None:
    K = np.array([[200.0, 0, 80], [0, 210, 60], [0, 0, 1]])

    def with_camera(entry: dict[str, Any]) -> None:
        entry["K"] = K.reshape(shape).tolist()

    for record in read(home, tmp_path, with_camera).records.records:
        assert record.K is not None
        assert np.array_equal(record.K, K)
