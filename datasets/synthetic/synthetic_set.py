"""A whole synthetic dataset in memory: scenes, their annotations, and the records for labelling."""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from animal3dbox.datasets.bodies.sources import ParametersBody
from animal3dbox.datasets.images.rle import encode_mask
from animal3dbox.datasets.records import AnimalRecord, RecordSet
from animal3dbox.datasets.synthetic.annotation import Annotation, Hidden, annotate
from animal3dbox.datasets.synthetic.faults import FaultConfig, faulty
from animal3dbox.datasets.synthetic.scenes import SyntheticAnimal, SyntheticScene, synthetic_scene
from animal3dbox.datasets.synthetic.world.config import WorldConfig
from animal3dbox.errors import ConfigError
from animal3dbox.smal.keypoints.vocabularies import VOCABULARIES
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped

FORMAT = "synthetic"
"""The format's name in reports."""
ANIMAL3D_FOCAL_PX = 1000.0
"""The one focal length, in px, with which Animal3D's bodies were fitted to all of its images."""


@dataclass(frozen=True)
class SyntheticSample:
    """One animal of a synthetic dataset, with its truth and its annotation.

    Attributes:
        scene: the animal's scene.
        animal: the truth.
        annotation: as a dataset would have it, faults included.

    Example:
        >>> dataset = SyntheticSet(0, 1, WorldConfig(image_hw=(120, 160)))
        >>> sample = next(dataset.samples())
        >>> isinstance(sample, SyntheticSample), sample.annotation.image_hw
        (True, (120, 160))

    """

    scene: SyntheticScene
    animal: SyntheticAnimal
    annotation: Annotation


@dataclass(frozen=True)
class SyntheticSet:
    """A synthetic dataset: the first scenes of a seed's world.

    Scenes are drawn when they are needed, and always the same.

    Attributes:
        seed: of the world, and of its faults.
        images: number of scenes.
        config: of the world.
        faults: of the annotations.
        hidden: whether keypoints that something hides are marked, too.

    Example:
        >>> dataset = SyntheticSet(0, 3, WorldConfig(image_hw=(120, 160), animals=(1, 1)))
        >>> [record.sample_id for record in dataset.records().records][:1]
        ['dog-run-0']

    """

    seed: int
    images: int
    config: WorldConfig = field(default_factory=WorldConfig)
    faults: FaultConfig = field(default_factory=FaultConfig)
    hidden: Hidden = "unmarked"

    def __post_init__(self) -> None:
        if self.seed < 0:
            raise ConfigError(f"seed must not be negative, got {self.seed}")
        if self.images < 1:
            raise ConfigError(
                f"a synthetic dataset must have at least one image, got {self.images}"
            )

    def __len__(self) -> int:
        return self.images

    def samples(self) -> Iterator[SyntheticSample]:
        """Every animal, scene by scene; a scene is not kept when the next one is drawn."""
        for index in range(self.images):
            yield from self.samples_of(index)

    def samples_of(self, index: int) -> tuple[SyntheticSample, ...]:
        """The animals of one scene."""
        scene = synthetic_scene(self.seed, index, self.config)
        return tuple(
            SyntheticSample(
                scene, animal, faulty(annotate(animal, self.hidden), self.faults, self.seed)
            )
            for animal in scene.animals
        )

    @cached_property
    def _annotated(self) -> tuple[tuple[AnimalRecord, Annotation], ...]:
        """The records and annotations of all animals, without their pictures and masks."""
        return tuple(
            (record_of(sample), replace(sample.annotation, mask=sample.annotation.mask[:0]))
            for sample in self.samples()
        )

    def records(self, stored_pose: bool = False) -> RecordSet:
        """The records of all animals for labelling, each with its own K.

        Args:
            stored_pose: whether the records know the camera for which their bodies were fitted, as
                Animal3D's do.

        """
        camera = (np.eye(3), np.zeros(3)) if stored_pose else None
        return RecordSet(
            FORMAT, tuple(replace(record, stored_pose=camera) for record, _ in self._annotated), ()
        )

    def bodies(self) -> ParametersBody:
        """The source of the animals' bodies as annotated, misfits included, in the camera frame."""
        return ParametersBody(
            load_quadruped(),
            {record.sample_id: annotation.parameters for record, annotation in self._annotated},
        )


def record_of(sample: SyntheticSample) -> AnimalRecord:
    """The record of one sample, as labelling takes it."""
    annotation = sample.annotation
    return AnimalRecord(
        sample_id=annotation.sample_id,
        image_id=sample.scene.image_id,
        image_path=None,
        image_hw=annotation.image_hw,
        vocabulary=annotation.vocabulary,
        keypoints_2d=annotation.keypoints_2d.numpy(),
        mask_runs=encode_mask(annotation.mask.numpy()),
        category=sample.animal.preset,
        K=annotation.K.numpy(),
    )


def animal3d_world(config: WorldConfig) -> WorldConfig:
    """The config with the one camera and the keypoints that Animal3D's format has a place for.

    The camera has a focal length of 1000 px and a centred principal point; the keypoints are the
    format's 26.

    Example:
        >>> animal3d_world(WorldConfig()).focal_px
        (1000.0, 1000.0)

    """
    focal = (ANIMAL3D_FOCAL_PX, ANIMAL3D_FOCAL_PX)
    return replace(
        config, focal_px=focal, principal_offset=0.0, vocabulary=VOCABULARIES["animal3d26"]
    )
