"""A synthetic dataset written as a StanfordExtra json with its images."""

from pathlib import Path
from typing import Any

import msgspec
from tqdm import tqdm

from animal3dbox.datasets.images.rle import encode_mask
from animal3dbox.datasets.synthetic.animal3d_writer import write_picture
from animal3dbox.datasets.synthetic.synthetic_set import SyntheticSample, SyntheticSet
from animal3dbox.datasets.synthetic.truth_file import truth_of, write_truth
from animal3dbox.errors import ConfigError
from animal3dbox.files import write_whole
from animal3dbox.geometry.pixel_boxes import mask_box

ANNOTATIONS = "annotations.json"


def write_stanfordextra(made: SyntheticSet, root: Path, progress: bool = False) -> int:
    """Write images, annotations.json and truth.json.

    Cameras and bodies have no place in this format.

    Args:
        made: with StanfordExtra's keypoints.
        root: the folder.
        progress: show a bar.

    Returns:
        How many animals.

    Raises:
        ConfigError: other keypoints.

    """
    if made.config.vocabulary.name != "stanfordextra24":
        raise ConfigError(
            "StanfordExtra has the keypoints of stanfordextra24, got a world with"
            f" {made.config.vocabulary.name}"
        )
    entries: list[dict[str, Any]] = []
    truths = []
    for sample in tqdm(
        made.samples(), desc="animals", unit="animal", disable=None if progress else True
    ):
        entry = _entry(sample)
        count = sum(
            other["img_path"] == entry["img_path"] for other in entries[-made.config.animals[1] :]
        )
        if count == 0:
            write_picture(root / "images" / entry["img_path"], sample.scene.image.numpy())
        entries.append(entry)
        truths.append(
            truth_of(sample, entry["img_path"] + (f"#{count}" if count else ""), entry["img_path"])
        )
    write_whole(root / ANNOTATIONS, msgspec.json.encode(entries))
    write_truth(root / "truth.json", made, truths)
    return len(truths)


def _entry(sample: SyntheticSample) -> dict[str, Any]:
    said = sample.annotation
    height, width = said.image_hw
    left, top, right, bottom = mask_box(said.mask).tolist()
    joints = [[x, y, v] if v else [0.0, 0.0, 0.0] for x, y, v in said.keypoints_2d.tolist()]
    return {
        "img_path": f"{sample.scene.animals[0].preset}/{sample.scene.image_id}.jpg", "img_width": width, "img_height": height, "joints": joints,
        "img_bbox": [left + 0.5, top + 0.5, right - left, bottom - top], "is_multiple_dogs": len(sample.scene.animals) > 1,
        "seg": encode_mask(said.mask.numpy()),
    }  # fmt: skip
