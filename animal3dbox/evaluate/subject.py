"""One animal of the evaluation: its truth, its annotation with faults, and its label."""

from collections.abc import Iterator
from dataclasses import dataclass

import torch
from torch import Tensor

from animal3dbox.datasets.synthetic.annotation import Annotation, annotate
from animal3dbox.datasets.synthetic.faults import FaultConfig, faulty
from animal3dbox.datasets.synthetic.scenes import SyntheticAnimal, synthetic_scene
from animal3dbox.datasets.synthetic.world.config import world_generator
from animal3dbox.evaluate.config import EvaluateConfig
from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.label import label_animal
from animal3dbox.labels.types import CuboidLabel, Rejection
from animal3dbox.smal.parameters import posed_body


@dataclass(frozen=True, eq=False)
class Subject:
    """The animal that scene number `index` aims at.

    Attributes:
        index: of the scene.
        seed: of the world and of all that is drawn for this animal.
        animal: the truth.
    """

    index: int
    seed: int
    animal: SyntheticAnimal

    def annotated(self, faults: FaultConfig) -> "Annotated":
        """Its annotation in a dataset with such faults, and the body that dataset would give."""
        annotation = faulty(annotate(self.animal), faults, self.seed)
        body = posed_body(self.animal.model, annotation.parameters)
        return Annotated(annotation, body.vertices[0], self.animal)

    def normal(self, purpose: str, shape: tuple[int, ...]) -> Tensor:
        """Standard normal numbers of this animal for one purpose."""
        return torch.from_numpy(
            world_generator(self.seed, self.index, f"evaluate-{purpose}").standard_normal(shape)
        )


@dataclass(frozen=True, eq=False)
class Annotated:
    """An annotation with its body; no camera pose is part of it.

    Attributes:
        annotation: keypoints, mask, intrinsics and parameters.
        vertices: (V, 3) of the fitted body.
        animal: whom it is about.
    """

    annotation: Annotation
    vertices: Tensor
    animal: SyntheticAnimal

    @property
    def landmarks(self) -> Tensor:
        """(J, 3) the keypoints' places on the fitted body."""
        return self.annotation.vocabulary.on_body(self.animal.model.landmark_groups, self.vertices)

    def labelled(self, config: LabelConfig) -> CuboidLabel | Rejection:
        """The label by the one door, from keypoints, mask, K and body.

        No method is given a camera pose.
        """
        annotation = self.annotation
        return label_animal(
            annotation.image_hw,
            keypoints_2d=annotation.keypoints_2d,
            vertices=self.vertices,
            template=self.animal.model,
            K=annotation.K,
            mask=annotation.mask,
            vocabulary=annotation.vocabulary,
            sample_id=annotation.sample_id,
            config=config,
        )


def subjects(config: EvaluateConfig) -> Iterator[Subject]:
    """The animals of an evaluation, in order; each depends on the seed and its index only."""
    for index in range(config.animals):
        yield subject(config, index)


def subject(config: EvaluateConfig, index: int) -> Subject:
    """One animal of an evaluation."""
    return Subject(index, config.seed, synthetic_scene(config.seed, index, config.world).animals[0])
