"""Exact intersection over union (IoU) of oriented boxes: batched, on any device, differentiable.

box_intersection.py says how the common volume is computed.
"""

import numpy as np
import torch
from torch import Tensor

from animal3dbox.errors import ShapeError
from animal3dbox.geometry.box_intersection import HalfSizeBoxes, intersection_volume
from animal3dbox.geometry.cuboid import Cuboid


def box_iou(a: Cuboid, b: Cuboid) -> Tensor:
    """The IoU by volume of two oriented boxes, or of each pair of two batches.

    IoU = |a ∩ b| / (|a| + |b| - |a ∩ b|), exact for any two orientations. Where boxes touch or
    coincide the gradient is one of the one-sided ones: finite always.

    Args:
        a: boxes (...,), in one frame and unit with b's; the batches broadcast.
        b: boxes (...,).

    Returns:
        (...,) in [0, 1]; computed in float64, returned in the type that the boxes' promote to.

    Raises:
        ShapeError: a box has no volume, or the batches do not broadcast.

    Example:
        >>> box = Cuboid(torch.zeros(3), torch.eye(3), torch.tensor([2.0, 1.0, 1.0]))
        >>> half_a_length_ahead = Cuboid(torch.tensor([1.0, 0, 0]), box.rotation, box.size)
        >>> round(float(box_iou(box, half_a_length_ahead)), 4)
        0.3333
    """
    boxes_a, boxes_b, shape = _pairs(a, b)
    # In units of each pair's greatest half size no volume overflows
    unit = torch.maximum(boxes_a.half, boxes_b.half).detach().amax(dim=-1, keepdim=True)
    boxes_a, boxes_b = boxes_a.in_units_of(unit), boxes_b.in_units_of(unit)
    common = intersection_volume(boxes_a, boxes_b)
    iou = common / (boxes_a.volume() + boxes_b.volume() - common)
    return iou.reshape(shape).to(_common_type(a, b))


def pairwise_box_iou(a: Cuboid, b: Cuboid) -> Tensor:
    """The IoU of every box of one set with every box of another, as detectors are matched by.

    Args:
        a: N boxes, in one frame and unit with b's.
        b: M boxes.

    Returns:
        (N, M); see box_iou.

    Raises:
        ShapeError: a or b is not a batch (N,) of boxes, or has one without volume.

    Example:
        >>> centers = torch.tensor([[0.0, 0, 0], [1.0, 0, 0], [9.0, 0, 0]])
        >>> boxes = Cuboid(centers, torch.eye(3).expand(3, 3, 3), torch.full((3, 3), 2.0))
        >>> pairwise_box_iou(boxes, boxes)[0].tolist()
        [1.0, 0.3333333432674408, 0.0]
    """
    for name, boxes in (("a", a), ("b", b)):
        if not boxes.center.ndim == boxes.size.ndim == boxes.rotation.ndim - 1 == 2:
            raise ShapeError(
                f"{name} must be a batch (N,) of boxes, got centers {tuple(boxes.center.shape)},"
                f" rotations {tuple(boxes.rotation.shape)}, sizes {tuple(boxes.size.shape)}"
            )
    return box_iou(Cuboid(a.center[:, None], a.rotation[:, None], a.size[:, None]), b)


def box_intersection_volume(a: Cuboid, b: Cuboid) -> Tensor:
    """The volume that two oriented boxes, or each pair of two batches, have in common.

    Args:
        a: boxes (...,), in one frame and unit with b's; the batches broadcast.
        b: boxes (...,).

    Returns:
        (...,) in the unit cubed; type, gradients and errors as box_iou's.

    Example:
        >>> box = Cuboid(torch.zeros(3), torch.eye(3), torch.tensor([2.0, 1.0, 3.0]))
        >>> half_a_length_ahead = Cuboid(torch.tensor([1.0, 0, 0]), box.rotation, box.size)
        >>> float(box_intersection_volume(box, half_a_length_ahead))
        3.0
    """
    boxes_a, boxes_b, shape = _pairs(a, b)
    return intersection_volume(boxes_a, boxes_b).reshape(shape).to(_common_type(a, b))


def _pairs(a: Cuboid, b: Cuboid) -> tuple[HalfSizeBoxes, HalfSizeBoxes, torch.Size]:
    """Two flat batches of boxes of equal length, and the shape of the answer."""
    batches = [
        tuple(field.shape[:-1])
        for box in (a, b)
        for field in (box.center, box.rotation[..., 0], box.size)
    ]
    try:
        shape = torch.Size(np.broadcast_shapes(*batches))
    except ValueError as error:
        raise ShapeError(
            "the batches of a and b must broadcast, got center, rotation and size of shapes"
            f" {', '.join(map(str, batches[:3]))} in a and {', '.join(map(str, batches[3:]))} in b"
        ) from error
    return _flat_boxes("a", a, shape), _flat_boxes("b", b, shape), shape


def _flat_boxes(name: str, cuboid: Cuboid, shape: torch.Size) -> HalfSizeBoxes:
    """Boxes in float64, broadcast to a batch of this shape, which is then flattened."""
    center, rotation, size = cuboid.center.double(), cuboid.rotation.double(), cuboid.size.double()
    if size.numel() and float(size.detach().amin()) <= 0:
        raise ShapeError(f"the size of {name} must be positive, got {float(size.detach().amin())}")
    # One Newton step to the nearest rotation: one stored in float32 is off by 1e-7, and would make
    # a skewed box
    rotation = 1.5 * rotation - 0.5 * rotation @ (rotation.mT @ rotation)
    return HalfSizeBoxes(
        center.expand(*shape, 3).reshape(-1, 3),
        rotation.expand(*shape, 3, 3).reshape(-1, 3, 3),
        (size / 2).expand(*shape, 3).reshape(-1, 3),
    )


def _common_type(a: Cuboid, b: Cuboid) -> torch.dtype:
    """The floating-point type that the boxes' tensors promote to; float64 of whole numbers."""
    dtype = torch.result_type(a.center, b.center)
    for tensor in (a.rotation, a.size, b.rotation, b.size):
        dtype = torch.promote_types(dtype, tensor.dtype)
    return dtype if dtype.is_floating_point else torch.float64
