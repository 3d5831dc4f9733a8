"""A cuboid drawn over its picture: front green and back blue, as in the paper's figures."""

from collections.abc import Mapping, Sequence

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from animal3dbox.geometry.box_visibility import near_depth, visible_faces
from animal3dbox.geometry.camera import project
from animal3dbox.geometry.cuboid import EDGES, FACE_NAMES, FACES, Cuboid
from animal3dbox.geometry.polygon import clip_to_near
from animal3dbox.labels.types import CuboidLabel
from animal3dbox.report.fitted_outline import draw_fitted_outline
from animal3dbox.report.label_words import words_of_label
from animal3dbox.smal.model import SmalModel

Picture = NDArray[np.uint8]

FRONT, BACK = (40, 190, 70), (50, 100, 235)
FACE_COLORS = {"front": FRONT, "back": BACK}
EDGE, HIDDEN = (255, 220, 60), (200, 170, 70)
"""Colours of the edges of visible faces and of the others."""
INK, PAPER = (255, 255, 255), (20, 20, 20)
POINT = (235, 60, 60)
LEAST_WIDTH = 480
"""Small pictures are enlarged before drawing, so that the words stay legible."""
MOST_HEIGHT = 2000
"""A narrow strip is not enlarged beyond this."""
DASH, GAP = 9, 8
"""Lengths of the dashes and gaps of dashed lines, px, where lines are one pixel thick."""
SHIFT = 4
"""Bits of OpenCV's fixed-point coordinates."""


def draw_label(image: Picture, label: CuboidLabel, fitted: SmalModel | None = None) -> Picture:
    """The picture with the label's cuboid, keypoints and words; a new array.

    Args:
        image: (H, W, 3) uint8 RGB of the label's size.
        label: what to draw.
        fitted: the model that was fitted, whose outline is drawn beneath the cuboid; None: no
            outline.

    Returns:
        (H', W', 3) uint8 RGB; enlarged if it was small.

    Example:
        >>> from animal3dbox import LabelConfig, label_animal
        >>> label = label_animal(
        ...     image_hw=(120, 160),
        ...     vertices=[[x, y, z] for x in (-1, 1) for y in (-0.5, 0.5) for z in (-0.4, 0.4)],
        ...     K=[[100, 0, 79.5], [0, 100, 59.5], [0, 0, 1]],
        ...     pose=([[1, 0, 0], [0, 0, -1], [0, 1, 0]], [0, 0, 5]),
        ...     config=LabelConfig(axes="pca"),
        ... )
        >>> draw_label(np.zeros((120, 160, 3), dtype=np.uint8), label).shape  # and words below
        (428, 480, 3)
    """
    canvas, factor = enlarged(image)
    if fitted is not None:
        draw_fitted_outline(canvas, label, fitted, factor=factor, width=thickness(canvas))
    draw_cuboid(canvas, label.cuboid, label.K, factor)
    if label.keypoints is not None:
        radius = 3 * thickness(canvas) << SHIFT
        for x, y, visibility in label.keypoints.tolist():
            if visibility > 0:
                center = _fixed((x + 0.5) * factor - 0.5, (y + 0.5) * factor - 0.5)
                cv2.circle(canvas, center, radius, POINT, -1, cv2.LINE_AA, SHIFT)
    return with_words(canvas, words_of_label(label).lines)


def enlarged(image: Picture) -> tuple[Picture, float]:
    """A copy of the picture and the factor by which it is larger.

    It is at least LEAST_WIDTH wide, unless that would make it higher than MOST_HEIGHT.
    """
    factor = max(1.0, min(LEAST_WIDTH / image.shape[1], MOST_HEIGHT / image.shape[0]))
    if factor == 1.0:
        return image.copy(), factor
    size = (round(image.shape[1] * factor), round(image.shape[0] * factor))
    return (
        np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_CUBIC), dtype=np.uint8),
        factor,
    )


