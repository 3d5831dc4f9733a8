"""truth.json: everything that is true of a synthetic dataset, beside its annotations."""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import msgspec
from torch import Tensor

from animal3dbox.datasets.synthetic.ray_shares import face_shares_by_rays
from animal3dbox.datasets.synthetic.scenes import SyntheticAnimal
from animal3dbox.datasets.synthetic.synthetic_set import SyntheticSample, SyntheticSet
from animal3dbox.files import write_whole
from animal3dbox.geometry.cuboid import CORNER_SIGNS, FACE_NAMES
from animal3dbox.geometry.pixel_boxes import mask_box

SCHEMA, VERSION = "animal3dbox.truth", 1
"""Name and version of the JSON's form."""


def truth_of(sample: SyntheticSample, sample_id: str, image: str) -> dict[str, Any]:
    """The truth of one animal, in the camera frame and the body's unit, as docs/formats.md says.

    Args:
        sample: the animal.
        sample_id: its name in the dataset's files.
        image: its image's name in the dataset's files.

    """
    animal, faces = sample.animal, sample.animal.faces_seen
    by_rays = face_shares_by_rays(animal.cuboid, animal.K, animal.image_hw)
    return {
        "sample_id": sample_id,
        "image": image,
        "preset": animal.preset,
        "pose": animal.pose,
        "image_hw": animal.image_hw,
        "K": _list(animal.K),
        "R": _list(animal.R),
        "t": _list(animal.t),
        "corners_3d": _list(animal.cuboid.corners()),
        "center": _list(animal.cuboid.center),
        "size": _list(animal.cuboid.size),
        "rotation": _list(animal.cuboid.rotation),
        "trunk_world": _list(animal.trunk),
        "face_visible": faces.visible.tolist(),
        "face_area": _list(faces.area),
        "face_share": _list(faces.share),
        "face_share_in_image": _list(faces.share_in_image),
        "face_share_in_image_by_rays": _list(by_rays),
        "surface_share": _list(animal.surface_share),
        "truncation": float(faces.truncation),
        "visible_part": animal.visible_part,
        "box": mask_box(animal.mask).tolist(),
        "amodal_box": mask_box(animal.amodal_mask).tolist(),
        "keypoints": _keypoints(animal),
        "keypoint_visible": animal.keypoint_visible.tolist(),
        "betas": _list(animal.parameters[0]),
        "body_pose": _list(animal.parameters[1]),
        "trans": _list(animal.parameters[2]),
    }


def write_truth(
    path: Path, synthetic_set: SyntheticSet, animals: Sequence[dict[str, Any] | msgspec.Raw]
) -> None:
    """Write the truths of all animals of a dataset, with the world that they are from.

    Args:
        path: the JSON file; one that is there is replaced.
        synthetic_set: the dataset.
        animals: a truth_of each, or its JSON.

    """
    config = {**asdict(synthetic_set.config), "vocabulary": synthetic_set.config.vocabulary.name}
    world = {
        "schema": SCHEMA,
        "version": VERSION,
        "seed": synthetic_set.seed,
        "images": synthetic_set.images,
        "world": config,
        "faults": asdict(synthetic_set.faults),
    }
    layout = {
        "face_names": FACE_NAMES,
        "corner_signs": CORNER_SIGNS,
        "keypoint_names": synthetic_set.config.vocabulary.keypoints,
    }
    write_whole(path, msgspec.json.encode({**world, **layout, "animals": animals}))


def _keypoints(animal: SyntheticAnimal) -> list[list[float] | None]:
    """Exact pixels of the keypoints in the frame; None for the others."""
    return [
        [float(x), float(y)] if inside else None for x, y, inside in animal.keypoints_2d.tolist()
    ]


def _list(tensor: Tensor) -> Any:
    return tensor.tolist()
