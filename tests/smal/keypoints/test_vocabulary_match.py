"""Keypoint names of files: which vocabulary they are, whatever their order.

What is not known is refused with the nearest names.
"""

from pathlib import Path

import pytest

from animal3dbox.errors import ConfigError
from animal3dbox.smal.keypoints.vocabularies import VOCABULARIES, vocabulary_of_option
from animal3dbox.smal.keypoints.vocabulary import vocabulary_from_names
from animal3dbox.smal.keypoints.vocabulary_match import match_by_name

SPELLED_OUT = [
    "left_eye", "right_eye", "nose", "left_ear", "right_ear",
    "left_front_elbow", "right_front_elbow", "left_back_elbow", "right_back_elbow",
    "left_front_knee", "right_front_knee", "left_back_knee", "right_back_knee",
    "left_front_paw", "right_front_paw", "left_back_paw", "right_back_paw", "throat", "withers",
    "tailbase",
]  # fmt: skip
"""AnimalPose's own json, in its order."""


@pytest.mark.parametrize("name", sorted(VOCABULARIES))
def test_keypoints_are_matched_by_name_whatever_their_order_and_case(name: str) -> None:
    shuffled = ["extra", *(keypoint.upper() for keypoint in reversed(VOCABULARIES[name].keypoints))]
    match = match_by_name(shuffled)
    assert match.vocabulary.name == name
    assert [shuffled[i] for i in match.columns if i is not None] == [
        keypoint.upper() for keypoint in VOCABULARIES[name].keypoints
    ]
    assert match.unused == ("extra",)
    assert not match.is_exact
    assert match_by_name(shuffled[1:]).is_exact


def test_animalpose_spelled_out_is_animalpose_and_its_back_knee_the_hock() -> None:
    match = match_by_name(SPELLED_OUT)
    assert match.vocabulary.name == "animalpose20"
    assert match.is_exact
    said = {
        SPELLED_OUT[column]: names
        for column, names in zip(match.columns, match.vocabulary.landmarks, strict=True)
        if column is not None
    }
    assert said["left_back_knee"] == ("left_back_hock",)
    assert said["left_back_elbow"] == ("left_back_knee",)
    assert said["right_front_knee"] == ("right_front_wrist",)
    assert said["right_ear"] == ("right_ear_base", "right_ear")
    assert said["tailbase"] == ("tail_base",)


def test_part_of_a_vocabulary_is_matched_and_the_rest_missing() -> None:
    names = ["root_of_tail", "left_hip", "right_hip", "nose", "left_shoulder"]
    match = match_by_name(names)
    assert match.vocabulary.name == "ap10k17"
    assert {
        keypoint: column
        for keypoint, column in zip(match.vocabulary.keypoints, match.columns, strict=True)
        if column is not None
    } == {name: i for i, name in enumerate(names)}


def test_names_that_mean_different_places_in_two_vocabularies_are_not_chosen_between() -> None:
    with pytest.raises(
        ConfigError,
        match=(
            r"'left_back_knee' is another place in animal3d26 than in animalpose20: give"
            r" --vocabulary"
        ),
    ):
        match_by_name(["left_eye", "right_eye", "nose", "left_back_knee"])


@pytest.mark.parametrize(
    ("names", "reason"),
    [
        (["nose"], "no known vocabulary"),
        ([], "no known vocabulary"),
        (
            ["nose", "left_eye", "right_eye", "left_shulder"],
            r"'left_shulder' \(nearest: left_shoulder",
        ),
        (["a", "b", "nose", "b", "c"], "names b, b|names b come more than once"),
        (["Nose", "nose", "left_eye", "right_eye"], "come more than once"),
        ([f"point_{i}" for i in range(9)], "and 4 more, of 9"),
    ],
)
def test_names_of_no_vocabulary_are_refused(names: list[str], reason: str) -> None:
    with pytest.raises(ConfigError, match=reason):
        match_by_name(names)


def test_the_users_own_vocabulary_must_have_every_name_and_may_have_more() -> None:
    own = vocabulary_from_names("mine", {"snout": "nose", "rump": "tail_base", "collar": None})
    assert match_by_name(["rump", "snout"], own).columns == (1, 0, None)
    with pytest.raises(
        ConfigError,
        match=(
            r"'snut' \(nearest: snout, .*\), of 2; nearest is mine; add them to the vocabulary mine"
        ),
    ):
        match_by_name(["rump", "snut"], own)


def test_a_vocabulary_is_named_or_a_file(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text('name = "mine"\n[keypoints]\nsnout = "nose"\n')
    assert vocabulary_of_option(str(tmp_path / "mine.toml")).keypoints == ("snout",)
    assert vocabulary_of_option("ap10k17") is VOCABULARIES["ap10k17"]
    with pytest.raises(ConfigError, match="must be one of animal3d26"):
        vocabulary_of_option("ap10k")
    with pytest.raises(ConfigError, match="cannot be read"):
        vocabulary_of_option(str(tmp_path / "other.toml"))
