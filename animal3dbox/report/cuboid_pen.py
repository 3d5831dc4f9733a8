"""Lines of the camera frame drawn into pictures: how thick, in which colours, dashed or not."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from animal3dbox.geometry.box_visibility import near_depth
from animal3dbox.geometry.camera import project
from animal3dbox.geometry.cuboid import EDGES, FACE_NAMES, FACES, Cuboid
from animal3dbox.geometry.polygon import clip_to_near
from animal3dbox.report.inset import Picture, Region

FRONT, BACK = (40, 190, 70), (50, 100, 235)
FACE_COLORS = {"front": FRONT, "back": BACK}
EDGE, HIDDEN = (255, 220, 60), (200, 170, 70)
"""Colours of the edges of visible faces and of the others."""
INK, PAPER = (255, 255, 255), (20, 20, 20)
POINT = (235, 60, 60)
LEAST_WIDTH = 480
"""Small pictures are enlarged before drawing, so that the words stay legible."""
DASH, GAP = 9, 8
"""Lengths of the dashes and gaps of dashed lines, px, where lines are one pixel thick."""
SHIFT = 4
"""Bits of OpenCV's fixed-point coordinates."""
PX_PER_WIDTH = 250
"""A box so long, px, has lines of one more pixel than one of half that, if the picture is large."""
PX_PER_DOT = 50
"""A keypoint's radius is at most this part of its box's length."""
LEAST_DOUBLED_PX = 60
"""Boxes shorter than this have all their lines one pixel wide."""
ARROW_HEIGHT, ARROW_HEAD = -0.3, (0.15, 0.11)
"""Where the arrow runs over the box's middle, and its head's length and half width, in parts of the
box's sides: below the trunk, and wholly inside the box."""


@dataclass(frozen=True)
class LineWidths:
    """How thick one animal is drawn, px of the enlarged picture: thin enough not to cover it.

    Attributes:
        thin: of edges of hidden faces.
        strong: of edges of visible faces.
        dot: the radius of a keypoint.
    """

    thin: int
    strong: int
    dot: int


def region_of(cuboid_cam: Cuboid, K: torch.Tensor, image_hw: tuple[int, int]) -> Region | None:
    """The rectangle about what the picture shows of a cuboid; None if it shows nothing.

    Args:
        cuboid_cam: in the camera frame.
        K: (3, 3) px.
        image_hw: height and width.

    """
    faces = cuboid_cam.corners()[torch.tensor([*FACES.values()])]
    points = clip_to_near(faces, near_depth(cuboid_cam)).flatten(0, 1)
    points = points[(points[:, :2] != 0).any(-1)]  # faces behind the camera are at (0, 0, near)
    if not len(points):
        return None
    px = pixels(points, K, 1.0)
    (x1, y1), (x2, y2) = px.min(0), px.max(0)
    height, width = image_hw
    region = Region(max(x1, -0.5), max(y1, -0.5), min(x2, width - 0.5), min(y2, height - 0.5))
    return region if region.width > 0 and region.height > 0 else None


def line_widths(
    canvas: Picture, region: Region | None, factor: float, *, unit: int | None = None
) -> LineWidths:
    """The widths of an animal's lines, by how large it is in an enlarged picture.

    Args:
        canvas: (H, W, 3) the enlarged picture.
        region: where the animal is in the picture, before it was enlarged.
        factor: by which it was.
        unit: the most that a thin line may have; None: by the picture's width.

    """
    length = 0.0 if region is None else factor * region.longer
    most = thickness(canvas) if unit is None else unit
    thin = max(1, min(most, round(length / PX_PER_WIDTH)))
    if length < LEAST_DOUBLED_PX:
        return LineWidths(thin=1, strong=1, dot=1)
    dot = max(1, min(3 * thin, round(length / PX_PER_DOT)))
    return LineWidths(thin=thin, strong=2 * thin, dot=dot)


def size_before(canvas: Picture, factor: float) -> tuple[int, int]:
    """Height and width of a picture before it was enlarged, px."""
    return round(canvas.shape[0] / factor), round(canvas.shape[1] / factor)


