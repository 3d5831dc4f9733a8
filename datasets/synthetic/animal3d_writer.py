"""A synthetic dataset written as an Animal3D folder, with all of its keys."""

import io
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image
from torch import Tensor
from tqdm import tqdm

from animal3dbox.datasets.readers.animal3d.entries import SHAPE
from animal3dbox.datasets.synthetic.synthetic_set import SyntheticSample, SyntheticSet
from animal3dbox.datasets.synthetic.truth_file import truth_of, write_truth
from animal3dbox.errors import ConfigError
from animal3dbox.files import write_whole
from animal3dbox.geometry.camera import intrinsics, project
from animal3dbox.geometry.pixel_boxes import mask_box
from animal3dbox.geometry.rasterizer import silhouette
from animal3dbox.smal.files.pickle_writer import write_smal_pickle
from animal3dbox.smal.keypoints.vocabularies import ANIMAL3D_26
from animal3dbox.smal.parameters import posed_body
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped, quadruped_names

SUPERCATEGORIES = ("cats", "dogs", "horses", "cattle", "hippos")
_SUPERCATEGORY = {
    "cat": 0,
    "lion": 0,
    "dog": 1,
    "bear": 1,
    "horse": 2,
    "zebra": 2,
    "deer": 2,
    "cow": 3,
    "hippo": 4,
    "pig": 4,
}
TEST_EVERY = 5
"""One image of so many goes into test.json."""
QUALITY = 92


def write_animal3d(made: SyntheticSet, root: Path, model: Path, progress: bool = False) -> int:
    """Write images, masks, rendered masks, train.json, test.json and truth.json, and the model their parameters belong to.

    Args:
        made: with the config of animal3d_world: the format has one focal length and no principal
            point.
        root: the folder.
        model: the SMAL pickle; as users have it, not inside root.
        progress: show a bar.

    Returns:
        How many animals.

    Raises:
        ConfigError: the cameras cannot be told in this format, or the model lies inside root or is
            there already.

    """
    if (
        made.config.vocabulary.keypoints != ANIMAL3D_26
        or made.config.focal_px[0] != made.config.focal_px[1]
        or made.config.principal_offset
    ):
        raise ConfigError(
            "Animal3D tells one focal length, a centred principal point and its 26 keypoints: make"
            " the config with animal3d_world"
        )
    if model.resolve().is_relative_to(root.resolve()):
        raise ConfigError(
            f"the model {model} must lie beside {root}, not in it, as SMAL does not come with the"
            " dataset"
        )
    if model.exists():
        raise ConfigError(
            f"the model {model} is there already and may be a real one: it is written, so give"
            " another path or remove it"
        )
    entries: dict[str, list[dict[str, Any]]] = {"train": [], "test": []}
    truths = []
    focal = made.config.focal_px[0] * made.faults.focal_factor
    for sample in tqdm(
        made.samples(), desc="animals", unit="animal", disable=None if progress else True
    ):
        split = "test" if sample.scene.plan.index % TEST_EVERY == TEST_EVERY - 1 else "train"
        entry = _entry(sample, split, focal)
        _write_pictures(root, sample, entry, focal)
        count = sum(
            other["img_path"] == entry["img_path"]
            for other in entries[split][-made.config.animals[1] :]
        )
        entries[split].append(entry)
        truths.append(
            truth_of(sample, entry["img_path"] + (f"#{count}" if count else ""), entry["img_path"])
        )
    for split, found in entries.items():
        write_whole(root / f"{split}.json", msgspec.json.encode({"data": found, **_about(focal)}))
    write_truth(root / "truth.json", made, truths)
    write_smal_pickle(load_quadruped(), model)
    return len(truths)


def _about(focal: float) -> dict[str, Any]:
    """What stands beside the data."""
    return {
        "flength": focal,
        "supercategories": [{"id": i, "name": name} for i, name in enumerate(SUPERCATEGORIES)],
        "categories": [{"id": i, "name": name} for i, name in enumerate(quadruped_names().presets)],
        "keypoint_vids": [list(load_quadruped().landmarks[name]) for name in ANIMAL3D_26],
        "info": "synthetic animals by animal3dbox; nothing of Animal3D or SMAL",
    }


def _entry(sample: SyntheticSample, split: str, focal: float) -> dict[str, Any]:
    """One element of "data"."""
    said, animal, model = sample.annotation, sample.animal, load_quadruped()
    height, width = said.image_hw
    folder = f"{split}/{sample.scene.animals[0].preset}"
    name = sample.scene.image_id + (f"_{animal.number}" if animal.number else "")
    left, top, right, bottom = mask_box(said.mask).tolist()
    body = posed_body(model, said.parameters)
    trans = said.parameters.trans
    landmarks, K = (
        said.vocabulary.on_body(model.landmark_groups, body.vertices[0]),
        intrinsics(focal, said.image_hw),
    )
    one = torch.ones(len(landmarks), 1, dtype=torch.float64)
    betas = said.parameters.betas.tolist()
    return {
        "img_path": f"images/{folder}/{sample.scene.image_id}.jpg",
        "mask_path": f"masks/{folder}/{name}.png", "rd_mask_path": f"rd_masks/{folder}/{name}.png",
        "bbox": [left + 0.5, top + 0.5, right - left, bottom - top],
        "keypoint_2d": said.keypoints_2d.tolist(), "reproj_kp_2d": torch.cat((project(K, landmarks)[0], one), dim=1).tolist(),
        "joints_2d": project(K, body.joints[0])[0].tolist(),
        "keypoint_3d": (landmarks - trans).tolist(), "joints_3d": (body.joints[0] - trans).tolist(),
        "pose": said.parameters.pose.flatten().tolist(), "shape": betas[:SHAPE], "shape_extra": betas[SHAPE:], "trans": trans.tolist(),
        "supercategory": _SUPERCATEGORY[animal.preset], "category": quadruped_names().presets.index(animal.preset),
        "height": height, "width": width, "with_tail": 1,
    }  # fmt: skip


def _write_pictures(
    root: Path, sample: SyntheticSample, entry: dict[str, Any], focal: float
) -> None:
    """The image, once a scene, the mask, and the mask rendered from the annotated body."""
    if sample.animal is sample.scene.animals[0]:
        write_picture(root / entry["img_path"], sample.scene.image.numpy())
    body, said = posed_body(load_quadruped(), sample.annotation.parameters), sample.annotation
    drawn = silhouette(
        body.vertices[0], load_quadruped().faces, intrinsics(focal, said.image_hw), said.image_hw
    )
    for key, mask in (("mask_path", said.mask), ("rd_mask_path", drawn)):
        write_picture(root / entry[key], _levels(mask))


def write_picture(path: Path, pixels: NDArray[np.uint8]) -> None:
    """A picture by its suffix, .jpg or .png."""
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(
        buffer, "PNG" if path.suffix == ".png" else "JPEG", quality=QUALITY
    )
    write_whole(path, buffer.getvalue())


def _levels(mask: Tensor) -> NDArray[np.uint8]:
    return np.asarray(mask.numpy(), dtype=np.uint8) * np.uint8(255)
