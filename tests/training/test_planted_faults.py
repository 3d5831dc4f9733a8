"""Each check of targets catches the fault that was planted for it."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor
from training_batches import HW, Batch, good_batch, images_of

from animal3dbox.errors import SampleError
from animal3dbox.geometry.cuboid import MIRRORED_CORNERS, MIRRORED_FACES
from animal3dbox.training.checks import check_targets
from animal3dbox.training.findings import CHECKS, WARNINGS, TargetReport


def put(field: str, change: Callable[[Tensor], Any]) -> Callable[[Batch], None]:
    """A fault in one field of the third target, which keeps its type."""

    def plant(batch: Batch) -> None:
        batch[2][field] = change(batch[2][field].clone())

    return plant


def at(index: Any, value: Any) -> Callable[[Tensor], Tensor]:
    """Another value at one place."""

    def change(tensor: Tensor) -> Tensor:
        tensor[index] = value
        return tensor

    return change


def flipped_by_another_library(batch: Batch) -> None:
    """A flip as a library of 2D and 3D points makes it.

    All coordinates are mirrored, no name is changed.
    """
    target, mirror = batch[2], torch.tensor([-1.0, 1, 1])
    target["K"] = target["K"].clone()
    target["K"][0, 2] = HW[1] - 1 - target["K"][0, 2]
    target["corners_2d"] = torch.stack(
        (HW[1] - 1 - target["corners_2d"][..., 0], target["corners_2d"][..., 1]), dim=-1
    )
    for name in ("corners_3d", "center"):
        target[name] = target[name] * mirror
    target["rotation"] = torch.diag(mirror) @ target["rotation"]


def twice(batch: Batch) -> None:
    """The first animal once more, in the place of the second."""
    for name, values in batch[2].items():
        if isinstance(values, Tensor) and name not in ("K", "keypoint_mirror"):
            batch[2][name] = values[[0, 0]]


FAULTS: dict[str, tuple[Callable[[Batch], None], str, str]] = {
    "labels of another type": (put("labels", lambda v: v.int()), "dtype", "labels"),
    "half precision": (put("center", lambda v: v.half()), "dtype", "center"),
    "flags as floats": (put("corner_in_front", lambda v: v.float()), "dtype", "corner_in_front"),
    "a list": (put("boxes", lambda v: v.tolist()), "dtype", "boxes"),
    "one box without its dimension": (put("size", lambda v: v[0]), "shape", "size"),
    "boxes of five numbers": (
        put("boxes", lambda v: torch.cat((v, v[:, :1]), 1)),
        "shape",
        "boxes",
    ),
    "labels of three animals": (put("labels", lambda v: torch.cat((v, v[:1]))), "count", "labels"),
    "NaN": (put("center", at((1, 0), float("nan"))), "finite", "center"),
    "infinite keypoint": (put("keypoints", at((1, 0, 0), float("inf"))), "finite", "keypoints"),
    "NaN in K": (put("K", at((0, 0), float("nan"))), "finite", "K"),
    "K transposed": (put("K", lambda v: v.T.contiguous()), "K", "K"),
    "negative focal": (put("K", at((1, 1), -300.0)), "K", "K"),
    "K not scaled": (put("K", at((2, 2), 2.0)), "K", "K"),
    "K of another size": (
        put("K", lambda v: torch.diag(torch.tensor([0.5, 0.5, 1.0])) @ v),
        "projection",
        "corners_2d",
    ),
    "rotation sheared": (put("rotation", at((1, 0, 0), 1.5)), "orthogonal", "rotation"),
    "R a reflection": (put("R", lambda v: v * torch.tensor([-1.0, 1, 1])), "handedness", "R"),
    "rotation mirrored": (
        put("rotation", lambda v: v * torch.tensor([1.0, -1, 1])),
        "handedness",
        "rotation",
    ),
    "size zero": (put("size", at((1, 2), 0.0)), "size", "size"),
    "corners in mirrored order": (
        put("corners_3d", lambda v: v[:, list(MIRRORED_CORNERS)]),
        "corner_order",
        "corners_3d",
    ),
    "corners in Cartesian order": (
        put("corners_3d", lambda v: v[:, [0, 4, 3, 7, 1, 5, 2, 6]]),
        "corner_order",
        "corners_3d",
    ),
    "corners of another frame": (put("corners_3d", lambda v: v + 0.01), "corners_3d", "corners_3d"),
    "size halved": (put("size", lambda v: v / 2), "corners_3d", "corners_3d"),
    "2D moved by 0.1 px": (put("corners_2d", lambda v: v + 0.1), "projection", "corners_2d"),
    "distance in another unit": (put("distance", lambda v: v * 100), "distance", "distance"),
    "in front flag": (
        put("corner_in_front", at((1, 3), False)),
        "corner_in_front",
        "corner_in_front",
    ),
    "behind flag": (put("behind_camera", at(1, True)), "behind_camera", "behind_camera"),
    "both opposite faces": (
        put("face_visible", lambda v: v | v[:, [1, 0, 3, 2, 5, 4]]),
        "opposite_faces",
        "face_visible",
    ),
    "left and right of faces swapped": (
        put("face_visible", lambda v: v[:, list(MIRRORED_FACES)]),
        "face_visible",
        "face_visible",
    ),
    "areas halved": (put("face_area", lambda v: v / 2), "face_area", "face_area"),
    "area of a hidden face": (put("face_area", lambda v: v + 50.0), "hidden_area", "face_area"),
    "shares of another box": (
        put("face_share", lambda v: v.flip(0)),
        "share_of_area",
        "face_share",
    ),
    "flanks not mirrored with the box": (put("flank", lambda v: 3 - v), "flank", "flank"),
    "no flank": (put("flank", at(1, 7)), "flank", "flank"),
    "shares not normalised": (put("face_share", lambda v: v * 0.9), "shares", "face_share"),
    "negative share": (put("surface_share", at((1, 0), -0.2)), "shares", "surface_share"),
    "in-image shares of another box": (
        put("face_share_in_image", lambda v: v.flip(1)),
        "shares",
        "face_share_in_image",
    ),
    "box turned round": (put("boxes", lambda v: v[:, [2, 1, 0, 3]]), "boxes", "boxes"),
    "box outside": (put("boxes", lambda v: v + 300.0), "boxes_in_frame", "boxes"),
    "box of another animal": (
        put("boxes", lambda v: torch.tensor([[0.0, 0, 3, 3]] * 2)),
        "boxes_on_cuboid",
        "boxes",
    ),
    "truncation out of range": (put("truncation", at(1, -0.25)), "truncation", "truncation"),
    "truncation not of this crop": (
        put("truncation", lambda v: (v + 0.3).clamp(0, 1)),
        "truncation",
        "truncation",
    ),
    "an animal twice": (twice, "twice", "center"),
    "label -1": (put("labels", at(1, -1)), "labels", "labels"),
    "keypoints marked outside": (
        put("keypoints", at((1, 0), torch.tensor([900.0, 5, 1]))),
        "keypoints",
        "keypoints",
    ),
    "keypoints of another place": (
        put(
            "keypoints",
            lambda v: v.repeat(1, 2, 1) * torch.tensor([0.0, 0, 1]) + torch.tensor([1.0, 1, 0]),
        ),
        "keypoints_on_animal",
        "keypoints",
    ),
    "negative visibility": (put("keypoints", at((1, 0, 2), -1.0)), "keypoints", "keypoints"),
    "mask of 255": (put("masks", lambda v: v * 255), "masks", "masks"),
    "mask flipped": (put("masks", lambda v: v.flip(-2)), "masks", "masks"),
    "mask of another size": (put("masks", lambda v: v[:, ::2, ::2].contiguous()), "masks", "masks"),
    "flipped by another library": (flipped_by_another_library, "handedness", "rotation"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_each_check_catches_its_planted_fault(fault: str) -> None:
    plant, check, field = FAULTS[fault]
    batch = good_batch(seed=3)
    plant(batch)
    reports = [
        check_targets(batch, images_of(batch), on_fault="count", step=step) for step in range(16)
    ]  # masks are looked at in turns
    report = sum(reports, TargetReport())
    assert report.counts[check] > 0, str(report)
    assert any(name == check and error.field == field for name, error in report.examples), str(
        report
    )
    assert all(
        error.sample_id is not None and error.sample_id.startswith("scene5.jpg")
        for _, error in report.examples
    ), str(report)
    step = next(
        step
        for step in range(16)
        if check_targets(batch, images_of(batch), on_fault="count", step=step).faults
    )
    with pytest.raises(SampleError, match=r"^scene5\.jpg"):
        check_targets(batch, images_of(batch), step=step)


def test_every_check_has_a_planted_fault_and_its_line_in_the_documents() -> None:
    elsewhere = {"batch", "mirrored", "H_out_in", "share_in_image", "range"}  # below
    assert {check for _, check, _ in FAULTS.values()} | elsewhere == set(CHECKS)
    page = (Path(__file__).parents[2] / "docs" / "checks.md").read_text()
    assert [
        name
        for name, meaning in {**CHECKS, **WARNINGS}.items()
        if f"| `{name}` | {meaning} |" not in page
    ] == []
