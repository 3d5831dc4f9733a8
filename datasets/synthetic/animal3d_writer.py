"""The writer of a synthetic dataset as an Animal3D folder, with all of the format's keys."""

import io
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image
from torch import Tensor

from animal3dbox.datasets.readers.animal3d.entries import SHAPE
from animal3dbox.datasets.synthetic.annotation import Annotation
from animal3dbox.datasets.synthetic.scene_files import (
    SceneRows,
    can_resume,
    raw,
    write_scenes,
)
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
"""Names of the supercategories by number."""
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
"""Quality of the JPEG files."""


def write_animal3d(
    synthetic_set: SyntheticSet,
    root: Path,
    model: Path,
    *,
    workers: int = 1,
    resume: bool = False,
) -> int:
    """Write a synthetic dataset in Animal3D's format, with the model of its parameters.

    The folder gets images, masks, rendered masks, train.json, test.json and truth.json.

    Args:
        synthetic_set: a dataset with the config of animal3d_world, since the format has one focal
            length and no principal point.
        root: the folder.
        model: the SMAL pickle that is written; as users have it, not inside root.
        workers: processes that draw; the files are the same for any number.
        resume: go on where an earlier run into the same folder was broken off.

    Returns:
        Number of animals.

    Raises:
        ConfigError: the format has no place for the cameras, the model lies inside root or is
            there already, or what was begun is another dataset.

    Example:
        >>> import tempfile
        >>> from animal3dbox.datasets.synthetic import WorldConfig, animal3d_world
        >>> config = animal3d_world(WorldConfig((120, 160), animals=(1, 1)))
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     root, model = Path(folder) / "animals", Path(folder) / "model.pkl"
        ...     write_animal3d(SyntheticSet(0, 2, config), root, model)
        2

    """
    is_begun = resume and can_resume(root)
    _check_writable(synthetic_set, root, model, is_begun=is_begun)
    if not is_begun or not model.exists():
        write_smal_pickle(load_quadruped(), model)
    files = Animal3DFiles(synthetic_set, root)
    return write_scenes(files, workers=workers, resume=resume)


@dataclass(frozen=True)
class Animal3DFiles:
    """The files of Animal3D's format, see scene_files.SceneFiles.

    Attributes:
        synthetic_set: the dataset.
        root: the folder.
    """

    synthetic_set: SyntheticSet
    root: Path

    @property
    def focal_px(self) -> float:
        """The focal length that the files tell."""
        return self.synthetic_set.config.focal_px[0] * self.synthetic_set.faults.focal_factor

    def write_scene(self, index: int) -> SceneRows:
        """Write the pictures of a scene, and give its rows."""
        split = "test" if index % TEST_EVERY == TEST_EVERY - 1 else "train"
        entries, truths = list[msgspec.Raw](), list[msgspec.Raw]()
        for sample in self.synthetic_set.samples_of(index):
            entry = _entry(sample, split, self.focal_px)
            _write_pictures(self.root, sample, entry, self.focal_px)
            name = entry["img_path"]
            truths.append(
                raw(truth_of(sample, name + (f"#{len(entries)}" if entries else ""), name))
            )
            entries.append(raw(entry))
        return SceneRows(index, split, entries, truths)

    def write_index(self, scenes: list[SceneRows]) -> None:
        """Write train.json, test.json and truth.json of some scenes."""
        for split in ("train", "test"):
            data = [entry for scene in scenes if scene.split == split for entry in scene.entries]
            content = msgspec.json.encode({"data": data, **_keys(self.focal_px)})
            write_whole(self.root / f"{split}.json", content)
        truths = [truth for scene in scenes for truth in scene.truths]
        write_truth(self.root / "truth.json", self.synthetic_set, truths)


