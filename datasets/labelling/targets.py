"""Targets: what a Dataset gives beside an image, cut out of labels by the schema of a target."""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from animal3dbox.datasets.sightings import NO_SIGHTING, Sighting
from animal3dbox.errors import SampleError
from animal3dbox.geometry.frame import in_frame
from animal3dbox.labels.label_row import FIRST_FLAG, FIRST_WHOLE, SPANS, WIDTH
from animal3dbox.labels.pose.problem import AS_GIVEN
from animal3dbox.labels.types import CuboidLabel
from animal3dbox.smal.keypoints.exchanges import exchange_order
from animal3dbox.smal.keypoints.vocabulary import Vocabulary
from animal3dbox.target_schema import LABEL_FIELDS, Field

_TYPES: dict[str, np.dtype[Any]] = {
    "float": np.dtype(np.float32),
    "whole": np.dtype(np.int64),
    "flag": np.dtype(np.bool_),
}
"""The types of a target's fields, kind by kind in the order of a row."""
_FIRST = {"float": 0, "whole": FIRST_WHOLE, "flag": FIRST_FLAG}
"""Where the numbers of a kind begin in a row."""
_SURFACE_SHARE = SPANS["surface_share"].start
_Place = tuple[str, tuple[int, ...], int]
"""A field's name in the target, its shape there, and the byte at which its numbers begin, of those
of its kind."""


def target_of(
    image_id: str,
    labels: Sequence[CuboidLabel],
    class_numbers: Sequence[int],
    *,
    masks: NDArray[np.uint8] | None = None,
    vocabulary: Vocabulary | None = None,
    named_faces: bool = True,
    sightings: Sequence[Sighting] = (),
) -> dict[str, Any]:
    """The target of one image, float32.

    In the camera frame, in metres where scale_known, else in each body's unit.

    Args:
        image_id: the image.
        labels: of its N animals, at least one.
        class_numbers: their classes.
        masks: (N, H, W) 0 and 1; None without.
        vocabulary: of the keypoints; None: no keypoints.
        named_faces: whether forward and left mean something; else there are no face fields.
        sightings: when, where and of whom the picture is, by animal; none: nothing is known.

    Returns:
        The fields of target_schema.FIELDS that a Dataset has; surface_share (N, 6) if it was
        measured.

    """
    measured = named_faces and all(label.row[_SURFACE_SHARE] >= 0 for label in labels)
    target = _label_fields(labels, named_faces=named_faces, measured=measured)
    target["labels"] = torch.from_numpy(np.array(class_numbers, dtype=np.int64))
    if labels[0].lens is not None:
        target["distortion"] = torch.from_numpy(labels[0].lens.astype(np.float32))
    if vocabulary is not None and all(label.keypoints_2d is not None for label in labels):
        target["keypoint_mirror"] = torch.from_numpy(_mirror(vocabulary.flip).copy())
        marked = [_keypoints_in_frame(label) for label in labels]
        target["keypoints"] = torch.from_numpy(np.array(marked, dtype=np.float32))
    if masks is not None:
        target["masks"] = torch.from_numpy(masks)
    scales = [label.scale_m_per_unit for label in labels]
    target["scale_known"] = torch.from_numpy(np.array([scale is not None for scale in scales]))
    factors = np.array([scale or 1.0 for scale in scales], dtype=np.float32)
    target["scale_m_per_unit"] = torch.from_numpy(factors)
    target["image_id"] = image_id
    target["meta"] = {
        "sample_ids": [label.sample_id or "" for label in labels],
        "quality": [_quality_record(label, vocabulary) for label in labels],
        "scale_source": [label.scale_source for label in labels],
        "K_source": labels[0].quality.K_source,
        "sightings": [one.known for one in sightings or [NO_SIGHTING] * len(labels)],
    }
    if "keypoints" in target and vocabulary is not None:
        target["meta"]["keypoint_sides"] = _sides(vocabulary)
    return target


def _quality_record(label: CuboidLabel, vocabulary: Vocabulary | None) -> dict[str, Any]:
    """How a label came about, and where the file has each of its keypoints if sides were mended.

    Of a fitted body it holds the parameters, too, as plain lists.
    """
    labeling = label.quality.labeling
    order = None
    if vocabulary is not None and labeling != AS_GIVEN:
        order = exchange_order(vocabulary, labeling)
    record = {**vars(label.quality), "confidence": label.confidence, "keypoint_order": order}
    if label.fit is not None:
        fit = label.fit
        record["fit"] = {**vars(fit), "betas": fit.betas.tolist(), "pose": fit.pose.tolist()}
    return record


