"""Meshes with SMAL's counts and landmark ids, made of our own quadruped: no data of SMAL's."""

from functools import cache

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from animal3dbox.smal.keypoints.smal_topology import (
    SMAL_EXTRA_LANDMARKS,
    SMAL_LANDMARKS,
    SMAL_VERTICES,
)
from animal3dbox.smal.quadruped.poses import named_pose
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped, preset_betas


def smal_like_mesh(preset: str = "dog", pose: str = "stand") -> tuple[Tensor, Tensor]:
    """A posed quadruped of SMAL's 3889 vertices and 7774 faces.

    Its vertices lie in an order in which SMAL's landmark ids are at the landmarks of their names.

    Returns:
        vertices (3889, 3) and faces (7774, 3).

    """
    body = load_quadruped().posed(
        preset_betas(preset)[None], named_pose(pose)[None], torch.zeros(1, 3, dtype=torch.float64)
    )
    order, faces = order_and_faces()
    return body.vertices[0][torch.from_numpy(order)], torch.from_numpy(faces)


@cache
def order_and_faces() -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The quadruped's vertex that each of SMAL's is, (3889,), and the faces (7774, 3)."""
    model = load_quadruped()
    template = model.v_template.numpy()
    kept, faces = _collapsed(template, model.faces.numpy(), SMAL_VERTICES)
    free, order = set(kept), np.full(SMAL_VERTICES, -1)
    for name, ids in {**SMAL_LANDMARKS, **SMAL_EXTRA_LANDMARKS}.items():
        place = _place(name)
        near = sorted(free, key=lambda v: float(((template[v] - place) ** 2).sum()))
        order[list(ids)] = near[: len(ids)]
        free -= set(near[: len(ids)])
    rest = np.random.default_rng(0).permutation(sorted(free))
    order[order < 0] = rest
    new_number = np.full(len(template), -1)
    new_number[order] = np.arange(SMAL_VERTICES)
    return order, new_number[faces]


def _place(name: str) -> NDArray[np.float64]:
    """Where SMAL has a landmark on the template: its shoulders are as high as the tail's base."""
    model = load_quadruped()
    template = model.v_template.numpy()
    groups = {**model.landmarks, **model.extra_landmarks}
    place = template[list(groups[name])].mean(0)
    if "shoulder" in name:
        place[2] = template[list(groups["tail_base"]), 2].mean()
    return np.asarray(place)


def _collapsed(
    vertices: NDArray[np.float64], faces: NDArray[np.int64], count: int
) -> tuple[list[int], NDArray[np.int64]]:
    """A closed mesh with count of its vertices: the shortest edges are drawn together.

    Returns:
        The vertices that are left, and faces (2 count - 4, 3) of the old numbers.

    """
    star: dict[int, set[tuple[int, ...]]] = {v: set() for v in range(len(vertices))}
    for face in faces.tolist():
        for v in face:
            star[v].add(tuple(face))
    edges = np.unique(np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1), axis=0)
    lengths = np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1)
    for keep, drop in edges[np.argsort(lengths)].tolist():
        if len(star) == count:
            break
        if keep not in star or drop not in star:
            continue
        if _may_be_drawn_together(star, keep, drop):
            _draw_together(star, keep, drop)
    left = {face for some in star.values() for face in some}
    return sorted(star), np.array(sorted(left))


def _may_be_drawn_together(star: dict[int, set[tuple[int, ...]]], keep: int, drop: int) -> bool:
    """Whether two vertices are neighbours, and the mesh stays closed without their edge."""
    rings = [{v for face in star[end] for v in face} for end in (keep, drop)]
    shared = (rings[0] & rings[1]) - {keep, drop}
    return drop in rings[0] and len(shared) == 2 and min(len(star[v]) for v in shared) >= 5


def _draw_together(star: dict[int, set[tuple[int, ...]]], keep: int, drop: int) -> None:
    """Put one vertex in another's place; the two triangles between them vanish."""
    for face in list(star.pop(drop)):
        moved = tuple(keep if v == drop else v for v in face)
        for v in face:
            star.get(v, set()).discard(face)
        if keep not in face:
            for v in moved:
                star[v].add(moved)
