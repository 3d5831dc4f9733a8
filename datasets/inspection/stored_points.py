"""Stored keypoint_3d beside the posed bodies, and whether the named left is the animal's left."""

from collections import Counter
from collections.abc import Sequence

import numpy as np
import torch

from animal3dbox.datasets.inspection.animal3d_entries import points_of
from animal3dbox.datasets.inspection.fits import (
    LEAST,
    POINTS,
    TARGETS,
    Points,
    Subject,
    free_camera,
)
from animal3dbox.datasets.inspection.measures import extent, spread
from animal3dbox.datasets.inspection.result import CameraFit, SideFacts, StoredPoints
from animal3dbox.datasets.readers.animal3d.camera import FRAMES, SAME
from animal3dbox.geometry.rigid_transforms import nearest_rotation
from animal3dbox.smal.keypoints.smal_topology import misplaced_sides
from animal3dbox.smal.keypoints.vocabulary import Vocabulary
from animal3dbox.smal.model import SmalModel

ANIMALS = 400
"""Number of animals that are compared."""
FAR_BETTER = 0.5
"""Sides count as exchanged if their residual then is at most this part of the present one."""
FLAT = 0.05
"""Part of a cube that a trunk's axes must span for its sides to be told."""


def stored_points(subjects: Sequence[Subject], vocabulary: Vocabulary) -> StoredPoints | None:
    """The relations of stored keypoint_3d to the posed bodies' own; None if no animal has both."""
    relations, differences = Counter[str](), []
    for subject in spread(subjects, ANIMALS):
        points, own = points_of(subject.entry, "keypoint_3d"), subject.landmarks
        if points is None or own is None or points.shape != own.shape:
            continue
        on_body = np.asarray(np.isfinite(own).all(axis=1))
        relations[_relation(points, own, subject.trans, list(vocabulary.flip))] += 1
        off = _off(_centred(points[on_body]), _centred(own[on_body]))
        differences.append(100 * off / extent(own[on_body]))
    if not differences:
        return None
    return StoredPoints(
        len(differences), dict(relations.most_common()), float(f"{np.median(differences):.6g}")
    )


def _relation(points: Points, own: Points, trans: Points, flip: list[int]) -> str:
    """The first relation of StoredPoints that makes stored points a body's own.

    Args:
        points: (J, 3) as stored.
        own: (J, 3) of the posed body; NaN where it has none.
        trans: (3,) of the body.
        flip: keypoint -> its partner on the other side.

    """
    on_body = np.asarray(np.isfinite(own).all(axis=1))
    near = SAME * extent(own[on_body])
    target = _centred(own[on_body])
    if _off(points[on_body], own[on_body]) < near:
        return "same"
    if _off(points[on_body], own[on_body] - trans) < near:
        return "less trans"
    centred = _centred(points[on_body])
    if _off(centred, target) < near:
        return "shifted"
    if any(_off(_centred(points[on_body] * signs), target) < near for signs in FRAMES.values()):
        return "other frame"
    if _off(_centred(points[flip][on_body]), target) < near:
        return "sides exchanged"
    source = torch.from_numpy(centred)
    rotation = nearest_rotation(torch.from_numpy(target).mT @ source)
    rotated = (source @ rotation.mT).numpy()
    scale = float((rotated * target).sum() / max(float((rotated * rotated).sum()), 1e-300))
    return "turned or scaled" if scale > 0 and _off(scale * rotated, target) < near else "other"


def _centred(points: Points) -> Points:
    """Points (N, 3) about their mean."""
    return np.asarray(points - points.mean(axis=0))


def _off(a: Points, b: Points) -> float:
    """The greatest difference of a coordinate of points (N, 3)."""
    return float(np.abs(a - b).max())


def side_facts(
    subjects: Sequence[Subject],
    vocabulary: Vocabulary,
    best: CameraFit | None,
    model: SmalModel | None,
) -> SideFacts:
    """Count whether the named left is the animal's left.

    It is looked for on the model's template, in stored keypoint_3d, and in the images.

    Args:
        subjects: the animals.
        vocabulary: their keypoints.
        best: the camera that fits keypoint_2d best; None without.
        model: of the bodies; None without.

    """
    turns = Counter[int]()
    swapped = compared = 0
    for subject in spread(subjects, ANIMALS):
        points = points_of(subject.entry, "keypoint_3d")
        if points is not None and points.shape == (len(vocabulary), 3):
            turns[handedness(points, vocabulary)] += 1
        verdict = None if best is None else _swapped(subject, vocabulary, best)
        compared += verdict is not None
        swapped += bool(verdict)
    wrong = [] if model is None else list(misplaced_sides(model.v_template, model.landmarks))
    return SideFacts(
        template_wrong=wrong,
        left_is_left=turns[1],
        left_is_right=turns[-1],
        swapped_in_image=swapped,
        compared_in_image=compared,
    )


def handedness(points: Points, vocabulary: Vocabulary) -> int:
    """The side of forward and up on which a body's named left lies.

    Args:
        points: (J, 3) keypoints of the body.
        vocabulary: their names.

    Returns:
        1 to the left, -1 to the right, 0 if it cannot be told.

    """
    at = dict(zip(vocabulary.keypoints, points, strict=True))
    pairs = ("shoulder", "front_elbow", "back_knee", "front_paw", "back_paw")
    left = np.mean([at[f"left_{part}"] - at[f"right_{part}"] for part in pairs], axis=0)
    forward = at["neck"] - at["tail_base"]
    up = (at["neck"] + at["tail_base"]) / 2 - np.mean(
        [at[f"{side}_{end}_paw"] for side in ("left", "right") for end in ("front", "back")], axis=0
    )
    axes = np.stack((forward, left, up))
    lengths = np.maximum(np.linalg.norm(axes, axis=1, keepdims=True), 1e-12)
    volume = float(np.linalg.det(axes / lengths))
    return 0 if abs(volume) < FLAT else (1 if volume > 0 else -1)


def _swapped(subject: Subject, vocabulary: Vocabulary, best: CameraFit) -> bool | None:
    """Whether an animal's keypoints fit far better with their sides exchanged.

    None if they cannot be compared.
    """
    points, marks = POINTS[best.points](subject), TARGETS["keypoint_2d"](subject)
    if points is None or marks is None or len(points) != len(marks):
        return None
    points_cam = points * FRAMES[best.frame]
    misfit, exchanged = (
        _misfit(points_cam, marks),
        _misfit(points_cam, marks[list(vocabulary.flip)]),
    )
    return None if misfit is None or exchanged is None else exchanged < FAR_BETTER * misfit


def _misfit(points_cam: Points, marks: Points) -> float | None:
    """Median distance in px of points (J, 3) from marks (J, 2) under their best camera.

    None if they are too few, or no camera fits them.
    """
    both = np.isfinite(points_cam).all(axis=1) & np.isfinite(marks).all(axis=1)
    camera = free_camera(points_cam[both], marks[both]) if both.sum() >= LEAST else None
    if camera is None:
        return None
    focal, center, plane = camera
    return float(np.median(np.linalg.norm(focal * plane + center - marks[both], axis=1)))
