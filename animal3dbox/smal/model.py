"""A SMAL-family body: template, shape columns, skeleton and skin, and its posing by linear blend skinning."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import torch
from torch import Tensor

from animal3dbox.errors import ShapeError
from animal3dbox.geometry.checks import check_shape
from animal3dbox.geometry.rigid import nearest_rotation, rotation_from_axis_angle

SPINE_JOINTS = tuple(range(7))  # pelvis to the last vertebra before the neck, in every SMAL topology
_TAIL_PREFIX = "Tail"
_TORSO_WEIGHT = 0.9
_TAIL_WEIGHT = 0.5


@dataclass(frozen=True)
class PosedBody:
    """Bodies in some pose, in world.

    Attributes:
        vertices: (B, V, 3).
        joints: (B, J, 3).
        R_world_joint: (B, J, 3, 3) the global rotation of each joint; the identity in the template pose.
    """

    vertices: Tensor
    joints: Tensor
    R_world_joint: Tensor


@dataclass(frozen=True, eq=False)
class SmalModel:
    """A body of SMAL's structure, with any numbers of vertices, joints and shape columns.

    The template frame is x forward, y to the animal's left, z up; all lengths are in the template's own units.

    Attributes:
        v_template: (V, 3).
        faces: (F, 3) int64, counter-clockwise seen from outside.
        shapedirs: (V, 3, S) displacement per unit of each beta.
        posedirs: (V, 3, 9 * (J - 1)) displacement per entry of R - I of the joints after the root, row by row.
        J_regressor: (J, V), joints of a shaped template.
        weights: (V, J) skinning weights, rows summing to 1.
        parents: J of them, each before its children; the root's is -1 and the root is joint 0.
        joint_names: J of them.
        landmarks: keypoint name -> vertex ids, whose mean is the keypoint; the order is that of `keypoints`.
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
            raise ShapeError(f"joint_names must name {j} joints as parents does, got {len(self.joint_names)}")
        if self.parents[0] != -1 or any(not 0 <= p < i for i, p in enumerate(self.parents) if i > 0):
            raise ShapeError(f"parents must be -1 and then an earlier joint for each joint, got {self.parents}")
        for name, ids in {**self.landmarks, **self.extra_landmarks}.items():
            if not ids or min(ids) < 0 or max(ids) >= v:
                raise ShapeError(f"landmarks[{name!r}] must hold vertex ids in 0..{v - 1}, got {ids}")

    @property
    def landmark_groups(self) -> dict[str, Sequence[int] | Tensor]:
        """Every place that a keypoint can be read off: landmarks, the extra ones too, as vertex ids; "joint:NAME" as weights (V,)."""
        joints = {f"joint:{name}": weights for name, weights in zip(self.joint_names, self.J_regressor, strict=True)}
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
        changed: dict[str, Any] = {name: getattr(self, name).to(device=device, dtype=dtype) for name in arrays}
        symmetry = None if self.symmetry is None else self.symmetry.to(device=device)
        return replace(self, **changed, faces=self.faces.to(device=device), symmetry=symmetry)

    def shaped(self, betas: Tensor) -> Tensor:
        """The template with a shape: betas (B, at most S; the rest are 0) -> vertices (B, V, 3)."""
        check_shape("betas", betas, "B S")
        if betas.shape[1] > self.beta_count:
            raise ShapeError(f"betas must have at most {self.beta_count} columns, got {tuple(betas.shape)}")
        return self.v_template + torch.einsum("vcs,bs->bvc", self.shapedirs[:, :, : betas.shape[1]], betas)

    def posed(self, betas: Tensor, pose: Tensor, trans: Tensor) -> PosedBody:
        """Bodies by linear blend skinning; differentiable in all three arguments.

        Args:
            betas: (B, at most S); the rest are 0.
            pose: (B, J, 3) axis-angle in radians, root first.
            trans: (B, 3) added at the end, in the template's units.

        Returns:
            The bodies, in the frame in which trans is given.
        """
        check_shape("betas", betas, "B S")
        batch = betas.shape[0]
        check_shape("pose", pose, f"{batch} {self.joint_count} 3")
        check_shape("trans", trans, f"{batch} 3")
        v_shaped = self.shaped(betas)
        joints_rest = torch.einsum("jv,bvc->bjc", self.J_regressor, v_shaped)
        rotations = rotation_from_axis_angle(pose)
        identity = torch.eye(3, dtype=pose.dtype, device=pose.device)
        feature = (rotations[:, 1:] - identity).flatten(1)
        v_posed = v_shaped + torch.einsum("vcp,bp->bvc", self.posedirs, feature)
        R_world_joint, joints = self._along_the_tree(rotations, joints_rest)
        offsets = joints - torch.einsum("bjmn,bjn->bjm", R_world_joint, joints_rest)
        R_world_vertex = torch.einsum("vj,bjmn->bvmn", self.weights, R_world_joint)
        vertices = torch.einsum("bvmn,bvn->bvm", R_world_vertex, v_posed) + torch.einsum("vj,bjm->bvm", self.weights, offsets)
        return PosedBody(vertices + trans[:, None], joints + trans[:, None], R_world_joint)

    def _along_the_tree(self, rotations: Tensor, joints_rest: Tensor) -> tuple[Tensor, Tensor]:
        """Compose local rotations (B, J, 3, 3) about rest joints (B, J, 3) from the root outwards."""
        R_chain, joints = [rotations[:, 0]], [joints_rest[:, 0]]
        for j, parent in enumerate(self.parents[1:], start=1):
            bone = joints_rest[:, j] - joints_rest[:, parent]
            joints.append(joints[parent] + (R_chain[parent] @ bone[:, :, None])[:, :, 0])
            R_chain.append(R_chain[parent] @ rotations[:, j])
        return torch.stack(R_chain, dim=1), torch.stack(joints, dim=1)

    def keypoints(self, vertices: Tensor) -> Tensor:
        """Means of the landmarks' vertices: (..., V, 3) -> (..., number of landmarks, 3), in the order of `landmarks`."""
        check_shape("vertices", vertices, f"... {self.vertex_count} 3")
        return torch.stack([vertices[..., list(ids), :].mean(dim=-2) for ids in self.landmarks.values()], dim=-2)

    @cached_property
    def torso_vertices(self) -> Tensor:
        """Ids (T,) of the vertices that the spine alone moves: summed weight on joints 0-6 above 0.9."""
        return torch.nonzero(self.weights[:, list(SPINE_JOINTS)].sum(dim=1) > _TORSO_WEIGHT)[:, 0]

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
        raise ShapeError(f"R_world_joint must have at least the {len(SPINE_JOINTS)} spine joints, got shape {tuple(R_world_joint.shape)}")
    return nearest_rotation(R_world_joint[..., list(SPINE_JOINTS), :, :].mean(dim=-3))
