"""A SMAL-family body.

Template, shape columns, skeleton and skin, and its posing by linear blend skinning.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any

import numpy as np
import torch
from torch import Tensor

from animal3dbox.errors import ShapeError
from animal3dbox.geometry.arrays import AnyArray, as_numpy, has_derivatives, is_plain
from animal3dbox.geometry.checks import check_shape
from animal3dbox.geometry.rigid_transforms import nearest_rotation
from animal3dbox.smal.array_skinning import BODIES_AT_ONCE, SkinMaps, array_maps, skin, skin_maps
from animal3dbox.smal.keypoints.landmark_places import LandmarkPlaces
from animal3dbox.smal.keypoints.vocabulary import Vocabulary

SPINE_JOINTS = tuple(
    range(7)
)  # pelvis to the last vertebra before the neck, in every SMAL topology
_TAIL_PREFIX = "Tail"
_TORSO_WEIGHT = 0.9
_TAIL_WEIGHT = 0.5


@dataclass(frozen=True)
class PosedBody:
    """Bodies in some pose, in world.

    Attributes:
        vertices: (B, V, 3).
        joints: (B, J, 3).
        R_world_joint: (B, J, 3, 3) the global rotation of each joint; the identity in the template
            pose.
    """

    vertices: Tensor
    joints: Tensor
    R_world_joint: Tensor


@dataclass(frozen=True, eq=False)
class SmalModel:
    """A body of SMAL's structure, with any numbers of vertices, joints and shape columns.

    The template frame is x forward, y to the animal's left, z up; all lengths are in the template's
    own units.

    Attributes:
        v_template: (V, 3).
        faces: (F, 3) int64, counter-clockwise seen from outside.
        shapedirs: (V, 3, S) displacement per unit of each beta.
        posedirs: (V, 3, 9 * (J - 1)) displacement per entry of R - I of the joints after the root,
            row by row.
        J_regressor: (J, V), joints of a shaped template.
        weights: (V, J) skinning weights, rows summing to 1.
        parents: J of them, each before its children; the root's is -1 and the root is joint 0.
        joint_names: J of them.
        landmarks: keypoint name -> vertex ids, whose mean is the keypoint; the order is that of
            `keypoints`.
        symmetry: (V,) int64, each vertex's mirror image, or None.
        extra_landmarks: further places of the same form, which other keypoint vocabularies use.
    """

    v_template: Tensor
    faces: Tensor
    shapedirs: Tensor
    posedirs: Tensor
    J_regressor: Tensor
    weights: Tensor
    parents: tuple[int, ...]
    joint_names: tuple[str, ...]
    landmarks: Mapping[str, tuple[int, ...]]
    symmetry: Tensor | None = None
    extra_landmarks: Mapping[str, tuple[int, ...]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check that the parts fit together."""
        v, j = self.vertex_count, len(self.parents)
        check_shape("v_template", self.v_template, "V 3")
        check_shape("faces", self.faces, "F 3")
        check_shape("shapedirs", self.shapedirs, f"{v} 3 S")
        check_shape("posedirs", self.posedirs, f"{v} 3 {9 * (j - 1)}")
        check_shape("J_regressor", self.J_regressor, f"{j} {v}")
        check_shape("weights", self.weights, f"{v} {j}")
        if self.symmetry is not None:
            check_shape("symmetry", self.symmetry, f"{v}")
        if len(self.joint_names) != j:
            raise ShapeError(
                f"joint_names must name {j} joints as parents does, got {len(self.joint_names)}"
            )
        if self.parents[0] != -1 or any(
            not 0 <= p < i for i, p in enumerate(self.parents) if i > 0
        ):
            raise ShapeError(
                f"parents must be -1 and then an earlier joint for each joint, got {self.parents}"
            )
        for name, ids in {**self.landmarks, **self.extra_landmarks}.items():
            if not ids or min(ids) < 0 or max(ids) >= v:
                raise ShapeError(
                    f"landmarks[{name!r}] must hold vertex ids in 0..{v - 1}, got {ids}"
                )

    @cached_property
    def landmark_groups(self) -> dict[str, Sequence[int] | Tensor]:
        """Every place that a keypoint can be read off.

        Landmarks, the extra ones too, as vertex ids; "joint:NAME" as weights (V,).
        """
        joints = {
            f"joint:{name}": weights
            for name, weights in zip(self.joint_names, self.J_regressor, strict=True)
        }
        return {**self.landmarks, **self.extra_landmarks, **joints}

    @property
    def vertex_count(self) -> int:
        """V."""
        return self.v_template.shape[0]

    @property
    def joint_count(self) -> int:
        """J."""
        return len(self.parents)

    @property
    def beta_count(self) -> int:
        """S."""
        return self.shapedirs.shape[2]

    def to(self, dtype: torch.dtype, device: torch.device | str | None = None) -> "SmalModel":
        """The same model in another floating-point type or on another device."""
        arrays = ("v_template", "shapedirs", "posedirs", "J_regressor", "weights")
        changed: dict[str, Any] = {
            name: getattr(self, name).to(device=device, dtype=dtype) for name in arrays
        }
        symmetry = None if self.symmetry is None else self.symmetry.to(device=device)
        return replace(self, **changed, faces=self.faces.to(device=device), symmetry=symmetry)

    def shaped(self, betas: Tensor) -> Tensor:
        """The template with a shape: betas (B, at most S; the rest are 0) -> vertices (B, V, 3)."""
        check_shape("betas", betas, "B S")
        self._check_beta_count(betas)
        return self.v_template + torch.einsum(
            "vcs,bs->bvc", self.shapedirs[:, :, : betas.shape[1]], betas
        )

    def _check_beta_count(self, betas: Tensor) -> None:
        if betas.shape[1] > self.beta_count:
            raise ShapeError(
                f"betas must have at most {self.beta_count} columns, got {tuple(betas.shape)}"
            )

    def posed(self, betas: Tensor, pose: Tensor, trans: Tensor) -> PosedBody:
        """Bodies by linear blend skinning; differentiable in all three arguments.

        Args:
            betas: (B, at most S); the rest are 0.
            pose: (B, J, 3) axis-angle in radians, root first.
            trans: (B, 3) added at the end, in the template's units.

        Returns:
            The bodies, in the frame in which trans is given; the vertices lie in memory coordinate
            by coordinate.
        """
        check_shape("betas", betas, "B S")
        batch = betas.shape[0]
        check_shape("pose", pose, f"{batch} {self.joint_count} 3")
        check_shape("trans", trans, f"{batch} 3")
        self._check_beta_count(betas)
        if not all(is_plain(x) for x in (betas, pose, trans, *self._arrays)):
            vertices, joints, R_world_joint = skin(self._tensor_maps, betas, pose)
            return PosedBody(
                (vertices + trans[..., None]).mT, joints + trans[:, None], R_world_joint
            )
        return self.posed_arrays(betas.numpy(), pose.numpy(), trans.numpy())

    def posed_arrays(
        self,
        betas: np.ndarray,
        pose: np.ndarray,
        trans: np.ndarray,
        vertices_in: torch.dtype | None = None,
    ) -> PosedBody:
        """posed, of arrays of the right shapes.

        A few bodies at a time, which stay in the processor's cache.

        vertices_in is the type in which vertices are computed before trans is added (array_skinning.py);
        None: the model's, as of any whose template stands so far from its origin that float32 would
        tell.
        """
        maps = self._array_maps(
            vertices_in
            if vertices_in is not None and self._is_about_origin
            else self.v_template.dtype
        )
        count, dtype = len(betas), np.result_type(as_numpy(self.v_template), betas, pose, trans)
        vertices = np.empty((count, 3, self.vertex_count), dtype)
        joints, R_world_joint = (
            np.empty((count, self.joint_count, 3), dtype),
            np.empty((count, self.joint_count, 3, 3), dtype),
        )
        for k in range(0, count, BODIES_AT_ONCE):
            some = slice(k, k + BODIES_AT_ONCE)
            about_origin, joints[some], R_world_joint[some] = skin(maps, betas[some], pose[some])
            np.add(about_origin, trans[some, :, None], out=vertices[some])
        joints += trans[:, None]
        return PosedBody(
            torch.from_numpy(vertices).mT, torch.from_numpy(joints), torch.from_numpy(R_world_joint)
        )

    @property
    def _arrays(self) -> tuple[Tensor, ...]:
        return self.v_template, self.shapedirs, self.posedirs, self.J_regressor, self.weights

    @property
    def _tensor_maps(self) -> SkinMaps[Tensor]:
        of_one_call = any(has_derivatives(x) for x in self._arrays)
        return self._new_tensor_maps() if of_one_call else self._known_tensor_maps

    @cached_property
    def _known_tensor_maps(self) -> SkinMaps[Tensor]:
        return self._new_tensor_maps()

    def _new_tensor_maps(self) -> SkinMaps[Tensor]:
        return skin_maps(
            self.v_template,
            self.shapedirs,
            self.posedirs,
            self.J_regressor,
            self.weights,
            self.parents,
        )

    def _array_maps(self, dtype: torch.dtype) -> SkinMaps[np.ndarray]:
        if dtype not in self._array_maps_by_type:
            self._array_maps_by_type[dtype] = array_maps(
                self._new_tensor_maps(), dtype
            )  # not kept: they are as large as the model
        return self._array_maps_by_type[dtype]

    @cached_property
    def _is_about_origin(self) -> bool:
        """Whether the template's middle is nearer to its origin than it is long."""
        template = as_numpy(self.v_template)
        least, greatest = template.min(0), template.max(0)
        return bool(np.abs(least + greatest).max() / 2 <= (greatest - least).max())

    @cached_property
    def _array_maps_by_type(self) -> dict[torch.dtype, SkinMaps[np.ndarray]]:
        return {}

    def __getstate__(self) -> dict[str, Any]:
        """The fields alone: what is worked out from them is not sent to other processes."""
        return {one.name: getattr(self, one.name) for one in fields(self)}

    def keypoints(self, vertices: Tensor) -> Tensor:
        """Means of the landmarks' vertices.

        (..., V, 3) -> (..., number of landmarks, 3), in the order of `landmarks`.
        """
        check_shape("vertices", vertices, f"... {self.vertex_count} 3")
        return torch.stack(
            [vertices[..., list(ids), :].mean(dim=-2) for ids in self.landmarks.values()], dim=-2
        )

    def read_keypoints(self, vocabulary: Vocabulary, vertices: AnyArray) -> AnyArray:
        """A vocabulary's keypoints (..., J, 3) on bodies (..., V, 3) of this model, NaN where it
        has no place; see Vocabulary.on_body."""
        places = self._places.get(vocabulary)
        if places is None:
            places = self._places[vocabulary] = LandmarkPlaces.of(
                vocabulary.places(self.landmark_groups, self.vertex_count), self.vertex_count
            )
        return places.read(vertices)

    @cached_property
    def _places(self) -> dict[Vocabulary, LandmarkPlaces]:
        return {}

    @cached_property
    def face_range(self) -> tuple[int, int]:
        """The least and the greatest vertex number in faces; (0, -1) without any."""
        return (int(self.faces.min()), int(self.faces.max())) if self.faces.numel() else (0, -1)

    @cached_property
    def torso_layout(self) -> np.ndarray:
        """The template's torso vertices (T, 3) about their mean, float64."""
        torso = as_numpy(self.v_template)[as_numpy(self.torso_vertices)].astype(np.float64)
        about: np.ndarray = torso - torso.mean(0)
        return about

    @cached_property
    def torso_vertices(self) -> Tensor:
        """Ids (T,) of the vertices that the spine alone moves.

        Summed weight on joints 0-6 above 0.9.
        """
        return torch.nonzero(self.weights[:, list(SPINE_JOINTS)].sum(dim=1) > _TORSO_WEIGHT)[:, 0]

    @cached_property
    def torso_ids(self) -> np.ndarray:
        """The same as an array."""
        return as_numpy(self.torso_vertices)

    @cached_property
    def tail_vertices(self) -> Tensor:
        """Ids (T,) of the vertices whose summed weight on the joints named Tail* is above 0.5."""
        joints = [j for j, name in enumerate(self.joint_names) if name.startswith(_TAIL_PREFIX)]
        return torch.nonzero(self.weights[:, joints].sum(dim=1) > _TAIL_WEIGHT)[:, 0]

    @cached_property
    def tail_faces(self) -> Tensor:
        """Indices (T,) into `faces` of those with a tail vertex."""
        return torch.nonzero(torch.isin(self.faces, self.tail_vertices).any(dim=1))[:, 0]

    def without_tail_faces(self) -> Tensor:
        """The faces (F', 3) that have no tail vertex; vertex numbers are kept."""
        kept = torch.ones(self.faces.shape[0], dtype=torch.bool, device=self.faces.device)
        kept[self.tail_faces] = False
        return self.faces[kept]


def trunk_rotation(R_world_joint: Tensor) -> Tensor:
    """The trunk's rotation R_world_box: the chordal mean of the spine joints' global rotations.

    Args:
        R_world_joint: (..., J, 3, 3), joints in SMAL's order (0-6 are the spine).

    Returns:
        (..., 3, 3), the rotation nearest to their arithmetic mean.
    """
    check_shape("R_world_joint", R_world_joint, "... J 3 3")
    if R_world_joint.shape[-3] < len(SPINE_JOINTS):
        raise ShapeError(
            f"R_world_joint must have at least the {len(SPINE_JOINTS)} spine joints, got shape"
            f" {tuple(R_world_joint.shape)}"
        )
    return nearest_rotation(R_world_joint[..., list(SPINE_JOINTS), :, :].mean(dim=-3))
