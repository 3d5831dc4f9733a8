"""The writer of a synthetic dataset as a StanfordExtra json with its images."""

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
"""Name of the annotation file."""


def write_stanfordextra(synthetic_set: SyntheticSet, root: Path, progress: bool = False) -> int:
    """Write a synthetic dataset in StanfordExtra's format: images, annotations.json, truth.json.

    Cameras and bodies have no place in this format.

    Args:
        synthetic_set: a dataset with StanfordExtra's keypoints.
        root: the folder.
        progress: show a bar.

    Returns:
        Number of animals.

    Raises:
        ConfigError: the dataset has other keypoints.

    Example:
        >>> import tempfile
        >>> from animal3dbox.datasets.synthetic import WorldConfig
        >>> from animal3dbox.smal import VOCABULARIES
        >>> config = WorldConfig((120, 160), VOCABULARIES["stanfordextra24"], animals=(1, 1))
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     write_stanfordextra(SyntheticSet(0, 2, config), Path(folder))
        2

    """
    if synthetic_set.config.vocabulary.name != "stanfordextra24":
        raise ConfigError(
            "StanfordExtra has the keypoints of stanfordextra24, got a world with"
            f" {synthetic_set.config.vocabulary.name}"
        )
    entries: list[dict[str, Any]] = []
    truths = []
    for sample in tqdm(
        synthetic_set.samples(), desc="animals", unit="animal", disable=None if progress else True
    ):
        entry = _entry(sample)
        count = sum(
            other["img_path"] == entry["img_path"]
            for other in entries[-synthetic_set.config.animals[1] :]
        )
        if count == 0:
            write_picture(root / "images" / entry["img_path"], sample.scene.image.numpy())
        entries.append(entry)
        truths.append(
            truth_of(sample, entry["img_path"] + (f"#{count}" if count else ""), entry["img_path"])
        )
    write_whole(root / ANNOTATIONS, msgspec.json.encode(entries))
    write_truth(root / "truth.json", synthetic_set, truths)
    return len(truths)


def _entry(sample: SyntheticSample) -> dict[str, Any]:
    """The element of the json's list for one animal."""
    annotation, scene = sample.annotation, sample.scene
    height, width = annotation.image_hw
    x1, y1, x2, y2 = mask_box(annotation.mask).tolist()
    joints = [[x, y, v] if v else [0.0, 0.0, 0.0] for x, y, v in annotation.keypoints_2d.tolist()]
    return {
        "img_path": f"{scene.animals[0].preset}/{scene.image_id}.jpg",
        "img_width": width,
        "img_height": height,
        "joints": joints,
        "img_bbox": [x1 + 0.5, y1 + 0.5, x2 - x1, y2 - y1],
        "is_multiple_dogs": len(scene.animals) > 1,
        "seg": encode_mask(annotation.mask.numpy()),
    }
