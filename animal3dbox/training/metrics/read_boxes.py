"""Predictions and targets of one image, checked, as tables of boxes."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from animal3dbox.errors import SampleError
from animal3dbox.geometry.arrays import norm
from animal3dbox.geometry.box_visibility import (
    QUADS,
    projected_faces,
    visible_face_shares,
    visible_faces,
)
from animal3dbox.geometry.cuboid import corners_of
from animal3dbox.geometry.polygon import polygon_area
from animal3dbox.geometry.rigid_transforms import nearest_rotation
from animal3dbox.target_schema import FIELDS
from animal3dbox.training.metrics.box_table import BoxTable, Flags, Floats, Whole
from animal3dbox.training.metrics.options import MetricOptions

Fields = Mapping[str, Any]

ROTATION_TOLERANCE = 1e-2
"""By how much R R^T of a prediction may differ from the identity: what half precision rounds is
mended, and anything else is no rotation."""
NAMED_FACES = tuple(field.name for field in FIELDS if field.named_faces)
"""Fields that a target has only if its boxes' fronts are known."""
SHARE_TOLERANCE = 1e-2
"""What half precision rounds of parts and of their sum."""
MEANING = {
    "boxes": "x0, y0, x1, y1 with x0 <= x1 and y0 <= y1 (not a width and a height)",
    "flank": "0 undecided, 1 left or 2 right",
    "face_share": "parts of the visible area, from 0 to 1, whose sum is 1 at most",
}
"""What the fields that only some detectors say must be; NaN is what is not known."""
MOST = 1e30
"""Lengths and coordinates from here on, and sizes below its inverse, are no box's: their volumes
would overflow."""


