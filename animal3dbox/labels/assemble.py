"""Everything that follows from the box and the camera: projections, faces, 2D box, quality.

Many animals at once.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from animal3dbox.geometry.arrays import norm
from animal3dbox.geometry.box_visibility import (
    corners_visibility,
    near_depth_of_corners,
    visible_faces,
)
from animal3dbox.geometry.camera import project
from animal3dbox.geometry.cuboid import corners_of
from animal3dbox.geometry.pixel_boxes import points_box
from animal3dbox.labels.confidence import confidence_of
from animal3dbox.labels.drafts import LabelDraft
from animal3dbox.labels.flank import UNKNOWN_SD_RAD, decided_flanks, lateral_angle
from animal3dbox.labels.label_row import NOT_MEASURED, rows_of
from animal3dbox.labels.pose.choice import elevation_and_roll
from animal3dbox.labels.pose.problem import AS_GIVEN
from animal3dbox.labels.types import CuboidLabel, Quality

Array = NDArray[np.float64]
INLIER_PER_EXTENT = 0.1
"""A keypoint fits if it is off by less than this part of the longer side of the keypoints' box
(PCK at 0.1)."""
AMBIGUOUS = 2.0
"""What a runner-up costs more and is still taken for nearly as good."""
FROM_BELOW_DEG, ROLLED_DEG, UNCERTAIN_DEG = -10.0, 45.0, 15.0
"""Elevation, roll and standard deviation beyond which a label is flagged."""
NO_SURFACE = np.full(6, NOT_MEASURED)


def assemble_labels(drafts: Sequence[LabelDraft]) -> list[CuboidLabel]:
    """The labels of animals whose boxes and cameras are known.

    Those of one size of image, one lens and as many keypoints go together.
    """
    groups: dict[tuple[tuple[int, int], bytes | None, int], list[int]] = {}
    for i, draft in enumerate(drafts):
        observation = draft.observation
        lens = None if observation.distortion is None else observation.distortion.tobytes()
        alike = observation.image_hw, lens, len(observation.vocabulary)
        groups.setdefault(alike, []).append(i)
    labels: dict[int, CuboidLabel] = {}
    for indices in groups.values():
        labels |= zip(indices, _assemble_alike([drafts[i] for i in indices]), strict=True)
    return [labels[i] for i in range(len(drafts))]


def box_fields(
    corners: Array, K: Array, image_hw: tuple[int, int], distortion: Array | None = None
) -> dict[str, NDArray[Any]]:
    """The fields of labels that follow from boxes and cameras alone.

    Args:
        corners: (B, 8, 3) camera frame.
        K: (B, 3, 3).
        image_hw: height and width.
        distortion: of the lens; None for a pinhole.

    Returns:
        Names of label_row.LAYOUT -> (B, ...); besides them "depth" (B, 8) of the corners.

    """
    corners_2d, depth = project(K, corners, distortion)
    camera_center = np.zeros_like(corners[:, 0])
    visible = visible_faces(corners, camera_center)
    faces = corners_visibility(corners, K, image_hw, visible, distortion=distortion)
    in_front: NDArray[np.bool_] = depth > near_depth_of_corners(corners)[:, None]
    return {
        "corners_3d": corners,
        "corners_2d": corners_2d,
        "corner_in_front": in_front,
        "behind_camera": np.asarray(~in_front.all(1)),
        "face_visible": faces.visible,
        "face_area": faces.area,
        "face_share": faces.share,
        "face_share_in_image": faces.share_in_image,
        "truncation": faces.truncation,
        "depth": depth,
    }


def _assemble_alike(drafts: Sequence[LabelDraft]) -> list[CuboidLabel]:
    """Labels of animals whose images have one size and one lens, and as many keypoints."""
    first = drafts[0].observation
    image_hw, distortion = first.image_hw, first.distortion
    K = np.array([draft.observation.K for draft in drafts])
    R = np.array([draft.pose.R for draft in drafts])
    t = np.array([draft.pose.t for draft in drafts])
    rows = _label_rows(drafts, K=K, R=R, t=t)
    qualities = _qualities(drafts, K, R, t)
    return [
        CuboidLabel(
            sample_id=draft.observation.sample_id,
            image_hw=image_hw,
            row=rows[i].copy(),  # a view would keep, and pickle, the whole batch
            keypoints_2d=draft.observation.keypoints_2d,
            quality=qualities[i],
            lens=None if distortion is None else distortion.copy(),
            fit=draft.observation.fit,
        )
        for i, draft in enumerate(drafts)
    ]


def _label_rows(drafts: Sequence[LabelDraft], *, K: Array, R: Array, t: Array) -> Array:
    """The numbers (B, WIDTH) of labels; arguments as in _assemble_alike, one entry a draft."""
    image_hw, distortion = drafts[0].observation.image_hw, drafts[0].observation.distortion
    mesh_center, mesh_rotation, size = (
        np.array(part) for part in zip(*(draft.mesh_box for draft in drafts), strict=True)
    )
    center, rotation = (R @ mesh_center[..., None])[..., 0] + t, R @ mesh_rotation
    fields = box_fields(corners_of(center, rotation, size), K, image_hw, distortion)
    depth, corners_2d = fields.pop("depth"), fields["corners_2d"]
    boxes = [
        points_box(corners_2d[i], depth[i], image_hw) if draft.flat_box is None else draft.flat_box
        for i, draft in enumerate(drafts)
    ]
    shares = [
        NO_SURFACE if draft.surface_share is None else draft.surface_share for draft in drafts
    ]
    flank, flank_confidence = _flanks(drafts, lateral_angle(center, rotation), np.array(shares))
    return rows_of(
        {
            **fields,
            "flank": flank,
            "flank_confidence": flank_confidence,
            "center": center,
            "rotation": rotation,
            "size": size,
            "distance": norm(center),
            "K": K,
            "R": R,
            "t": t,
            "box": np.array(boxes),
            "surface_share": np.array(shares),
            "mesh_center": mesh_center,
            "mesh_rotation": mesh_rotation,
            "mesh_size": size,
        }
    )


def _flanks(
    drafts: Sequence[LabelDraft], theta: Array, shares: Array
) -> tuple[NDArray[np.int64], Array]:
    """The flanks (B,) that drafts show, and the probability (B,) of each; see decided_flanks."""
    known_camera = np.array([draft.observation.camera_is_known for draft in drafts])
    told = [draft.pose.evidence for draft in drafts]
    sigma = np.array(
        [UNKNOWN_SD_RAD if one is None else math.radians(one.rotation_sd_deg) for one in told]
    )
    flank, confidence = decided_flanks(theta, shares, sigma, known_camera=known_camera)
    by_chance = np.array([draft.orientation_rule == "principal components" for draft in drafts])
    return np.where(by_chance, 0, flank), np.where(by_chance, 0.5, confidence)


def _qualities(drafts: Sequence[LabelDraft], K: Array, R: Array, t: Array) -> list[Quality]:
    """How the labels came about, and how well their keypoints fit.

    Distances of keypoints from their landmarks are in px of the picture as it is, with its lens.
    """
    observations = [draft.observation for draft in drafts]
    nowhere = np.zeros((len(observations[0].vocabulary), 3))
    matched = np.array([observation.matched for observation in observations])
    keypoints, landmarks = (
        np.where(matched[..., None], np.array([nowhere if x is None else x for x in part]), 0.0)
        for part in (
            [observation.keypoints_2d for observation in observations],
            [observation.body.landmarks for observation in observations],
        )
    )
    px = keypoints[..., :2]
    projected, _ = project(K, landmarks @ R.mT + t[:, None], observations[0].distortion)
    distance = np.where(matched, norm(projected - px), 0.0)
    count = matched.sum(1)
    greatest, least = (np.where(matched[..., None], px, edge) for edge in (-np.inf, np.inf))
    extent = (greatest.max(1) - least.min(1)).max(1)
    near = matched & (distance < INLIER_PER_EXTENT * extent[:, None])
    mean_px = distance.sum(1) / np.maximum(count, 1)
    return [
        _quality(draft, n_keypoints=n, mean_px=mean, n_inliers=inliers)
        for draft, n, mean, inliers in zip(
            drafts, count.tolist(), mean_px.tolist(), near.sum(1).tolist(), strict=True
        )
    ]


def _quality(draft: LabelDraft, *, n_keypoints: int, mean_px: float, n_inliers: int) -> Quality:
    """How one label came about."""
    observation, evidence = draft.observation, draft.pose.evidence
    quality = Quality(
        reprojection_error_px=mean_px if n_keypoints else None,
        n_keypoints=n_keypoints,
        n_inliers=n_inliers,
        mask_iou=draft.mask_iou,
        orientation_rule=draft.orientation_rule,
        pose_source="given" if observation.camera_is_known else "estimated",
        pose_hypothesis=draft.pose.hypothesis,
        bounds_source=draft.bounds_source,
        mask_source="none" if observation.mask is None else "dataset",
        K_source=observation.K_source,
        warnings=draft.warnings,
        rotation_sd_deg=None if evidence is None else evidence.rotation_sd_deg,
        runner_up=None if evidence is None else evidence.runner_up,
        labeling=AS_GIVEN if evidence is None else evidence.labeling,
        hidden=None if evidence is None else evidence.hidden,
        misfit=None if evidence is None else evidence.misfit,
        log_focal_sd=None if evidence is None else evidence.log_focal_sd,
        flags=_flags(draft),
        calibration=draft.calibration,
        body=observation.body_source,
    )
    if draft.method != "default":
        return quality
    body = observation.body
    told = confidence_of(
        quality,
        has_template=body.template is not None and body.vertices is not None,
        is_rigid=body.landmark_sigma is not None,
    )
    return replace(quality, confidence=told.probability, expected_corner_error=told.corner_error)


def _flags(draft: LabelDraft) -> tuple[str, ...]:
    """The words of FLAGS that hold of a draft."""
    evidence = draft.pose.evidence
    if evidence is None:
        return ("off_mask",) if draft.mask_denies_camera else ()
    rotation = draft.pose.R @ draft.mesh_box[1]
    center = draft.pose.R @ draft.mesh_box[0] + draft.pose.t
    elevation, roll = elevation_and_roll(rotation, center)
    holds = {
        "exchanged": evidence.labeling != AS_GIVEN,
        "ambiguous": evidence.runner_up is not None and evidence.runner_up < AMBIGUOUS,
        "from_below": elevation < FROM_BELOW_DEG,
        "rolled": abs(roll) > ROLLED_DEG,
        "uncertain": evidence.rotation_sd_deg > UNCERTAIN_DEG,
    }
    return tuple(flag for flag, is_so in holds.items() if is_so)
