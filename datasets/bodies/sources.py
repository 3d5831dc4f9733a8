"""Where the bodies come from that labels are made of.

A source gives each animal vertices and landmarks in a frame of its own. ModelBody is one shape for
every animal, such as a preset of the embedded quadruped; ParametersBody poses each animal's own
SMAL parameters; mesh_file.py and mesh_folder.py have the sources of mesh files.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Protocol

import numpy as np
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
from animal3dbox.smal.quadruped.rest_pose import rest_alignment

BREED = 0.02
"""Difference between one animal of a species and its preset, in body lengths.

Dogs differ by more, but not in all landmarks at once.
"""


class BodySource(Protocol):
    """Anything that gives each animal of a dataset its body, and says what the bodies depend on.

    A label's cache key is made of `fingerprint` and `content`, so both must change whenever a body
    does.
    """

    @property
    def name(self) -> str:
        """The source's name in reports."""
        ...

    @property
    def fingerprint(self) -> bytes:
        """Digest of everything that all bodies of this source depend on."""
        ...

    @property
    def lasting(self) -> bool:
        """Whether `content` of an animal can never change while the source lives.

        Values in memory stay as they are, so a Dataset takes their content once. Files may be
        replaced at any time, so theirs is taken anew for each sample.
        """
        ...

    def content(self, sample_id: str) -> bytes:
        """Digest of what the body of this animal alone depends on; empty if of nothing.

        Raises SampleError if the animal has no body.
        """
        ...

    def body(self, record: AnimalRecord) -> Body:
        """The body of a record's animal; raises SampleError if it has none."""
        ...


@dataclass(frozen=True)
class ModelBody:
    """A body source that gives every animal one model in one shape and its template pose.

    Attributes:
        model: a model with landmarks.
        name: the source's name in reports.
        betas: the shape; the template's if left out.

    Example:
        >>> from animal3dbox.smal import load_quadruped
        >>> source = ModelBody(load_quadruped(), name="template")
        >>> source.lasting, source.content("photo.jpg")
        (True, b'')

    """

    model: SmalModel
    name: str
    betas: tuple[float, ...] = (0.0,)

    def __post_init__(self) -> None:
        if not self.model.landmarks:
            raise ConfigError(
                f"{self.name} has no landmarks, so no keypoint has a place on it: give them to"
                " load_model, or convert it again with convert-model --landmarks"
            )

    @property
    def fingerprint(self) -> bytes:
        """Digest of the model and its shape."""
        return digest(model_digest(self.model), content_digest(self.betas))

    @property
    def lasting(self) -> bool:
        """True: the model is held in memory and does not change."""
        return True

    def content(self, sample_id: str) -> bytes:
        """Empty, since all animals have the same body."""
        return b""

    def body(self, record: AnimalRecord) -> Body:
        """The body with the landmarks of the record's vocabulary.

        How far the landmarks may stray is known only for a model whose joints are the quadruped's,
        since the poses that tell it are the quadruped's.
        """
        vertices = standing_vertices(self.model, self.betas)
        has_poses = self.model.joint_names == load_quadruped().joint_names
        return Body(
            vertices=vertices,
            faces=self.model.faces,
            landmarks=self.model.read_keypoints(record.vocabulary, vertices),
            landmark_sigma=(
                model_mobility(self.model, self.betas, record.vocabulary) if has_poses else None
            ),
            template=self.model,
        )


def preset_body(preset: str) -> ModelBody:
    """The body source of the embedded quadruped in a preset's shape.

    Raises ConfigError, naming the presets, if there is none of that name.

    Example:
        >>> preset_body("zebra").name
        'quadruped:zebra'

    """
    return ModelBody(load_quadruped(), f"quadruped:{preset}", tuple(preset_betas(preset).tolist()))


@lru_cache(maxsize=16)
def model_digest(model: SmalModel) -> bytes:
    """Digest of a model's content with its landmarks, computed once a model."""
    return content_digest(model)


@lru_cache(maxsize=16)
def standing_vertices(model: SmalModel, betas: tuple[float, ...]) -> Tensor:
    """A model's vertices (V, 3) in a shape and the template pose."""
    return model.shaped(torch.tensor([betas], dtype=torch.float64))[0]


@lru_cache(maxsize=64)
def model_mobility(model: SmalModel, betas: tuple[float, ...], vocabulary: Vocabulary) -> Tensor:
    """How far each landmark strays from its place on the standing body, over the named poses.

    It is the root mean square of the landmark's way, seen from the trunk, along one axis; BREED is
    added in quadrature for what one shape misses of a species.

    Args:
        model: a model with the quadruped's joints, in their order.
        betas: the shape.
        vocabulary: names the J keypoints.

    Returns:
        (J,) in the body's unit.

    """
    shape, standing = torch.tensor(betas, dtype=torch.float64), standing_vertices(model, betas)
    poses = torch.stack([named_pose(pose) for pose in POSES])
    if model is not load_quadruped():
        poses = _own_poses(model, shape, poses)
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
    # sigma_j² = mean over poses and axes of (x_pose − x_standing)², plus BREED², in body lengths
    breed = BREED * torso_length(model) / torso_length(load_quadruped())
    return (mean_square.nan_to_num() + breed**2).sqrt()


