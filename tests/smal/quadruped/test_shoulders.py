"""The two places of a shoulder: the upper edge of its blade, and its point, the joint."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from animal3dbox.smal.keypoints.vocabularies import VOCABULARIES
from animal3dbox.smal.keypoints.vocabulary import Vocabulary, load_vocabulary
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped, preset_betas, quadruped_names

Array = NDArray[np.float64]


def middle(preset: str, name: str) -> Array:
    model = load_quadruped()
    vertices = model.shaped(preset_betas(preset)[None])[0].numpy()
    sides = [f"left_{name}", f"right_{name}"]
    names = [name] if name in model.landmark_groups else sides
    mean: Array = np.mean([vertices[list(model.landmark_groups[n])].mean(0) for n in names], axis=0)
    return mean


def rise_deg(preset: str, name: str) -> float:
    """By how many degrees the line from the tail's base rises forward."""
    way = middle(preset, name) - middle(preset, "tail_base")
    return float(np.rad2deg(np.arctan2(way[2], way[0])))


@pytest.mark.parametrize("preset", quadruped_names().presets)
def test_animal3ds_shoulders_lie_as_high_as_the_tails_base_as_smals_do(preset: str) -> None:
    assert abs(rise_deg(preset, "shoulder_blade")) < 3


@pytest.mark.parametrize("preset", quadruped_names().presets)
def test_the_point_of_the_shoulder_lies_well_below_its_blade(preset: str) -> None:
    assert rise_deg(preset, "shoulder_point") < rise_deg(preset, "shoulder_blade") - 10


def test_each_vocabulary_says_which_place_its_shoulder_is() -> None:
    for name, place in (("animal3d26", "left_shoulder_blade"), ("ap10k17", "left_front_elbow")):
        vocabulary = VOCABULARIES[name]
        assert vocabulary.landmarks[vocabulary.keypoints.index("left_shoulder")] == (place,)
        assert vocabulary.notes == ()


def test_ap10ks_legs_have_the_places_of_superanimals_which_was_trained_on_it() -> None:
    ap10k, superanimal = (VOCABULARIES[name] for name in ("ap10k17", "superanimal39"))
    theirs = dict(zip(superanimal.keypoints, superanimal.landmarks, strict=True))
    for side in ("left", "right"):
        for own, other in (
            ("shoulder", f"front_{side}_thai"),
            ("elbow", f"front_{side}_knee"),
            ("hip", f"back_{side}_thai"),
            ("knee", f"back_{side}_knee"),
        ):
            place = ap10k.landmarks[ap10k.keypoints.index(f"{side}_{own}")]
            assert place == theirs[other]


def own_vocabulary(tmp_path: Path, landmark: str) -> Vocabulary:
    lines = ['name = "own"', "[keypoints]"]
    lines += [f'{side}_x = "{side}_{landmark}"' for side in ("left", "right")]
    path = tmp_path / "own.toml"
    path.write_text("\n".join(lines))
    return load_vocabulary(path)


def test_a_file_that_says_left_shoulder_keeps_its_place_and_gets_a_note(tmp_path: Path) -> None:
    model = load_quadruped()
    old, point = (own_vocabulary(tmp_path, name) for name in ("shoulder", "shoulder_point"))
    places = [v.on_body(model.landmark_groups, model.v_template) for v in (old, point)]
    assert np.array_equal(places[0], places[1])
    assert "left_shoulder_blade" in old.notes[0]
    assert point.notes == ()


def test_groups_of_the_old_name_serve_every_vocabulary(tmp_path: Path) -> None:
    groups = {"left_shoulder": (1,), "right_shoulder": (2,)}
    vertices = np.arange(9.0).reshape(3, 3)
    for landmark in ("shoulder", "shoulder_blade", "shoulder_point"):
        vocabulary = own_vocabulary(tmp_path, landmark)
        assert np.array_equal(vocabulary.on_body(groups, vertices), vertices[1:])
