"""One animal as it comes in, checked.

Every fault is an error that names the sample and the field.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from animal3dbox.geometry.arrays import as_numpy
from animal3dbox.geometry.camera import intrinsics
from animal3dbox.geometry.checks import check_intrinsics
from animal3dbox.geometry.distortion import check_distortion
from animal3dbox.geometry.used_vertices import used_vertices
from animal3dbox.labels.argument_checks import ArgumentChecks
from animal3dbox.labels.body import Array, ArrayLike, Body
from animal3dbox.labels.calibration import Calibration, calibration_of
from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.fit_parameters import FitParameters
from animal3dbox.labels.loose_vertices import without_loose_vertices
from animal3dbox.labels.mesh_landmarks import SMAL_NOTE, template_landmarks, topology_landmarks
from animal3dbox.labels.pose.problem import PoseEstimate
from animal3dbox.smal.keypoints.vocabularies import find_vocabulary
from animal3dbox.smal.keypoints.vocabulary import Vocabulary

LEAST_FOCAL = 0.05
"""Of the longer side of the image: a field of view of 169 degrees."""
LEAST_VERTICES = 4
"""Fewer points than this enclose nothing."""


@dataclass(frozen=True)
class Observation:
    """One animal and its picture, checked: arrays in float64, which nothing may write to.

    Attributes:
        sample_id: named in every error.
        image_hw: height and width.
        vocabulary: what the keypoints are.
        keypoints_2d: (J, 3) x, y, confidence; x = y = 0 and confidence 0 where missing; None
            without keypoints.
        body: the animal's body, in world, its vertices coordinate by coordinate in memory; only
            those that some face uses.
        vertex_ids: (V,) the template's vertex that each of the body's is; None: they are all there,
            in the template's order.
        K: (3, 3).
        K_source: "given" or "guessed"; "estimated" once the focal length has been.
        pose: the camera's, known exactly, or None.
        hypotheses: poses to try.
        mask: (H, W) bool, or None.
        distortion: the lens's coefficients, or None for a pinhole.
        warnings: what a careful person should know of the input, in whole sentences.
        image: names the picture among those labelled together: its animals share a focal length;
            None: it shows this animal alone.
        log_focal_sd: standard deviation of the natural logarithm of an estimated focal length.
        down_cam: (3,) unit, gravity in the camera frame; None: not known.
        species: the animal's category, by which a calibration tells animals apart; None if unknown.
        calibration: what its dataset taught; None if nothing was asked for.
        body_source: see Quality.body.
        fit: the parameters of a body that was fitted to the picture; None of any other.
        body_calibration: digest of the calibration that had a part in a fitted body; None without.
    """

    sample_id: str | None
    image_hw: tuple[int, int]
    vocabulary: Vocabulary
    keypoints_2d: Array | None
    body: Body
    K: Array
    K_source: str
    pose: PoseEstimate | None
    hypotheses: tuple[PoseEstimate, ...]
    mask: NDArray[np.bool_] | None
    distortion: Array | None
    warnings: tuple[str, ...]
    image: str | None = None
    log_focal_sd: float | None = None
    down_cam: Array | None = None
    vertex_ids: NDArray[np.intp] | None = None
    species: str | None = None
    calibration: Calibration | None = None
    body_source: str = "given"
    fit: FitParameters | None = None
    body_calibration: str | None = None

    @property
    def camera_is_known(self) -> bool:
        """Whether the camera's pose was given exactly, not fitted with the body."""
        return self.pose is not None and self.pose.evidence is None

    @cached_property
    def has_landmark(self) -> NDArray[np.bool_]:
        """Which keypoints have a landmark on the body, (J,)."""
        if self.body.landmarks is None:
            return np.zeros(len(self.vocabulary), dtype=np.bool_)
        known: NDArray[np.bool_] = np.isfinite(self.body.landmarks).all(1)
        return known

    @property
    def visible(self) -> NDArray[np.bool_]:
        """Which keypoints are seen, (J,)."""
        if self.keypoints_2d is None:
            return np.zeros(len(self.vocabulary), dtype=np.bool_)
        return self.keypoints_2d[:, 2] > 0

    @property
    def matched(self) -> NDArray[np.bool_]:
        """Which keypoints are seen and have a landmark on the body, (J,)."""
        return self.visible & self.has_landmark

    @property
    def known_landmarks(self) -> Array:
        """The landmarks that the body has, (N, 3) world."""
        landmarks = self.body.landmarks
        return np.zeros((0, 3)) if landmarks is None else landmarks[self.has_landmark]


