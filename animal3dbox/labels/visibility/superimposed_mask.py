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

    """
    return silhouette(transform_points(rigid(*pose), vertices), faces, K, image_hw)
