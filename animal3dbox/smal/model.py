"""A body model of the SMAL family: template, shape columns, skeleton and skin.

Example:
    >>> SPINE_JOINTS
    (0, 1, 2, 3, 4, 5, 6)
"""

import hashlib
from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any, SupportsIndex

import numpy as np
import torch
from torch import Tensor

from animal3dbox.errors import ShapeError
from animal3dbox.geometry.arrays import AnyArray, as_numpy, is_plain
from animal3dbox.geometry.checks import check_shape
from animal3dbox.geometry.rigid_transforms import nearest_rotation
from animal3dbox.geometry.used_vertices import used_vertices
from animal3dbox.smal.array_skinning import (
    BODIES_AT_ONCE,
    SkinningTables,
    pose_arrays,
    skinning_tables,
)
from animal3dbox.smal.keypoints.landmark_places import LandmarkPlaces
from animal3dbox.smal.keypoints.vocabulary import Vocabulary
from animal3dbox.smal.linear_blend_skinning import PosedBody, linear_blend_skinning
from animal3dbox.smal.model_origin import model_of

SPINE_JOINTS = tuple(range(7))
"""The joints from the pelvis to the last vertebra before the neck, in every SMAL topology."""
_TAIL_PREFIX = "Tail"
_TORSO_WEIGHT = 0.9
_TAIL_WEIGHT = 0.5
DIGEST_STEP = 1e-6
"""Of a model's numbers, in its template's unit: smaller differences do not make another body."""
_CONSTANTS = ("v_template", "shapedirs", "posedirs", "J_regressor", "weights")