def observe(
    *,
    image_hw: tuple[int, int],
    body: Body,
    keypoints_2d: ArrayLike = None,
    K: ArrayLike = None,
    pose: ArrayLike = None,
    pose_hypotheses: Sequence[ArrayLike] = (),
    mask: ArrayLike = None,
    vocabulary: str | Vocabulary = "animal3d26",
    distortion: ArrayLike = None,
    down_cam: ArrayLike = None,
    image: str | None = None,
    sample_id: str | None = None,
    species: str | None = None,
    calibration: Calibration | Path | str | None = None,
    config: LabelConfig,
) -> Observation:
    """Check the arguments of label_animal, which see.

    Raises:
        SampleError: naming the sample, the argument, what is wrong and the remedy.
        ConfigError: the vocabulary is not known, or the calibration's file is none.

    """
    checks, words = ArgumentChecks(sample_id), find_vocabulary(vocabulary)
    size = checks.image_hw(image_hw)
    checked, vertex_ids = _checked_body(checks, body, words)
    keypoints, warnings = (
        (None, [])
        if keypoints_2d is None
        else checks.keypoints(keypoints_2d, len(words), words.name, size)
    )
    matrix = checked_intrinsics(checks, K, size, config)
    return Observation(
        sample_id=sample_id,
        image_hw=size,
        vocabulary=words,
        keypoints_2d=keypoints,
        K=matrix,
        K_source="guessed" if K is None else "given",
        distortion=_checked_lens(checks, distortion),
        body=checked,
        vertex_ids=vertex_ids,
        pose=None if pose is None else checks.pose("pose", pose, "given"),
        hypotheses=tuple(
            checks.pose(f"pose_hypotheses[{i}]", hypothesis, f"hypothesis_{i}")
            for i, hypothesis in enumerate(pose_hypotheses)
        ),
        mask=None if mask is None else checks.mask(mask, size),
        image=image,
        down_cam=checks.down(down_cam),
        warnings=(*warnings, *checked.notes, *words.notes),
        species=species,
        calibration=calibration_of(calibration),
    )


def _checked_lens(checks: ArgumentChecks, distortion: ArrayLike) -> Array | None:
    """The coefficients of the lens; None for a pinhole."""
    if distortion is None:
        return None
    lens = checks.array("distortion", distortion, "N")
    checks.check(check_distortion, "distortion", lens)
    return lens


def _checked_body(
    checks: ArgumentChecks, body: Body, words: Vocabulary
) -> tuple[Body, NDArray[np.intp] | None]:
    """The body with its arrays checked, without the vertices that no face uses.

    Returns:
        The body, and the numbers that its vertices had; None if none was left out.

    """
    vertices, sigma, faces = _checked_vertices(checks, body), body.landmark_sigma, None
    if body.faces is not None and vertices is not None:
        faces = checks.faces(body.faces, len(vertices), body.template)
    used = None if vertices is None else _used(body, faces, len(vertices))
    landmarks, notes = _landmarks(checks, body, words, vertices=vertices, faces=faces, used=used)
    whole = Body(
        vertices=vertices,
        landmarks=landmarks,
        landmark_sigma=None if sigma is None else checks.sigma(sigma, words),
        faces=faces,
        template=body.template,
        notes=(*body.notes, *notes),
    )
    surface = without_loose_vertices(whole, used)
    if used is None or surface.vertex_ids is None:
        return whole, None
    if len(surface.vertex_ids) < LEAST_VERTICES:
        raise checks.fail(
            "faces",
            f"use {len(surface.vertex_ids)} of the {len(used)} vertices, which is no body: give all"
            " of its triangles, or none",
        )
    note = f"{np.count_nonzero(~used)} of {len(used)} vertices count for nothing: no face uses them"
    return replace(surface.body, notes=(*whole.notes, note)), surface.vertex_ids


