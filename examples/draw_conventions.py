"""The pictures of docs/conventions.md: corners, faces and axes of a box; pixels; a mirror.

Run: python examples/draw_conventions.py [FOLDER]
"""

import sys
from pathlib import Path

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image

from animal3dbox.datasets.synthetic.world.shading import shade
from animal3dbox.geometry import (
    FACE_NAMES,
    FACES,
    Cuboid,
    intrinsics,
    look_at,
    project,
    update_camera,
    visible_faces,
)
from animal3dbox.labels.bounds import tight_cuboid
from animal3dbox.report.overlay import draw_cuboid
from animal3dbox.smal import load_quadruped, preset_betas

IMAGE_HW = (420, 560)
F64 = torch.float64
Picture = NDArray[np.uint8]


def scene() -> tuple[Picture, Cuboid, torch.Tensor]:
    """A picture of the dog from its front left, its box in the camera frame, and K."""
    model = load_quadruped()
    vertices = model.shaped(preset_betas("dog")[None])[0]
    middle = (vertices.amax(0) + vertices.amin(0)) / 2
    T = look_at(
        middle + torch.tensor([1.5, 2.1, 0.95], dtype=F64),
        middle,
        torch.tensor([0.0, 0, 1], dtype=F64),
    )
    K = intrinsics(700.0, IMAGE_HW)
    color = torch.tensor([0.66, 0.47, 0.28], dtype=F64).expand(len(vertices), 3)
    image, _ = shade(vertices, model.faces, color, R=T[:3, :3], t=T[:3, 3], K=K, image_hw=IMAGE_HW)
    return image.numpy(), tight_cuboid(vertices, torch.eye(3, dtype=F64)).transformed(T), K


def write(
    canvas: Picture, text: str, at: torch.Tensor, color: tuple[int, int, int], size: float = 0.6
) -> None:
    """Put text, centred, at a pixel, on a dark plate."""
    (width, height), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, size, 1)
    x, y = (round(v) for v in at.tolist())
    left, top = x - width // 2 - 4, y - height // 2 - 4
    cv2.rectangle(canvas, (left, top), (left + width + 8, top + height + 8), (25, 25, 25), -1)
    cv2.putText(
        canvas,
        text,
        (left + 4, top + height + 4),
        cv2.FONT_HERSHEY_SIMPLEX,
        size,
        color,
        1,
        cv2.LINE_AA,
    )


def named_box(image: Picture, cuboid: Cuboid, K: torch.Tensor, corners: bool) -> Picture:
    """A picture with the box, the names of the visible faces, and the numbers of the corners."""
    canvas = image.copy()
    draw_cuboid(canvas, cuboid, K)
    seen = visible_faces(cuboid.corners(), torch.zeros_like(cuboid.center)).tolist()
    for name, visible in zip(FACE_NAMES, seen, strict=True):
        if visible:
            write(
                canvas,
                name,
                project(K, cuboid.corners()[list(FACES[name])].mean(0, keepdim=True))[0][0],
                (255, 255, 255),
                0.55,
            )
    for i, px in enumerate(project(K, cuboid.corners())[0]):
        if corners:
            write(canvas, str(i), px, (255, 220, 60))
    return canvas


def with_axes(canvas: Picture, cuboid: Cuboid, K: torch.Tensor) -> Picture:
    """The box's own axes from its centre: x forward, y to its left, z up."""
    names = (("x", (255, 80, 80)), ("y", (90, 220, 90)), ("z", (90, 140, 255)))
    start, _ = project(K, cuboid.center[None])
    for axis, (name, color) in enumerate(names):
        tip, _ = project(
            K, (cuboid.center + cuboid.rotation[:, axis] * (cuboid.size[axis] / 2 + 0.18))[None]
        )
        a, b = (tuple(round(v) for v in p[0].tolist()) for p in (start, tip))
        cv2.arrowedLine(canvas, a, b, color, 2, cv2.LINE_AA, tipLength=0.08)
        write(canvas, name, tip[0] + torch.tensor([10.0, -10.0]), color)
    return canvas


def write_small(
    canvas: Picture, text: str, place: tuple[int, int], size: float, colour: tuple[int, int, int]
) -> None:
    """A word on a picture, its lower left corner at a place in px."""
    cv2.putText(canvas, text, place, cv2.FONT_HERSHEY_SIMPLEX, size, colour, 1, cv2.LINE_AA)


def pixels() -> Picture:
    """A 4 x 3 image, much enlarged, with the coordinates of centres and borders."""
    cell, margin, (height, width) = 90, 60, (3, 4)
    canvas = np.full(
        (height * cell + 2 * margin, width * cell + 2 * margin, 3), 255, dtype=np.uint8
    )
    for v in range(height):
        for u in range(width):
            x, y = margin + u * cell, margin + v * cell
            grey = (215, 228, 240) if (u + v) % 2 else (238, 243, 248)
            cv2.rectangle(canvas, (x, y), (x + cell, y + cell), grey, -1)
            cv2.circle(canvas, (x + cell // 2, y + cell // 2), 3, (200, 40, 40), -1, cv2.LINE_AA)
            write_small(canvas, f"({u}, {v})", (x + 18, y + cell // 2 - 10), 0.45, (40, 40, 40))
    for u, text in ((0, "u = -0.5"), (width, f"u = W - 0.5 = {width - 0.5}")):
        place = (max(2, margin + u * cell - 60), margin - 14)
        write_small(canvas, text, place, 0.45, (30, 90, 200))
    for v, text in ((0, "v = -0.5"), (height, f"v = H - 0.5 = {height - 0.5}")):
        place = (2, margin + v * cell + (18 if v else -30))
        write_small(canvas, text, place, 0.4, (30, 90, 200))
    center = (margin + width * cell // 2, margin + height * cell // 2)
    cv2.drawMarker(canvas, center, (30, 150, 60), cv2.MARKER_CROSS, 18, 2)
    write_small(canvas, "((W-1)/2, (H-1)/2)", (center[0] - 70, center[1] + 26), 0.42, (30, 120, 50))
    return canvas


def mirrored(image: Picture, cuboid: Cuboid, K: torch.Tensor) -> Picture:
    """The picture flipped, with the mirrored animal's box.

    What showed its left now shows its right.
    """
    width = image.shape[1]
    flip = torch.tensor([[-1.0, 0, width - 1], [0, 1, 0], [0, 0, 1]], dtype=F64)
    update = update_camera(flip, K)
    return named_box(
        np.ascontiguousarray(image[:, ::-1]), cuboid.mirrored(update.Q), update.K, corners=True
    )


def main() -> None:
    """Write the three pictures."""
    out = Path(sys.argv[1] if len(sys.argv) > 1 else "docs/images")
    out.mkdir(parents=True, exist_ok=True)
    image, cuboid, K = scene()
    box = named_box(image, cuboid, K, corners=True)
    axes = with_axes(named_box(image, cuboid, K, corners=False), cuboid, K)
    Image.fromarray(np.concatenate((box, axes), axis=1)).save(
        out / "convention_box.png", optimize=True
    )
    Image.fromarray(pixels()).save(out / "convention_pixels.png", optimize=True)
    Image.fromarray(np.concatenate((box, mirrored(image, cuboid, K)), axis=1)).save(
        out / "convention_mirror.png", optimize=True
    )


if __name__ == "__main__":
    main()
