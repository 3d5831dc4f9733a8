import numpy as np
import pytest
import torch

from animal3dbox.geometry import mesh_edges as edges_module
from animal3dbox.geometry.mesh_edges import contour_edges, mesh_edges
from animal3dbox.geometry.rasterizer import silhouette
from animal3dbox.geometry.rasterizer_clip import project_triangles

TETRAHEDRON = torch.tensor([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
K = torch.tensor([[100.0, 0, 50], [0, 100, 40], [0, 0, 1]], dtype=torch.float64)


def rows(edges: edges_module.MeshEdges) -> set[tuple[int, ...]]:
    return set(map(tuple, np.concatenate((edges.ends, edges.sides)).T.tolist()))


def test_every_edge_of_a_tetrahedron_lies_between_two_faces() -> None:
    assert rows(mesh_edges(TETRAHEDRON)) == {
        (0, 1, 1, 0),
        (0, 2, 0, 3),
        (0, 3, 3, 1),
        (1, 2, 2, 0),
        (1, 3, 1, 2),
        (2, 3, 2, 3),
    }


def test_an_edge_of_four_faces_is_two_and_one_of_a_single_face_has_none_behind() -> None:
    fan = torch.tensor([[0, 1, 2], [1, 0, 3], [0, 1, 4], [1, 0, 5]])
    shared = [
        (first, second, a, b)
        for first, second, a, b in rows(mesh_edges(fan))
        if (first, second) == (0, 1)
    ]
    assert shared == [(0, 1, 0, 1), (0, 1, 2, 3)] or shared == [(0, 1, 2, 3), (0, 1, 0, 1)]
    assert (1, 2, 0, 4) in rows(mesh_edges(fan))
    assert (0, 2, 4, 0) in rows(mesh_edges(fan))


def test_only_the_outline_of_a_closed_body_is_left() -> None:
    points = torch.tensor(
        [[-1.0, -1, 5], [1, -1, 5], [0, 1, 5], [0, 0, 4]], dtype=torch.float64
    )  # its tip towards the camera
    edges = mesh_edges(TETRAHEDRON)
    upper, lower, step = contour_edges(
        edges,
        project_triangles(
            points.numpy(), edges.columns, K.numpy(), near=None, cull_backfaces=False
        ),
    )
    assert {frozenset(pair) for pair in zip(upper.tolist(), lower.tolist(), strict=True)} == {
        frozenset(p) for p in ((0, 1), (1, 2), (2, 0))
    }
    assert set(np.abs(step).tolist()) == {2}  # of the face in front and the one behind


def test_edges_are_found_once_a_mesh_whatever_tensor_holds_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    first = mesh_edges(TETRAHEDRON)
    monkeypatch.setattr(edges_module, "_edges_of", lambda faces: pytest.fail("looked for again"))
    assert mesh_edges(TETRAHEDRON.clone()) is first


def test_faces_changed_in_place_are_another_mesh() -> None:
    faces = torch.tensor([[0, 1, 2]])
    points = torch.tensor([[-1.0, -1, 5], [1, -1, 5], [0, 1, 5], [-1, 1, 5]], dtype=torch.float64)
    before = silhouette(points, faces, K, (80, 100))
    faces[0, 2] = 3
    after = silhouette(points, faces, K, (80, 100))
    assert not torch.equal(before, after)
    assert torch.equal(after, silhouette(points, torch.tensor([[0, 1, 3]]), K, (80, 100)))


def test_few_meshes_are_remembered() -> None:
    for shift in range(2 * edges_module.KNOWN_MESHES):
        mesh_edges(TETRAHEDRON + shift)
    assert len(edges_module._known) == edges_module.KNOWN_MESHES
