"""The bodies that a dataset stores beside bodies that are fitted here to the same keypoints."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from animal3dbox.datasets.bodies.sources import BodySource, ParametersBody
from animal3dbox.datasets.inspection.measures import extent, spread
from animal3dbox.datasets.inspection.result import StoredFitFacts
from animal3dbox.datasets.records import AnimalRecord
from animal3dbox.errors import ShapeError
from animal3dbox.geometry.arrays import as_numpy
from animal3dbox.geometry.camera import project
from animal3dbox.geometry.rigid_transforms import rotation_angle
from animal3dbox.labels.fit.fit import fit_many
from animal3dbox.labels.fit.fitted_body import FittedBody
from animal3dbox.labels.fit.fitted_observation import ENOUGH_KEYPOINTS
from animal3dbox.progress import watched
from animal3dbox.smal.keypoints.exchanges import exchange_order
from animal3dbox.smal.model import trunk_rotation
from animal3dbox.smal.parameters import posed_body

Array = NDArray[np.float64]
ANIMALS = 200
"""Number of animals that are compared."""
TURNED_DEG = 30.0
"""Turn between two trunks from which they differ."""
WORSE, LEAST_PERCENT = 2.0, 5.0
"""A stored body's keypoints are worse if they are off by so many times the fit's, and by more than
so many percent of the keypoints' extent."""
UNSURE_DEG, CLOSE_CALL = 15.0, 2.0
"""A fit tells nothing of a stored trunk if its rotation's standard deviation is more, or if its
runner-up of another orientation costs less more."""


@dataclass(frozen=True)
class _Comparison:
    """One animal's stored body beside the fitted one.

    Attributes:
        sample_id: the animal.
        turn_deg: between the trunks; None if the fit is unsure.
        stored_px: median distance of the keypoints from the stored body's.
        fitted_px: from the fitted one's.
        extent_px: the longer side of the keypoints' box.
    """

    sample_id: str
    turn_deg: float | None
    stored_px: float
    fitted_px: float
    extent_px: float

    @property
    def is_turned(self) -> bool:
        """Whether the trunks differ."""
        return self.turn_deg is not None and self.turn_deg > TURNED_DEG

    @property
    def is_worse(self) -> bool:
        """Whether the stored body misses the keypoints and the fitted one does not."""
        least_px = LEAST_PERCENT / 100 * self.extent_px
        return self.stored_px > max(WORSE * self.fitted_px, least_px)

    @property
    def sentence(self) -> str:
        """What is told of the animal."""
        turn = "the fit is unsure of its trunk"
        if self.turn_deg is not None:
            turn = f"its trunk is turned by {self.turn_deg:.0f} degrees from the fit's"
        return (
            f"{self.sample_id}: {turn}; its keypoints are off by {self.stored_px:.1f} px, the"
            f" fit's by {self.fitted_px:.1f}"
        )


def stored_fit_facts(
    records: Sequence[AnimalRecord], bodies: BodySource | None
) -> StoredFitFacts | None:
    """Compare stored bodies with fits of the same model to the same keypoints.

    The fits know the keypoints alone: no mask, and nothing of the stored body or its pose.

    Args:
        records: the dataset's; ANIMALS of them are compared, evenly spread.
        bodies: the animals' own.

    Returns:
        The facts; None of a dataset without stored parameters, a camera for them, or an animal
        with keypoints enough.

    """
    if not isinstance(bodies, ParametersBody):
        return None
    usable = [record for record in records if _is_comparable(record, bodies)]
    compared = [
        one
        for record in watched(spread(usable, ANIMALS), "fitting bodies", unit="animal")
        if (one := _comparison(record, bodies)) is not None
    ]
    if not compared:
        return None
    differing = [one for one in compared if one.is_turned or one.is_worse]
    return StoredFitFacts(
        compared=len(compared),
        unsure=sum(one.turn_deg is None for one in compared),
        turned=[one.sample_id for one in compared if one.is_turned],
        worse=[one.sample_id for one in compared if one.is_worse],
        examples=[one.sentence for one in differing],
    )


def _is_comparable(record: AnimalRecord, bodies: ParametersBody) -> bool:
    """Whether an animal has a body, a camera for it, and keypoints enough for a fit."""
    has_camera = record.K is not None and (record.pose or record.stored_pose) is not None
    marked = int((record.keypoints_2d[:, 2] > 0).sum())
    has_body = record.sample_id in bodies.parameters
    return has_camera and has_body and marked >= ENOUGH_KEYPOINTS and record.distortion is None


def _comparison(record: AnimalRecord, bodies: ParametersBody) -> _Comparison | None:
    """An animal's stored body beside the fitted one; None if either cannot be made."""
    pose = record.pose or record.stored_pose
    if pose is None or record.K is None:
        return None
    try:
        stored = posed_body(bodies.model, bodies.parameters[record.sample_id])
    except ShapeError:
        return None  # body_facts counts it
    (fit,) = fit_many(
        [
            {
                "image_hw": record.image_hw,
                "keypoints_2d": record.keypoints_2d,
                "K": record.K,
                "vocabulary": record.vocabulary,
                "model": bodies.model,
                "sample_id": record.sample_id,
            }
        ]
    )
    if not isinstance(fit, FittedBody):
        return None
    landmarks = as_numpy(bodies.model.read_keypoints(record.vocabulary, stored.vertices[0]))
    marks = record.keypoints_2d
    if fit.labeling != "as given":
        marks = marks[list(exchange_order(record.vocabulary, fit.labeling))]
    R, t = pose
    rotation = R @ as_numpy(trunk_rotation(stored.R_world_joint)[0])
    turn = rotation_angle(torch.from_numpy(rotation), torch.from_numpy(fit.rotation))
    seen = (marks[:, 2] > 0) & np.isfinite(landmarks).all(1)
    return _Comparison(
        sample_id=record.sample_id,
        turn_deg=float(torch.rad2deg(turn)) if _is_sure(fit) else None,
        stored_px=_distance(landmarks[seen] @ R.T + t, record.K, marks[seen]),
        fitted_px=_distance(fit.landmarks[seen] @ fit.R.T + fit.t, record.K, marks[seen]),
        extent_px=extent(marks[seen, :2]),
    )


def _is_sure(fit: FittedBody) -> bool:
    """Whether a fit tells an orientation."""
    is_alone = fit.margin is None or fit.margin > CLOSE_CALL
    return is_alone and fit.rotation_sd_deg < UNSURE_DEG


def _distance(points_cam: Array, K: Array, marks: Array) -> float:
    """The median distance in px of projected points (N, 3) from marks; inf behind the camera."""
    if not (points_cam[:, 2] > 0).all():
        return float("inf")
    px, _ = project(K, points_cam)
    return float(np.median(np.linalg.norm(px - marks[:, :2], axis=1)))
