"""The picture of the README: four synthetic animals labelled from keypoints with 2 px of noise.

Run: python examples/readme_picture.py [FILE]
"""

import sys
from pathlib import Path

import numpy as np
from PIL import Image

from animal3dbox.cli.demo import label_synthetic
from animal3dbox.datasets.synthetic.annotation import annotate
from animal3dbox.datasets.synthetic.faults import FaultConfig, faulty
from animal3dbox.datasets.synthetic.scenes import synthetic_animal
from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.types import CuboidLabel
from animal3dbox.report.inset import Picture
from animal3dbox.report.overlay import draw_label

ANIMALS = ((0, "dog", "walk"), (4, "cat", "stand"), (12, "horse", "trot"), (7, "cow", "graze"))
"""Index in the world, preset and pose."""
WIDTH = 1000


def panel(index: int, preset: str, pose: str) -> Picture:
    """An animal's picture with its label, made from noisy keypoints."""
    animal = synthetic_animal(0, index, preset=preset, pose=pose)
    annotation = faulty(annotate(animal, hidden="marked"), FaultConfig(noise_px=2.0))
    label = label_synthetic(animal, annotation.keypoints_2d, LabelConfig())
    if not isinstance(label, CuboidLabel):
        raise SystemExit(f"{animal.sample_id}: {label.reason}")
    return draw_label(animal.image.numpy(), label)


def main() -> None:
    """Label the four animals and write their pictures as one."""
    panels = [panel(*animal) for animal in ANIMALS]
    rows = [np.concatenate(panels[i : i + 2], axis=1) for i in (0, 2)]
    image = Image.fromarray(np.concatenate(rows))
    height = round(image.height * WIDTH / image.width)
    image = image.resize((WIDTH, height), Image.Resampling.LANCZOS)
    out = Path(sys.argv[1] if len(sys.argv) > 1 else "docs/images/readme.jpg")
    image.save(out, quality=85, optimize=True)


if __name__ == "__main__":
    main()
