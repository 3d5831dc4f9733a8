"""A mesh's triangles prove that its vertices are a model's."""

import torch

from animal3dbox.smal.correspondence import corresponds
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped

MODEL = load_quadruped()
COUNT = MODEL.vertex_count


def test_the_models_own_faces_prove_it_in_any_order_from_any_corner() -> None:
    assert corresponds(MODEL, COUNT, MODEL.faces)
    assert corresponds(MODEL, COUNT, MODEL.faces.flip(0).roll(1, dims=1))


def test_faces_that_were_left_out_prove_it_too() -> None:
    assert corresponds(MODEL, COUNT, MODEL.without_tail_faces())


def test_another_count_of_vertices_or_no_faces_prove_nothing() -> None:
    assert not corresponds(MODEL, COUNT + 1, MODEL.faces)
    assert not corresponds(MODEL, COUNT, MODEL.faces[:0])


def test_vertices_in_another_order_do_not_correspond() -> None:
    order = torch.randperm(COUNT, generator=torch.Generator().manual_seed(0))
    assert not corresponds(MODEL, COUNT, order[MODEL.faces])


def test_one_face_that_is_not_the_models_disproves_it() -> None:
    faces = MODEL.faces.clone()
    faces[100] = torch.tensor([0, COUNT // 2, COUNT - 1])
    assert not corresponds(MODEL, COUNT, faces)
    faces[100] = torch.tensor([0, 1, COUNT])
    assert not corresponds(MODEL, COUNT, faces)


def test_an_inside_out_mesh_does_not_correspond() -> None:
    assert not corresponds(MODEL, COUNT, MODEL.faces.flip(1))
