"""The synthetic world as a torch Dataset."""

from pathlib import Path
from typing import Unpack

from animal3dbox.datasets.label_dataset import LabelDataset
from animal3dbox.datasets.labelling.dataset_options import Options
from animal3dbox.datasets.labelling.synthetic_source import SyntheticSource
from animal3dbox.datasets.synthetic.faults import FaultConfig
from animal3dbox.datasets.synthetic.synthetic_set import SyntheticSet
from animal3dbox.datasets.synthetic.world.config import WorldConfig
from animal3dbox.errors import ConfigError
from animal3dbox.geometry.checks import check_image_hw


class SyntheticDataset(LabelDataset):
    """The synthetic world: scenes of posed quadrupeds, drawn when they are asked for.

    With stored_cameras="exact", the default, its own cameras are used, and labels are as good as
    its annotations.

    Args:
        images: how many scenes, or a whole SyntheticSet.
        seed: another seed gives another world.
        image_hw: height and width of the pictures.
        faults: what is wrong with the annotations; None: nothing.
        store: a folder in which every scene is kept when it has been drawn once, for all runs and
            workers; None: scenes are drawn whenever they are asked for. Labels have a cache of
            their own.
        **options: LabelDataset's.

    Example:
        >>> dataset = SyntheticDataset(24, seed=0, image_hw=(120, 160))
        >>> image, target = dataset[0]
        >>> len(dataset), image.shape, target["face_visible"].shape
        (24, torch.Size([3, 120, 160]), torch.Size([1, 6]))
    """

    def __init__(
        self,
        images: int | SyntheticSet,
        *,
        seed: int | None = None,
        image_hw: tuple[int, int] | None = None,
        faults: FaultConfig | None = None,
        store: Path | str | None = None,
        **options: Unpack[Options],
    ) -> None:
        options.setdefault("stored_cameras", "exact")
        if isinstance(images, SyntheticSet):
            if (seed, image_hw, faults) != (None, None, None):
                raise ConfigError(
                    "seed, image_hw and faults are the SyntheticSet's own: give them there"
                )
            scenes = images
        else:
            if not isinstance(images, int) or not isinstance(seed, int | None):
                raise ConfigError(
                    "images must be a number of scenes or a SyntheticSet, and seed a number, got"
                    f" {images!r} and {seed!r}"
                )
            world = WorldConfig()
            if image_hw is not None:
                check_image_hw("image_hw", image_hw)
                world = WorldConfig(image_hw=(int(image_hw[0]), int(image_hw[1])))
            scenes = SyntheticSet(seed or 0, images, world, faults or FaultConfig())
        super().__init__(SyntheticSource(scenes, store), **options)
