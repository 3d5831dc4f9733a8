"""Boxes in KITTI's text files as a torch Dataset."""

from pathlib import Path
from typing import Unpack

from animal3dbox.datasets.label_dataset import LabelDataset
from animal3dbox.datasets.labelling.dataset_options import Options
from animal3dbox.datasets.labelling.file_source import FileSource
from animal3dbox.datasets.readers.cuboid_checks import Metric
from animal3dbox.datasets.readers.kitti.reader import read_kitti
from animal3dbox.datasets.readers.tolerance import upright_cuboids
from animal3dbox.files import user_path


class KittiDataset(LabelDataset):
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
        apply_orientation: whether pictures are turned as their EXIF headers say, of boxes that are
            for turned pictures; False: pixels are as stored.
        **options: LabelDataset's; those about labelling have no effect.

    Example:
        >>> KittiDataset("nowhere")
        Traceback (most recent call last):
        animal3dbox.errors.DatasetNotFoundError: there is no folder nowhere
    """

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
        cuboids = read_kitti(user_path(root), folder, heading_known=heading_known, metric=metric)
        if apply_orientation:
            cuboids = upright_cuboids(cuboids)
        super().__init__(FileSource(cuboids), **options)