def _own_poses(model: SmalModel, betas: Tensor, poses: Tensor) -> Tensor:
    """The quadruped's poses (P, J, 3) in the angles of a model that may stand otherwise at rest."""
    shape, ours = (np.zeros(one.beta_count) for one in (model, load_quadruped()))
    shape[: len(betas)] = betas.numpy()
    return torch.from_numpy(rest_alignment(model, shape, ours).angles(poses.numpy()))


def torso_length(model: SmalModel) -> float:
    """Length of a model's torso along x in the template pose, in the model's unit."""
    along = model.v_template[model.torso_vertices, 0]
    return float(along.amax() - along.amin())


NO_PARAMETERS = (
    "there are none for this sample, or zeros, which stand for none: fit a body to it, without"
    " --model or with --body fit"
)
"""The problem of an animal without parameters of its own, and its remedy."""


@dataclass(frozen=True)
class ParametersBody:
    """A body source that poses each animal's own SMAL parameters.

    Attributes:
        model: the model that the parameters were fitted with.
        parameters: sample id -> the animal's parameters.
        vertices_in: the type in which vertices are computed before they are placed, see
            posed_bodies; float32 moves the sides of boxes by less than a millionth of their
            diagonal.

    Example:
        >>> from animal3dbox.smal import load_quadruped
        >>> model = load_quadruped()
        >>> pose, betas, trans = torch.zeros(3 * model.joint_count), torch.zeros(1), torch.zeros(3)
        >>> source = ParametersBody(model, {"dog.jpg": SmalParameters(pose, betas, trans)})
        >>> source.name
        'parameters:1 of a model with 35 joints'

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
        """Number of bodies and of the model's joints, as reports print them."""
        return f"parameters:{len(self.parameters)} of a model with {self.model.joint_count} joints"

    @property
    def fingerprint(self) -> bytes:
        """Digest of the model and of the type in which it is posed."""
        return digest(model_digest(self.model), str(self.vertices_in).encode())

    @property
    def lasting(self) -> bool:
        """True if the parameters are packed; a mapping may be changed by whoever holds it."""
        return isinstance(self.parameters, PackedMapping)

    def content(self, sample_id: str) -> bytes:
        """Bytes that name the animal's parameters; raises SampleError if there are none."""
        try:
            if isinstance(self.parameters, PackedMapping):
                return self.parameters.packed(sample_id)
            return content_digest(self.parameters[sample_id])
        except KeyError:
            raise SampleError(sample_id, "parameters", NO_PARAMETERS) from None

    def packed(self) -> "ParametersBody":
        """The same source with its parameters in a few tensors, for workers (see packed.py)."""
        return replace(self, parameters=PackedMapping(SmalParameters, self.parameters))

    def body(self, record: AnimalRecord) -> Body:
        """The animal's posed body with the landmarks of the record's vocabulary."""
        return self.bodies([record])[0]

    def bodies(self, records: Sequence[AnimalRecord]) -> list[Body]:
        """The posed bodies of several records, posed at once, which costs less than one by one.

        Raises SampleError, naming the first record that has no parameters.
        """
        for record in records:
            if record.sample_id not in self.parameters:
                raise SampleError(record.sample_id, "parameters", NO_PARAMETERS)
        if not records:
            return []
        try:
            bodies = posed_bodies(
                self.model,
                [self.parameters[record.sample_id] for record in records],
                self.vertices_in,
            )
        except ShapeError as error:
            if len(records) == 1:
                raise SampleError(records[0].sample_id, "parameters", str(error)) from error
            # One by one, so that the error names the record that it is about.
            return [self.body(record) for record in records]
        landmarks = {
            vocabulary: self.model.read_keypoints(vocabulary, bodies.vertices.numpy())
            for vocabulary in {record.vocabulary for record in records}
        }
        return [
            Body(
                vertices=vertices,
                faces=self.model.faces,
                landmarks=landmarks[record.vocabulary][i],
                landmark_sigma=None,
                template=self.model,
            )
            for i, (record, vertices) in enumerate(zip(records, bodies.vertices, strict=True))
        ]


def many_bodies(source: BodySource, records: Sequence[AnimalRecord]) -> list[Body]:
    """The bodies of several records, posed together if the source can.

    Raises SampleError, naming the first record that has no body.
    """
    if isinstance(source, ParametersBody) and type(source).body is ParametersBody.body:
        return source.bodies(records)
    return [source.body(record) for record in records]
