"""A cuboid drawn over its picture: front green and back blue, as in the paper's figures.

The front is told without its colour too: a cross fills it where it is seen, and an arrow inside the
box points to it. Lines are as thick as the animal's size admits, and a small animal is shown once
more, enlarged, in a corner.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from animal3dbox.geometry.box_visibility import near_depth, visible_faces
from animal3dbox.geometry.cuboid import FACE_NAMES, FACES, Cuboid
from animal3dbox.geometry.polygon import clip_to_near
from animal3dbox.labels.types import CuboidLabel
from animal3dbox.report.cuboid_pen import (
    FACE_COLORS,
    INK,
    LEAST_WIDTH,
    PAPER,
    POINT,
    SHIFT,
    CuboidPen,
    fixed,
    line_widths,
    pixels,
    region_of,
    size_before,
    thickness,
)
from animal3dbox.report.fitted_outline import draw_fitted_outline
from animal3dbox.report.inset import Picture, with_insets
from animal3dbox.report.label_words import words_of_label
from animal3dbox.smal.model import SmalModel

MOST_HEIGHT = 2000
"""A narrow strip is not enlarged beyond this."""
LETTERS, LETTER_SCALE = cv2.FONT_HERSHEY_SIMPLEX, 0.5
"""The letters of the words below a picture, and their scale in one LEAST_WIDTH wide."""
HEAD_ON = 0.9
"""Cosine of the camera's angle to the x axis from which on the cross is read, and no arrow."""


@dataclass(frozen=True)
class DrawnCuboid:
    """A cuboid and how it is drawn.

    Attributes:
        cuboid_cam: in the camera frame.
        K: (3, 3) px of the picture.
        dashed: draw lines dashed and fill no face, as of a detection beside a label.
        heading_known: whether the box has a front; one that has none is drawn without its colours,
            cross and arrow.
    """

    cuboid_cam: Cuboid
    K: torch.Tensor
    dashed: bool = False
    heading_known: bool = True


