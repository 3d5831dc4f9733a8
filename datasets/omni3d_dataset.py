"""Boxes in Omni3D's format as a torch Dataset."""

from pathlib import Path
from typing import Unpack

from animal3dbox.datasets.label_dataset import LabelDataset
from animal3dbox.datasets.labelling.dataset_options import Options
from animal3dbox.datasets.labelling.file_source import FileSource
from animal3dbox.datasets.readers.cuboid_checks import Metric
from animal3dbox.datasets.readers.omni3d.reader import read_omni3d
from animal3dbox.datasets.readers.tolerance import upright_cuboids
from animal3dbox.files import user_path


class Omni3DDataset(LabelDataset):
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
        apply_orientation: whether pictures are turned as their EXIF headers say, of boxes that are
            for turned pictures; False: pixels are as stored.
        **options: LabelDataset's; those about labelling have no effect.

    Example:
        >>> Omni3DDataset("nowhere.json")
        Traceback (most recent call last):
        animal3dbox.errors.DatasetNotFoundError: there is no file nowhere.json
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
        cuboids = read_omni3d(user_path(root), folder, heading_known=heading_known, metric=metric)
        if apply_orientation:
            cuboids = upright_cuboids(cuboids)
        super().__init__(FileSource(cuboids), **options)
