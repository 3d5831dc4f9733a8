"""SMAL's topology is recognised without its model, and never by its counts alone."""

import numpy as np
import pytest
from numpy.typing import NDArray
from smal_like import smal_like_mesh

from animal3dbox.smal.keypoints.smal_recognition import SMAL_GROUPS, why_not_smal
from animal3dbox.smal.quadruped.poses import POSES
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped, quadruped_names

Array = NDArray[np.float64]


def mesh(preset: str = "dog", pose: str = "stand") -> Array:
    return np.asarray(smal_like_mesh(preset, pose)[0])


@pytest.mark.parametrize("preset", quadruped_names().presets)
@pytest.mark.parametrize("pose", POSES)
def test_every_species_in_every_pose_is_recognised(preset: str, pose: str) -> None:
    assert why_not_smal(mesh(preset, pose), 7774) is None


def test_neither_frame_nor_unit_counts() -> None:
    turn = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    assert why_not_smal(170 * mesh() @ turn.T + [5.0, -900.0, 3.0], 7774) is None


def test_other_counts_are_not_smals() -> None:
    assert why_not_smal(mesh()[:-1], 7774) == "it has 3888 vertices, not SMAL's 3889"
    assert why_not_smal(mesh(), 7775) == "it has 7775 faces, and SMAL has 7774"
    assert why_not_smal(mesh(), None) is None
    assert why_not_smal(mesh(), 7000) is None


@pytest.mark.parametrize("seed", range(5))
def test_3889_vertices_in_another_order_are_not_taken_for_smals(seed: int) -> None:
    order = np.random.default_rng(seed).permutation(3889)
    assert why_not_smal(mesh()[order], 7774) == (
        "the vertices of SMAL's landmarks do not lie together"
    )


@pytest.mark.parametrize("shift", [1, -1, 2, 100])
def test_ids_that_count_from_elsewhere_are_not_smals(shift: int) -> None:
    assert why_not_smal(np.roll(mesh(), shift, axis=0), 7774) is not None


def test_our_own_quadruped_of_as_many_vertices_is_not_taken_for_smals() -> None:
    template = load_quadruped().v_template.numpy()
    assert why_not_smal(template[:3889], 7774) is not None
    assert why_not_smal(template[-3889:], 7774) is not None


def test_a_mirrored_animal_is_not_taken_for_smals() -> None:
    reason = why_not_smal(mesh() * [1.0, -1.0, 1.0], 7774)
    assert reason is not None
    assert reason.startswith("SMAL's left landmarks lie on the right")


def test_exchanged_front_legs_are_not_taken_for_smals() -> None:
    vertices = mesh()
    left, right = (list(SMAL_GROUPS[f"{side}_front_elbow"]) for side in ("left", "right"))
    vertices[left + right] = vertices[right + left]
    assert why_not_smal(vertices, 7774) is not None


def test_landmarks_that_lie_together_at_other_places_are_not_smals() -> None:
    vertices = mesh()
    places = {name: vertices[list(ids)].mean(0) for name, ids in SMAL_GROUPS.items()}
    others = np.random.default_rng(0).permutation(list(SMAL_GROUPS))
    for name, other in zip(SMAL_GROUPS, others, strict=True):
        vertices[list(SMAL_GROUPS[name])] = places[str(other)]
    assert why_not_smal(vertices, 7774) == "SMAL's landmarks are not where an animal has them"


def test_loose_vertices_do_not_count() -> None:
    vertices, used = mesh(), np.ones(3889, dtype=np.bool_)
    for name in ("tail_tip", "tail_middle"):
        used[list(SMAL_GROUPS[name])] = False
    vertices[~used] = np.random.default_rng(0).uniform(-99, 99, (int((~used).sum()), 3))
    assert why_not_smal(vertices, 7774) is not None
    assert why_not_smal(vertices, 7700, used) is None
    for name in list(SMAL_GROUPS)[:12]:
        used[list(SMAL_GROUPS[name])] = False
    assert why_not_smal(vertices, 7700, used) == (
        "its faces use too few of the vertices of SMAL's landmarks"
    )
