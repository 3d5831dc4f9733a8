"""Boxes that a dataset comes with as torch Datasets, one a format: nothing is estimated."""

from collections.abc import Callable
from pathlib import Path
from typing import ClassVar, Unpack

from animal3dbox.datasets.label_dataset import LabelDataset
from animal3dbox.datasets.labelling.dataset_options import Options
from animal3dbox.datasets.labelling.file_source import FileSource
from animal3dbox.datasets.readers.cuboid_checks import Metric
from animal3dbox.datasets.readers.kitti.reader import read_kitti
from animal3dbox.datasets.readers.omni3d.reader import read_omni3d
from animal3dbox.datasets.readers.tolerance import upright_cuboids
from animal3dbox.datasets.records import CuboidSet
from animal3dbox.files import user_path


class CuboidDataset(LabelDataset):
    """Boxes of any kind as their files have them: nothing is estimated, no animal is needed.

    Args:
        root: the dataset's file or folder.
        images: the folder of pictures; None: the format's usual one.
        heading_known: whether forward and left mean something; None: as the format or the file
            says. If not, targets have no face fields: which side is the front would be a guess.
        metric: whether lengths are metres: "yes", "no", or "info": as the format or the file says.
        apply_orientation: whether pictures are turned as their EXIF headers say, of boxes that are
            for turned pictures; False: pixels are as stored.
        **options: LabelDataset's; those about labelling have no effect.

    """

    READ: ClassVar[Callable[..., CuboidSet]]

    def __init__(
        self,
        root: Path | str,
        *,
        images: Path | str | None = None,
        heading_known: bool | None = None,
        metric: Metric = "info",
        apply_orientation: bool = False,
        **options: Unpack[Options],
    ) -> None:
        folder = None if images is None else user_path(images)
        cuboids = type(self).READ(
            user_path(root), folder, heading_known=heading_known, metric=metric
        )
        if apply_orientation:
            cuboids = upright_cuboids(cuboids)
        super().__init__(FileSource(cuboids), **options)


class Omni3DDataset(CuboidDataset):
    """Boxes of any kind in Omni3D's format, as they are: nothing is estimated, no animal is needed.

    Without a known heading, targets have no face fields: which side is the front would be a guess.

    If you use Omni3D, cite Brazil et al., "Omni3D: A Large Benchmark and Model for 3D Object
    Detection in the Wild", CVPR 2023.

    Args:
        root: the json.
        images: the folder that file_path is relative to.
        heading_known: whether forward and left mean something; None: what the file says if this
            package wrote it, or where it tells by face_locks or heading_alpha; else not.
        metric: whether lengths are metres: "yes", "no", or "info": what the file says; of one that
            says nothing, scale is not known.
        apply_orientation: see CuboidDataset.
        **options: see CuboidDataset.

    Example:
        >>> Omni3DDataset("nowhere.json")
        Traceback (most recent call last):
        animal3dbox.errors.DatasetNotFoundError: there is no file nowhere.json
    """

    READ = staticmethod(read_omni3d)


class KittiDataset(CuboidDataset):
    """Boxes of any kind in KITTI's text files, as they are: nothing is estimated.

    Labels (15 columns), a detector's results (16) and tracking (17) are read. A KITTI box stands on
    the camera's ground plane: of pitch and roll it knows nothing.

    If you use KITTI, cite Geiger et al., "Are we ready for Autonomous Driving? The KITTI Vision
    Benchmark Suite", CVPR 2012.

    Args:
        root: the folder with label_2/ (or label_02/) and calib/, or one of results beside calib/.
        images: the folder of pictures; None: image_2/ (or image_02/).
        heading_known: whether forward and left mean something; None: they do, as for KITTI's cars,
            unless a file of this package says otherwise. If not, targets have no face fields.
        metric: whether lengths are metres: "yes", "no", or "info": as KITTI's are, unless a file of
            this package says otherwise.
        apply_orientation: see CuboidDataset.
        **options: see CuboidDataset.

    Example:
        >>> KittiDataset("nowhere")
        Traceback (most recent call last):
        animal3dbox.errors.DatasetNotFoundError: there is no folder nowhere
    """

    READ = staticmethod(read_kitti)
