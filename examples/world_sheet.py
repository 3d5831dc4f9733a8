"""Twelve pictures of the synthetic world on one sheet.

Run: python examples/world_sheet.py [FILE] [SEED]
"""

import sys
from pathlib import Path

import numpy as np
from PIL import Image

from animal3dbox.datasets.synthetic.scenes import synthetic_scene
from animal3dbox.datasets.synthetic.world.config import WorldConfig

COLUMNS, ROWS, WIDTH = 4, 3, 250


def sheet(seed: int) -> Image.Image:
    """The first pictures of a world, row by row."""
    tiles = []
    for index in range(COLUMNS * ROWS):
        picture = Image.fromarray(synthetic_scene(seed, index, WorldConfig()).image.numpy())
        height = round(WIDTH * picture.height / picture.width)
        tiles.append(np.asarray(picture.resize((WIDTH, height), Image.Resampling.LANCZOS)))
    starts = range(0, len(tiles), COLUMNS)
    rows = [np.concatenate(tiles[start : start + COLUMNS], axis=1) for start in starts]
    return Image.fromarray(np.concatenate(rows))


def main() -> None:
    """Write the sheet to the file that the command line names."""
    out = Path(sys.argv[1] if len(sys.argv) > 1 else "docs/images/world.jpg")
    seed = int(sys.argv[2]) if len(sys.argv) > 2 else 7
    sheet(seed).save(out, quality=85, optimize=True)


if __name__ == "__main__":
    main()
