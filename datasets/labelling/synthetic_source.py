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
        scenes: the scenes, their faults and what is marked.

    """

    name = FORMAT
    faults: tuple[SampleError, ...] = ()
    notes: tuple[str, ...] = ()
    named_faces = True
    has_cameras = True

    def __init__(self, scenes: SyntheticSet) -> None:
        self.scenes = scenes
        self.categories = tuple(sorted(scenes.config.presets or quadruped_names().presets))

    def __len__(self) -> int:
        return len(self.scenes)

    @property
    def fingerprint(self) -> bytes:
        """Names the quadruped that all scenes are made of."""
        return ParametersBody(load_quadruped(), {}).fingerprint

    def image_id(self, index: int) -> str:
        """The name of a scene: its seed and index."""
        return f"{self.scenes.seed}-{index:06d}"

    def animals(self, index: int) -> int:
        """The number of animals of a scene."""
        return len(_scene(self.scenes, index).animals)

    def sample(self, index: int) -> ImageSample:
        """The animals of a scene as annotated."""
        scene = _scene(self.scenes, index)
        samples = [
            SyntheticSample(
                scene,
                animal,
                faulty(annotate(animal, self.scenes.hidden), self.scenes.faults, self.scenes.seed),
            )
            for animal in scene.animals
        ]
        bodies = ParametersBody(
            load_quadruped(),
            {sample.annotation.sample_id: sample.annotation.parameters for sample in samples},
        )
        records = tuple(_with_camera(sample) for sample in samples)
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
            _scene(self.scenes, int(sample.image_id.rpartition("-")[2])).image.numpy().copy(),
            PhotoFacts(),
        )

    def facts(self, sample: ImageSample) -> PhotoFacts:
        """No facts: a drawn picture has no header."""
        return PhotoFacts()


def _with_camera(sample: SyntheticSample) -> AnimalRecord:
    return replace(record_of(sample), stored_pose=(np.eye(3), np.zeros(3)))


@lru_cache(maxsize=2)
def _scene(scenes: SyntheticSet, index: int) -> SyntheticScene:
    return synthetic_scene(scenes.seed, index, scenes.config)
