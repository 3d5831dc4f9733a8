from pathlib import Path

import numpy as np
import pytest
import torch
from torch.testing import assert_close

from animal3dbox.errors import ConfigError
from animal3dbox.smal.keypoints.known_places import KNOWN_PLACES
from animal3dbox.smal.keypoints.vocabularies import VOCABULARIES, find_vocabulary
from animal3dbox.smal.keypoints.vocabulary import (
    Vocabulary,
    load_vocabulary,
    side_of,
    swap_sides,
    vocabulary_from_names,
)
from animal3dbox.smal.quadruped.poses import named_pose
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped, preset_betas

ANIMAL3D_FLIP = (
    1,
    0,
    2,
    4,
    3,
    6,
    5,
    7,
    9,
    8,
    11,
    10,
    13,
    12,
    15,
    14,
    17,
    16,
    18,
    19,
    21,
    20,
    23,
    22,
    24,
    25,
)
STANFORD_TO_ANIMAL3D = {
    0: 3,
    1: 14,
    2: 8,
    3: 5,
    4: 16,
    5: 10,
    6: 4,
    7: 15,
    8: 9,
    9: 6,
    10: 17,
    11: 11,
    12: 7,
    13: 19,
    16: 24,
    17: 2,
    20: 0,
    21: 1,
}


def test_the_flip_of_animal3d_is_the_published_one() -> None:
    assert VOCABULARIES["animal3d26"].flip == ANIMAL3D_FLIP


def test_stanfordextra_keypoints_are_the_animal3d_landmarks_that_its_users_map_them_to() -> None:
    names = VOCABULARIES["animal3d26"].keypoints
    for row, target in STANFORD_TO_ANIMAL3D.items():
        assert VOCABULARIES["stanfordextra24"].landmarks[row] == (names[target],)


@pytest.mark.parametrize("name", sorted(VOCABULARIES))
def test_sides_are_right_by_geometry_and_flips_are_mirror_images(name: str) -> None:
    model, vocabulary = load_quadruped(), VOCABULARIES[name]
    points = vocabulary.on_body(model.landmark_groups, model.v_template)
    known = torch.isfinite(points).all(1)
    mirror = points[list(vocabulary.flip)] * torch.tensor([1.0, -1, 1], dtype=points.dtype)
    assert float((mirror - points)[known].abs().amax()) < 1e-12
    for row in known.nonzero()[:, 0].tolist():
        y, side = float(points[row, 1]), vocabulary.sides[row]
        assert {"left": y > 0.001, "right": y < -0.001, None: abs(y) < 1e-9}[side], (
            vocabulary.keypoints[row]
        )
        assert (vocabulary.flip[row] == row) == (side is None)


@pytest.mark.parametrize("name", sorted(VOCABULARIES))
def test_mapping_a_mirrored_animal_is_mirroring_the_mapped_one(name: str) -> None:
    model, vocabulary = load_quadruped(), VOCABULARIES[name]
    vertices = model.posed(
        preset_betas("horse")[None],
        named_pose("walk")[None],
        torch.zeros(1, 3, dtype=torch.float64),
    ).vertices[0]
    S = torch.diag(torch.tensor([1.0, -1, 1], dtype=torch.float64))
    assert model.symmetry is not None
    of_mirrored = vocabulary.on_body(model.landmark_groups, (vertices @ S)[model.symmetry])
    mirrored = (vocabulary.on_body(model.landmark_groups, vertices) @ S)[list(vocabulary.flip)]
    assert_close(of_mirrored, mirrored, atol=1e-12, rtol=0, equal_nan=True)


@pytest.mark.parametrize(
    ("name", "length", "unknown"),
    [
        ("animal3d26", 26, 0),
        ("stanfordextra24", 24, 0),
        ("animalpose20", 20, 0),
        ("ap10k17", 17, 0),
        ("superanimal39", 39, 17),
    ],
)
def test_each_vocabulary_has_its_length_and_leaves_out_what_the_body_lacks(
    name: str, length: int, unknown: int
) -> None:
    model, vocabulary = load_quadruped(), VOCABULARIES[name]
    points = vocabulary.on_body(model.landmark_groups, model.v_template)
    assert len(vocabulary) == length
    assert int(torch.isnan(points).all(1).sum()) == unknown


