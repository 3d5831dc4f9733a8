"""The body's axes by the configured rule; the default uses all of the trunk at once."""

from collections.abc import Mapping, Sequence
from functools import cache

import numpy as np
import torch
from torch import Tensor

from animal3dbox.geometry.arrays import AnyArray, as_numpy
from animal3dbox.geometry.rigid_transforms import nearest_rotation
from animal3dbox.labels.axes.landmarks import BodyAxes, landmark_axes
from animal3dbox.labels.axes.pca import pca_axes
from animal3dbox.labels.observation import Observation
from animal3dbox.smal.model import SmalModel
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped, preset_betas, quadruped_names

TRUNK = ("tail_base", "left_shoulder", "right_shoulder", "left_hip", "right_hip")
"""Landmarks that legs, head and tail do not move."""

NEAR_TRUNK = (
    *TRUNK,
    "withers",
    "left_front_elbow",
    "right_front_elbow",
    "left_back_knee",
    "right_back_knee",
    "neck",
)
"""For vocabularies that lack the trunk's own: these follow the legs and the neck a little."""


def body_axes(seen: Observation, axes: str) -> BodyAxes | None:
    """The axes of a body (section 2.1.1); None if nothing tells which way it points.

    See bodies_axes.
    """
    return bodies_axes([seen], axes)[0]


def bodies_axes(animals: Sequence[Observation], axes: str) -> list[BodyAxes | None]:
    """The axes of bodies (section 2.1.1); those on one template are found together.

    Args:
        animals: the animals.
        axes: "landmarks" and "pca" as published; "default": the torso's vertices against the
            template if there is one, else the trunk's landmarks together, whether seen in the image
            or not: the mesh knows its hidden ones.

    Returns:
        The axes of each and their rule, or None if nothing tells which way the body points.

    """
    found: list[BodyAxes | None] = [None] * len(animals)
    on_template: dict[SmalModel, dict[int, np.ndarray]] = {}
    for i, seen in enumerate(animals):
        if axes == "default" and seen.template is not None and seen.vertices is not None:
            on_template.setdefault(seen.template, {})[i] = seen.vertices
        else:
            found[i] = _axes_of_landmarks(seen, axes)
    for template, bodies in on_template.items():
        for i, R_box in zip(bodies, _torsos_axes(list(bodies.values()), template), strict=True):
            found[i] = BodyAxes(torch.from_numpy(R_box), "torso vertices on the template")
    return found


def _axes_of_landmarks(seen: Observation, axes: str) -> BodyAxes | None:
    """The axes of a body without a template, or by one of the published rules."""
    named = _named_landmarks(seen)
    if axes == "pca":
        points = (
            torch.from_numpy(seen.vertices)
            if seen.vertices is not None
            else torch.stack(list(named.values()))
        )
        return BodyAxes(pca_axes(points), "principal components")
    if axes == "landmarks":
        visible = seen.visible if seen.keypoints_2d is not None else seen.has_landmark
        flags = {
            name: bool(visible[i])
            for name in named
            if (i := seen.vocabulary.index_of(name)) is not None
        }
        return landmark_axes(named, flags)
    return trunk_axes(named)


def _named_landmarks(seen: Observation) -> dict[str, Tensor]:
    """Landmark name -> (3,) of those the body has.

    The first keypoint that can be read as a landmark is it.
    """
    if seen.landmarks is None:
        return {}
    named: dict[str, Tensor] = {}
    for point, known, names in zip(
        torch.from_numpy(seen.landmarks), seen.has_landmark, seen.vocabulary.landmarks, strict=True
    ):
        if known:
            for name in names:
                named.setdefault(name, point)
    return named


def torso_axes(vertices_world: AnyArray, template: SmalModel) -> AnyArray:
    """The rotation that best turns the template's torso onto this body's (Kabsch on the vertices the spine alone moves).

    Args:
        vertices_world: (V, 3) in correspondence with the template.
        template: whose own frame is forward, left, up.

    Returns:
        R_world_box (3, 3), float64.

    """
    R = _torsos_axes([as_numpy(vertices_world)], template)[0]
    axes: AnyArray = torch.from_numpy(R) if isinstance(vertices_world, Tensor) else R
    return axes


def _torsos_axes(bodies: Sequence[np.ndarray], template: SmalModel) -> np.ndarray:
    """torso_axes (B, 3, 3) of B bodies."""
    here = np.array([vertices.T.take(template.torso_ids, 1) for vertices in bodies])  # (B, 3, T)
    here -= here[
        :, :, :1
    ]  # near the origin, so that no digits cancel; the layout is about its mean, and so no shift counts
    return nearest_rotation(here @ template.torso_layout)


def trunk_axes(landmarks: Mapping[str, Tensor]) -> BodyAxes | None:
    """Axes from the trunk's landmarks together, by turning the embedded quadruped's onto them (Kabsch).

    Each preset is turned on its own and the rotations are averaged, so that no species' proportions
    decide.

    Args:
        landmarks: name -> (3,) in world.

    Returns:
        The axes and the landmarks used; None if those known do not span a plane.

    """
    for pool in (TRUNK, NEAR_TRUNK):
        names = tuple(name for name in pool if name in landmarks)
        if _tells_sides_and_ends(names):
            here = torch.stack([landmarks[name] for name in names])
            turns = [
                nearest_rotation((here - here.mean(0)).mT @ (there - there.mean(0)))
                for there in _reference_layouts(names)
            ]
            return BodyAxes(
                nearest_rotation(torch.stack(turns).sum(0)), f"trunk landmarks: {', '.join(names)}"
            )
    return landmark_axes(landmarks, dict.fromkeys(landmarks, True))


def _tells_sides_and_ends(names: tuple[str, ...]) -> bool:
    """Whether a pair says left from right, and something at the other end of the trunk front from
    back."""
    ends = {
        name: name.startswith(("tail", "left_hip", "right_hip", "left_back", "right_back"))
        for name in names
    }
    pairs = [
        name
        for name in names
        if name.startswith("left_") and name.replace("left_", "right_") in names
    ]
    return bool(pairs) and len(set(ends.values())) == 2


@cache
def _reference_layouts(names: tuple[str, ...]) -> tuple[Tensor, ...]:
    """The landmarks (N, 3) of each preset of the embedded quadruped, in the body frame."""
    model = load_quadruped()
    bodies = model.shaped(
        torch.stack([preset_betas(preset) for preset in quadruped_names().presets])
    )
    groups = model.landmark_groups
    return tuple(
        torch.stack([body[list(groups[name])].mean(0) for name in names]) for body in bodies
    )
