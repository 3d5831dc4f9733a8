"""Draw the embedded quadruped from eight sides: `python examples/quadruped_turntable.py OUT_DIR`.

Writes quadruped_<preset>.png, each preset seen from eight azimuths, quadruped_presets.png, all of
them side by side, and quadruped_poses.png, every named pose of some presets.
"""

import argparse
from pathlib import Path

import torch
from PIL import Image
from torch import Tensor

from animal3dbox.geometry import rasterize
from animal3dbox.smal import (
    POSES,
    ground_trans,
    load_quadruped,
    named_pose,
    preset_betas,
    quadruped_names,
)

SIDE_PX, POSE_PX = 220, 140
POSED_PRESETS = ("dog", "lion", "horse", "cow")
OVERSAMPLING = 2
FUR, BACKGROUND = torch.tensor([205.0, 176.0, 146.0]), 250.0


def camera(
    azimuth_deg: float, elevation_deg: float, target_world: Tensor, distance: float
) -> tuple[Tensor, Tensor]:
    """R_cam_world and t_cam_world of a camera that looks at a point.

    Azimuth 0 is in front, 90 on the animal's left.
    """
    azimuth, elevation = torch.deg2rad(
        torch.tensor([azimuth_deg, elevation_deg], dtype=torch.float64)
    )
    back = torch.stack(
        [elevation.cos() * azimuth.cos(), elevation.cos() * azimuth.sin(), elevation.sin()]
    )
    right = torch.stack([-azimuth.sin(), azimuth.cos(), torch.zeros_like(azimuth)])
    R_cam_world = torch.stack([right, torch.linalg.cross(-back, right), -back])
    return R_cam_world, -R_cam_world @ (target_world + distance * back)


def shaded(
    vertices_world: Tensor, faces: Tensor, azimuth_deg: float, span: float, side_px: int = SIDE_PX
) -> Tensor:
    """A picture (side_px, side_px, 3) uint8 of a mesh, lit from above the camera's left shoulder.

    It is span of the mesh's units wide.
    """
    size = side_px * OVERSAMPLING
    distance = 6.0
    target = (vertices_world.amin(dim=0) + vertices_world.amax(dim=0)) / 2
    R_cam_world, t_cam_world = camera(azimuth_deg, 10.0, target, distance)
    focal = size * distance / span
    K = torch.tensor(
        [[focal, 0, (size - 1) / 2], [0, focal, (size - 1) / 2], [0, 0, 1]], dtype=torch.float64
    )
    vertices_cam = vertices_world @ R_cam_world.T + t_cam_world
    raster = rasterize(vertices_cam, faces, K, (size, size))
    corners = vertices_cam[faces]
    face_normals = torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = torch.zeros_like(vertices_cam).index_add(
        0, faces.flatten(), face_normals.repeat_interleave(3, dim=0)
    )
    seen = raster.face_index >= 0
    per_pixel = torch.nn.functional.normalize(
        (normals[faces[raster.face_index[seen]]] * raster.barycentric[seen][:, :, None]).sum(dim=1),
        dim=1,
    )
    light = torch.nn.functional.normalize(
        torch.tensor([-0.45, -0.75, -0.65], dtype=torch.float64), dim=0
    )
    picture = torch.full((size, size, 3), BACKGROUND, dtype=torch.float64)
    picture[seen] = (0.30 + 0.70 * (per_pixel @ light).clamp(min=0))[:, None] * FUR.double()
    small = picture.reshape(side_px, OVERSAMPLING, side_px, OVERSAMPLING, 3).mean(dim=(1, 3))
    return small.round().to(torch.uint8)


def posed_vertices(preset: str, pose: str) -> Tensor:
    """A preset in a named pose, standing on z = 0: (V, 3)."""
    body = load_quadruped().posed(
        preset_betas(preset)[None], named_pose(pose)[None], torch.zeros(1, 3, dtype=torch.float64)
    )
    return body.vertices[0] + ground_trans(body.vertices[0])


def sheet(pictures: list[Tensor], columns: int) -> Image.Image:
    """Pictures of one size side by side, in rows."""
    blank = torch.full_like(pictures[0], int(BACKGROUND))
    padded = pictures + [blank] * (-len(pictures) % columns)
    rows = [torch.cat(padded[i : i + columns], dim=1) for i in range(0, len(padded), columns)]
    return Image.fromarray(torch.cat(rows).numpy()).quantize(64)


def fitted(vertices_world: Tensor, azimuth_deg: float, side_px: int = SIDE_PX) -> Tensor:
    """The picture of a body that fills it."""
    span = 1.08 * float((vertices_world.amax(dim=0) - vertices_world.amin(dim=0)).max())
    return shaded(vertices_world, load_quadruped().faces, azimuth_deg, span, side_px)


def main() -> None:
    """Write the pictures."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("out_dir", type=Path)
    out_dir: Path = parser.parse_args().out_dir
    out_dir.mkdir(parents=True, exist_ok=True)
    presets = quadruped_names().presets
    for preset in presets:
        pictures = [
            fitted(posed_vertices(preset, "stand"), azimuth) for azimuth in range(90, 450, 45)
        ]
        sheet(pictures, 4).save(out_dir / f"quadruped_{preset}.png", optimize=True)
    pictures = [fitted(posed_vertices(preset, "stand"), 70) for preset in presets]
    sheet(pictures, 5).save(out_dir / "quadruped_presets.png", optimize=True)
    pictures = [
        fitted(posed_vertices(preset, pose), 60, POSE_PX)
        for preset in POSED_PRESETS
        for pose in POSES
    ]
    sheet(pictures, len(POSES)).save(out_dir / "quadruped_poses.png", optimize=True)
    print(f"wrote {out_dir}/quadruped_*.png")


if __name__ == "__main__":
    main()
