"""A small mesh folder of foreign bodies under known cameras, whose keypoints lie elsewhere."""

import json
from pathlib import Path

import numpy as np
from PIL import Image

from animal3dbox.datasets.synthetic.foreign.animals import ForeignAnimal, foreign_animal
from animal3dbox.datasets.synthetic.foreign.bodies import merged_mesh
from animal3dbox.datasets.synthetic.foreign.config import ALONE, ForeignConfig
from animal3dbox.datasets.synthetic.world.config import WorldConfig

HW = (48, 64)
WORLD = WorldConfig(
    animals=ALONE.animals, occluded=ALONE.occluded, truncated=ALONE.truncated, image_hw=HW
)
CONFIG = ForeignConfig(world=WORLD, standing=1.0)


def capture_animal(index: int, seed: int = 50) -> ForeignAnimal:
    """An animal of the capture's one dataset."""
    return foreign_animal(seed, index, CONFIG, dataset=0)


def write_capture(root: Path, count: int) -> Path:
    """A mesh folder of so many images with an animal each, re-meshed."""
    for name in ("images", "meshes", "cameras"):
        (root / name).mkdir(parents=True, exist_ok=True)
    for index in range(count):
        animal = capture_animal(index)
        vertices, landmarks = animal.fitted
        vertices, faces = merged_mesh(vertices, animal.model.faces, 0.03)
        names = [name for (name,) in animal.vocabulary.landmarks]
        np.savez(
            root / "meshes" / f"{index}.npz",
            vertices=vertices.numpy(),
            faces=faces.numpy(),
            landmarks=landmarks.numpy(),
            landmark_names=np.array(names),
        )
        camera = {
            "K": animal.camera.K.tolist(),
            "R": animal.camera.T_cam_world[:3, :3].tolist(),
            "t": animal.camera.T_cam_world[:3, 3].tolist(),
            "image_hw": list(HW),
        }
        (root / "cameras" / f"{index}.json").write_text(json.dumps(camera))
        Image.new("RGB", (HW[1], HW[0]), (120, 120, 120)).save(root / "images" / f"{index}.jpg")
    (root / "mesh_folder.json").write_text(json.dumps({"category": "horse"}))
    return root
