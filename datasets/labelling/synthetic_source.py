"""The synthetic world as samples of a Dataset: scenes are drawn when they are asked for."""

from dataclasses import replace
from functools import lru_cache

import numpy as np

from animal3dbox.datasets.bodies.sources import ParametersBody
from animal3dbox.datasets.images.exif import PhotoFacts
from animal3dbox.datasets.images.photos import Photo
from animal3dbox.datasets.labelling.file_source import record_content
from animal3dbox.datasets.labelling.image_index import entry_of
from animal3dbox.datasets.labelling.image_samples import ImageSample
from animal3dbox.datasets.records import AnimalRecord, CuboidImage
from animal3dbox.datasets.storage.fingerprint import content_digest
from animal3dbox.datasets.synthetic.annotation import annotate
from animal3dbox.datasets.synthetic.faults import faulty
from animal3dbox.datasets.synthetic.scenes import SyntheticScene, synthetic_scene
from animal3dbox.datasets.synthetic.synthetic_set import (
    FORMAT,
    SyntheticSample,
    SyntheticSet,
    record_of,
)
from animal3dbox.errors import SampleError
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped, quadruped_names


class SyntheticSource:
    """Scenes of a seed's world with their annotations, faults included; nothing is held.

    Records know the camera for which their bodies were fitted as their stored pose: the bodies
    stand in the camera frame.

    Args:
        made: the scenes, their faults and what is marked.

    """

    name = FORMAT
    faults: tuple[SampleError, ...] = ()
    notes: tuple[str, ...] = ()
    named_faces = True
    has_cameras = True

    def __init__(self, made: SyntheticSet) -> None:
        self.made = made
        self.categories = tuple(sorted(made.config.presets or quadruped_names().presets))

    def __len__(self) -> int:
        return len(self.made)

    @property
    def fingerprint(self) -> bytes:
        """Of the quadruped that all scenes are made of."""
        return ParametersBody(load_quadruped(), {}).fingerprint

    def image_id(self, index: int) -> str:
        """Seed and index."""
        return f"{self.made.seed}-{index:06d}"

    def animals(self, index: int) -> int:
        """How many animals a scene has."""
        return len(_scene(self.made, index).animals)

    def sample(self, index: int) -> ImageSample:
        """The animals of a scene as annotated."""
        scene = _scene(self.made, index)
        said = [
            SyntheticSample(
                scene,
                animal,
                faulty(annotate(animal, self.made.hidden), self.made.faults, self.made.seed),
            )
            for animal in scene.animals
        ]
        bodies = ParametersBody(
            load_quadruped(),
            {sample.annotation.sample_id: sample.annotation.parameters for sample in said},
        )
        records = tuple(_with_camera(sample) for sample in said)
        # Named by what they say, not by what they are drawn from: the code that draws may change.
        animals = tuple(
            entry_of(record, record_content(record, content_digest(record), bodies))
            for record in records
        )
        camera, image_id = scene.camera, self.image_id(index)
        listed = CuboidImage(image_id, None, camera.image_hw, camera.K.numpy())
        return ImageSample(
            image_id=image_id,
            image_path="",
            has_unread=False,
            animals=animals,
            unpack=lambda: records,
            bodies=bodies,
            listed=None if records else listed,
        )

    def photo(self, sample: ImageSample) -> Photo:
        """The picture of a scene."""
        return Photo(
            _scene(self.made, int(sample.image_id.rpartition("-")[2])).image.numpy().copy(),
            PhotoFacts(),
        )

    def facts(self, sample: ImageSample) -> PhotoFacts:
        """Nothing."""
        return PhotoFacts()


def _with_camera(sample: SyntheticSample) -> AnimalRecord:
    return replace(record_of(sample), stored_pose=(np.eye(3), np.zeros(3)))


@lru_cache(maxsize=2)
def _scene(made: SyntheticSet, index: int) -> SyntheticScene:
    return synthetic_scene(made.seed, index, made.config)