def draw_label(image: Picture, label: CuboidLabel, fitted: SmalModel | None = None) -> Picture:
    """The picture with the label's cuboid, keypoints and words; a new array.

    An animal below a sixth of the picture's width is shown enlarged in a corner too.

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

    def draw_outline(canvas: Picture, K: torch.Tensor, factor: float, width: int) -> None:
        if fitted is not None:
            part = label.with_fields(K=K)
            draw_fitted_outline(canvas, part, fitted, factor=factor, width=width)

    canvas = cuboid_in_picture(
        image, label.cuboid, label.K, keypoints=label.keypoints, draw_beneath=draw_outline
    )
    return with_words(canvas, words_of_label(label).lines)


def cuboid_in_picture(
    image: Picture,
    cuboid_cam: Cuboid,
    K: torch.Tensor,
    *,
    keypoints: torch.Tensor | None = None,
    draw_beneath: Callable[[Picture, torch.Tensor, float, int], None] | None = None,
) -> Picture:
    """The picture with one animal's cuboid, a small one enlarged in a corner too; a new array.

    Args:
        image: (H, W, 3) uint8 RGB.
        cuboid_cam: in the camera frame.
        K: (3, 3) px.
        keypoints: (J, 3) x, y in px and visibility, drawn over the cuboid where they are visible.
        draw_beneath: draws what lies beneath the cuboid of an animal that is large enough: the
            picture or its part, that one's K, how much it was enlarged, the width of lines.

    Returns:
        (H', W', 3) uint8 RGB; enlarged if it was small.

    """
    points = [] if keypoints is None else keypoints[keypoints[:, 2] > 0, :2].tolist()
    canvas, whole_factor = enlarged(image)
    unit = thickness(canvas)

    def draw(canvas: Picture, origin_px: tuple[int, int], factor: float) -> None:
        part_K = _K_of_part(K, origin_px)
        region = region_of(cuboid_cam, part_K, size_before(canvas, factor))
        widths = line_widths(canvas, region, factor, unit=unit)
        if draw_beneath is not None and widths.strong > 1:  # else it would cover the animal
            draw_beneath(canvas, part_K, factor, widths.thin)
        draw_cuboid(canvas, cuboid_cam, part_K, factor, unit=unit)
        for point in points:
            center = [(z - o + 0.5) * factor - 0.5 for z, o in zip(point, origin_px, strict=True)]
            cv2.circle(canvas, fixed(*center), widths.dot << SHIFT, POINT, -1, cv2.LINE_AA, SHIFT)

    regions = [region_of(cuboid_cam, K, (image.shape[0], image.shape[1]))]
    return with_insets(image, canvas, regions, factor=whole_factor, draw=draw, points_px=points)


def cuboids_in_picture(image: Picture, cuboids: Sequence[DrawnCuboid]) -> Picture:
    """The picture with several cuboids, small ones enlarged in its corners too; a new array.

    Args:
        image: (H, W, 3) uint8 RGB.
        cuboids: in the order in which they are drawn, and enlarged where not all can be.

    Returns:
        (H', W', 3) uint8 RGB; enlarged if it was small.

    """
    canvas, whole_factor = enlarged(image)
    unit = thickness(canvas)

    def draw(canvas: Picture, origin_px: tuple[int, int], factor: float) -> None:
        for one in cuboids:
            draw_cuboid(
                canvas,
                one.cuboid_cam,
                _K_of_part(one.K, origin_px),
                factor,
                dashed=one.dashed,
                heading_known=one.heading_known,
                unit=unit,
            )

    image_hw = (image.shape[0], image.shape[1])
    regions = [region_of(one.cuboid_cam, one.K, image_hw) for one in cuboids]
    return with_insets(image, canvas, regions, factor=whole_factor, draw=draw)


def _K_of_part(K: torch.Tensor, origin_px: tuple[int, int]) -> torch.Tensor:
    """The intrinsics (3, 3) of the part of a picture that begins at a pixel (x, y)."""
    part_K = K.clone()
    part_K[:2, 2] -= torch.tensor(origin_px, dtype=K.dtype)
    return part_K


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
    unit: int | None = None,
) -> None:
    """Draw a cuboid of the camera frame into a picture that was enlarged by a factor.

    It is cut at the near plane. The picture itself is drawn into.

    Args:
        canvas: (H, W, 3) uint8 RGB.
        cuboid_cam: in the camera frame.
        K: (3, 3) px of the picture before it was enlarged.
        factor: by which it was.
        dashed: draw lines dashed and fill no face, as of a detection beside a label.
        heading_known: whether the box has a front; one that has none is drawn without its colours,
            cross and arrow.
        unit: the most that a thin line may have, px; None: by the picture's width.

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
        name: pixels(clip_to_near(corners[list(FACES[name])], near), K, factor)
        for name in ("back", "front")
        if heading_known
    }
    for name, outline in outlines.items() if not dashed else ():
        strength = 0.38 if visible[FACE_NAMES.index(name)] else 0.16
        _fill(canvas, outline, FACE_COLORS[name], strength)
    region = region_of(cuboid_cam, K, size_before(canvas, factor))
    widths = line_widths(canvas, region, factor, unit=unit)
    pen = CuboidPen(canvas, K, factor, widths, near, dashed)
    pen.draw_edges(corners, visible, colors=FACE_COLORS if dashed and heading_known else {})
    for name in outlines if not dashed else ():
        if visible[FACE_NAMES.index(name)]:
            a, b, c, d = corners[list(FACES[name])]
            for line in ((a, b), (b, c), (c, d), (d, a), *([(a, c), (b, d)] * (name == "front"))):
                pen.draw(*line, FACE_COLORS[name], pen.widths.strong)
    ahead = cuboid_cam.rotation.mT @ -cuboid_cam.center  # from the box to the camera
    is_head_on = float(ahead[0]) > HEAD_ON * float(torch.linalg.vector_norm(ahead))
    if heading_known and (dashed or not is_head_on):
        pen.draw_arrow(cuboid_cam)


def with_words(canvas: Picture, lines: list[str]) -> Picture:
    """The picture with a strip of text below it; lines that are too long go on in the next one."""
    unit = thickness(canvas)
    lines = [part for line in lines for part in _wrapped(line, canvas.shape[1] - 16 * unit, unit)]
    strip = np.full(((20 * len(lines) + 8) * unit, canvas.shape[1], 3), PAPER, dtype=np.uint8)
    for i, line in enumerate(lines):
        cv2.putText(
            strip,
            line,
            (8 * unit, (20 * i + 19) * unit),
            LETTERS,
            LETTER_SCALE * unit,
            INK,
            unit,
            cv2.LINE_AA,
        )
    return np.concatenate((canvas, strip))


def _wrapped(line: str, width: int, unit: int) -> list[str]:
    """The parts of a line of text, broken at spaces, that fit into a width in px."""
    parts = [""]
    for word in line.split(" "):
        longer = f"{parts[-1]} {word}" if parts[-1] else word
        (length, _), _ = cv2.getTextSize(longer, LETTERS, LETTER_SCALE * unit, unit)
        if parts[-1] and length > width:
            parts.append(word)
        else:
            parts[-1] = longer
    return [part.rstrip() for part in parts]


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