@dataclass(frozen=True)
class CuboidPen:
    """Draws lines of the camera frame into an enlarged picture, cut at the near plane.

    Attributes:
        canvas: (H, W, 3) uint8 RGB, which is drawn into.
        K: (3, 3) px of the picture before it was enlarged.
        factor: by which it was.
        widths: of its lines.
        near: depth of the near plane.
        dashed: whether lines are.
    """

    canvas: Picture
    K: torch.Tensor
    factor: float
    widths: LineWidths
    near: torch.Tensor
    dashed: bool

    def draw(
        self, start: torch.Tensor, end: torch.Tensor, color: tuple[int, int, int], width: int
    ) -> None:
        """Draw the line between two points (3,)."""
        line = clip_to_near(torch.stack([start, end, end]), self.near)
        if float(line.amax(0)[2] - line.amin(0)[2]) == 0 and float(line.abs()[:, :2].sum()) == 0:
            return  # all of it is behind the near plane
        ends = pixels(line, self.K, self.factor)[:2]
        if self.dashed:
            _draw_dashes(self.canvas, ends, color, width)
            return
        first, last = (fixed(*end) for end in ends)
        cv2.line(self.canvas, first, last, color, width, cv2.LINE_AA, SHIFT)

    def draw_edges(
        self,
        corners: torch.Tensor,
        visible: Sequence[bool],
        *,
        colors: Mapping[str, tuple[int, int, int]],
    ) -> None:
        """Draw the twelve edges, those of visible faces thicker and last.

        Dashed ones of a visible front or back have its colour, for no outline goes over them:
        colors has those of faces by name.
        """
        edges_of_visible_faces = {
            frozenset(edge): colors.get(name, EDGE)
            for name in sorted(FACES, key=lambda name: name in FACE_COLORS)
            if visible[FACE_NAMES.index(name)]
            for edge in zip(FACES[name], FACES[name][1:] + FACES[name][:1], strict=True)
        }
        for edge in sorted(EDGES, key=lambda e: frozenset(e) in edges_of_visible_faces):
            color = edges_of_visible_faces.get(frozenset(edge))
            width = self.widths.strong if color else self.widths.thin
            self.draw(corners[edge[0]], corners[edge[1]], color or HIDDEN, width)

    def draw_arrow(self, cuboid_cam: Cuboid) -> None:
        """Draw an arrow inside the box to the middle of its front, the head turned to the camera.

        It is white within a dark rim, so that it is seen on any fur and without any colour.
        """
        length, half_width = ARROW_HEAD
        line_of_sight = cuboid_cam.rotation.mT @ cuboid_cam.center
        is_from_the_side = bool(line_of_sight[1].abs() >= line_of_sight[2].abs())
        aside = (0.0, 0.0, half_width) if is_from_the_side else (0.0, half_width, 0.0)
        in_box = [(0.0, 0.0, ARROW_HEIGHT), (0.5, 0.0, ARROW_HEIGHT)] + [
            (0.5 - length, sign * aside[1], ARROW_HEIGHT + sign * aside[2]) for sign in (1, -1)
        ]
        parts = torch.tensor(in_box, dtype=cuboid_cam.center.dtype)
        points = parts * cuboid_cam.size @ cuboid_cam.rotation.mT + cuboid_cam.center
        start, tip, *barbs = points
        rim = self.widths.strong + (2 * self.widths.thin if self.widths.strong > 1 else 0)
        for color, width in ((PAPER, rim), (INK, self.widths.strong)):
            for point in (start, *barbs):
                self.draw(point, tip, color, width)


def _draw_dashes(
    canvas: Picture, line: NDArray[np.float64], color: tuple[int, int, int], width: int
) -> None:
    """Draw the part of a line (2, 2) px that lies in the picture, dashed."""
    first, last = ((round(float(x)), round(float(y))) for x, y in line)
    inside, *ends = cv2.clipLine((0, 0, canvas.shape[1], canvas.shape[0]), first, last)
    if not inside:
        return
    start, end = np.array(ends, dtype=np.float64)
    length, unit = float(np.linalg.norm(end - start)), thickness(canvas)
    for begin in np.arange(0.0, max(length, 1.0), (DASH + GAP) * unit):
        along = np.array([begin, min(begin + DASH * unit, length)]) / max(length, 1.0)
        dash = start + along[:, None] * (end - start)
        cv2.line(canvas, fixed(*dash[0]), fixed(*dash[1]), color, width, cv2.LINE_AA, SHIFT)


def thickness(canvas: Picture) -> int:
    """How many times thicker than on a picture of LEAST_WIDTH lines and letters are drawn."""
    return max(1, round(float(canvas.shape[1]) / (1.5 * LEAST_WIDTH)))


def pixels(points_cam: torch.Tensor, K: torch.Tensor, factor: float) -> NDArray[np.float64]:
    """Pixels (P, 2) of points in the enlarged picture, kept within what OpenCV's integers hold."""
    px, _ = project(K, points_cam)
    return np.asarray(((px + 0.5) * factor - 0.5).clamp(-1e6, 1e6).numpy(), dtype=np.float64)


def fixed(x: float, y: float) -> tuple[int, int]:
    """A pixel in OpenCV's fixed-point coordinates."""
    return round(x * (1 << SHIFT)), round(y * (1 << SHIFT))