def _check_writable(
    synthetic_set: SyntheticSet, root: Path, model: Path, *, is_begun: bool
) -> None:
    """Raise a ConfigError unless a dataset can be written in this format and to these paths."""
    if (
        synthetic_set.config.vocabulary.keypoints != ANIMAL3D_26
        or synthetic_set.config.focal_px[0] != synthetic_set.config.focal_px[1]
        or synthetic_set.config.principal_offset
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
    if model.exists() and not is_begun:
        raise ConfigError(
            f"the model {model} is there already and may be a real one: it is written, so give"
            " another path or remove it"
        )


def _keys(focal: float) -> dict[str, Any]:
    """The keys of a split's file beside "data"."""
    return {
        "flength": focal,
        "supercategories": [{"id": i, "name": name} for i, name in enumerate(SUPERCATEGORIES)],
        "categories": [{"id": i, "name": name} for i, name in enumerate(quadruped_names().presets)],
        "keypoint_vids": [list(ids) for ids in load_quadruped().landmarks.values()],
        "info": "synthetic animals by animal3dbox; nothing of Animal3D or SMAL",
    }


def _entry(sample: SyntheticSample, split: str, focal: float) -> dict[str, Any]:
    """The element of "data" for one animal.

    Args:
        sample: the animal.
        split: "train" or "test".
        focal: the file's focal length in px.

    """
    annotation, animal = sample.annotation, sample.animal
    height, width = annotation.image_hw
    folder = f"{split}/{sample.scene.animals[0].preset}"
    name = sample.scene.image_id + (f"_{animal.number}" if animal.number else "")
    x1, y1, x2, y2 = mask_box(annotation.mask).tolist()
    return {
        "img_path": f"images/{folder}/{sample.scene.image_id}.jpg",
        "mask_path": f"masks/{folder}/{name}.png",
        "rd_mask_path": f"rd_masks/{folder}/{name}.png",
        "bbox": [x1 + 0.5, y1 + 0.5, x2 - x1, y2 - y1],
        "keypoint_2d": annotation.keypoints_2d.tolist(),
        **_body_keys(annotation, focal),
        "supercategory": _SUPERCATEGORY[animal.preset],
        "category": quadruped_names().presets.index(animal.preset),
        "height": height,
        "width": width,
        "with_tail": 1,
    }


def _body_keys(annotation: Annotation, focal: float) -> dict[str, Any]:
    """The keys of an element of "data" that hold its body's parameters and points."""
    model, parameters = load_quadruped(), annotation.parameters
    body = posed_body(model, parameters)
    joints, trans, betas = body.joints[0], parameters.trans, parameters.betas.tolist()
    landmarks = annotation.vocabulary.on_body(model.landmark_groups, body.vertices[0])
    K = intrinsics(focal, annotation.image_hw)
    one = torch.ones(len(landmarks), 1, dtype=torch.float64)
    return {
        "reproj_kp_2d": torch.cat((project(K, landmarks)[0], one), dim=1).tolist(),
        "joints_2d": project(K, joints)[0].tolist(),
        "keypoint_3d": (landmarks - trans).tolist(),
        "joints_3d": (joints - trans).tolist(),
        "pose": parameters.pose.flatten().tolist(),
        "shape": betas[:SHAPE],
        "shape_extra": betas[SHAPE:],
        "trans": trans.tolist(),
    }


def _write_pictures(
    root: Path, sample: SyntheticSample, entry: dict[str, Any], focal: float
) -> None:
    """Write the image, once a scene, the mask, and the mask rendered from the annotated body."""
    if sample.animal is sample.scene.animals[0]:
        write_picture(root / entry["img_path"], sample.scene.image.numpy())
    annotation, model = sample.annotation, load_quadruped()
    body = posed_body(model, annotation.parameters)
    K = intrinsics(focal, annotation.image_hw)
    body_mask = silhouette(body.vertices[0], model.faces, K, annotation.image_hw)
    for key, mask in (("mask_path", annotation.mask), ("rd_mask_path", body_mask)):
        write_picture(root / entry[key], _levels(mask))


def write_picture(path: Path, pixels: NDArray[np.uint8]) -> None:
    """Write a picture (H, W) or (H, W, 3) in the format of its path's suffix, .jpg or .png."""
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(
        buffer, "PNG" if path.suffix == ".png" else "JPEG", quality=QUALITY
    )
    write_whole(path, buffer.getvalue())


def _levels(mask: Tensor) -> NDArray[np.uint8]:
    """A mask (H, W) as a picture of 0 and 255."""
    return np.asarray(mask.numpy(), dtype=np.uint8) * np.uint8(255)
