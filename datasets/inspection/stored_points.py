"""Stored keypoint_3d against the posed bodies, and whether left is left."""

from collections import Counter
from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray

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
"""So many animals are compared."""
FAR_BETTER = 0.5
"""Sides count as exchanged if the other labelling's residual is at most so many times this one's.
"""
FLAT = 0.05
"""A trunk whose axes span less than this part of a cube does not tell its sides."""


def stored_points(subjects: Sequence[Subject], words: Vocabulary) -> StoredPoints | None:
    """How stored keypoint_3d relate to the posed bodies' own; None if no animal has both."""
    relations, differences = Counter[str](), []
    for subject in spread(subjects, ANIMALS):
        stored = points_of(subject.entry, "keypoint_3d")
        if stored is None or subject.landmarks is None or stored.shape != subject.landmarks.shape:
            continue
        known = np.asarray(np.isfinite(subject.landmarks).all(axis=1))
        own, size = subject.landmarks, extent(subject.landmarks[known])
        relations[_relation(stored, own, subject.trans, known, list(words.flip))] += 1
        differences.append(100 * _off(_centred(stored, known), _centred(own, known)) / size)
    if not differences:
        return None
    return StoredPoints(
        len(differences), dict(relations.most_common()), float(f"{np.median(differences):.6g}")
    )


def _relation(
    stored: Points, own: Points, trans: Points, known: NDArray[np.bool_], flip: list[int]
) -> str:
    """The first thing that makes stored points (J, 3) a body's own."""
    near = SAME * extent(own[known])
    here = _centred(own, known)
    if _off(stored[known], own[known]) < near:
        return "same"
    if _off(stored[known], own[known] - trans) < near:
        return "less trans"
    if _off(_centred(stored, known), here) < near:
        return "shifted"
    if any(_off(_centred(stored * signs, known), here) < near for signs in FRAMES.values()):
        return "other frame"
    if _off(_centred(stored[flip], known), here) < near:
        return "sides exchanged"
    there = torch.from_numpy(_centred(stored, known))
    turned = (there @ nearest_rotation(torch.from_numpy(here).mT @ there).mT).numpy()
    scale = float((turned * here).sum() / max(float((turned * turned).sum()), 1e-300))
    return "turned or scaled" if scale > 0 and _off(scale * turned, here) < near else "other"


def _centred(points: Points, known: NDArray[np.bool_]) -> Points:
    return np.asarray(points[known] - points[known].mean(axis=0))


def _off(a: Points, b: Points) -> float:
    return float(np.abs(a - b).max())


def side_facts(
    subjects: Sequence[Subject], words: Vocabulary, best: CameraFit | None, model: SmalModel | None
) -> SideFacts:
    """Whether left is left.

    On the model's template, in stored keypoint_3d, and in the image under the best camera of
    keypoint_2d.
    """
    turns = Counter[int]()
    swapped = compared = 0
    for subject in spread(subjects, ANIMALS):
        stored = points_of(subject.entry, "keypoint_3d")
        if stored is not None and stored.shape == (len(words), 3):
            turns[handedness(stored, words)] += 1
        verdict = None if best is None else _swapped(subject, words, best)
        compared += verdict is not None
        swapped += bool(verdict)
    wrong = [] if model is None else list(misplaced_sides(model.v_template, model.landmarks))
    return SideFacts(wrong, turns[1], turns[-1], swapped, compared)


def handedness(points: Points, words: Vocabulary) -> int:
    """1 if a body's (J, 3) named left lies to the left of forward and up, -1 if to the right, 0 if
    that cannot be told."""
    at = dict(zip(words.keypoints, points, strict=True))
    pairs = ("shoulder", "front_elbow", "back_knee", "front_paw", "back_paw")
    left = np.mean([at[f"left_{part}"] - at[f"right_{part}"] for part in pairs], axis=0)
    forward = at["neck"] - at["tail_base"]
    up = (at["neck"] + at["tail_base"]) / 2 - np.mean(
        [at[f"{side}_{end}_paw"] for side in ("left", "right") for end in ("front", "back")], axis=0
    )
    axes = np.stack((forward, left, up))
    volume = float(
        np.linalg.det(axes / np.maximum(np.linalg.norm(axes, axis=1, keepdims=True), 1e-12))
    )
    return 0 if abs(volume) < FLAT else (1 if volume > 0 else -1)


def _swapped(subject: Subject, words: Vocabulary, best: CameraFit) -> bool | None:
    """Whether an animal's keypoints fit far better with their sides exchanged.

    None if they cannot be compared.
    """
    points, marks = POINTS[best.points](subject), TARGETS["keypoint_2d"](subject)
    if points is None or marks is None or len(points) != len(marks):
        return None
    here, there = (
        _misfit(points * FRAMES[best.frame], labels) for labels in (marks, marks[list(words.flip)])
    )
    return None if here is None or there is None else there < FAR_BETTER * here


def _misfit(points_cam: Points, marks: Points) -> float | None:
    both = np.isfinite(points_cam).all(axis=1) & np.isfinite(marks).all(axis=1)
    fitted = free_camera(points_cam[both], marks[both]) if both.sum() >= LEAST else None
    if fitted is None:
        return None
    focal, center, plane = fitted
    return float(np.median(np.linalg.norm(focal * plane + center - marks[both], axis=1)))
