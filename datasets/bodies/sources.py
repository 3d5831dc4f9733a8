"""Where the bodies come from that labels are made of.

A source gives, for each animal, vertices and landmarks in one frame of its own: the embedded
quadruped, the same for every animal; each animal's own SMAL parameters; a mesh file
(mesh_bodies.py). Fits are sources of the same form.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Protocol

import torch
from torch import Tensor

from animal3dbox.datasets.records import AnimalRecord
from animal3dbox.datasets.storage.fingerprint import content_digest, digest
from animal3dbox.datasets.storage.packed import PackedMapping
from animal3dbox.errors import ConfigError, SampleError, ShapeError
from animal3dbox.labels.body import Body
from animal3dbox.smal.keypoints.vocabulary import Vocabulary
from animal3dbox.smal.model import SmalModel, trunk_rotation
from animal3dbox.smal.parameters import SmalParameters, posed_bodies
from animal3dbox.smal.quadruped.poses import POSES, named_pose
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped, preset_betas

BREED = 0.02
"""Difference between one animal of a species and its preset, in body lengths.

Dogs differ by more, but not in all at once.
"""


class BodySource(Protocol):
    """Gives each animal its body."""

    @property
    def name(self) -> str:
        """What to call the source in reports."""
        ...

    @property
    def fingerprint(self) -> bytes:
        """Names the content that all its bodies depend on."""
        ...

    @property
    def lasting(self) -> bool:
        """Whether what content gives stays the same, as that of files may not."""
        ...

    def content(self, sample_id: str) -> bytes:
        """Names the content that this animal's body alone depends on; empty if there is none.

        Raises SampleError if it has no body.
        """
        ...

    def body(self, record: AnimalRecord) -> Body:
        """The body of one animal; raises SampleError if it has none."""
        ...


@dataclass(frozen=True)
class ModelBody:
    """A model in one shape and its template pose: the same rigid body for every animal.

    Attributes:
        model: with landmarks.
        name: what to call it in reports.
        betas: its shape; the template's if left out.
    """

    model: SmalModel
    name: str
    betas: tuple[float, ...] = (0.0,)

    def __post_init__(self) -> None:
        if not self.model.landmarks:
            raise ConfigError(
                f"{self.name} has no landmarks, so no keypoint has a place on it: give them to"
                " load_model and convert it again"
            )

    @property
    def fingerprint(self) -> bytes:
        """Of the model and its shape."""
        return digest(model_digest(self.model), content_digest(self.betas))

    @property
    def lasting(self) -> bool:
        """Yes."""
        return True

    def content(self, sample_id: str) -> bytes:
        """Nothing: all animals have the same body."""
        return b""

    def body(self, record: AnimalRecord) -> Body:
        """The body with the record's landmarks.

        How far they may stray only if its joints are SMAL's.
        """
        vertices, words = standing_vertices(self.model, self.betas), record.vocabulary
        known = self.model.joint_names == load_quadruped().joint_names
        sigma = model_mobility(self.model, self.betas, words) if known else None
        return Body(
            vertices,
            self.model.faces,
            self.model.read_keypoints(words, vertices),
            sigma,
            self.model,
        )


def preset_body(preset: str) -> ModelBody:
    """The embedded quadruped in a preset's shape.

    Raises ConfigError, naming the presets, if there is none of that name.
    """
    return ModelBody(load_quadruped(), f"quadruped:{preset}", tuple(preset_betas(preset).tolist()))


@lru_cache(maxsize=16)
def model_digest(model: SmalModel) -> bytes:
    """Names a model's content."""
    return content_digest(model)


@lru_cache(maxsize=16)
def standing_vertices(model: SmalModel, betas: tuple[float, ...]) -> Tensor:
    """A model's vertices (V, 3) in a shape and the template pose."""
    return model.shaped(torch.tensor([betas], dtype=torch.float64))[0]


