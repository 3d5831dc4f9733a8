"""Targets: what a Dataset gives beside an image, made of label rows."""

from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from animal3dbox.datasets.label_rows import LAYOUT, SPANS, LabelRow, columns
from animal3dbox.errors import SampleError
from animal3dbox.smal.vocabulary import Vocabulary

APART = ("box", "K", "surface_share")
FACES = ("face_visible", "face_area", "face_share", "face_share_in_image")
_ALWAYS = tuple(name for name in LAYOUT if name not in APART)
_WITHOUT_FACES = tuple(name for name in _ALWAYS if name not in FACES)
_SURFACE_SHARE = SPANS["surface_share"][0]


def target_of(
    image_id: str,
    rows: Sequence[LabelRow],
    labels: Sequence[int],
    masks: NDArray[np.uint8] | None = None,
    vocabulary: Vocabulary | None = None,
    named_faces: bool = True,
) -> dict[str, Any]:
    """The target of one image, float32; in the camera frame, in metres where scale_known, else in each body's unit.

    Args:
        image_id: the image.
        rows: the labels of its N animals, at least one.
        labels: their classes.
        masks: (N, H, W) 0 and 1; None without.
        vocabulary: of the keypoints; None: no keypoints.
        named_faces: whether forward and left mean something; else there are no face fields.

    Returns:
        The fields of design.md's target, with keypoint_mirror (J,), scale_known (N,) and scale_source, and surface_share (N, 6) if it was measured.

    """
    found = columns(rows)
    target = _tensors(found, named_faces)
    target["boxes"], target["K"] = torch.from_numpy(found["box"]), torch.from_numpy(found["K"][0])
    if named_faces and all(row.values[_SURFACE_SHARE] >= 0 for row in rows):
        target["surface_share"] = torch.from_numpy(found["surface_share"])
    target["labels"] = torch.from_numpy(np.array(labels, dtype=np.int64))
    if rows[0].distortion is not None:
        target["distortion"] = torch.from_numpy(rows[0].distortion.astype(np.float32))
    if vocabulary is not None and all(row.keypoints is not None for row in rows):
        target["keypoint_mirror"] = torch.from_numpy(_mirror(vocabulary.flip).copy())
        target["keypoints"] = torch.from_numpy(np.array([row.keypoints for row in rows], dtype=np.float32))
    if masks is not None:
        target["masks"] = torch.from_numpy(masks)
    scales = [row.scale_m_per_unit for row in rows]
    target["scale_known"] = torch.from_numpy(np.array([scale is not None for scale in scales]))
    target["scale_m_per_unit"] = torch.from_numpy(np.array([scale or 1.0 for scale in scales], dtype=np.float32))
    target["scale_source"] = [row.scale_source for row in rows]
    target["quality"] = [row.quality for row in rows]
    target["sample_ids"] = [row.sample_id for row in rows]
    target["image_id"], target["K_source"] = image_id, rows[0].quality["K_source"]
    return target


def _tensors(found: Mapping[str, NDArray[Any]], named_faces: bool) -> dict[str, Any]:
    """The fields that every target has."""
    return {name: torch.from_numpy(found[name]) for name in (_ALWAYS if named_faces else _WITHOUT_FACES)}


@lru_cache(maxsize=16)
def _mirror(flip: tuple[int, ...]) -> NDArray[np.int64]:
    return np.array(flip, dtype=np.int64)


def empty_target(image_id: str, K: NDArray[np.float64], named_faces: bool = True) -> dict[str, Any]:
    """The target of an image of boxes without any: the same fields, N = 0."""
    target = _tensors(columns([]), named_faces)
    target |= {"K": torch.from_numpy(K.astype(np.float32)), "boxes": torch.zeros(0, 4), "labels": torch.zeros(0, dtype=torch.int64)}
    target |= {
        "scale_known": torch.zeros(0, dtype=torch.bool),
        "scale_m_per_unit": torch.zeros(0),
        "scale_source": [],
        "quality": [],
        "sample_ids": [],
    }
    return {**target, "image_id": image_id, "K_source": "given"}


def check_one_camera(sample_id: str, rows: Sequence[LabelRow]) -> None:
    """Raise if the animals of an image do not share one camera: its target has one K."""
    first = rows[0].field("K")
    for row in rows[1:]:
        if not np.array_equal(row.field("K"), first):
            raise SampleError(sample_id, "K", f"the animals {rows[0].sample_id} and {row.sample_id} of this image have different intrinsics")


def image_tensor(pixels: NDArray[np.uint8]) -> torch.Tensor:
    """(3, H, W) uint8 RGB of (H, W, 3), without a copy: channels last in memory, as decoders and OpenCV have them."""
    return torch.from_numpy(pixels).permute(2, 0, 1)
