"""The body's axes by the configured rule; the default uses all of the trunk at once."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from animal3dbox.geometry.arrays import as_numpy
from animal3dbox.geometry.orthogonal_frames import frame_from_directions
from animal3dbox.geometry.rigid_transforms import nearest_rotation, rotation_angle
from animal3dbox.labels.axes.landmarks import landmark_axes
from animal3dbox.labels.axes.pca import pca_axes
from animal3dbox.labels.axes.section_axes import section_axes, shipped_weights
from animal3dbox.labels.axes.trunk_line import (
    LineAxes,
    line_axes,
    line_facts,
    pitch_between,
    pitched,
    trunk_ends,
)
from animal3dbox.labels.config import Axes
from animal3dbox.labels.observation import Observation
from animal3dbox.smal.model import SmalModel

Array = NDArray[np.float64]
Faces = NDArray[np.int64]
DISAGREEMENT_DEG = 10.0
"""Angle between the axes of landmarks and those of sections from which a label warns."""
LINE_YAW_SHARE, LINE_ROLL_SHARE = 0.3, 0.4
"""How much the line's yaw, of trunks that are bent, and the roll of its pairs count beside those of
the sections."""
FOREIGN_BODIES = 1.3
"""How much larger the error of sections is taken to be than on the bodies that their weights were
learned from."""
PLACEMENT_SD_DEG = 1.5
"""Standard deviation of a dataset's pitch as calibration finds it."""


LEAST_TORSO = 0.5
"""A body with a smaller part of its template's torso vertices than this gets its axes from
landmarks."""


class BodyAxes(NamedTuple):
    """The axes of a body, and how they came about.

    Attributes:
        R_box: (3, 3) R_world_box, columns forward, left, up.
        rule: what gave them, for the record.
        warnings: in whole sentences.
        calibration: digest of the calibration that had a part in them; None without.
    """

    R_box: Array
    rule: str
    warnings: tuple[str, ...] = ()
    calibration: str | None = None


def body_axes(observations: Sequence[Observation], axes: Axes) -> list[BodyAxes | None]:
    """The axes of bodies (section 2.1.1); those on one template are found together.

    Args:
        observations: the animals.
        axes: "landmarks" and "pca" as published; "default": the torso's vertices against the
            template if there is one, else the trunk's landmarks, whether seen in the image or not
            (the mesh knows its hidden ones), with sections across the trunk's surface.

    Returns:
        The axes of each, or None if nothing tells which way the body points.

    """
    results: list[BodyAxes | None] = [None] * len(observations)
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
            results[i] = BodyAxes(R_box, "torso vertices on the template")
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


def trunk_axes(landmarks: Mapping[str, Array]) -> tuple[Array, str] | None:
    """Axes from the trunk's landmarks alone: forward along a line, left by all pairs together.

    x runs along the first line of trunk_line.LINES that the landmarks allow, turned by the pitch
    that the line has on the mean of species; no single body's constellation is laid over them.

    Args:
        landmarks: name -> (3,) in world.

    Returns:
        R_world_box (3, 3) and the landmarks used; None if those known do not fix forward and left.

    Example:
        >>> import numpy as np
        >>> from animal3dbox.labels import trunk_axes
        >>> from animal3dbox.smal import load_quadruped
        >>> model = load_quadruped()
        >>> known = "tail_base", "left_shoulder_blade", "right_shoulder_blade"
        >>> vertices = model.v_template.numpy()
        >>> groups = model.landmark_groups
        >>> landmarks = {name: vertices[list(groups[name])].mean(axis=0) for name in known}
        >>> R, rule = trunk_axes(landmarks)
        >>> bool(np.degrees(np.arccos((np.trace(R) - 1) / 2)) < 3)
        True
    """
    axes = line_axes(landmarks)
    if axes is None:
        return landmark_axes(landmarks, dict.fromkeys(landmarks, True))
    return pitched(axes.R_box, -line_facts(axes.line).pitch_deg), _line_rule(axes)


def trunk_pitch(
    landmarks: Mapping[str, Array], vertices: Array | None, faces: Faces | None
) -> float | None:
    """Degrees by which the line of a body's landmarks rises above its trunk, as its surface tells.

    What calibration learns for a dataset; None if the surface does not tell.
    """
    axes = line_axes(landmarks)
    sections = None if axes is None else _axes_of_sections(landmarks, vertices, faces, axes)
    return None if axes is None or sections is None else pitch_between(sections, axes.R_box)


def _axes_of_landmarks(observation: Observation, axes: Axes) -> BodyAxes | None:
    """The axes of a body without a template, or by one of the published rules."""
    landmarks = named_landmarks(observation)
    if axes == "pca":
        vertices = observation.body.vertices
        points = np.stack(list(landmarks.values())) if vertices is None else vertices
        return BodyAxes(pca_axes(points), "principal components")
    if axes == "default":
        return _axes_of_trunk(observation, landmarks)
    has_keypoints = observation.keypoints_2d is not None
    visible = observation.visible if has_keypoints else observation.has_landmark
    rows = {name: observation.vocabulary.index_of(name) for name in landmarks}
    flags = {name: bool(visible[row]) for name, row in rows.items() if row is not None}
    return _plain_axes(landmark_axes(landmarks, flags))