@dataclass(frozen=True)
class BoxSource:
    """Where boxes come from: the fields of one image's predictions or target, and their name.

    Attributes:
        kind: "prediction" or "target", for messages.
        fields: the dict.
        image_id: the image, for messages.
    """

    kind: str
    fields: Fields
    image_id: str

    def error(self, field: str, problem: str, animal: int | None = None) -> SampleError:
        """What is wrong with a field, of one of its boxes or of all."""
        sample = self.image_id if animal is None else f"{self.image_id}#{animal}"
        return SampleError(sample, f"{self.kind} {field}", problem)

    def array(self, name: str, shape: tuple[int, ...], count: int | None = None) -> Floats | None:
        """A field as float64 (N, *shape); None if it is not there.

        Args:
            name: of the field.
            shape: of an entry.
            count: how many entries it must have; None: as many as there are.

        Raises:
            SampleError: it has another shape.

        """
        value = self.fields.get(name)
        if value is None:
            return None
        try:
            # On the host first: not every device has float64; NumPy does not have bfloat16
            host = value.detach().cpu().double() if isinstance(value, Tensor) else value
            array = np.asarray(host, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise self.error(name, f"must be a tensor or an array, got {value!r}") from error
        if array.size == 0 and not count:
            array = array.reshape(0, *shape)
        if array.shape[1:] != shape or array.ndim == 0 or count not in (None, len(array)):
            expected = ", ".join(map(str, ("N" if count is None else count, *shape)))
            raise self.error(name, f"must have shape ({expected}), got {array.shape}")
        return array

    def required(self, name: str, shape: tuple[int, ...], count: int | None = None) -> Floats:
        """A field that must be there; see array."""
        array = self.array(name, shape, count)
        if array is None:
            remedy = (
                "; animal3dbox.geometry.corners_to_cuboid gives center, rotation and size of"
                " corners_3d"
                if "corners_3d" in self.fields
                else ""
            )
            raise self.error(name, f"is missing{remedy}")
        return array

    def flags(self, name: str, count: int, otherwise: bool) -> Flags:
        """A field of flags (N,), or the same for all if it is not there."""
        array = self.array(name, (), count)
        return np.full(count, otherwise) if array is None else array != 0


def read_predictions(
    fields: Fields, target: Fields, image_id: str, options: MetricOptions
) -> BoxTable:
    """The predicted boxes of an image.

    Args:
        fields: `center`, `rotation`, `size`, `scores`; `labels`; and what else of a target's fields
            the detector says: `boxes`, `face_visible` (flags, or probabilities), `face_share`,
            `flank`; `heading_known`.
        target: of the same image; its K serves where the prediction brings none.
        image_id: for messages.
        options: the metrics'.

    Raises:
        SampleError: a field is missing, or of the wrong shape, or a score is no number.

    """
    source = BoxSource("prediction", fields, image_id)
    score = source.required("scores", (), len(source.required("center", (3,))))
    if not np.isfinite(score).all():
        wrong = int(np.flatnonzero(~np.isfinite(score))[0])
        raise source.error("scores", f"must be finite, got {score[wrong]}", wrong)
    if "labels" in target and "labels" not in fields and not options.class_agnostic:
        raise source.error("labels", "is missing, and the target has labels; or class_agnostic")
    camera = BoxSource("camera", {**target, **fields}, image_id)
    return _table(source, camera, score=score, metric=np.zeros(len(score), bool), options=options)


def read_truths(target: Fields, image_id: str, options: MetricOptions) -> BoxTable:
    """The true boxes of an image.

    Args:
        target: a Dataset's; of its fields `center`, `rotation` and `size` are needed, and what is
            compared beside them.
        image_id: for messages.
        options: the metrics'.

    Raises:
        SampleError: a field is missing or of the wrong shape, or a box is none.

    """
    source = BoxSource("target", target, image_id)
    count = len(source.required("center", (3,)))
    metric = source.flags("scale_known", count, options.metric)
    table = _table(source, source, score=np.zeros(count), metric=metric, options=options)
    for animal in np.flatnonzero(~table.usable):
        raise source.error(
            "center, rotation or size",
            "is no box: not finite, no rotation, or a size that is not positive;"
            " animal3dbox.training.check_targets says which",
            int(animal),
        )
    return table


def _table(
    source: BoxSource, camera: BoxSource, *, score: Floats, metric: Flags, options: MetricOptions
) -> BoxTable:
    """The boxes of an image.

    Args:
        source: of the boxes.
        camera: of K and distortion.
        score: (N,).
        metric: (N,) whether lengths are metres.
        options: the metrics'.

    """
    count = len(score)
    center, rotation, size, usable = _placed(source, count)
    truth = source.kind == "target"
    known = not truth or _front_is_known(source.fields, options)
    heading_known = source.flags("heading_known", count, known)
    face_score, face_share = _faces(source, camera, (center, rotation, size))
    face_score[~(usable & heading_known)] = np.nan
    face_share[~(usable & heading_known)] = np.nan
    box, flank = _said_boxes(source, count), _said_flanks(source, count)
    if box is None and count and options.pair_by == "boxes":
        raise source.error("boxes", "is missing, and pair_by='boxes' pairs boxes in the picture")
    return BoxTable(
        score=score,
        label=_labels(source, count, options),
        center=center,
        rotation=rotation,
        size=size,
        box=np.full((count, 4), np.nan) if box is None else box,
        face_score=face_score,
        face_share=face_share,
        flank=np.full(count, np.nan) if flank is None else flank,
        usable=usable,
        heading_known=heading_known,
        metric=metric,
        crowd=source.flags("iscrowd", count, False) & truth,
    )


def _front_is_known(target: Fields, options: MetricOptions) -> bool:
    """Whether the true boxes of a target that does not say so have a front.

    A Dataset of boxes without one gives the fields of its corners and leaves out those that name
    faces.
    """
    if options.heading_known is not None:
        return options.heading_known
    return "corner_in_front" not in target or any(name in target for name in NAMED_FACES)


def _refuse_wrong(source: BoxSource, name: str, values: Floats, right: Flags) -> None:
    """Raise a SampleError for the first of the boxes (N,) whose field is not right."""
    for animal in np.flatnonzero(~right):
        problem = f"must be {MEANING[name]}, got {values[animal].tolist()}"
        raise source.error(name, problem, int(animal))


def _said_boxes(source: BoxSource, count: int) -> Floats | None:
    """The 2D boxes (N, 4) that are said; NaN of those that are not known."""
    box = source.array("boxes", (4,), count)
    if box is not None and count:
        in_order: Flags = np.asarray((box[:, 2:] >= box[:, :2]).all(1) & np.isfinite(box).all(1))
        _refuse_wrong(source, "boxes", box, in_order | np.isnan(box).any(1))
    return box


def _said_flanks(source: BoxSource, count: int) -> Floats | None:
    """The flanks (N,) that are said; NaN of those that are not known."""
    flank = source.array("flank", (), count)
    if flank is not None:
        right: Flags = np.asarray(np.isnan(flank) | np.isin(flank, (0, 1, 2)))
        _refuse_wrong(source, "flank", flank, right)
    return flank


def _said_shares(source: BoxSource, count: int) -> Floats | None:
    """The faces' parts of the visible area (N, 6) that are said; NaN of those not known."""
    share = source.array("face_share", (6,), count)
    if share is not None and count:
        total = share.sum(1)
        inside = ((share >= -SHARE_TOLERANCE) & (share <= 1 + SHARE_TOLERANCE)).all(1)
        right: Flags = np.asarray(np.isnan(share).any(1) | inside & (total <= 1 + SHARE_TOLERANCE))
        _refuse_wrong(source, "face_share", share, right)
    return share


def _labels(source: BoxSource, count: int, options: MetricOptions) -> Whole:
    """The classes (N,) of boxes: 0 if they have none, or if classes do not matter."""
    labels = None if options.class_agnostic else source.array("labels", (), count)
    if labels is None:
        return np.zeros(count, np.int64)
    value = source.fields["labels"]
    if value.dtype == torch.bool if isinstance(value, Tensor) else np.asarray(value).dtype == bool:
        raise source.error("labels", "must be the classes' numbers, got flags")
    for animal in np.flatnonzero(~(np.mod(labels, 1) == 0)):
        raise source.error("labels", f"must be whole, got {labels[animal]}", int(animal))
    return labels.astype(np.int64)


def _placed(source: BoxSource, count: int) -> tuple[Floats, Floats, Floats, Flags]:
    """Center, rotation and size of N boxes, and which of them are boxes.

    What is none gets a unit box's numbers, which nothing is computed of.
    """
    center = source.required("center", (3,), count)
    rotation = source.required("rotation", (3, 3), count)
    size = source.required("size", (3,), count)
    with np.errstate(all="ignore"):
        off = np.abs(rotation @ rotation.mT - np.eye(3)).max((1, 2), initial=0.0)
        usable = (np.abs(center) < MOST).all(1) & ((size > 1 / MOST) & (size < MOST)).all(1)
        usable &= (off <= ROTATION_TOLERANCE) & (np.linalg.det(rotation) > 0)
    if not usable.all():
        center = np.where(usable[:, None], center, 0.0)
        size = np.where(usable[:, None], size, 1.0)
        rotation = np.where(usable[:, None, None], rotation, np.eye(3))
    return center, nearest_rotation(rotation) if count else rotation, size, usable


def _faces(
    source: BoxSource, camera: BoxSource, placed: tuple[Floats, Floats, Floats]
) -> tuple[Floats, Floats]:
    """How sure it is that each face is seen, and each face's part of the visible area, (N, 6) each.

    Both are what the fields say; else what the cuboid implies, a face whose normal makes the angle
    a with the way to the camera being seen with a score of (1 + cos a) / 2. Parts of the area need
    K then, and are NaN without.
    """
    center, _, _ = placed
    count = len(center)
    score = source.array("face_visible", (6,), count)
    share = _said_shares(source, count)
    if score is not None and not ((score >= 0) & (score <= 1)).all():
        wrong = int(np.flatnonzero(~((score >= 0) & (score <= 1)).all(1))[0])
        problem = "must be flags or probabilities in 0 to 1 (of logits: torch.sigmoid), got"
        raise source.error("face_visible", f"{problem} {score[wrong].tolist()}", wrong)
    if score is not None and share is not None:
        return score.copy(), share.copy()
    corners = corners_of(*placed)
    if score is None:
        score = _scores_of(corners)
    if share is None:
        K = camera.array("K", (3,), 3)
        if K is None:
            return score.copy(), np.full((count, 6), np.nan)
        quads = projected_faces(corners, K, camera.array("distortion", ()))
        visible = visible_faces(corners, np.zeros_like(center))
        share = visible_face_shares(polygon_area(quads) * visible)
    return score.copy(), share.copy()


def _scores_of(corners: Floats) -> Floats:
    """(1 + cos a) / 2 of each face (N, 6), a between its normal and the way to the camera."""
    faces = corners[:, QUADS].mean(2)  # (N, 6, 3)
    normals = faces - corners.mean(1)[:, None]
    lengths = norm(normals) * norm(faces)
    cosines = -(normals * faces).sum(2) / np.maximum(lengths, np.finfo(np.float64).tiny)
    return np.asarray((1 + cosines) / 2)
