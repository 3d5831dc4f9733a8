"""`inspect --fits`: stored bodies that fits to the same keypoints contradict are named."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
from animal3d_copies import copy_with, in_pytorch3d_frame
from commands import ran

from animal3dbox.datasets.formats import ReadOptions
from animal3dbox.datasets.inspection.inspect import inspect_dataset
from animal3dbox.datasets.inspection.result import StoredFitFacts
from animal3dbox.datasets.inspection.text import as_text
from animal3dbox.datasets.synthetic.animal3d_writer import write_animal3d
from animal3dbox.datasets.synthetic.faults import FaultConfig
from animal3dbox.datasets.synthetic.synthetic_set import SyntheticSet, animal3d_world
from animal3dbox.datasets.synthetic.world.config import WorldConfig
from animal3dbox.geometry.rigid_transforms import axis_angle_from_rotation, rotation_from_axis_angle

CHANGED = 1
"""The entry of train.json that is altered."""


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the dataset "animals" and its model beside it."""
    home = tmp_path_factory.mktemp("animal3d")
    config = animal3d_world(
        WorldConfig(fill=(0.5, 0.9), occluded=0.0, truncated=0.0, animals=(1, 1))
    )
    write_animal3d(
        SyntheticSet(6, 5, config, FaultConfig(noise_px=1.0)), home / "animals", home / "body.pkl"
    )
    return home


def facts_of(
    home: Path, tmp_path: Path, change: Callable[[dict[str, Any]], object]
) -> tuple[StoredFitFacts, str, str]:
    """The facts of a copy one of whose bodies is altered, the animal's name, and the words."""
    names = []

    def altered(content: dict[str, Any]) -> None:
        change(content["data"][CHANGED])
        names.append(content["data"][CHANGED]["img_path"])

    copy = copy_with(home, tmp_path / "copy", altered)
    inspection = inspect_dataset(copy, options=ReadOptions(model=home / "body.pkl"), fits=True)
    assert inspection.stored_fits is not None
    return inspection.stored_fits, names[0], as_text(inspection)


def turned(entry: dict[str, Any]) -> None:
    """Turn the body by 70 degrees about its root's own vertical."""
    R = rotation_from_axis_angle(torch.tensor(entry["pose"][:3], dtype=torch.float64))
    yaw = rotation_from_axis_angle(torch.tensor([0.0, 0.0, 1.2], dtype=torch.float64))
    entry["pose"][:3] = axis_angle_from_rotation(R @ yaw).tolist()


def moved(entry: dict[str, Any]) -> None:
    """Move the body sideways by a tenth of its distance."""
    entry["trans"][0] += 0.1 * entry["trans"][2]


def test_bodies_as_they_are_are_not_contradicted(home: Path, tmp_path: Path) -> None:
    facts, _, words = facts_of(home, tmp_path, lambda entry: None)
    assert facts.compared == 4
    assert (facts.turned, facts.worse, facts.examples) == ([], [], [])
    assert "no stored body of 4 compared is contradicted" in words


def test_the_frame_that_bodies_are_stored_in_does_not_matter(home: Path, tmp_path: Path) -> None:
    copy = copy_with(home, tmp_path / "copy", in_pytorch3d_frame)
    facts = inspect_dataset(copy, options=ReadOptions(model=home / "body.pkl"), fits=True)
    assert facts.stored_fits is not None
    assert (facts.stored_fits.compared, facts.stored_fits.examples) == (4, [])


def test_a_body_that_is_turned_is_named_by_its_trunk_and_its_keypoints(
    home: Path, tmp_path: Path
) -> None:
    facts, name, words = facts_of(home, tmp_path, turned)
    assert facts.turned == facts.worse == [name]
    assert f"{name}: its trunk is turned by" in words
    assert "1 of 4 stored bodies compared are contradicted" in words


def test_a_body_that_is_moved_is_named_by_its_keypoints_alone(home: Path, tmp_path: Path) -> None:
    facts, name, _ = facts_of(home, tmp_path, moved)
    assert (facts.turned, facts.worse) == ([], [name])


def test_fits_are_made_only_if_asked_for_and_need_the_model(home: Path) -> None:
    plain = inspect_dataset(home / "animals", options=ReadOptions(model=home / "body.pkl"))
    assert plain.stored_fits is None
    code, printed = ran("inspect", home / "animals", "--fits")
    assert code == 2
    assert "--model" in printed
    code, printed = ran(
        "inspect", home / "animals", "--model", home / "body.pkl", "--fits", "--json"
    )
    assert code == 0
    assert json.loads(printed)["stored_fits"]["compared"] == 5
