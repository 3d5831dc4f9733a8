"""All animals of a dataset as crops in memory: decoded and cut out once, looked at many times."""

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from animal3dbox.errors import ConfigError, ShapeError
from animal3dbox.training.detector_targets.crops import crop_boxes


@dataclass(frozen=True, kw_only=True)
class StoredCrops:
    """The crops of N animals and what is true of them; CropViews looks at them.

    Attributes:
        pixels: (N, 3, s, s) uint8.
        K: (N, 3, 3) intrinsics of the crops.
        center: (N, 3) camera frame of the image, which is the crop's too.
        rotation: (N, 3, 3) R_cam_box.
        size: (N, 3) length, width, height.
        boxes: (N, 4) xyxy px of the images.
        image: (N,) the number of each animal's image, those of an image side by side.
        weight: (N,) how much each counts in training, as the confidence of its label; 1.

    Example:
        >>> target = {"boxes": torch.tensor([[2.0, 2, 6, 6]]), "K": torch.eye(3)}
        >>> target |= {"center": torch.ones(1, 3), "rotation": torch.eye(3)[None]}
        >>> target["size"] = torch.ones(1, 3)
        >>> crops = StoredCrops.of([(torch.zeros(3, 9, 9, dtype=torch.uint8), target)], side=96)
        >>> len(crops), crops.pixels.shape
        (1, torch.Size([1, 3, 96, 96]))
    """

    pixels: Tensor
    K: Tensor
    center: Tensor
    rotation: Tensor
    size: Tensor
    boxes: Tensor
    image: Tensor
    weight: Tensor

    def __len__(self) -> int:
        return len(self.pixels)

    @classmethod
    def of(cls, samples: Iterable[Any], *, side: int = 96, margin: float = 0.4) -> "StoredCrops":
        """Cut all animals of a Dataset out.

        Args:
            samples: (image, target) each, as a Dataset gives them; what is no such pair, as a
                sample that was skipped, has no animals.
            side: of the crops in px.
            margin: part of the 2D box that is shown on each side of it: with 0.4, views of two
                thirds of the side have a margin of 0.1, and room to turn.

        Raises:
            ConfigError: there is no animal.
            SampleError: a target has no boxes or K, or a box has no area.

        """
        rows: list[dict[str, Tensor]] = []
        for number, sample in enumerate(samples):
            if not isinstance(sample, tuple) or not len(sample[1]["boxes"]):
                continue
            image, target = sample
            crops = crop_boxes([image], [target], (side, side), margin=margin)
            row = {"weight": torch.ones(len(target["boxes"]))}
            row |= {name: target[name] for name in ("center", "rotation", "size", "boxes")}
            rows.append(
                {**row, "pixels": crops.pixels, "K": crops.K, "image": crops.image + number}
            )
        if not rows:
            raise ConfigError("there is no animal to cut out in any sample")
        return cls(**{one.name: torch.cat([row[one.name] for row in rows]) for one in fields(cls)})

    @classmethod
    def kept(
        cls, dataset: Any, path: Path, *, side: int = 96, margin: float = 0.4
    ) -> "StoredCrops":
        """The crops of a Dataset, read from a file if it is there, else cut out and kept there.

        A file of another Dataset is refused: it keeps the Dataset's length and the names of its
        images, and its first, middle and last crops must be cut out again as they are. A label
        that was changed between those is not noticed: delete the file after such a change.

        Args:
            dataset: with a length, and samples by number that are the same each time.
            path: of the file; written at once as a whole.
            side: see `of`.
            margin: see `of`.

        Raises:
            ConfigError: the file is of another Dataset, side or margin, or of an older version.

        """
        if path.exists():
            contents = torch.load(path)
            if contents.pop("names", None) != _names_digest(dataset):
                raise _of_another(path, "length and image names differ")
            crops = cls(**contents)
            crops._check_cut_from(dataset, path, side=side, margin=margin)
            return crops
        samples = (dataset[number] for number in range(len(dataset)))
        crops = cls.of(samples, side=side, margin=margin)
        part = path.with_name(path.name + ".part")
        contents = {one.name: getattr(crops, one.name) for one in fields(cls)}
        torch.save({**contents, "names": _names_digest(dataset)}, part)
        part.replace(path)
        return crops

    def _check_cut_from(self, dataset: Any, path: Path, *, side: int, margin: float) -> None:
        """Raise a ConfigError unless the first, middle and last image give these crops again."""
        images = self.images
        for number in sorted({images[0], images[len(images) // 2], images[-1]}):
            stored = self.at(self.image == number)
            try:
                fresh = StoredCrops.of([dataset[number]], side=side, margin=margin)
            except ConfigError:
                raise _of_another(path, f"image {number} has no animal") from None
            for one in fields(self):
                old, new = getattr(stored, one.name).double(), getattr(fresh, one.name).double()
                slack = 1.0 if one.name == "pixels" else 1e-4
                is_same = one.name == "image" or (
                    old.shape == new.shape and torch.allclose(old, new, rtol=1e-4, atol=slack)
                )
                if not is_same:
                    raise _of_another(path, f"{one.name} of image {number} differ")

    @property
    def digest(self) -> str:
        """A name of what is true of the crops, for checkpoints: pixels do not count."""
        name = hashlib.sha256()
        for one in fields(self):
            if one.name != "pixels":
                name.update(getattr(self, one.name).double().contiguous().numpy().tobytes())
        return name.hexdigest()[:16]

    def at(self, rows: Tensor) -> "StoredCrops":
        """Some of the crops, by numbers or flags."""
        return StoredCrops(**{one.name: getattr(self, one.name)[rows] for one in fields(self)})

    @property
    def images(self) -> list[int]:
        """The numbers of the images that have animals, in order."""
        numbers: list[int] = torch.unique_consecutive(self.image).tolist()
        return numbers

    @property
    def truth(self) -> dict[str, Tensor]:
        """What CropViews takes beside the pixels: `K`, `center`, `rotation`, `size`, `weight`."""
        names = ("K", "center", "rotation", "size", "weight")
        return {name: getattr(self, name) for name in names}

    def by_image(
        self, predicted: Mapping[str, Tensor]
    ) -> tuple[list[dict[str, Tensor]], list[dict[str, Tensor]]]:
        """Predictions and targets as BoxMetrics takes them, one dict an image.

        Args:
            predicted: fields (N, ...) of the crops' boxes; `boxes` are put in.

        Raises:
            ShapeError: a field has not one row a crop.

        """
        for name, value in predicted.items():
            if len(value) != len(self):
                raise ShapeError(f"{name} must have {len(self)} rows, one a crop, got {len(value)}")
        _, counts = torch.unique_consecutive(self.image, return_counts=True)
        true = {name: getattr(self, name) for name in ("center", "rotation", "size", "boxes")}
        split = [
            {name: value.split(counts.tolist()) for name, value in side.items()}
            for side in ({**predicted, "boxes": self.boxes}, true)
        ]
        predictions, targets = (
            [{name: parts[k] for name, parts in side.items()} for k in range(len(counts))]
            for side in split
        )
        return predictions, targets


def _names_digest(dataset: Any) -> str:
    """Names the length of a Dataset and, if it has them, the names of its images."""
    count = len(dataset)
    name_of = getattr(dataset, "image_id", None)
    names = [] if name_of is None else [str(name_of(number)) for number in range(count)]
    return hashlib.sha256(repr((count, names)).encode()).hexdigest()


def _of_another(path: Path, difference: str) -> ConfigError:
    return ConfigError(
        f"{path} keeps crops of another Dataset, side or margin, or is of an older version"
        f" ({difference}): give another path, or delete it to have them cut out anew"
    )