@lru_cache(maxsize=64)
def model_mobility(model: SmalModel, betas: tuple[float, ...], vocabulary: Vocabulary) -> Tensor:
    """How far each landmark (J,) strays from where the standing body has it, seen from the trunk, over the named poses.

    The root mean square along one axis, in the body's unit, and on top BREED for what one shape
    misses of a species.

    Args:
        model: of the quadruped's joints, in its order.
        betas: its shape.
        vocabulary: the keypoints.

    """
    shape, standing = torch.tensor(betas, dtype=torch.float64), standing_vertices(model, betas)
    poses = torch.stack([named_pose(pose) for pose in POSES])
    body = model.posed(
        shape.expand(len(poses), -1), poses, torch.zeros(len(poses), 3, dtype=torch.float64)
    )
    torso = model.torso_vertices
    strays = []
    for vertices, R_trunk in zip(body.vertices, trunk_rotation(body.R_world_joint), strict=True):
        upright = (vertices - vertices[torso].mean(0)) @ R_trunk + standing[torso].mean(0)
        strays.append(
            model.read_keypoints(vocabulary, upright) - model.read_keypoints(vocabulary, standing)
        )
    mean_square = torch.stack(strays).pow(2).mean((0, 2))
    breed = BREED * torso_length(model) / torso_length(load_quadruped())
    return (mean_square.nan_to_num() + breed**2).sqrt()


def torso_length(model: SmalModel) -> float:
    """Length of a template's torso along x, in its unit."""
    along = model.v_template[model.torso_vertices, 0]
    return float(along.amax() - along.amin())


@dataclass(frozen=True)
class ParametersBody:
    """Each animal's own SMAL-structured body, from its parameters.

    Attributes:
        model: what the parameters were fitted with.
        parameters: sample id -> the animal's parameters.
        vertices_in: the type in which vertices are computed before they are placed, see
            posed_bodies; float32 moves the sides of boxes by less than a millionth of their
            diagonal.
    """

    model: SmalModel
    parameters: Mapping[str, SmalParameters]
    vertices_in: torch.dtype = torch.float32

    def __post_init__(self) -> None:
        if self.vertices_in not in (torch.float32, torch.float64):
            raise ConfigError(
                f"vertices_in must be torch.float32 or torch.float64, got {self.vertices_in}"
            )

    @property
    def name(self) -> str:
        """How many bodies, of how many joints."""
        return f"parameters:{len(self.parameters)} of a model with {self.model.joint_count} joints"

    @property
    def fingerprint(self) -> bytes:
        """Of the model and how it is posed."""
        return digest(model_digest(self.model), str(self.vertices_in).encode())

    @property
    def lasting(self) -> bool:
        """Yes of packed parameters; others may be replaced by whoever holds them."""
        return isinstance(self.parameters, PackedMapping)

    def content(self, sample_id: str) -> bytes:
        """The animal's parameters."""
        try:
            if isinstance(self.parameters, PackedMapping):
                return self.parameters.packed(sample_id)
            return content_digest(self.parameters[sample_id])
        except KeyError:
            raise SampleError(sample_id, "parameters", "there are none for this sample") from None

    def packed(self) -> "ParametersBody":
        """The same with its parameters in a few tensors, for workers (packed.py)."""
        return replace(self, parameters=PackedMapping(SmalParameters, self.parameters))

    def body(self, record: AnimalRecord) -> Body:
        """The record's posed body with its landmarks; its pose is the animal's own."""
        return self.bodies([record])[0]

    def bodies(self, records: Sequence[AnimalRecord]) -> list[Body]:
        """The posed bodies of several records at once, which costs less.

        Raises SampleError of the first that has none.
        """
        for record in records:
            if record.sample_id not in self.parameters:
                raise SampleError(record.sample_id, "parameters", "there are none for this sample")
        if not records:
            return []
        try:
            posed = posed_bodies(
                self.model,
                [self.parameters[record.sample_id] for record in records],
                self.vertices_in,
            )
        except ShapeError as error:
            if len(records) == 1:
                raise SampleError(records[0].sample_id, "parameters", str(error)) from error
            return [self.body(record) for record in records]  # tells which
        read = {
            words: self.model.read_keypoints(words, posed.vertices.numpy())
            for words in {record.vocabulary for record in records}
        }
        return [
            Body(
                vertices,
                self.model.faces,
                read[record.vocabulary][i],
                None,
                self.model,
            )
            for i, (record, vertices) in enumerate(zip(records, posed.vertices, strict=True))
        ]


def many_bodies(source: BodySource, records: Sequence[AnimalRecord]) -> list[Body]:
    """The bodies of several records, posed together if the source can.

    Raises SampleError of the first that has none.
    """
    if isinstance(source, ParametersBody) and type(source).body is ParametersBody.body:
        return source.bodies(records)
    return [source.body(record) for record in records]
