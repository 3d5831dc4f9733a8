"""Linear blend skinning as SMPL and SMAL define it.

This is the definition. Tensors with derivatives, or on another device, are posed by it; the faster
way of a loader's worker (array_skinning.py) is held equal to it by a test.

Source: Loper et al., SMPL: A Skinned Multi-Person Linear Model (2015), section 3; Zuffi et al.,
3D Menagerie: Modeling the 3D Shape and Pose of Animals (2017), section 3.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from animal3dbox.geometry.rigid_transforms import rigid, rotation_from_axis_angle


@dataclass(frozen=True)
class PosedBody:
    """Bodies in some pose, in world.

    Attributes:
        vertices: (B, V, 3).
        joints: (B, J, 3).
        R_world_joint: (B, J, 3, 3) the global rotation of each joint; the identity in the template
            pose.

    Example:
        >>> from animal3dbox.smal import SmalParameters, load_quadruped, posed_body
        >>> as_the_template = SmalParameters(torch.zeros(105), torch.zeros(1), torch.zeros(3))
        >>> posed_body(load_quadruped(), as_the_template).joints.shape
        torch.Size([1, 35, 3])
    """

    vertices: Tensor
    joints: Tensor
    R_world_joint: Tensor


def linear_blend_skinning(
    betas: Tensor,
    pose: Tensor,
    trans: Tensor,
    *,
    v_template: Tensor,
    shapedirs: Tensor,
    posedirs: Tensor,
    J_regressor: Tensor,
    weights: Tensor,
    parents: Sequence[int],
) -> PosedBody:
    """Pose bodies of SMAL's structure; differentiable in all tensors.

    Args:
        betas: (B, at most S); the rest are 0.
        pose: (B, J, 3) axis-angle in radians, root first.
        trans: (B, 3) added at the end.
        v_template: (V, 3).
        shapedirs: (V, 3, S).
        posedirs: (V, 3, 9 (J - 1)).
        J_regressor: (J, V).
        weights: (V, J), rows summing to 1.
        parents: J of them, each before its children; the root's is -1.

    Returns:
        The bodies, in the type of v_template.

    Example:
        >>> one_vertex, one_joint = torch.tensor([[1.0, 0.0, 0.0]]), torch.ones(1, 1)
        >>> body = linear_blend_skinning(
        ...     torch.tensor([[2.0]]), torch.zeros(1, 1, 3), torch.tensor([[0.0, 0.0, 5.0]]),
        ...     v_template=one_vertex, shapedirs=one_vertex[..., None],
        ...     posedirs=torch.zeros(1, 3, 0), J_regressor=one_joint, weights=one_joint,
        ...     parents=(-1,),
        ... )
        >>> body.vertices.tolist()
        [[[3.0, 0.0, 5.0]]]
    """
    betas, pose, trans = (values.to(v_template) for values in (betas, pose, trans))
    # Shape blend: v_shaped = template + sum_s beta_s shapedirs_s
    v_shaped = v_template + torch.einsum("vcs,bs->bvc", shapedirs[..., : betas.shape[1]], betas)
    # Joints of the shaped body in the template pose
    joints_rest = J_regressor @ v_shaped
    # Pose blend: v_posed = v_shaped + sum_p (R - I)_p posedirs_p, of all joints but the root
    rotations = rotation_from_axis_angle(pose)
    bends = (rotations[:, 1:] - torch.eye(3).to(rotations)).reshape(len(pose), posedirs.shape[2])
    v_posed = v_shaped + torch.einsum("vcp,bp->bvc", posedirs, bends)
    # Kinematic chain: R_j and the joint's place in world
    T_world_joint = _kinematic_chain(rotations, joints_rest, parents)
    R_world_joint, joints = T_world_joint[..., :3, :3], T_world_joint[..., :3, 3]
    # Skinning: v = R v_posed + t, with R and t the weighted means of R_j and joint_j - R_j rest_j
    offsets = joints - (R_world_joint @ joints_rest[..., None])[..., 0]
    R = (weights @ R_world_joint.flatten(2)).reshape(len(pose), len(weights), 3, 3)
    vertices = (R @ v_posed[..., None])[..., 0] + weights @ offsets
    return PosedBody(vertices + trans[:, None], joints + trans[:, None], R_world_joint)


def _kinematic_chain(rotations: Tensor, joints_rest: Tensor, parents: Sequence[int]) -> Tensor:
    """The rigid transforms T_world_joint (B, J, 4, 4), from the root outwards.

    Args:
        rotations: (B, J, 3, 3) of each joint against its parent.
        joints_rest: (B, J, 3) their places in the template pose.
        parents: J of them.

    """
    bones = [joints_rest[:, :1], joints_rest[:, 1:] - joints_rest[:, list(parents[1:])]]
    root, *others = rigid(rotations, torch.cat(bones, dim=1)).unbind(dim=1)
    chain = [root]
    for parent, T_parent_joint in zip(parents[1:], others, strict=True):
        chain.append(chain[parent] @ T_parent_joint)
    return torch.stack(chain, dim=1)