def test_superanimal_stands_in_the_published_order() -> None:
    published = (
        10,
        5,
        None,
        26,
        29,
        30,
        35,
        22,
        24,
        27,
        31,
        32,
        None,
        None,
        25,
        28,
        33,
        34,
        15,
        23,
        11,
        6,
        4,
        3,
        0,
        None,
    )
    vocabulary = VOCABULARIES["superanimal39"]
    for landmark, index in zip(VOCABULARIES["animal3d26"].keypoints, published, strict=True):
        assert vocabulary.index_of(landmark) == index, landmark


def test_animalposes_back_elbow_is_the_knee_and_its_back_knee_the_hock() -> None:
    vocabulary = VOCABULARIES["animalpose20"]
    named = dict(zip(vocabulary.keypoints, vocabulary.landmarks, strict=True))
    assert named["L_B_Elbow"] == ("left_back_knee",)
    assert named["R_B_Knee"] == ("right_back_hock",)


@pytest.mark.parametrize(
    ("name", "twin", "side"),
    [
        ("left_eye", "right_eye", "left"),
        ("mouth_end_right", "mouth_end_left", "right"),
        ("Base of left ear", "Base of right ear", "left"),
        ("L_F_Paw", "R_F_Paw", "left"),
        ("RightEye", "LeftEye", "right"),
        ("hoof_cleft", "hoof_cleft", None),
        ("brightness", "brightness", None),
        ("LLeg1", "LLeg1", None),
        ("nose", "nose", None),
    ],
)
def test_sides_are_read_off_names_as_words(name: str, twin: str, side: str | None) -> None:
    assert (swap_sides(name), side_of(name)) == (twin, side)


def test_a_side_without_its_twin_is_refused() -> None:
    with pytest.raises(ConfigError, match="'left paw' has no twin 'right paw'"):
        vocabulary_from_names("mine", {"left paw": "left_front_paw"})


def test_a_left_keypoint_on_a_right_landmark_is_refused() -> None:
    with pytest.raises(
        ConfigError, match="'left paw' is left, but its landmark 'right_front_paw' is not"
    ):
        vocabulary_from_names(
            "mine", {"left paw": "right_front_paw", "right paw": "left_front_paw"}
        )


TOML = """
name = "mine"
[keypoints]
nose = "nose"
"left paw" = ["left_front_toe", "left_front_paw"]
"right paw" = "right_front_paw"
A = "vertex:7"
B = "vertices:8+9"
hip = "joint:pelvis"
tag = []
[flip]
A = "B"
"""


def test_a_users_vocabulary_is_read_from_toml(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text(TOML)
    vocabulary, model = load_vocabulary(tmp_path / "mine.toml"), load_quadruped()
    assert vocabulary.keypoints == ("nose", "left paw", "right paw", "A", "B", "hip", "tag")
    assert vocabulary.flip == (0, 2, 1, 4, 3, 5, 6)
    points = vocabulary.on_body(model.landmark_groups, model.v_template)
    assert_close(points[3], model.v_template[7])
    assert_close(points[4], (model.v_template[8] + model.v_template[9]) / 2)
    assert_close(points[5], model.J_regressor[0] @ model.v_template)
    assert points[1, 1] > 0
    assert bool(points[6].isnan().all())


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("name = 3", "name"),
        ("not toml at all [", "no vocabulary"),
        ('name = "x"\n[keypoints]\nnose = 4', "keypoints"),
        ('name = "x"\nfolder = "y"\n[keypoints]\n', "folder"),
        ('name = "x"\n[keypoints]\nA = "nose"\n[flip]\nA = "B"', "no twin 'B'"),
    ],
)
def test_a_file_that_is_no_vocabulary_is_refused_by_name(
    tmp_path: Path, text: str, says: str
) -> None:
    (tmp_path / "mine.toml").write_text(text)
    with pytest.raises(ConfigError, match=says):
        load_vocabulary(tmp_path / "mine.toml")


def test_a_missing_file_and_a_vertex_the_body_lacks_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="cannot be read"):
        load_vocabulary(tmp_path / "none.toml")
    with pytest.raises(ConfigError, match="at vertices \\[5\\], but the body has 3"):
        vocabulary_from_names("mine", {"dot": "vertex:5"}).on_body({}, torch.zeros(3, 3))


