"""Draw the two places of a shoulder on presets: `python examples/shoulder_places.py OUT_DIR`.

Writes shoulder_places.png: each animal from its left; the tail's base, the blade's upper edge
(Animal3D's "shoulder") and the point of the shoulder (AP-10K's), with the lines from the tail's
base to both.
"""

import argparse
from pathlib import Path

import numpy as np
import torch
from PIL import Image, ImageDraw
from torch import Tensor

from animal3dbox.geometry import project, rasterize
from animal3dbox.smal import load_quadruped, preset_betas

PRESETS = ("dog", "horse", "cow", "bear", "pig", "lion")
SIDE_PX, COLUMNS, OVERSAMPLING = 220, 3, 3
BACKGROUND, FUR = (250, 250, 250), np.array([205.0, 186.0, 166.0])
MARKS = {
    "tail_base": (60, 60, 60),
    "left_shoulder_blade": (20, 90, 200),
    "left_shoulder_point": (200, 60, 30),
}
R_CAM_WORLD = torch.tensor([[-1.0, 0, 0], [0, 0, -1], [0, -1, 0]], dtype=torch.float64)
"""Of a camera on the animal's left: its front is on the picture's left."""


def picture(preset: str) -> Image.Image:
    """One animal with its places."""
    model, size = load_quadruped(), SIDE_PX * OVERSAMPLING
    vertices = model.shaped(preset_betas(preset)[None])[0]
    middle = (vertices.amin(0) + vertices.amax(0)) / 2
    distance = 20.0
    focal = size * distance / 1.5
    center = (size - 1) / 2
    K = torch.tensor([[focal, 0, center], [0, focal, center], [0, 0, 1]], dtype=torch.float64)

    def seen(points: Tensor) -> Tensor:
        """Points of the template in the camera frame."""
        away = torch.tensor([0.0, 0.0, distance], dtype=torch.float64)
        return (points - middle) @ R_CAM_WORLD.T + away

    vertices_cam = seen(vertices)
    raster = rasterize(vertices_cam, model.faces, K, (size, size))
    corners = vertices_cam[model.faces]
    normals = torch.nn.functional.normalize(
        torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), dim=1
    )
    pixels = np.full((size, size, 3), BACKGROUND, dtype=np.uint8)
    is_animal = raster.face_index.numpy() >= 0
    facing = normals[raster.face_index[raster.face_index >= 0], 2].abs().numpy()
    light = 0.55 + 0.45 * facing
    pixels[is_animal] = (light[:, None] * FUR).astype(np.uint8)
    image = Image.fromarray(pixels)
    draw = ImageDraw.Draw(image)
    places = torch.stack([vertices[list(model.landmark_groups[name])].mean(0) for name in MARKS])
    px, _ = project(K, seen(places))
    tail, *shoulders = (tuple(place) for place in px.tolist())
    colours = list(MARKS.values())
    for place, colour in zip(shoulders, colours[1:], strict=True):
        draw.line((*tail, *place), fill=colour, width=2 * OVERSAMPLING)
    radius = 3 * OVERSAMPLING
    for (u, v), colour in zip((tail, *shoulders), colours, strict=True):
        draw.ellipse((u - radius, v - radius, u + radius, v + radius), fill=colour)
    draw.text((6 * OVERSAMPLING, 6 * OVERSAMPLING), preset, fill=(60, 60, 60), font_size=36)
    return image.resize((SIDE_PX, SIDE_PX), Image.Resampling.LANCZOS)


def main() -> None:
    """Write the picture."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("out_dir", metavar="OUT_DIR", type=Path)
    folder: Path = parser.parse_args().out_dir
    folder.mkdir(parents=True, exist_ok=True)
    rows = -(-len(PRESETS) // COLUMNS)
    sheet = Image.new("RGB", (COLUMNS * SIDE_PX, rows * SIDE_PX), BACKGROUND)
    for i, preset in enumerate(PRESETS):
        sheet.paste(picture(preset), (i % COLUMNS * SIDE_PX, i // COLUMNS * SIDE_PX))
    sheet.quantize(64).save(folder / "shoulder_places.png")
    print(folder / "shoulder_places.png")


if __name__ == "__main__":
    main()
