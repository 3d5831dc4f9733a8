"""Targets: what a Dataset gives beside an image, made of label rows."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from animal3dbox.datasets.label_rows import LabelRow, columns
from animal3dbox.errors import SampleError
from animal3dbox.smal.vocabulary import Vocabulary

FACES = ("face_visible", "face_area", "face_share", "face_share_in_image")


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
    box = found.pop("box")
    K = found.pop("K")
    if not named_faces:
        for name in FACES:
            del found[name]
    if not named_faces or (found["surface_share"] < 0).any():
        del found["surface_share"]
    target: dict[str, Any] = {name: _tensor(value) for name, value in found.items()}
    target["K"], target["boxes"] = _tensor(K[0].copy()), _tensor(box)
    target["labels"] = torch.tensor(labels, dtype=torch.int64)
    if rows[0].distortion is not None:
        target["distortion"] = _tensor(rows[0].distortion)
    if vocabulary is not None and all(row.keypoints is not None for row in rows):
        target["keypoint_mirror"] = torch.tensor(vocabulary.flip, dtype=torch.int64)
        target["keypoints"] = _tensor(np.stack([row.keypoints for row in rows if row.keypoints is not None]))
    if masks is not None:
        target["masks"] = torch.from_numpy(masks)
    known = [row.scale_m_per_unit is not None for row in rows]
    target["scale_known"] = torch.tensor(known)
    target["scale_m_per_unit"] = torch.tensor([row.scale_m_per_unit or 1.0 for row in rows], dtype=torch.float32)
    target["scale_source"] = [row.scale_source for row in rows]
    target["quality"] = [row.quality for row in rows]
    target["image_id"], target["K_source"] = image_id, rows[0].quality["K_source"]
    return target


def empty_target(image_id: str, K: NDArray[np.float64], named_faces: bool = True) -> dict[str, Any]:
    """The target of an image of boxes without any: the same fields, N = 0."""
    found = columns([])
    for name in ("box", "K", "surface_share", *(() if named_faces else FACES)):
        del found[name]
    target: dict[str, Any] = {name: _tensor(value) for name, value in found.items()}
    target |= {"K": _tensor(K), "boxes": torch.zeros(0, 4), "labels": torch.zeros(0, dtype=torch.int64)}
    target |= {"scale_known": torch.zeros(0, dtype=torch.bool), "scale_m_per_unit": torch.zeros(0), "scale_source": [], "quality": []}
    return {**target, "image_id": image_id, "K_source": "given"}


def check_one_camera(sample_id: str, rows: Sequence[LabelRow]) -> None:
    """Raise if the animals of an image do not share one camera: its target has one K."""
    first = rows[0].field("K")
    for row in rows[1:]:
        if not np.array_equal(row.field("K"), first):
            raise SampleError(sample_id, "K", f"the animals {rows[0].sample_id} and {row.sample_id} of this image have different intrinsics")


def _tensor(array: NDArray[Any]) -> torch.Tensor:
    """float32 of numbers, bool of booleans."""
    return torch.from_numpy(array if array.dtype == np.bool_ else array.astype(np.float32))


def image_tensor(pixels: NDArray[np.uint8]) -> torch.Tensor:
    """(3, H, W) uint8 RGB of (H, W, 3), without a copy: channels last in memory, as decoders and OpenCV have them."""
    return torch.from_numpy(pixels).permute(2, 0, 1)
