import itertools

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from strategies import cuboids_anywhere, rotations, vector
from thorough import thorough
from torch import Tensor
from torch.testing import assert_close

from animal3dbox.errors import ShapeError
from animal3dbox.geometry.box_visibility import face_normals
from animal3dbox.geometry.cuboid import (
    CORNER_SIGNS,
    EDGES,
    FACE_NAMES,
    FACES,
    MIRRORED_CORNERS,
    MIRRORED_FACES,
    OPPOSITE_FACES,
    Cuboid,
)
from animal3dbox.geometry.rigid_transforms import rigid

UNIT = Cuboid(
    torch.zeros(3, dtype=torch.float64),
    torch.eye(3, dtype=torch.float64),
    torch.full((3,), 2.0, dtype=torch.float64),
)


def test_unit_box_has_its_corners_in_the_documented_order() -> None:
    assert UNIT.corners().tolist() == [
        [-1, -1, -1],
        [1, -1, -1],
        [1, 1, -1],
        [-1, 1, -1],
        [-1, -1, 1],
        [1, -1, 1],
        [1, 1, 1],
        [-1, 1, 1],
    ]


def test_each_face_lies_on_the_side_it_is_named_for() -> None:
    outward = {
        "front": (1, 0, 0),
        "back": (-1, 0, 0),
        "left": (0, 1, 0),
        "right": (0, -1, 0),
        "top": (0, 0, 1),
        "bottom": (0, 0, -1),
    }
    for name, corner_ids in FACES.items():
        assert UNIT.corners()[list(corner_ids)].mean(0).tolist() == list(outward[name])


def test_faces_turn_counter_clockwise_seen_from_outside() -> None:
    for corner_ids in FACES.values():
        quad = UNIT.corners()[list(corner_ids)]
        normal = torch.linalg.cross(quad[1] - quad[0], quad[2] - quad[1])
        assert float(normal @ quad.mean(0)) > 0


def test_opposite_faces_share_no_corner_and_edges_join_corners_that_differ_in_one_sign() -> None:
    for face, opposite in enumerate(OPPOSITE_FACES):
        assert not set(FACES[FACE_NAMES[face]]) & set(FACES[FACE_NAMES[opposite]])
    assert len(EDGES) == len({frozenset(edge) for edge in EDGES}) == 12
    for a, b in EDGES:
        assert sum(s != t for s, t in zip(CORNER_SIGNS[a], CORNER_SIGNS[b], strict=True)) == 1


def test_normals_of_the_unit_box_are_its_axes() -> None:
    assert face_normals(UNIT.corners()).tolist() == [
        [1, 0, 0],
        [-1, 0, 0],
        [0, 1, 0],
        [0, -1, 0],
        [0, 0, 1],
        [0, 0, -1],
    ]


@thorough(1000)
@given(cuboids_anywhere(), rotations())
def test_mirroring_permutes_corners_and_faces_as_documented_and_twice_is_identity(
    box: Cuboid, R: Tensor
) -> None:
    Q = R @ torch.diag(torch.tensor([-1.0, 1.0, 1.0], dtype=torch.float64))
    mirrored = box.mirrored(Q)
    assert_close(
        torch.linalg.det(mirrored.rotation),
        torch.tensor(1.0, dtype=torch.float64),
        atol=1e-12,
        rtol=0,
    )
    assert_close(
        mirrored.corners(), (box.corners() @ Q.mT)[list(MIRRORED_CORNERS)], atol=1e-12, rtol=0
    )
    assert_close(
        face_normals(mirrored.corners()),
        (face_normals(box.corners()) @ Q.mT)[list(MIRRORED_FACES)],
        atol=1e-9,
        rtol=0,
    )
    again = mirrored.mirrored(Q.mT)
    assert_close(
        torch.cat((again.center, again.size, again.rotation.flatten())),
        torch.cat((box.center, box.size, box.rotation.flatten())),
        atol=1e-12,
        rtol=0,
    )


@thorough(1000)
@given(cuboids_anywhere(), rotations(), vector(-5, 5), st.floats(0.01, 100))
def test_corners_move_with_the_box(box: Cuboid, R: Tensor, t: Tensor, factor: float) -> None:
    assert_close(
        box.transformed(rigid(R, t)).corners(), box.corners() @ R.mT + t, atol=1e-12, rtol=0
    )
    assert_close(box.scaled(factor).corners(), box.corners() * factor, atol=1e-12, rtol=1e-12)


def test_a_box_contains_what_is_inside_and_nothing_else() -> None:
    points = torch.tensor(
        [[0.0, 0.0, 0.0], [1.0, 1.0, 1.0], [1.001, 0.0, 0.0], [0.0, -1.1, 0.0]], dtype=torch.float64
    )
    assert UNIT.contains(points).tolist() == [True, True, False, False]
    assert UNIT.contains(points, tolerance=0.01).tolist() == [True, True, True, False]


def test_a_batch_of_boxes_has_the_corners_of_each() -> None:
    centers = torch.arange(6, dtype=torch.float64).reshape(2, 3)
    batch = Cuboid(
        centers,
        torch.eye(3, dtype=torch.float64).expand(2, 3, 3),
        torch.ones(2, 3, dtype=torch.float64),
    )
    for row in range(2):
        single = Cuboid(
            centers[row], torch.eye(3, dtype=torch.float64), torch.ones(3, dtype=torch.float64)
        )
        assert_close(batch.corners()[row], single.corners())


@pytest.mark.parametrize(
    ("field", "value", "says"),
    [
        ("center", torch.zeros(2), "center must have shape"),
        ("center", torch.full((3,), torch.nan), "center must be finite"),
        ("rotation", torch.eye(3) * 2, "rotation must hold rotation matrices"),
        ("rotation", torch.diag(torch.tensor([1.0, -1.0, 1.0])), "determinant"),
        ("size", torch.tensor([1.0, -1.0, 1.0]), "size must not be negative"),
    ],
)
def test_an_impossible_box_is_refused_by_name(field: str, value: Tensor, says: str) -> None:
    good = {"center": torch.zeros(3), "rotation": torch.eye(3), "size": torch.ones(3)}
    with pytest.raises(ShapeError, match=says):
        Cuboid(**{**good, field: value})


def test_only_a_mirror_mirrors() -> None:
    with pytest.raises(ShapeError, match="determinant -1"):
        UNIT.mirrored(torch.eye(3, dtype=torch.float64))


def test_every_corner_order_that_keeps_the_loop_is_not_cartesian() -> None:
    assert list(CORNER_SIGNS) != list(itertools.product((-1, 1), repeat=3))


def test_a_batch_gives_its_boxes_and_a_single_box_none() -> None:
    batch = Cuboid(torch.arange(6.0).reshape(2, 3), torch.eye(3).expand(2, 3, 3), torch.ones(2, 3))
    assert [batch[i].center.tolist() for i in range(2)] == batch.center.tolist()
    batch[1].center.zero_()
    assert batch.center[1].tolist() == [3, 4, 5]
    with pytest.raises(TypeError, match="one box"):
        batch[0][0]
