"""The body's axes by the configured rule; the default uses all of the trunk at once."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from animal3dbox.geometry.arrays import as_numpy
from animal3dbox.geometry.orthogonal_frames import mean_alignment
from animal3dbox.geometry.rigid_transforms import nearest_rotation
from animal3dbox.labels.axes.landmarks import landmark_axes
from animal3dbox.labels.axes.pca import pca_axes
from animal3dbox.labels.config import Axes
from animal3dbox.labels.observation import Observation
from animal3dbox.smal.model import SmalModel
from animal3dbox.smal.quadruped.preset_bodies import preset_landmarks

Array = NDArray[np.float64]
AxesAndRule = tuple[Array, str]
"""R_world_box (3, 3), columns forward, left, up, and the rule that gave it, for the record."""

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


LEAST_TORSO = 0.5
"""A body with a smaller part of its template's torso vertices than this gets its axes from
landmarks."""


def body_axes(observations: Sequence[Observation], axes: Axes) -> list[AxesAndRule | None]:
    """The axes of bodies (section 2.1.1); those on one template are found together.

    Args:
        observations: the animals.
        axes: "landmarks" and "pca" as published; "default": the torso's vertices against the
            template if there is one, else the trunk's landmarks together, whether seen in the image
            or not: the mesh knows its hidden ones.

    Returns:
        The axes of each and their rule, or None if nothing tells which way the body points.

    """
    results: list[AxesAndRule | None] = [None] * len(observations)
    on_template: dict[SmalModel, dict[int, Array]] = {}
    for i, observation in enumerate(observations):
        body = observation.body
        if axes == "default" and body.template is not None and body.vertices is not None:
            if observation.vertex_ids is None:
                on_template.setdefault(body.template, {})[i] = body.vertices
            else:
                results[i] = _axes_of_part(observation, body.template, observation.vertex_ids)
        else:
            results[i] = _axes_of_landmarks(observation, axes)
    for template, bodies in on_template.items():
        rotations = _torsos_axes(list(bodies.values()), template)
        for i, R_box in zip(bodies, rotations, strict=True):
            results[i] = R_box, "torso vertices on the template"
    return results


def torso_axes(vertices_world: Array, template: SmalModel) -> Array:
    """The rotation that best turns the template's torso onto this body's.

    Kabsch's algorithm on the vertices that the spine alone moves.

    Args:
        vertices_world: (V, 3) in correspondence with the template.
        template: whose own frame is forward, left, up.

    Returns:
        R_world_box (3, 3), float64.

    Example:
        >>> from animal3dbox.labels import torso_axes
        >>> from animal3dbox.smal import load_quadruped
        >>> model = load_quadruped()
        >>> torso_axes(model.v_template.numpy(), model).round(6) + 0.0
        array([[1., 0., 0.],
               [0., 1., 0.],
               [0., 0., 1.]])
    """
    R_box: Array = _torsos_axes([as_numpy(vertices_world)], template)[0]
    return R_box


def trunk_axes(landmarks: Mapping[str, Array]) -> AxesAndRule | None:
    """Axes from the trunk's landmarks together, by turning the embedded quadruped's onto them.

    Each preset is turned on its own (Kabsch's algorithm) and the rotations are averaged, so that no
    species' proportions decide.

    Args:
        landmarks: name -> (3,) in world.

    Returns:
        The axes and the landmarks used; None if those known do not span a plane.

    Example:
        >>> import numpy as np
        >>> from animal3dbox.labels import trunk_axes
        >>> from animal3dbox.smal import load_quadruped
        >>> model = load_quadruped()
        >>> known = "tail_base", "withers", "left_shoulder", "right_shoulder"
        >>> vertices = model.v_template.numpy()
        >>> groups = model.landmark_groups
        >>> landmarks = {name: vertices[list(groups[name])].mean(axis=0) for name in known}
        >>> R, rule = trunk_axes(landmarks)
        >>> bool(np.degrees(np.arccos((np.trace(R) - 1) / 2)) < 15)
        True
    """
    for pool in (TRUNK, NEAR_TRUNK):
        names = tuple(name for name in pool if name in landmarks)
        if _tells_sides_and_ends(names):
            places = np.stack([landmarks[name] for name in names])
            R_box = mean_alignment(places, preset_landmarks(names))
            return R_box, f"trunk landmarks: {', '.join(names)}"
    return landmark_axes(landmarks, dict.fromkeys(landmarks, True))


def _axes_of_landmarks(observation: Observation, axes: Axes) -> AxesAndRule | None:
    """The axes of a body without a template, or by one of the published rules."""
    landmarks = _named_landmarks(observation)
    if axes == "pca":
        vertices = observation.body.vertices
        points = np.stack(list(landmarks.values())) if vertices is None else vertices
        return pca_axes(points), "principal components"
    if axes == "landmarks":
        has_keypoints = observation.keypoints_2d is not None
        visible = observation.visible if has_keypoints else observation.has_landmark
        rows = {name: observation.vocabulary.index_of(name) for name in landmarks}
        flags = {name: bool(visible[row]) for name, row in rows.items() if row is not None}
        return landmark_axes(landmarks, flags)
    return trunk_axes(landmarks)


def _axes_of_part(
    observation: Observation, template: SmalModel, vertex_ids: NDArray[np.intp]
) -> AxesAndRule | None:
    """The axes of a body that lacks some of its template's vertices: by those of its torso left."""
    left = np.isin(vertex_ids, template.torso_ids)
    layout = as_numpy(template.v_template)[vertex_ids[left]].astype(np.float64)
    if len(layout) < LEAST_TORSO * len(template.torso_ids):
        return _axes_of_landmarks(observation, "default")
    torso = observation.body.vertices[left]
    about: Array = (torso - torso[0]).T @ (layout - layout.mean(0))
    return nearest_rotation(about), "torso vertices on the template"


def _named_landmarks(observation: Observation) -> dict[str, Array]:
    """Landmark name -> (3,) of those the body has.

    The first keypoint that can be read as a landmark is it.
    """
    if observation.body.landmarks is None:
        return {}
    places: dict[str, Array] = {}
    for place, known, names in zip(
        observation.body.landmarks,
        observation.has_landmark,
        observation.vocabulary.landmarks,
        strict=True,
    ):
        if known:
            for name in names:
                places.setdefault(name, place)
    return places


def _torsos_axes(bodies: Sequence[Array], template: SmalModel) -> Array:
    """The rotations (B, 3, 3) of torso_axes, of B bodies."""
    torsos = np.array([vertices.T.take(template.torso_ids, 1) for vertices in bodies])  # (B, 3, T)
    # Near the origin no digits cancel; the layout is about its mean, and so no shift counts.
    torsos -= torsos[:, :, :1]
    return nearest_rotation(torsos @ template.torso_layout)


def _tells_sides_and_ends(names: tuple[str, ...]) -> bool:
    """Whether landmarks tell left from right, by a pair, and front from back, by both ends."""
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
