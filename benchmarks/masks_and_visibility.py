"""What pixels miss.

A mask's bounds against the exact ones, and visibility by z-buffer against the exact one.

Run: python benchmarks/masks_and_visibility.py
"""

import torch
from torch import Tensor

from animal3dbox.datasets.synthetic.scenes import SyntheticAnimal, synthetic_animal
from animal3dbox.geometry.camera import project
from animal3dbox.geometry.pixel_boxes import mask_box
from animal3dbox.geometry.rasterizer import rasterize
from animal3dbox.geometry.visible_surface import visible_vertices

ANIMALS = 25
SIZES = ((480, 640), (120, 160))
WINDOW = 256


def bounds_off(animal: SyntheticAnimal, vertices_cam: Tensor) -> Tensor:
    """How far (4,) px each side of the mask's box is inside the exact bounds."""
    px, _ = project(animal.K, vertices_cam)
    bounds = torch.cat((px.amin(0), px.amax(0)))
    return (torch.from_numpy(mask_box(animal.mask)) - bounds) * torch.tensor([1, 1, -1, -1])


def seen_in_zbuffer(animal: SyntheticAnimal, vertices_cam: Tensor) -> Tensor:
    """Which vertices (V,) a z-buffer, WINDOW pixels along the animal, shows at their own pixel."""
    px, _ = project(animal.K, vertices_cam)
    scale = WINDOW / float((px.amax(0) - px.amin(0)).amax())
    low = px.amin(0).tolist()
    H = torch.tensor(
        [[scale, 0, -0.5 - scale * low[0]], [0, scale, -0.5 - scale * low[1]], [0, 0, 1]],
        dtype=torch.float64,
    )
    depth = rasterize(vertices_cam, animal.model.faces, H @ animal.K, (WINDOW, WINDOW)).depth
    column, row = (
        project(H @ animal.K, vertices_cam)[0].round().long().clamp(0, WINDOW - 1).unbind(1)
    )
    extent = float((vertices_cam.amax(0) - vertices_cam.amin(0)).amax())
    return vertices_cam[:, 2] <= depth[row, column] + 0.01 * extent


def main() -> None:
    """Print the mask's greatest error, and the share of vertices on which visibilities agree."""
    torch.set_num_threads(1)
    off, agree = [], []
    for image_hw in SIZES:
        for index in range(ANIMALS):
            animal = synthetic_animal(5, index, image_hw)
            cam = animal.vertices @ animal.R.mT + animal.t
            off.append(bounds_off(animal, cam))
            exact = visible_vertices(cam, animal.model.faces, animal.K, image_hw)
            agree.append(float((exact == seen_in_zbuffer(animal, cam)).double().mean()))
    every = torch.cat(off)
    print(
        f"mask bounds of {len(off)} animals: median {every.median():.2f} px inside, greatest error"
        f" {every.abs().amax():.2f} px"
    )
    low, mean, high = (100 * value for value in (min(agree), sum(agree) / len(agree), max(agree)))
    print(
        f"z-buffer of {WINDOW} px against exact visibility: {low:.1f} to {high:.1f} % of vertices"
        f" agree, mean {mean:.1f} %"
    )


if __name__ == "__main__":
    main()
