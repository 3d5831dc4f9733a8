"""The writer of a synthetic dataset as a StanfordExtra json with its images."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from animal3dbox.datasets.images.rle import encode_mask
from animal3dbox.datasets.synthetic.animal3d_writer import write_picture
from animal3dbox.datasets.synthetic.scene_files import SceneRows, raw, write_scenes
from animal3dbox.datasets.synthetic.synthetic_set import SyntheticSample, SyntheticSet
from animal3dbox.datasets.synthetic.truth_file import truth_of, write_truth
from animal3dbox.errors import ConfigError
from animal3dbox.files import write_whole
from animal3dbox.geometry.pixel_boxes import mask_box

ANNOTATIONS = "annotations.json"
"""Name of the annotation file."""


def write_stanfordextra(
    synthetic_set: SyntheticSet,
    root: Path,
    *,
    workers: int = 1,
    resume: bool = False,
) -> int:
    """Write a synthetic dataset in StanfordExtra's format: images, annotations.json, truth.json.

    Cameras and bodies have no place in this format.

    Args:
        synthetic_set: a dataset with StanfordExtra's keypoints.
        root: the folder.
        workers: processes that draw; the files are the same for any number.
        resume: go on where an earlier run into the same folder was broken off.

    Returns:
        Number of animals.

    Raises:
        ConfigError: the dataset has other keypoints, or what was begun is another dataset.

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
    files = StanfordExtraFiles(synthetic_set, root)
    return write_scenes(files, workers=workers, resume=resume)


@dataclass(frozen=True)
class StanfordExtraFiles:
    """The files of StanfordExtra's format, see scene_files.SceneFiles.

    Attributes:
        synthetic_set: the dataset.
        root: the folder.
    """

    synthetic_set: SyntheticSet
    root: Path

    def write_scene(self, index: int) -> SceneRows:
        """Write the picture of a scene, and give its rows."""
        entries, truths = list[msgspec.Raw](), list[msgspec.Raw]()
        for sample in self.synthetic_set.samples_of(index):
            entry = _entry(sample)
            name = entry["img_path"]
            if not entries:
                write_picture(self.root / "images" / name, sample.scene.image.numpy())
            truths.append(
                raw(truth_of(sample, name + (f"#{len(entries)}" if entries else ""), name))
            )
            entries.append(raw(entry))
        return SceneRows(index, "train", entries, truths)

    def write_index(self, scenes: list[SceneRows]) -> None:
        """Write annotations.json and truth.json of some scenes."""
        entries = [entry for scene in scenes for entry in scene.entries]
        write_whole(self.root / ANNOTATIONS, msgspec.json.encode(entries))
        truths = [truth for scene in scenes for truth in scene.truths]
        write_truth(self.root / "truth.json", self.synthetic_set, truths)


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
