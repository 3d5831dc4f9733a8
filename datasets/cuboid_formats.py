"""Any dataset of cuboids by its path: its format, and its boxes.

They come as they are, so nothing is labelled: the commands `check` and `export` and the Datasets
of cuboids read them. Formats of annotated animals are in `formats`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from animal3dbox.datasets.readers.cuboid_checks import Metric
from animal3dbox.datasets.readers.cuboid_conventions import KITTI, OMNI3D
from animal3dbox.datasets.readers.kitti.layout import is_kitti
from animal3dbox.datasets.readers.kitti.reader import read_kitti
from animal3dbox.datasets.readers.omni3d.reader import read_omni3d
from animal3dbox.datasets.readers.omni3d.recognition import is_omni3d
from animal3dbox.datasets.records import CuboidSet
from animal3dbox.errors import DatasetFormatError


@dataclass(frozen=True)
class CuboidOptions:
    """The user's options for reading a dataset of cuboids, besides its path.

    Attributes:
        images: the folder that image paths are relative to; None: as the format has it.
        heading_known: whether forward and left mean something; None: as the format or file says.
        metric: whether lengths are metres: "yes", "no", or "info": as the format or file says.
    """

    images: Path | None = None
    heading_known: bool | None = None
    metric: Metric = "info"


@dataclass(frozen=True)
class CuboidReader:
    """How one format of cuboids is recognised and read, and what its Dataset is called."""

    recognises: Callable[[Path], bool]
    read: Callable[[Path, CuboidOptions], CuboidSet]
    dataset: str


def _read_omni3d(path: Path, options: CuboidOptions) -> CuboidSet:
    return read_omni3d(
        path, options.images, heading_known=options.heading_known, metric=options.metric
    )


def _read_kitti(path: Path, options: CuboidOptions) -> CuboidSet:
    return read_kitti(
        path,
        options.images,
        heading_known=options.heading_known,
        metric=options.metric,
    )


CUBOID_READERS = {
    OMNI3D.name: CuboidReader(is_omni3d, _read_omni3d, "Omni3DDataset"),
    KITTI.name: CuboidReader(is_kitti, _read_kitti, "KittiDataset"),
}
"""Every format of cuboids that is read, by name, in the order in which a path is tried."""


def cuboid_format(path: Path, format: str = "auto") -> str | None:
    """The name of the format of a file or folder of cuboids; None of anything else.

    Args:
        path: the file or folder.
        format: as the user says, of CUBOID_READERS or of animals; "auto": it is recognised, as is
            one that is said to be COCO's, whose keys Omni3D shares.

    Raises:
        DatasetFormatError: a .json file that is none.

    """
    if format not in ("auto", "coco"):
        return format if format in CUBOID_READERS else None
    return next((name for name, one in CUBOID_READERS.items() if one.recognises(path)), None)


def read_cuboid_set(
    path: Path, options: CuboidOptions | None = None, format: str = "auto"
) -> CuboidSet:
    """The cuboids of a file or folder in any format that is known, or in the one that is given.

    Raises:
        ConfigError: an option that the format has no use for.
        DatasetNotFoundError: nothing there.
        DatasetFormatError: in no such format, or not readable as a whole.

    """
    kind = cuboid_format(path, format)
    if kind is None:
        raise DatasetFormatError(
            f"{path} holds cuboids in no format that is known ({', '.join(CUBOID_READERS)})"
        )
    return CUBOID_READERS[kind].read(path, options or CuboidOptions())
