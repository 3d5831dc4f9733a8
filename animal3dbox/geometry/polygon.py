"""Convex polygons: their area, clipping at the near plane, and the area inside the frame.

Polygons travel in batches of one length. One with fewer corners repeats its last; an empty one is
all one point. Both have the right area, so no lengths need to be carried along.
"""

import numpy as np
import torch
from torch import Tensor

from animal3dbox.geometry.arrays import AnyArray, at_least, clip, like, namespace, rows_at
from animal3dbox.geometry.checks import check_shape
from animal3dbox.geometry.frame import frame_box

ROUNDING = 1e-13
"""An area in a box below this share of what its rounding depends on is float64 noise.

The share is of (sum of the polygon's coordinates + 1) times the sum of the box's sides.
"""


def signed_area(polygons: AnyArray) -> AnyArray:
    """The area of polygons by the shoelace formula, positive if they turn from +x towards +y.

    Args:
        polygons: (..., P, 2).

    Returns:
        (...,), in the square of their unit.

    """
    check_shape("polygons", polygons, "... P 2")
    # About the first corner, so that no digits cancel far from the origin
    about = polygons[..., 1:, :] - polygons[..., :1, :]
    x, y = about[..., 0], about[..., 1]
    # area = 1/2 sum of x_i y_(i+1) - x_(i+1) y_i
    area: AnyArray = 0.5 * (x[..., :-1] * y[..., 1:] - x[..., 1:] * y[..., :-1]).sum(-1)
    return area


def polygon_area(polygons: AnyArray) -> AnyArray:
    """The area of polygons (..., P, 2) without its sign (section 2.3.2, Area), (...,)."""
    return abs(signed_area(polygons))


def clip_by_plane(polygons: Tensor, distance: Tensor) -> Tensor:
    """The parts of convex polygons on one side of a plane (Sutherland and Hodgman's step).

    Args:
        polygons: (..., P, D) corners in any dimension.
        distance: (..., P) of the corners from the plane, in any unit; not negative on the side that
            stays.

    Returns:
        (..., P + 1, D); all zeros where nothing is left.

    """
    check_shape("polygons", polygons, "... P D")
    inside = distance >= 0
    after, distance_after = polygons.roll(-1, -2), distance.roll(-1, -1)
    crosses = inside != (distance_after >= 0)
    gap = distance - distance_after
    # crossing = corner + d / (d - d_after) (corner_after - corner)
    fraction = torch.where(crosses, distance, torch.zeros_like(distance)) / torch.where(
        crosses, gap, torch.ones_like(gap)
    )
    crossings = polygons + fraction[..., None] * (after - polygons)
    # Every corner is a candidate, if inside, then the crossing of its edge, if there is one
    candidates = torch.stack((polygons, crossings), dim=-2).flatten(-3, -2)
    is_corner = torch.stack((inside, crosses), dim=-1).flatten(-2)
    order = torch.argsort((~is_corner).to(torch.int8), dim=-1, stable=True)
    order = order[..., : polygons.shape[-2] + 1]
    count = is_corner.sum(-1, keepdim=True)
    slots = torch.arange(order.shape[-1], device=order.device).expand_as(order)
    slots = torch.minimum(slots, (count - 1).clamp_min(0))  # those left over repeat the last corner
    rows = torch.gather(order, -1, slots)[..., None].expand(*order.shape, candidates.shape[-1])
    clipped = torch.gather(candidates, -2, rows)
    return torch.where(count[..., None] > 0, clipped, torch.zeros_like(clipped))


def clip_to_near(polygons_cam: Tensor, near: Tensor | float) -> Tensor:
    """The parts of polygons in front of the near plane.

    Args:
        polygons_cam: (..., P, 3) in the camera frame.
        near: the plane's depth, a number or a tensor that broadcasts to (..., P).

    Returns:
        (..., P + 1, 3); where nothing is left, the one point (0, 0, near), which projects to the
        principal point.

    """
    check_shape("polygons_cam", polygons_cam, "... P 3")
    clipped = clip_by_plane(polygons_cam, polygons_cam[..., 2] - near)
    empty = (clipped == 0).all(-1).all(-1)[..., None]
    depth = torch.as_tensor(near, dtype=clipped.dtype, device=clipped.device).expand_as(
        clipped[..., 2]
    )
    return torch.cat(
        (clipped[..., :2], torch.where(empty, depth, clipped[..., 2])[..., None]), dim=-1
    )


def area_in_frame(polygons_px: AnyArray, image_hw: tuple[int, int]) -> AnyArray:
    """The area (...,) in px^2 of the parts of polygons (..., P, 2) px inside the image."""
    return area_in_box(polygons_px, like(polygons_px, frame_box(image_hw)))


def area_in_box(polygons: AnyArray, box: AnyArray) -> AnyArray:
    """The area of polygons inside an upright box, exactly and without building their parts.

    By Green's theorem the area is the integral of x dy round the polygon, with x and y clamped to
    the box; along an edge the clamped x is linear between the points where the edge crosses the
    box's lines.

    Args:
        polygons: (..., P, 2).
        box: (..., 4) least x, least y, greatest x, greatest y; broadcasts against the polygons'
            batch.

    Returns:
        (...,); 0 below what rounding makes of a polygon that only touches the box.

    """
    check_shape("polygons", polygons, "... P 2")
    xp = namespace(polygons)
    low, high = box[..., None, :2], box[..., None, 2:]
    along = rows_at(polygons, np.arange(1, polygons.shape[-2] + 1) % polygons.shape[-2]) - polygons
    divisor = along + (along == 0)
    past_low, past_high = (low - polygons) / divisor, (high - polygons) / divisor
    first = clip(xp.minimum(past_low, past_high), 0, 1)
    last = clip(xp.maximum(past_low, past_high), 0, 1)
    enters, leaves = first[..., 1], last[..., 1]
    turn_low = xp.minimum(xp.maximum(first[..., 0], enters), leaves)
    turn_high = xp.minimum(xp.maximum(last[..., 0], enters), leaves)
    steps = xp.stack((enters, turn_low, turn_high, leaves))  # along an edge, in order
    clamped = (polygons[..., 0] - low[..., 0]) + along[..., 0] * steps
    clamped = xp.minimum(at_least(clamped, 0), high[..., 0] - low[..., 0])
    # integral of x dy = sum over the pieces of an edge of (x_i + x_(i+1)) / 2 (y_(i+1) - y_i)
    pieces = (clamped[1:] + clamped[:-1]) * (steps[1:] - steps[:-1]) * along[..., 1]
    area = 0.5 * abs(pieces.sum((0, -1)))
    reach = (abs(polygons).sum((-2, -1)) + 1) * (box[..., 2:] - box[..., :2]).sum(-1)
    certain: AnyArray = area * (area > ROUNDING * reach)
    return certain