def _used(body: Body, faces: Tensor | None, count: int) -> NDArray[np.bool_] | None:
    """Which vertices (V,) count: those that a face uses, of the template's where none are given.

    None if all do.
    """
    template = body.template
    if template is not None and (faces is None or faces is template.faces):
        return template.used_vertices  # looked for once a model
    return used_vertices(faces, count)


def checked_intrinsics(
    checks: ArgumentChecks, K: ArrayLike, image_hw: tuple[int, int], config: LabelConfig
) -> Array:
    """The intrinsics (3, 3) as given, or guessed from the longer side of the image."""
    longer = max(image_hw)
    if K is None:
        matrix: Array = as_numpy(intrinsics(config.focal_guess * longer, image_hw))
    else:
        matrix = checks.array("K", K, "3 3")
    checks.check(check_intrinsics, "K", matrix)
    if min(matrix[0, 0], matrix[1, 1]) < LEAST_FOCAL * longer:
        raise checks.fail(
            "K",
            f"has focal lengths of {matrix[0, 0]:.3g} and {matrix[1, 1]:.3g} px for"
            f" {image_hw[1]} x {image_hw[0]} px, as no lens has: is it normalised? Multiply its"
            " first row by the width and its second by the height",
        )
    return matrix


def _checked_vertices(checks: ArgumentChecks, body: Body) -> Array | None:
    """The vertices (V, 3) of a body, coordinate by coordinate in memory; None without any."""
    vertices = None
    if body.vertices is not None:
        vertices = np.asfortranarray(checks.finite("vertices", body.vertices, "V 3"))
    if vertices is None and body.landmarks is None:
        raise checks.fail(
            "vertices",
            "give vertices or keypoints_3d: without either there is nothing to put a box around",
        )
    if vertices is not None and len(vertices) < LEAST_VERTICES:
        raise checks.fail("vertices", f"must be a body, got {len(vertices)} points")
    template = body.template
    if template is not None and vertices is not None and len(vertices) != template.vertex_count:
        raise checks.fail(
            "vertices",
            f"has {len(vertices)} vertices, but the template has {template.vertex_count}: leave"
            " template out unless they correspond one to one",
        )
    return vertices


def _landmarks(
    checks: ArgumentChecks,
    body: Body,
    words: Vocabulary,
    *,
    vertices: Array | None,
    faces: Tensor | None,
    used: NDArray[np.bool_] | None,
) -> tuple[Array | None, tuple[str, ...]]:
    """The landmarks (J, 3) as given, else by the template, else by SMAL's topology; and notes.

    Rows of NaN are landmarks that the body lacks.
    """
    if body.landmarks is not None:
        return _given_landmarks(checks, body, words), ()
    if vertices is None:
        return None, ()
    if body.template is not None:
        return template_landmarks(body.template, words, vertices, used), ()
    found = topology_landmarks(words, vertices, faces, used)
    return (None, ()) if isinstance(found, str) else (found, (SMAL_NOTE,))


def _given_landmarks(checks: ArgumentChecks, body: Body, words: Vocabulary) -> Array:
    """The landmarks (J, 3) as given, checked."""
    landmarks = checks.array("keypoints_3d", body.landmarks, "J 3")
    if len(landmarks) != len(words):
        raise checks.fail(
            "keypoints_3d",
            f"has {len(landmarks)} landmarks, but vocabulary {words.name} has {len(words)}",
        )
    if not np.isfinite(landmarks).all() and np.isinf(landmarks).any():
        raise checks.fail(
            "keypoints_3d",
            "must not be infinite; a landmark the body does not have is a row of NaN",
        )
    return landmarks
