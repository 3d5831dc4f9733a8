"""The places of KITTI's files: of its benchmark's, of tracking's, and of a detector's results."""

from dataclasses import dataclass
from pathlib import Path

INDEX = "images.txt"
"""This package's own list of images, which has the suffix of label files."""
LABELS = (("label_2", "image_2"), ("label_02", "image_02"))
"""Folders of labels, each with that of its images: of detection, and of tracking."""
SUFFIXES = ("png", "jpg", "jpeg")
"""Suffixes of pictures, in the order in which they are looked for."""


@dataclass(frozen=True)
class KittiLayout:
    """The files of one folder.

    Attributes:
        home: the folder that holds calib/.
        labels: the files of boxes in their order: an image's each, or a sequence's in tracking.
        pictures: name of the folder of images.
    """

    home: Path
    labels: tuple[Path, ...]
    pictures: str

    def picture(self, stem: str, frame: int | None, images: Path | None) -> Path:
        """The path of an image, whether there is a file or not.

        Args:
            stem: of the label file.
            frame: of a sequence; None outside tracking.
            images: the user's folder of images; None: the usual one.

        """
        folder = images or self.home / self.pictures
        name = stem if frame is None else f"{stem}/{frame:06d}"
        found = (folder / f"{name}.{suffix}" for suffix in SUFFIXES)
        return next((path for path in found if path.is_file()), folder / f"{name}.png")


def kitti_layout(folder: Path) -> KittiLayout | None:
    """The files of a folder of KITTI's, or of the one that holds its training/.

    The folder may also be that of a detector's results (000000.txt, ..., perhaps in data/), if
    calib/ lies beside or above them.

    Returns:
        None if there are no label files.

    """
    if not folder.is_dir():
        return None
    for home in (folder, folder / "training"):
        for name, pictures in LABELS:
            labels = _label_files(home / name)
            if labels:
                return KittiLayout(home, labels, pictures)
    for results in (folder, folder / "data"):
        labels = _label_files(results)
        above = (results, *results.resolve().parents[:3])
        calibrated = next((one for one in above if (one / "calib").is_dir()), None)
        numbered = all(path.stem.isdecimal() for path in labels)
        if labels and numbered and calibrated is not None:
            present = [name for _, name in LABELS if (calibrated / name).is_dir()]
            return KittiLayout(calibrated, labels, present[0] if present else LABELS[0][1])
    return None


def is_kitti(path: Path) -> bool:
    """Whether a path is a folder with KITTI's label files."""
    return kitti_layout(path) is not None


def _label_files(folder: Path) -> tuple[Path, ...]:
    return tuple(
        path for path in sorted(folder.glob("*.txt")) if path.name != INDEX and path.is_file()
    )
