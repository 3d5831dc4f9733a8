"""Convex polygons: area, clipping at the near plane, area inside the frame of the image.

Polygons travel in batches of fixed length. One with fewer corners repeats its last; an empty one is
all one point. Both have the right area, so no lengths need to be carried along.
"""

import torch
from torch import Tensor

from animal3dbox.geometry.arrays import AnyArray, at_least, clip, like, namespace
from animal3dbox.geometry.checks import check_shape

ROUNDING = 1e-13
"""Areas in boxes below this, times the sum of the polygon's coordinates and the box's sides, are
float64 noise."""


def signed_area(polygons: AnyArray) -> AnyArray:
    """Shoelace area of polygons, positive if they turn from +x towards +y.

    Args:
        polygons: (..., P, 2).

    Returns:
        (...,), in the square of their unit.

    """
    check_shape("polygons", polygons, "... P 2")
    about = (
        polygons[..., 1:, :] - polygons[..., :1, :]
    )  # near the origin, so that no digits cancel; the first corner is the origin
    x, y = about[..., 0], about[..., 1]
    area: AnyArray = 0.5 * (x[..., :-1] * y[..., 1:] - x[..., 1:] * y[..., :-1]).sum(-1)
    return area


def polygon_area(polygons: AnyArray) -> AnyArray:
    """Area of polygons (..., P, 2) without its sign (section 2.3.2, Area), (...,)."""
    return abs(signed_area(polygons))


def clip_by_plane(polygons: Tensor, distance: Tensor) -> Tensor:
    """The parts of convex polygons where a linear function is not negative (Sutherland-Hodgman, one plane).

    Args:
        polygons: (..., P, D) corners in any dimension.
        distance: (..., P) the function at the corners.

    Returns:
        (..., P + 1, D); all zeros where nothing is left.

    """
    check_shape("polygons", polygons, "... P D")
    inside = distance >= 0
    after, distance_after = polygons.roll(-1, -2), distance.roll(-1, -1)
    crosses = inside != (distance_after >= 0)
    gap = distance - distance_after
    fraction = torch.where(crosses, distance, torch.zeros_like(distance)) / torch.where(
        crosses, gap, torch.ones_like(gap)
    )
    between = polygons + fraction[..., None] * (after - polygons)
    # Every corner offers itself, if inside, then the crossing of its edge, if there is one.
    offered = torch.stack((polygons, between), dim=-2).flatten(-3, -2)
    kept = torch.stack((inside, crosses), dim=-1).flatten(-2)
    order = torch.argsort((~kept).to(torch.int8), dim=-1, stable=True)[
        ..., : polygons.shape[-2] + 1
    ]
    count = kept.sum(-1, keepdim=True)
    slot = torch.minimum(
        torch.arange(order.shape[-1], device=order.device).expand_as(order),
        (count - 1).clamp_min(0),
    )
    picked = torch.gather(
        offered,
        -2,
        torch.gather(order, -1, slot)[..., None].expand(*order.shape, offered.shape[-1]),
    )
    return torch.where(count[..., None] > 0, picked, torch.zeros_like(picked))


def clip_to_near(polygons_cam: Tensor, near: Tensor | float) -> Tensor:
    """The parts of polygons (..., P, 3) of the camera frame whose depth is at least near.

    (..., P + 1, 3).

    Where nothing is left, the polygon is the one point (0, 0, near), which projects to the
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
    """Area (...,) of the parts of polygons (..., P, 2) inside the image, in px^2."""
    height, width = image_hw
    return area_in_box(polygons_px, like(polygons_px, [-0.5, -0.5, width - 0.5, height - 0.5]))


def area_in_box(polygons: AnyArray, box: AnyArray) -> AnyArray:
    """Area of the parts of polygons inside an upright box, exactly and without building those parts.

    By Green's theorem the area is the integral of x dy round the polygon with x and y held inside
    the box; along an edge the held x is linear between the points where the edge crosses the box's
    lines.

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
    along = polygons[..., [*range(1, polygons.shape[-2]), 0], :] - polygons
    divisor = along + (along == 0)
    past_low, past_high = (low - polygons) / divisor, (high - polygons) / divisor
    first, last = xp.minimum(past_low, past_high), xp.maximum(past_low, past_high)
    enters, leaves = clip(first[..., 1], 0, 1), clip(last[..., 1], 0, 1)
    turn_low, turn_high = (
        xp.minimum(xp.maximum(first[..., 0], enters), leaves),
        xp.minimum(xp.maximum(last[..., 0], enters), leaves),
    )
    steps = xp.stack((enters, turn_low, turn_high, leaves))  # along an edge, in order
    held = (polygons[..., 0] - low[..., 0]) + along[..., 0] * steps
    held = xp.minimum(at_least(held, 0), high[..., 0] - low[..., 0])
    area = 0.5 * abs(
        ((held[1:] + held[:-1]) * (steps[1:] - steps[:-1]) * along[..., 1]).sum(0).sum(-1)
    )
    reach = (abs(polygons).sum(-1).sum(-1) + 1) * (box[..., 2:] - box[..., :2]).sum(-1)
    certain: AnyArray = area * (area > ROUNDING * reach)
    return certain
