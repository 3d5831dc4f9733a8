"""One small dataset in three formats of JSON, and the ways in which other programs write it."""

import copy
import json
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from coco_dataset import coco_content, write_coco
from photo_dataset import View, add_photo

from animal3dbox.datasets.images.rle import encode_mask
from animal3dbox.datasets.read_options import ReadOptions

Content = Any


@dataclass
class JsonSet:
    """A dataset whose entries can be changed before it is written.

    Attributes:
        format: coco, stanfordextra or animal3d.
        root: its folder.
        content: of its file.
    """

    format: str
    root: Path
    content: Content = field(default=None)

    @property
    def animals(self) -> list[dict[str, Any]]:
        """The animals' elements."""
        if self.format == "coco":
            return list(self.content["annotations"])
        return list(self.content["data"] if self.format == "animal3d" else self.content)

    @property
    def images(self) -> list[tuple[dict[str, Any], str]]:
        """The elements that name an image, and the key that does."""
        if self.format == "coco":
            return [(image, "file_name") for image in self.content["images"]]
        return [(animal, "img_path") for animal in self.animals]

    def change_keypoints(self, change: Callable[[list[list[float]]], list[list[float]]]) -> None:
        """Rewrite the keypoints of every animal, as rows of x, y and visibility."""
        for animal in self.animals:
            if self.format == "coco":
                flat = animal["keypoints"]
                rows = [flat[i : i + 3] for i in range(0, len(flat), 3)]
                animal["keypoints"] = [number for row in change(rows) for number in row]
            else:
                key = "joints" if self.format == "stanfordextra" else "keypoint_2d"
                animal[key] = change(animal[key])

    def append(self, animal: dict[str, Any]) -> None:
        """Add an animal's element at the end."""
        lists = {"coco": "annotations", "animal3d": "data"}
        key = lists.get(self.format)
        (self.content if key is None else self.content[key]).append(animal)

    def change_last_keypoints(
        self, change: Callable[[list[list[float]]], list[list[float]]]
    ) -> None:
        """Rewrite the keypoints of the last animal, as change_keypoints does."""
        whole, self.content = self.content, copy.deepcopy(self.content)
        self.change_keypoints(change)
        last, self.content = self.animals[-1], whole
        self.animals[-1].update(last)

    def rename_images(self, rename: Callable[[str], str]) -> None:
        """Rewrite the name of every image."""
        for element, key in self.images:
            element[key] = rename(element[key])

    def write(self) -> Path:
        """The dataset's file."""
        if self.format == "coco":
            return write_coco(self.root, self.content)
        name = "train.json" if self.format == "animal3d" else "annotations.json"
        (self.root / name).write_text(json.dumps(self.content))
        return self.root / name

    def options(self, **more: Any) -> ReadOptions:
        """How it is read."""
        return ReadOptions(images=self.root / "images", **more)


def json_set(format: str, root: Path, view: View) -> JsonSet:
    """The dataset in one format."""
    root.mkdir(parents=True, exist_ok=True)
    if format == "coco":
        return JsonSet(format, root, coco_content(root))
    entries = [add_photo(root, view, name) for name in ("a.jpg", "sub/b.jpg")]
    if format == "stanfordextra":
        return JsonSet(format, root, entries)
    data = []
    for entry in entries:
        rows = copy.deepcopy(entry["joints"])
        data.append(
            {
                "img_path": entry["img_path"],
                "height": entry["img_height"],
                "width": entry["img_width"],
                "keypoint_2d": rows + [[0.0, 0.0, 0.0]] * (26 - len(rows)),
            }
        )
    return JsonSet(format, root, {"data": data})


def broken_mask(made: JsonSet) -> None:
    """Give the first animal a mask of another size."""
    wrong = {"size": [5, 5], "counts": encode_mask(np.ones((5, 5), dtype=bool))}
    animal = made.animals[0]
    if made.format == "animal3d":
        animal["mask_path"] = "masks/nowhere.png"
    else:
        animal["segmentation" if made.format == "coco" else "seg"] = wrong
