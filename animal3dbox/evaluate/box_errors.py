"""One box beside the true one, beside the two numbers that one picture does not tell."""

import math
from dataclasses import dataclass, replace

import torch

from animal3dbox.geometry.box_overlap import box_iou
from animal3dbox.geometry.box_visibility import face_normals, visible_faces
from animal3dbox.geometry.cuboid import FACES, Cuboid
from animal3dbox.geometry.rigid_transforms import rotation_angle

EDGE_ON_DEG, FLANK_DEG = 5.0, 20.0
"""A view in which a true face is nearer to edge-on tells nothing of faces; a camera nearer to the
sagittal plane shows no flank."""


@dataclass(frozen=True)
class BoxErrors:
    """How far an animal's box is from the truth.

    Attributes:
        deg: of the rotation.
        iou: intersection over union, aligned.
        corners: mean distance of the aligned corners, by the diagonal.
        faces: whether the faces seen are exactly right; None if one is nearly edge-on.
        flank: whether the flank shown is right; None if none is.

    Example:
        >>> BoxErrors(deg=2.5, iou=0.85, corners=0.03, faces=True, flank=None).faces
        True
    """

    deg: float
    iou: float
    corners: float
    faces: bool | None
    flank: bool | None


def box_errors(box: Cuboid, truth: Cuboid) -> BoxErrors:
    """A box beside the true one, both in the camera frame.

    Overlap and corners are those of the box scaled about the camera's centre to the true distance
    and about its own centre to the true diagonal, which one picture does not tell.

    Example:
        >>> truth = Cuboid(torch.tensor([0.3, 0.2, 5.0]), torch.eye(3), torch.tensor([2.0, 1, 1]))
        >>> twice = Cuboid(2 * truth.center, truth.rotation, 2 * truth.size)
        >>> round(box_errors(twice, truth).iou, 4), box_errors(twice, truth).deg
        (1.0, 0.0)
    """
    corners = truth.corners()
    distance = torch.linalg.vector_norm(truth.center) / torch.linalg.vector_norm(box.center)
    aligned = replace(
        box, center=box.center * distance, size=box.size * (truth.diagonal / box.diagonal)
    )
    apart = torch.linalg.vector_norm(aligned.corners() - corners, dim=-1).mean()
    origin = torch.zeros_like(truth.center)
    same = torch.equal(visible_faces(box.corners(), origin), visible_faces(corners, origin))
    side, own_side = (float((-one.rotation.mT @ one.center)[1]) for one in (truth, box))
    return BoxErrors(
        deg=float(torch.rad2deg(rotation_angle(box.rotation, truth.rotation))),
        iou=float(box_iou(aligned, truth)),
        corners=float(apart / truth.diagonal),
        faces=same if _edge_on_deg(truth) >= EDGE_ON_DEG else None,
        flank=side * own_side > 0 if lateral_deg(truth) > FLANK_DEG else None,
    )


def lateral_deg(box: Cuboid) -> float:
    """How far the camera stands from a box's sagittal plane, 0 to 90 degrees."""
    side = float((-box.rotation.mT @ box.center)[1])
    return math.degrees(math.asin(abs(side) / float(torch.linalg.vector_norm(box.center))))


def _edge_on_deg(box: Cuboid) -> float:
    """The least angle between a face and the line of sight to its middle, degrees."""
    corners = box.corners()
    middles = corners[torch.tensor(list(FACES.values()))].mean(1)
    sight = middles / torch.linalg.vector_norm(middles, dim=-1, keepdim=True)
    return float(torch.rad2deg(torch.asin((face_normals(corners) * sight).sum(-1))).abs().min())