def empty_target(
    image_id: str, K: NDArray[np.float64], *, named_faces: bool = True
) -> dict[str, Any]:
    """The target of an image of boxes without any: the same fields, N = 0."""
    return {
        **_label_fields([], named_faces=named_faces, measured=False),
        "K": torch.from_numpy(K.astype(np.float32)),
        "labels": torch.zeros(0, dtype=torch.int64),
        "scale_known": torch.zeros(0, dtype=torch.bool),
        "scale_m_per_unit": torch.zeros(0),
        "image_id": image_id,
        "meta": {
            "sample_ids": [],
            "quality": [],
            "scale_source": [],
            "K_source": "given",
            "sightings": [],
        },
    }


def check_one_camera(sample_id: str, labels: Sequence[CuboidLabel]) -> None:
    """Raise a SampleError unless the animals of an image share one camera: a target has one K."""
    for label in labels[1:]:
        if not np.array_equal(label.field("K"), labels[0].field("K")):
            raise SampleError(
                sample_id,
                "K",
                f"the animals {labels[0].sample_id} and {label.sample_id} of this image have"
                " different intrinsics",
            )


def masks_of(masks: Sequence[NDArray[np.bool_]]) -> NDArray[np.uint8]:
    """The masks (H, W) in one contiguous uint8 array (N, H, W) of 0 and 1.

    A single mask is not copied, so it must be nobody else's.
    """
    stacked = np.stack(masks) if len(masks) > 1 else np.ascontiguousarray(masks[0])[None]
    return np.ascontiguousarray(stacked).view(np.uint8)


def image_tensor(pixels: NDArray[np.uint8]) -> torch.Tensor:
    """(3, H, W) uint8 RGB of (H, W, 3), without a copy.

    Channels last in memory, as decoders and OpenCV have them.
    """
    return torch.from_numpy(pixels).permute(2, 0, 1)


def _keypoints_in_frame(label: CuboidLabel) -> NDArray[np.float64]:
    """A label's keypoints (J, 3), whose visibility is 0 outside the frame."""
    keypoints = label.keypoints_2d
    if keypoints is None:
        raise ValueError(f"{label.sample_id} has no keypoints")
    inside = in_frame(keypoints[:, :2], label.image_hw)
    if inside.all():
        return keypoints
    return np.concatenate((keypoints[:, :2], (keypoints[:, 2] * inside)[:, None]), 1)


def _label_fields(
    labels: Sequence[CuboidLabel], *, named_faces: bool, measured: bool
) -> dict[str, Any]:
    """The fields that labels hold as numbers, as targets have them."""
    count = len(labels)
    rows = [label.row for label in labels]
    if count == 1:
        by_field = rows[0]
    else:
        by_field = np.concatenate(rows)[_field_order(count)] if rows else np.zeros(0)
    ends = [first * count for first in (FIRST_WHOLE, FIRST_FLAG, WIDTH)]
    places = _places(count, named_faces, measured)
    target: dict[str, Any] = {}
    for (kind, dtype), end in zip(_TYPES.items(), ends, strict=True):
        values = by_field[_FIRST[kind] * count : end].astype(dtype)
        for name, shape, start in places[kind]:
            target[name] = torch.from_numpy(np.ndarray(shape, dtype, values, start))
    return target


@lru_cache(maxsize=256)
def _places(count: int, named_faces: bool, measured: bool) -> dict[str, list[_Place]]:
    """Where the fields of a target stand among the numbers of its labels, kind by kind.

    K is the first animal's, which all share.
    """

    def is_there(field: Field) -> bool:
        if field.name == "surface_share":
            return measured
        return bool(count) if field.per == "image" else named_faces or not field.named_faces

    places: dict[str, list[_Place]] = {kind: [] for kind in _TYPES}
    for field in filter(is_there, LABEL_FIELDS):
        shape = field.entry_shape or ()
        start = (SPANS[field.label_name or field.name].start - _FIRST[field.kind]) * count
        whole_shape = shape if field.per == "image" else (count, *shape)
        places[field.kind].append((field.name, whole_shape, start * _TYPES[field.kind].itemsize))
    return places


@lru_cache(maxsize=64)
def _field_order(count: int) -> NDArray[np.int64]:
    """The order that puts the fields of several rows, one row after the other, field by field."""
    places = np.arange(count * WIDTH).reshape(count, WIDTH)
    return np.concatenate([places[:, span].ravel() for span in SPANS.values()])


@lru_cache(maxsize=16)
def _mirror(flip: tuple[int, ...]) -> NDArray[np.int64]:
    """Each keypoint's counterpart on the other side, (J,)."""
    return np.array(flip, dtype=np.int64)


@lru_cache(maxsize=16)
def _sides(vocabulary: Vocabulary) -> tuple[str | None, ...]:
    """The side of each keypoint, "left", "right" or None, (J,)."""
    return vocabulary.sides
