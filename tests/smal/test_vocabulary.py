import pytest
import torch

from animal3dbox.errors import ConfigError
from animal3dbox.smal.quadruped import load_quadruped
from animal3dbox.smal.vocabulary import VOCABULARIES, Vocabulary, find_vocabulary, vocabulary_from_names

ANIMAL3D_FLIP = (1, 0, 2, 4, 3, 6, 5, 7, 9, 8, 11, 10, 13, 12, 15, 14, 17, 16, 18, 19, 21, 20, 23, 22, 24, 25)
STANFORD_TO_ANIMAL3D = {0: 3, 1: 14, 2: 8, 3: 5, 4: 16, 5: 10, 6: 4, 7: 15, 8: 9, 9: 6, 10: 17, 11: 11, 12: 7, 13: 19, 16: 24, 17: 2, 20: 0, 21: 1}


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
    assert bool(torch.isfinite(points).all())
    mirror = points[list(vocabulary.flip)] * torch.tensor([1.0, -1, 1], dtype=points.dtype)
    assert float((mirror - points).abs().amax()) < 1e-12
    for keypoint, partner, (_, y, _) in zip(vocabulary.keypoints, vocabulary.flip, points.tolist(), strict=True):
        if "left" in keypoint.lower():
            assert y > 0.001, keypoint
        elif "right" in keypoint.lower():
            assert y < -0.001, keypoint
        else:
            assert vocabulary.keypoints[partner] == keypoint
            assert abs(y) < 1e-9, keypoint


def test_a_landmark_the_body_lacks_is_nan_not_a_guess() -> None:
    vocabulary = vocabulary_from_names("two", {"nose": "nose", "horn": None})
    points = vocabulary.on_body({"nose": (0, 1)}, torch.tensor([[0.0, 0, 0], [2, 0, 0]]))
    assert points[0].tolist() == [1, 0, 0]
    assert bool(points[1].isnan().all())


def test_the_first_landmark_that_the_body_has_is_taken() -> None:
    vocabulary = vocabulary_from_names("ears", {"Base of left ear": ("left_ear_base", "left_ear")})
    assert vocabulary.on_body({"left_ear": (0,)}, torch.ones(1, 3)).tolist() == [[1, 1, 1]]


@pytest.mark.parametrize("flip", [(0, 0), (1, 2), (0,)])
def test_a_flip_that_is_no_involution_is_refused(flip: tuple[int, ...]) -> None:
    with pytest.raises(ConfigError, match="vocabulary mine"):
        Vocabulary("mine", ("a", "b"), ((), ()), flip)


def test_users_vocabularies_pass_through_and_unknown_names_do_not() -> None:
    mine = vocabulary_from_names("mine", {"nose": "nose"})
    assert find_vocabulary(mine) is mine
    with pytest.raises(ConfigError, match="one of animal3d26"):
        find_vocabulary("dogs99")