def _axes_of_part(
    observation: Observation, template: SmalModel, vertex_ids: NDArray[np.intp]
) -> BodyAxes | None:
    """The axes of a body that lacks some of its template's vertices: by those of its torso left."""
    left = np.isin(vertex_ids, template.torso_ids)
    layout = as_numpy(template.v_template)[vertex_ids[left]].astype(np.float64)
    if len(layout) < LEAST_TORSO * len(template.torso_ids):
        return _axes_of_landmarks(observation, "default")
    torso = observation.body.vertices[left]
    about: Array = (torso - torso[0]).T @ (layout - layout.mean(0))
    return BodyAxes(nearest_rotation(about), "torso vertices on the template")


def _plain_axes(axes_and_rule: tuple[Array, str] | None) -> BodyAxes | None:
    return None if axes_and_rule is None else BodyAxes(*axes_and_rule)


def _axes_of_trunk(observation: Observation, landmarks: Mapping[str, Array]) -> BodyAxes | None:
    """The axes of the trunk's line and of its sections together.

    The line's pitch is what the dataset's calibration says, or the mean of species.
    """
    line = line_axes(landmarks)
    if line is None:
        return _plain_axes(trunk_axes(landmarks))
    facts, rule, digest = line_facts(line.line), _line_rule(line), None
    rises_deg, spread_deg = facts.pitch_deg, facts.sd_deg
    calibration = observation.calibration
    if calibration is not None:
        names = observation.vocabulary.name, observation.species, line.line.name
        placement = calibration.pitch_deg(*names)
        if placement is not None:
            rises_deg, digest = placement, calibration.digest
            spread_deg = float(np.hypot(facts.sd_within_deg, PLACEMENT_SD_DEG))
            rule += f", which rises by {placement:g} degrees in this dataset"
    of_line, body = pitched(line.R_box, -rises_deg), observation.body
    sections = _axes_of_sections(landmarks, body.vertices, body.faces, line)
    if sections is None:
        return BodyAxes(of_line, rule, (), digest)
    off_deg = _angle_deg(of_line, sections)
    warnings = () if off_deg <= DISAGREEMENT_DEG else (_disagreement(off_deg),)
    R_box = _mixed_axes(of_line, sections, spread_deg)
    return BodyAxes(R_box, f"{rule}; sections of the trunk", warnings, digest)


def _mixed_axes(of_line: Array, of_sections: Array, spread_deg: float) -> Array:
    """Axes between those of a line and those of sections, (3, 3) each.

    Yaw and roll are shared by LINE_YAW_SHARE and LINE_ROLL_SHARE. Pitches are weighed by inverse
    variances, of which the line's is given as a standard deviation.
    """
    of_sections_deg = FOREIGN_BODIES * shipped_weights().sd_deg
    share = 1 / (1 + (spread_deg / of_sections_deg) ** 2)
    forward = of_line[:, 0] @ of_sections
    yaw = LINE_YAW_SHARE * np.arctan2(forward[1], forward[0])
    turned = frame_from_directions(
        of_sections[:, 0] + np.tan(yaw) * of_sections[:, 1],
        of_sections[:, 1] + LINE_ROLL_SHARE * (of_line[:, 1] - of_sections[:, 1]),
    )
    R_box = of_sections if turned is None else turned
    return pitched(R_box, share * pitch_between(of_sections, of_line))


def _axes_of_sections(
    landmarks: Mapping[str, Array],
    vertices: Array | None,
    faces: Faces | None,
    line: LineAxes,
) -> Array | None:
    """The axes (3, 3) that a body's surface tells, begun with those of its landmarks."""
    ends = trunk_ends(landmarks)
    if vertices is None or faces is None or ends is None:
        return None
    start = pitched(line.R_box, -line_facts(line.line).pitch_deg)
    return section_axes(vertices, faces, start=start, ends=ends)


def _disagreement(off_deg: float) -> str:
    return (
        f"The trunk's surface and its landmarks disagree by {off_deg:.0f} degrees about the body's"
        " axes: check that the landmarks belong to the mesh and lie where their names say."
    )


def _angle_deg(a: Array, b: Array) -> float:
    """The angle between two frames (3, 3)."""
    return float(torch.rad2deg(rotation_angle(torch.from_numpy(a), torch.from_numpy(b))))


def _line_rule(axes: LineAxes) -> str:
    """The rule of a line and its pairs, for the record."""
    return f"trunk line: {axes.line.name}; left by {', '.join(axes.pairs)}"


def named_landmarks(observation: Observation) -> dict[str, Array]:
    """Landmark name -> (3,) in world, of those that an animal's body has.

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
