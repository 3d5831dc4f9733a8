"""The mask of a mesh laid over its image."""

from torch import Tensor

from animal3dbox.geometry.rasterizer import silhouette
from animal3dbox.geometry.rigid_transforms import rigid, transform_points


def superimposed_mask(
    vertices: Tensor,
    faces: Tensor,
    *,
    K: Tensor,
    pose: tuple[Tensor, Tensor],
    image_hw: tuple[int, int],
) -> Tensor:
    """The mask (H, W) bool of a mesh over its image (section 2.2.2, superimposition).

    By the dataset's own camera. Never use a pose that is being estimated: such a mask agrees with
    any pose.

    Args:
        vertices: (V, 3) in the mesh's frame.
        faces: (F, 3).
        K: (3, 3) in px.
        pose: (R, t), X_cam = R X + t.
        image_hw: height and width.

    Example:
        >>> import torch
        >>> from animal3dbox.labels import superimposed_mask
        >>> triangle = torch.tensor([[0.0, 0, 0], [4, 0, 0], [0, 4, 0]])
        >>> K = torch.tensor([[1.0, 0, 0], [0, 1, 0], [0, 0, 1]])
        >>> pose = torch.eye(3), torch.tensor([0.0, 0, 1])
        >>> faces = torch.tensor([[0, 1, 2]])
        >>> superimposed_mask(triangle, faces, K=K, pose=pose, image_hw=(3, 5)).int()
        tensor([[1, 1, 1, 1, 0],
                [1, 1, 1, 0, 0],
                [1, 1, 0, 0, 0]], dtype=torch.int32)
    """
    return silhouette(transform_points(rigid(*pose), vertices), faces, K, image_hw)