@dataclass(frozen=True, eq=False, kw_only=True)
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

    Raises:
        ShapeError: the parts do not fit together.

    Example:
        >>> from animal3dbox.smal import load_quadruped, named_pose, preset_betas
        >>> model = load_quadruped()
        >>> model.joint_names[6], model.joint_count
        ('spine3', 35)
        >>> dog, sitting = preset_betas("dog")[None], named_pose("sit")[None]
        >>> body = model.posed(dog, sitting, torch.zeros(1, 3, dtype=torch.float64))
        >>> body.vertices.shape == (1, model.vertex_count, 3)
        True
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
        """Every place that a keypoint can be read off, by its name.

        Landmarks, the extra ones too, as vertex ids; "joint:NAME" as weights (V,).
        """
        joints = {
            f"joint:{name}": weights
            for name, weights in zip(self.joint_names, self.J_regressor, strict=True)
        }
        return {**self.landmarks, **self.extra_landmarks, **joints}

    @property
    def vertex_count(self) -> int:
        """The number V of vertices."""
        return self.v_template.shape[0]

    @property
    def joint_count(self) -> int:
        """The number J of joints."""
        return len(self.parents)

    @property
    def beta_count(self) -> int:
        """The number S of shape columns."""
        return self.shapedirs.shape[2]

    @cached_property
    def digest(self) -> str:
        """32 hexadecimal digits that name what poses vertices: all but landmarks and symmetry.

        Numbers count to DIGEST_STEP, for the embedded quadruped's pose correctives are computed as
        it is loaded, and the last digits may differ from machine to machine.
        """
        names = f"{self.parents} {self.joint_names}"
        content = hashlib.blake2b(names.encode(), digest_size=16)
        for name in (*_CONSTANTS, "faces"):
            array = as_numpy(getattr(self, name).detach().cpu())
            if name in _CONSTANTS:
                array = np.rint(array.astype(np.float64) / DIGEST_STEP)
            content.update(f"{name} {array.shape}".encode())
            content.update(np.ascontiguousarray(array, dtype=np.int64).data)
        return content.hexdigest()

    def to(self, dtype: torch.dtype, device: torch.device | str | None = None) -> "SmalModel":
        """The same model in another floating-point type or on another device."""
        constants: dict[str, Any] = {
            name: getattr(self, name).to(device=device, dtype=dtype) for name in _CONSTANTS
        }
        symmetry = None if self.symmetry is None else self.symmetry.to(device=device)
        return replace(self, **constants, faces=self.faces.to(device=device), symmetry=symmetry)

    def shaped(self, betas: Tensor) -> Tensor:
        """The template with a shape, (B, V, 3), of betas (B, at most S); the rest are 0."""
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
        """Pose bodies by linear blend skinning; differentiable in all three arguments.

        Args:
            betas: (B, at most S); the rest are 0.
            pose: (B, J, 3) axis-angle in radians, root first.
            trans: (B, 3) added at the end, in the template's units.

        Returns:
            The bodies, in the frame in which trans is given.

        Raises:
            ShapeError: an argument has the wrong shape; names it.

        """
        check_shape("betas", betas, "B S")
        batch = betas.shape[0]
        check_shape("pose", pose, f"{batch} {self.joint_count} 3")
        check_shape("trans", trans, f"{batch} 3")
        self._check_beta_count(betas)
        constants: dict[str, Any] = {name: getattr(self, name) for name in _CONSTANTS}
        if all(is_plain(x) for x in (betas, pose, trans, *constants.values())):
            return self.posed_arrays(betas.numpy(), pose.numpy(), trans.numpy())
        kind = self.v_template.device.type
        # In half precision joints would be off by 0.4 %, and every vertex with them
        with (
            torch.autocast(kind, enabled=False)
            if torch.amp.is_autocast_available(kind)
            else nullcontext()
        ):
            return linear_blend_skinning(betas, pose, trans, **constants, parents=self.parents)

    def posed_arrays(
        self,
        betas: np.ndarray,
        pose: np.ndarray,
        trans: np.ndarray,
        *,
        vertices_in: torch.dtype | None = None,
    ) -> PosedBody:
        """Pose bodies of arrays that have the right shapes, as a loader's worker does.

        A few bodies at a time, which stay in the processor's cache; see array_skinning.py.

        Args:
            betas: (B, at most S).
            pose: (B, J, 3).
            trans: (B, 3).
            vertices_in: the type in which vertices are computed before trans is added; None: the
                model's, as of any model whose template stands so far from its origin that float32
                would tell.

        Returns:
            The bodies; their vertices lie in memory coordinate by coordinate.

        """
        if vertices_in is None or not self._is_about_origin:
            vertices_in = self.v_template.dtype
        tables = self._skinning_tables(vertices_in)
        count, dtype = len(betas), np.result_type(as_numpy(self.v_template), betas, pose, trans)
        vertices = np.empty((count, 3, self.vertex_count), dtype)
        joints, R_world_joint = (
            np.empty((count, self.joint_count, 3), dtype),
            np.empty((count, self.joint_count, 3, 3), dtype),
        )
        for k in range(0, count, BODIES_AT_ONCE):
            some = slice(k, k + BODIES_AT_ONCE)
            about_origin, joints[some], R_world_joint[some] = pose_arrays(
                tables, betas[some], pose[some]
            )
            np.add(about_origin, trans[some, :, None], out=vertices[some])
        joints += trans[:, None]
        return PosedBody(
            torch.from_numpy(vertices).mT, torch.from_numpy(joints), torch.from_numpy(R_world_joint)
        )

    def _skinning_tables(self, vertices_in: torch.dtype) -> SkinningTables:
        """The constants laid out for array_skinning.py, once for each type of vertices."""
        if vertices_in not in self._skinning_tables_by_type:
            constants: dict[str, Any] = {name: as_numpy(getattr(self, name)) for name in _CONSTANTS}
            self._skinning_tables_by_type[vertices_in] = skinning_tables(
                **constants,
                parents=self.parents,
                vertices_in=torch.zeros(0, dtype=vertices_in).numpy().dtype,
            )
        return self._skinning_tables_by_type[vertices_in]

    @cached_property
    def _is_about_origin(self) -> bool:
        """Whether the template's middle is nearer to its origin than it is long."""
        template = as_numpy(self.v_template)
        least, greatest = template.min(0), template.max(0)
        return bool(np.abs(least + greatest).max() / 2 <= (greatest - least).max())

    @cached_property
    def _skinning_tables_by_type(self) -> dict[torch.dtype, SkinningTables]:
        return {}

    def __getstate__(self) -> dict[str, Any]:
        """The fields alone: what is worked out from them is not sent to other processes."""
        return {one.name: getattr(self, one.name) for one in fields(self)}

    def __reduce_ex__(self, protocol: SupportsIndex) -> str | tuple[Any, ...]:
        """Where it was loaded from, if it is as it was loaded; else its fields."""
        origin = self.__dict__.get("origin")
        return super().__reduce_ex__(protocol) if origin is None else (model_of, (origin,))

    def keypoints(self, vertices: Tensor) -> Tensor:
        """The landmarks (..., L, 3) on bodies (..., V, 3), in the order of `landmarks`."""
        check_shape("vertices", vertices, f"... {self.vertex_count} 3")
        return torch.stack(
            [vertices[..., list(ids), :].mean(dim=-2) for ids in self.landmarks.values()], dim=-2
        )

    def read_keypoints(self, vocabulary: Vocabulary, vertices: AnyArray) -> AnyArray:
        """The keypoints of a vocabulary on bodies of this model; see Vocabulary.on_body.

        Args:
            vocabulary: names the J keypoints.
            vertices: (..., V, 3).

        Returns:
            (..., J, 3); NaN for a keypoint that the body has no place for.

        """
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
    def used_vertices(self) -> np.ndarray | None:
        """Which vertices (V,) some face uses, bool; None if all are, or if there are no faces."""
        return used_vertices(self.faces, self.vertex_count)

    @cached_property
    def torso_layout(self) -> np.ndarray:
        """The template's torso vertices (T, 3) about their mean, float64."""
        torso = as_numpy(self.v_template)[as_numpy(self.torso_vertices)].astype(np.float64)
        about: np.ndarray = torso - torso.mean(0)
        return about

    @cached_property
    def torso_vertices(self) -> Tensor:
        """The indices (T,) of the vertices that the spine moves: weight on joints 0-6 above 0.9."""
        return torch.nonzero(self.weights[:, list(SPINE_JOINTS)].sum(dim=1) > _TORSO_WEIGHT)[:, 0]

    @cached_property
    def torso_ids(self) -> np.ndarray:
        """The torso's vertices (T,) as an array."""
        return as_numpy(self.torso_vertices)

    @cached_property
    def tail_vertices(self) -> Tensor:
        """The indices (T,) of the vertices whose weight on the joints named Tail* is above 0.5."""
        joints = [j for j, name in enumerate(self.joint_names) if name.startswith(_TAIL_PREFIX)]
        return torch.nonzero(self.weights[:, joints].sum(dim=1) > _TAIL_WEIGHT)[:, 0]

    @cached_property
    def tail_faces(self) -> Tensor:
        """The indices (T,) into `faces` of those with a tail vertex."""
        return torch.nonzero(torch.isin(self.faces, self.tail_vertices).any(dim=1))[:, 0]

    def without_tail_faces(self) -> Tensor:
        """The faces (F', 3) that have no tail vertex; vertex numbers are kept."""
        has_no_tail = torch.ones(len(self.faces), dtype=torch.bool, device=self.faces.device)
        has_no_tail[self.tail_faces] = False
        return self.faces[has_no_tail]


def trunk_rotation(R_world_joint: Tensor) -> Tensor:
    """The trunk's rotation R_world_box, the chordal mean of the spine joints' global rotations.

    Args:
        R_world_joint: (..., J, 3, 3), joints in SMAL's order (0-6 are the spine).

    Returns:
        (..., 3, 3), the rotation nearest to their arithmetic mean.

    Raises:
        ShapeError: there are fewer joints than the spine has.

    Example:
        >>> trunk_rotation(torch.eye(3).expand(35, 3, 3)).tolist()
        [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    """
    check_shape("R_world_joint", R_world_joint, "... J 3 3")
    if R_world_joint.shape[-3] < len(SPINE_JOINTS):
        raise ShapeError(
            f"R_world_joint must have at least the {len(SPINE_JOINTS)} spine joints, got shape"
            f" {tuple(R_world_joint.shape)}"
        )
    return nearest_rotation(R_world_joint[..., list(SPINE_JOINTS), :, :].mean(dim=-3))
