"""Faces of the box against ray-casting, and its shares against the animal's own (section 3.3)."""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from animal3dbox.datasets.synthetic.ray_shares import face_shares_by_rays
from animal3dbox.evaluate.face_views import BEHIND, CLASSES, draw_view
from animal3dbox.evaluate.subject import Subject
from animal3dbox.evaluate.tables import Cell, Table, mean, percent, quantile, table_from_records
from animal3dbox.geometry.box_visibility import face_visibility, projected_faces
from animal3dbox.geometry.cuboid import FACES, Cuboid
from animal3dbox.geometry.rigid_transforms import transform_points
from animal3dbox.geometry.visible_surface import surface_share

RAYS = 256
"""Rays along each side of the part of the picture that the box's faces fill.

RAYS squared of them, evenly spread.
"""
ON_FACE = (-0.8, 0.0, 0.8)
"""Where on a face, from its centre to its border, rays are aimed that tell whether it is seen."""


@dataclass(frozen=True)
class FaceRow:
    """One view of one animal's box.

    Attributes:
        index: of the animal.
        view: of CLASSES.
        booleans_right: how many of the six faces are seen or hidden as the rays say.
        share_error: greatest difference of a face's share from the rays', of the whole box; None if
            corners are behind the camera.
        share_in_image_error: the same within the frame.
        surface_difference: greatest difference of a face's share in the frame from the part of the
            animal's visible surface that faces there.
        same_side: the largest share is of the side that most of the surface faces; None if no
            surface is seen.

    Example:
        >>> row = FaceRow(0, "in frame", 6, 6e-6, 6e-6, surface_difference=0.14, same_side=True)
        >>> row.booleans_right, row.same_side  # all six faces as the rays say
        (6, True)
    """

    index: int
    view: str
    booleans_right: int
    share_error: float | None
    share_in_image_error: float
    surface_difference: float | None
    same_side: bool | None


def seen_by_rays(box: Cuboid) -> Tensor:
    """Which faces (6,) of a box in the camera frame rays meet first.

    Nine rays are aimed at each face; most of them must enter the box there.
    """
    grid = torch.tensor([[1.0, a, b] for a in ON_FACE for b in ON_FACE], dtype=torch.float64)
    eye = -box.center @ box.rotation
    half = box.size / 2
    visible = []
    for face in range(len(FACES)):
        axis, sign = face // 2, (1.0 if face in (0, 2, 4) else -1.0)
        points = (
            torch.roll(grid, axis, dims=1) * torch.where(torch.arange(3) == axis, sign, 1.0) * half
        )
        rays = points - eye
        to_low, to_high = (-half - eye) / rays, (half - eye) / rays
        enter, by = torch.minimum(to_low, to_high).max(dim=1)
        meets = (by == axis) & (enter > 0) & (torch.sign(rays[:, axis]) == -sign)
        visible.append(bool(meets.sum() > len(grid) / 2))
    return torch.tensor(visible)


def window_shares(box: Cuboid, K: Tensor, image_hw: tuple[int, int], within_frame: bool) -> Tensor:
    """Shares (6,) by RAYS squared rays over what the box's faces fill of the picture.

    Args:
        box: in the camera frame.
        K: (3, 3) px.
        image_hw: height and width.
        within_frame: whether the frame cuts that part.

    """
    px = projected_faces(box.corners(), K).reshape(-1, 2)
    low, high = px.amin(0), px.amax(0)
    if within_frame:
        beyond = torch.tensor([image_hw[1] - 0.5, image_hw[0] - 0.5], dtype=px.dtype)
        low, high = (
            torch.minimum(low.clamp_min(-0.5), beyond),
            torch.minimum(high.clamp_min(-0.5), beyond),
        )
    size = high - low
    if not bool((size > 0).all()):
        return torch.zeros(6, dtype=px.dtype)
    zoom = torch.eye(3, dtype=px.dtype)
    zoom[[0, 1], [0, 1]] = RAYS / size
    zoom[:2, 2] = -low * RAYS / size - 0.5
    return face_shares_by_rays(box, zoom @ K, (RAYS, RAYS))


def face_rows(subject: Subject) -> list[FaceRow]:
    """One animal's box under a camera of every class of view."""
    animal, rows = subject.animal, []
    for view in CLASSES:
        camera = draw_view(
            view, animal.cuboid_world, animal.vertices, seed=subject.seed, index=subject.index
        )
        if camera is None:
            continue
        box = animal.cuboid_world.transformed(camera.T_cam_world)
        faces = face_visibility(box, camera.K, camera.image_hw)
        whole = (
            None
            if view == BEHIND
            else float(
                (window_shares(box, camera.K, camera.image_hw, False) - faces.share).abs().amax()
            )
        )
        inside = float(
            (window_shares(box, camera.K, camera.image_hw, True) - faces.share_in_image)
            .abs()
            .amax()
        )
        right = int((seen_by_rays(box) == faces.visible).sum())
        surface = surface_share(
            transform_points(camera.T_cam_world, animal.vertices),
            animal.model.faces,
            box.rotation,
            K=camera.K,
            image_hw=camera.image_hw,
        )
        difference = same_side = None
        if bool(surface.any()):
            difference = float((surface - faces.share_in_image).abs().amax())
            same_side = bool(surface.argmax() == faces.share_in_image.argmax())
        rows.append(FaceRow(subject.index, view, right, whole, inside, difference, same_side))
    return rows


def face_table(rows: Sequence[FaceRow]) -> Table:
    """Every class of view, its faces by the formula against its faces by rays."""
    records: list[dict[str, Cell]] = []
    for view in CLASSES:
        of_view = [row for row in rows if row.view == view]
        right = sum(row.booleans_right for row in of_view)
        in_frame = [row.share_in_image_error for row in of_view]
        other_side = [not row.same_side for row in of_view if row.same_side is not None]
        records.append(
            {
                "view": view,
                "views": len(of_view),
                "booleans right %": 100 * right / (6 * len(of_view)) if of_view else None,
                "share max error": quantile([row.share_error for row in of_view], 1.0),
                "in-frame share mean error": mean(in_frame),
                "in-frame share max error": quantile(in_frame, 1.0),
                "box to surface mean": mean(row.surface_difference for row in of_view),
                "other side %": percent(other_side),
            }
        )
    notes = (
        f"{RAYS} x {RAYS} rays, evenly spread over the part of the picture that the box fills,"
        f" count by which face each enters; for the booleans, {len(ON_FACE) ** 2} rays to each"
        " face. share: of the whole box, where it is all before the camera; in-frame: clipped by"
        " the frame.",
        "box to surface: greatest difference, over the faces, of the box's in-frame share from the"
        " part of the animal's own visible surface facing that side. other side: the largest share"
        " and most of the surface name different sides.",
    )
    return table_from_records("faces", "Faces against ray-casting", records, notes=notes)
