"""The user's options for reading a dataset, which every reader takes as far as they concern it."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

from animal3dbox.datasets.readers.tolerance import BadParts, Tolerance, Visibility
from animal3dbox.errors import ConfigError
from animal3dbox.smal.keypoints.vocabulary import Vocabulary

Keep = Literal["location"]
"""What a dataset's file says that is left behind unless somebody asks for it."""


@dataclass(frozen=True)
class ReadOptions:
    """The user's options for reading a dataset, besides its path.

    A reader refuses an option that it has no use for.

    Attributes:
        images: the folder that image paths are relative to; None: the format's usual one.
        model: the SMAL file that the dataset's parameters or meshes belong to; None without.
        vocabulary: the keypoints, of a format whose names may not tell them; None: by the names.
        focal_px: focal length of every image that has no camera of its own, with the principal
            point in the middle; None: as the dataset or the picture's header says, or a guess.
        optional: a bad mask or box is a "fault" of its animal, or is left out with a note: "drop".
        visibility: what stands beside a keypoint: "flags" (0, 1, 2), or "scores" of a network.
        categories: names of those that are read, of files that list some; none: all with an
            animal's keypoints.
        keep: what of the file travels into labels only if asked for: "location", the place.
        apply_orientation: whether pictures and masks are turned as their EXIF headers say, of
            annotations that were made on turned pictures; else pixels are as stored.
        check_paths: whether every picture is looked up when the dataset is opened; else, of COCO
            (other formats always do), only when it is read.
        index_folder: folder of indexes that spare later openings most of the reading (COCO,
            without check_paths); None: none is kept.

    Example:
        >>> ReadOptions(images=Path("photos"), focal_px=1200.0).focal_px
        1200.0

    """

    images: Path | None = None
    model: Path | None = None
    vocabulary: Vocabulary | None = None
    focal_px: float | None = None
    optional: BadParts = "fault"
    visibility: Visibility = "flags"
    categories: tuple[str, ...] = ()
    keep: tuple[Keep, ...] = ()
    apply_orientation: bool = False
    check_paths: bool = True
    index_folder: Path | None = None

    def __post_init__(self) -> None:
        for name, kind in (("optional", BadParts), ("visibility", Visibility)):
            if getattr(self, name) not in get_args(kind):
                raise ConfigError(
                    f"{name} must be one of {', '.join(get_args(kind))}, got"
                    f" {getattr(self, name)!r}"
                )
        if unknown := [word for word in self.keep if word not in get_args(Keep)]:
            raise ConfigError(f"keep must be of {', '.join(get_args(Keep))}, got {unknown}")
        if self.focal_px is not None and not 0 < self.focal_px < math.inf:
            raise ConfigError(f"focal_px must be a positive number of pixels, got {self.focal_px}")

    def tolerance(self) -> Tolerance:
        """How a reader takes a file, to be used for that file alone."""
        return Tolerance(self.optional, self.visibility, self.apply_orientation)