def test_a_landmark_the_body_lacks_is_nan_not_a_guess() -> None:
    vocabulary = vocabulary_from_names("two", {"nose": "nose", "horn": None})
    points = vocabulary.on_body({"nose": (0, 1)}, torch.tensor([[0.0, 0, 0], [2, 0, 0]]))
    assert points[0].tolist() == [1, 0, 0]
    assert bool(points[1].isnan().all())


def test_the_first_landmark_that_the_body_has_is_taken() -> None:
    vocabulary = vocabulary_from_names("snouts", {"snout": ("nose", "chin")})
    assert vocabulary.on_body({"chin": (0,)}, torch.ones(1, 3)).tolist() == [[1, 1, 1]]


def test_a_place_that_no_body_has_is_refused_with_the_nearest() -> None:
    misspelt = vocabulary_from_names("mine", {"snout": "nsoe", "tail": "tail_base"})
    with pytest.raises(ConfigError, match=r"'snout' is at 'nsoe', which no body has .nearest: no"):
        misspelt.on_body({"tail_base": (0,)}, torch.ones(1, 3))
    own_groups = {"nsoe": (0,), "tail_base": (0,)}
    assert misspelt.on_body(own_groups, torch.ones(1, 3)).shape == (2, 3)


def test_the_known_places_are_the_quadrupeds() -> None:
    model = load_quadruped()
    assert {*model.landmarks, *model.extra_landmarks} == set(KNOWN_PLACES)


def test_a_keypoint_of_one_side_needs_a_mirror_image() -> None:
    words = "'forelegL1' is left .left_front_elbow., but is its own mirror image"
    places = {"forelegL1": "left_front_elbow", "forelegR1": "right_front_elbow"}
    with pytest.raises(ConfigError, match=words):
        vocabulary_from_names("mine", {**places, "forelegR1": "right_front_paw"})
    paired = vocabulary_from_names("mine", places, {"forelegL1": "forelegR1"})
    assert paired.flip == (1, 0)


@pytest.mark.parametrize("flip", [(0, 0), (1, 2), (0,)])
def test_a_flip_that_is_no_involution_is_refused(flip: tuple[int, ...]) -> None:
    with pytest.raises(ConfigError, match="vocabulary mine"):
        Vocabulary("mine", ("a", "b"), ((), ()), flip)


def test_users_vocabularies_pass_through_and_unknown_names_do_not() -> None:
    mine = vocabulary_from_names("mine", {"nose": "nose"})
    assert find_vocabulary(mine) is mine
    with pytest.raises(ConfigError, match="one of animal3d26"):
        find_vocabulary("dogs99")


def test_a_body_that_has_no_place_for_any_keypoint_gives_none() -> None:
    vocabulary = vocabulary_from_names("mine", {"nose": "nose", "dot": None})
    assert bool(vocabulary.on_body({}, torch.ones(3, 3)).isnan().all())
    assert np.isnan(vocabulary.on_body({}, np.ones((3, 3)))).all()
    points = vocabulary.on_body({"nose": (0, 1)}, torch.ones(3, 3))
    assert points[0].tolist() == [1, 1, 1]
    assert bool(points[1].isnan().all())


def test_twins_whose_names_say_no_side_are_told_by_their_places() -> None:
    own = vocabulary_from_names(
        "own",
        {
            "LF_paw": "left_front_paw",
            "Nose": "nose",
            "RF_paw": ["right_front_paw", "right_front_wrist"],
            "snout": "nose",  # the same place, and nobody's mirror image
            "left_eye": "left_eye",
            "right_eye": "right_eye",
        },
    )
    assert own.flip == (2, 1, 0, 3, 5, 4)
    assert own.sides[:3] == ("left", None, "right")


@pytest.mark.parametrize("others", [{}, {"RF_1": "right_front_paw", "RF_2": "right_front_paw"}])
def test_a_keypoint_at_a_side_with_no_single_twin_is_refused(others: dict[str, str]) -> None:
    with pytest.raises(ConfigError, match=r"say in \[flip\]"):
        vocabulary_from_names("own", {"LF_paw": "left_front_paw", **others})
