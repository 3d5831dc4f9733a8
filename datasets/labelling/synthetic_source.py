"""The synthetic world as samples of a Dataset: scenes are drawn when they are asked for."""

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from animal3dbox.datasets.bodies.sources import ParametersBody
from animal3dbox.datasets.images.exif import PhotoFacts
from animal3dbox.datasets.images.photos import Photo
from animal3dbox.datasets.labelling.image_index import entry_of
from animal3dbox.datasets.labelling.image_samples import ImageSample
from animal3dbox.datasets.labelling.record_stores import record_content
from animal3dbox.datasets.labelling.scene_store import AnnotatedScene, SceneStore, png_of
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
    """Scenes of a seed's world with their annotations, faults included.

    Records know the camera for which their bodies were fitted as their stored pose: the bodies
    stand in the camera frame.

    Args:
        scenes: the scenes, their faults and what is marked.
        store: folder in which drawn scenes are kept; None: each is drawn when it is asked for.

    """

    name = FORMAT
    faults: tuple[SampleError, ...] = ()
    notes: tuple[str, ...] = ()
    named_faces = True
    has_cameras = True

    def __init__(self, scenes: SyntheticSet, store: Path | str | None = None) -> None:
        self.scenes = scenes
        self.store = None if store is None else SceneStore(store, scenes)
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
        return len(self._annotated(index).records)

    def sample(self, index: int) -> ImageSample:
        """The animals of a scene as annotated."""
        scene = self._annotated(index)
        records, image_id = scene.records, self.image_id(index)
        names = (record.sample_id for record in records)
        bodies = ParametersBody(load_quadruped(), dict(zip(names, scene.parameters, strict=True)))
        # Named by what they say, not by what they are drawn from: the code that draws may change.
        animals = tuple(
            entry_of(record, record_content(record, content_digest(record), bodies))
            for record in records
        )
        listed = CuboidImage(image_id, None, scene.image_hw, scene.K)
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
        index = int(sample.image_id.rpartition("-")[2])
        if self.store is not None:
            return Photo(self._annotated(index).pixels, PhotoFacts())
        return Photo(_scene(self.scenes, index).image.numpy().copy(), PhotoFacts())

    def facts(self, sample: ImageSample) -> PhotoFacts:
        """No facts: a drawn picture has no header."""
        return PhotoFacts()

    def _annotated(self, index: int) -> AnnotatedScene:
        """A scene out of the store; one that is not there is drawn, and stored if there is one."""
        if self.store is None:
            return _drawn(self.scenes, index, png=b"")
        stored = self.store.get(index)
        if stored is None:
            stored = _drawn(
                self.scenes, index, png=png_of(_scene(self.scenes, index).image.numpy())
            )
            self.store.put(index, stored)
        return stored


def _drawn(scenes: SyntheticSet, index: int, *, png: bytes) -> AnnotatedScene:
    """A scene as it is drawn, its animals annotated."""
    scene = _scene(scenes, index)
    samples = [
        SyntheticSample(
            scene, animal, faulty(annotate(animal, scenes.hidden), scenes.faults, scenes.seed)
        )
        for animal in scene.animals
    ]
    return AnnotatedScene(
        records=tuple(_with_camera(sample) for sample in samples),
        parameters=tuple(sample.annotation.parameters for sample in samples),
        K=scene.camera.K.numpy(),
        image_hw=scene.camera.image_hw,
        png=png,
    )


def _with_camera(sample: SyntheticSample) -> AnimalRecord:
    return replace(record_of(sample), stored_pose=(np.eye(3), np.zeros(3)))


@lru_cache(maxsize=16)
def _scene(scenes: SyntheticSet, index: int) -> SyntheticScene:
    """A scene, kept while a batch asks for its animals first and for its picture later."""
    return synthetic_scene(scenes.seed, index, scenes.config)
