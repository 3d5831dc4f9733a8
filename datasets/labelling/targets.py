"""Targets: what a Dataset gives beside an image, made of label rows."""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from animal3dbox.datasets.labelling.label_rows import SPANS, LabelRow, columns, places
from animal3dbox.errors import SampleError
from animal3dbox.smal.keypoints.vocabulary import Vocabulary

FACES = ("face_visible", "face_area", "face_share", "face_share_in_image")
_SURFACE_SHARE = SPANS["surface_share"][0]
_FLOAT32, _BOOL = np.dtype(np.float32), np.dtype(np.bool_)
_Place = tuple[str, tuple[int, ...], int]


def target_of(
    image_id: str,
    rows: Sequence[LabelRow],
    labels: Sequence[int],
    masks: NDArray[np.uint8] | None = None,
    vocabulary: Vocabulary | None = None,
    named_faces: bool = True,
) -> dict[str, Any]:
    """The target of one image, float32.

    In the camera frame, in metres where scale_known, else in each body's unit.

    Args:
        image_id: the image.
        rows: the labels of its N animals, at least one.
        labels: their classes.
        masks: (N, H, W) 0 and 1; None without.
        vocabulary: of the keypoints; None: no keypoints.
        named_faces: whether forward and left mean something; else there are no face fields.

    Returns:
        The fields of design.md's target, with keypoint_mirror (J,), scale_known (N,) and
        scale_source, and surface_share (N, 6) if it was measured.

    """
    measured = named_faces and all(row.values[_SURFACE_SHARE] >= 0 for row in rows)
    target = _tensors(rows, named_faces, measured)
    target["labels"] = torch.from_numpy(np.array(labels, dtype=np.int64))
    if rows[0].distortion is not None:
        target["distortion"] = torch.from_numpy(rows[0].distortion.astype(np.float32))
    if vocabulary is not None and all(row.keypoints is not None for row in rows):
        target["keypoint_mirror"] = torch.from_numpy(_mirror(vocabulary.flip).copy())
        target["keypoints"] = torch.from_numpy(
            np.array([row.keypoints for row in rows], dtype=np.float32)
        )
    if masks is not None:
        target["masks"] = torch.from_numpy(masks)
    scales = [row.scale_m_per_unit for row in rows]
    target["scale_known"] = torch.from_numpy(np.array([scale is not None for scale in scales]))
    target["scale_m_per_unit"] = torch.from_numpy(
        np.array([scale or 1.0 for scale in scales], dtype=np.float32)
    )
    target["scale_source"] = [row.scale_source for row in rows]
    target["quality"] = [row.quality for row in rows]
    target["sample_ids"] = [row.sample_id for row in rows]
    target["image_id"], target["K_source"] = image_id, rows[0].quality["K_source"]
    return target


def _tensors(rows: Sequence[LabelRow], named_faces: bool, measured: bool) -> dict[str, Any]:
    """The fields of LAYOUT as targets have them."""
    numbers, flags = columns(rows)
    of_numbers, of_flags = _plan(len(rows), named_faces, measured)
    target: dict[str, Any] = {
        name: torch.from_numpy(np.ndarray(shape, _FLOAT32, numbers, at))
        for name, shape, at in of_numbers
    }
    for name, shape, at in of_flags:
        target[name] = torch.from_numpy(np.ndarray(shape, _BOOL, flags, at))
    return target


@lru_cache(maxsize=256)
def _plan(count: int, named_faces: bool, measured: bool) -> tuple[list[_Place], list[_Place]]:
    """Name, shape and place of a target's fields in columns' numbers, and in its booleans.

    K is the first animal's, which all share.
    """
    left_out = {
        *(() if named_faces else FACES),
        *(() if measured else ("surface_share",)),
        *(() if count else ("K",)),
    }
    of_numbers, of_flags = (
        [
            ("boxes" if name == "box" else name, shape[1:] if name == "K" else shape, at)
            for name, (shape, at) in places(count, boolean).items()
            if name not in left_out
        ]
        for boolean in (False, True)
    )
    return of_numbers, of_flags


@lru_cache(maxsize=16)
def _mirror(flip: tuple[int, ...]) -> NDArray[np.int64]:
    return np.array(flip, dtype=np.int64)


def empty_target(image_id: str, K: NDArray[np.float64], named_faces: bool = True) -> dict[str, Any]:
    """The target of an image of boxes without any: the same fields, N = 0."""
    target = _tensors([], named_faces, False)
    target |= {
        "K": torch.from_numpy(K.astype(np.float32)),
        "labels": torch.zeros(0, dtype=torch.int64),
    }
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
    for row in rows[1:]:
        if not np.array_equal(row.field("K"), rows[0].field("K")):
            raise SampleError(
                sample_id,
                "K",
                f"the animals {rows[0].sample_id} and {row.sample_id} of this image have different"
                " intrinsics",
            )


def masks_of(masks: Sequence[NDArray[np.bool_]]) -> NDArray[np.uint8]:
    """(N, H, W) 0 and 1, contiguous, of masks (H, W) that are nobody else's.

    A single one is not copied.
    """
    whole = (
        np.ascontiguousarray(np.stack(masks))
        if len(masks) > 1
        else np.ascontiguousarray(masks[0])[None]
    )
    return whole.view(np.uint8)


def image_tensor(pixels: NDArray[np.uint8]) -> torch.Tensor:
    """(3, H, W) uint8 RGB of (H, W, 3), without a copy.

    Channels last in memory, as decoders and OpenCV have them.
    """
    return torch.from_numpy(pixels).permute(2, 0, 1)