def draw_cuboid(
    canvas: Picture,
    cuboid_cam: Cuboid,
    K: torch.Tensor,
    factor: float = 1.0,
    *,
    dashed: bool = False,
    heading_known: bool = True,
) -> None:
    """Draw a cuboid of the camera frame into a picture that was enlarged by a factor.

    It is cut at the near plane. The picture itself is drawn into.

    Args:
        canvas: (H, W, 3) uint8 RGB.
        cuboid_cam: in the camera frame.
        K: (3, 3) px of the picture before it was enlarged.
        factor: by which it was.
        dashed: draw lines dashed and fill no face, as of a detection beside a label.
        heading_known: whether the box has a front; one that has none is drawn without its colours.

    Example:
        >>> canvas = np.zeros((120, 160, 3), dtype=np.uint8)
        >>> box = Cuboid(torch.tensor([0, 0, 5.0]), torch.eye(3), torch.tensor([2.0, 1.0, 1.0]))
        >>> draw_cuboid(canvas, box, torch.tensor([[100, 0, 79.5], [0, 100, 59.5], [0, 0, 1]]))
        >>> bool(canvas[:, 40:120].any()), bool(canvas[:, :40].any())
        (True, False)
    """
    corners, near = cuboid_cam.corners(), near_depth(cuboid_cam)
    visible = visible_faces(corners, torch.zeros_like(cuboid_cam.center)).tolist()
    outlines = {
        name: _pixels(clip_to_near(corners[list(FACES[name])], near), K, factor)
        for name in ("back", "front")
        if heading_known
    }
    for name, outline in outlines.items() if not dashed else ():
        strength = 0.38 if visible[FACE_NAMES.index(name)] else 0.16
        _fill(canvas, outline, FACE_COLORS[name], strength)
    colors = FACE_COLORS if dashed and heading_known else {}
    _draw_edges(
        canvas, corners, visible, near=near, K=K, factor=factor, dashed=dashed, colors=colors
    )
    for name, outline in outlines.items() if not dashed else ():
        if visible[FACE_NAMES.index(name)]:
            points = np.round(outline * (1 << SHIFT)).astype(np.int32)
            width = 2 * thickness(canvas)
            cv2.polylines(canvas, [points], True, FACE_COLORS[name], width, cv2.LINE_AA, SHIFT)


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
        cv2.line(canvas, _fixed(*dash[0]), _fixed(*dash[1]), color, width, cv2.LINE_AA, SHIFT)


def _draw_edges(
    canvas: Picture,
    corners: torch.Tensor,
    visible: Sequence[bool],
    *,
    near: torch.Tensor,
    K: torch.Tensor,
    factor: float,
    dashed: bool,
    colors: Mapping[str, tuple[int, int, int]],
) -> None:
    """Draw the twelve edges, those of visible faces thicker and last.

    Dashed ones of a visible front or back have its colour, for no outline goes over them: colors
    has those of faces by name.
    """
    edges_of_visible_faces = {
        frozenset(edge): colors.get(name, EDGE)
        for name in sorted(FACES, key=lambda name: name in FACE_COLORS)
        if visible[FACE_NAMES.index(name)]
        for edge in zip(FACES[name], FACES[name][1:] + FACES[name][:1], strict=True)
    }
    unit = thickness(canvas)
    for edge in sorted(EDGES, key=lambda e: frozenset(e) in edges_of_visible_faces):
        line = clip_to_near(corners[[edge[0], edge[1], edge[1]]], near)
        if float(line.amax(0)[2] - line.amin(0)[2]) == 0 and float(line.abs()[:, :2].sum()) == 0:
            continue  # all of it is behind the near plane
        ends = _pixels(line, K, factor)[:2]
        visible_color = edges_of_visible_faces.get(frozenset(edge))
        color, width = (visible_color, 2 * unit) if visible_color else (HIDDEN, unit)
        if dashed:
            _draw_dashes(canvas, ends, color, width)
            continue
        start, end = ends
        cv2.line(canvas, _fixed(*start), _fixed(*end), color, width, cv2.LINE_AA, SHIFT)


def with_words(canvas: Picture, lines: list[str]) -> Picture:
    """The picture with a strip of text below it."""
    unit = thickness(canvas)
    strip = np.full(((20 * len(lines) + 8) * unit, canvas.shape[1], 3), PAPER, dtype=np.uint8)
    for i, line in enumerate(lines):
        cv2.putText(
            strip,
            line,
            (8 * unit, (20 * i + 19) * unit),
            cv2.FONT_HERSHEY_SIMPLEX,
            0.5 * unit,
            INK,
            unit,
            cv2.LINE_AA,
        )
    return np.concatenate((canvas, strip))


def thickness(canvas: Picture) -> int:
    """How many times thicker than on a picture of LEAST_WIDTH lines and letters are drawn."""
    return max(1, round(float(canvas.shape[1]) / (1.5 * LEAST_WIDTH)))


def _pixels(points_cam: torch.Tensor, K: torch.Tensor, factor: float) -> NDArray[np.float64]:
    """Pixels (P, 2) of points in the enlarged picture, kept within what OpenCV's integers hold."""
    px, _ = project(K, points_cam)
    return np.asarray(((px + 0.5) * factor - 0.5).clamp(-1e6, 1e6).numpy(), dtype=np.float64)


def _fixed(x: float, y: float) -> tuple[int, int]:
    return round(x * (1 << SHIFT)), round(y * (1 << SHIFT))


def _fill(
    canvas: Picture, outline: NDArray[np.float64], color: tuple[int, int, int], strength: float
) -> None:
    """Blend a convex polygon into the picture."""
    inside = np.zeros(canvas.shape[:2], dtype=np.uint8)
    cv2.fillConvexPoly(
        inside, np.round(outline * (1 << SHIFT)).astype(np.int32), 255, cv2.LINE_8, SHIFT
    )
    where = inside > 0
    canvas[where] = np.round(canvas[where] * (1 - strength) + np.array(color) * strength).astype(
        np.uint8
    )
