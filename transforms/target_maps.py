"""The law on a whole target, for pixels that another library has moved, and the way back."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from torch import Tensor

from animal3dbox.errors import SampleError
from animal3dbox.geometry.arrays import as_numpy
from animal3dbox.geometry.homography import oriented_homography
from animal3dbox.transforms.camera_law.consistency import check_consistent
from animal3dbox.transforms.camera_law.fields import Fields
from animal3dbox.transforms.camera_law.law import map_fields
from animal3dbox.transforms.camera_law.target_dict import read_target, write_target
from animal3dbox.transforms.rendering.pixel_fields import mapped_with_pixels


def transform_target(
    target: Mapping[str, Any],
    H_out_in: Tensor | np.ndarray,
    image_hw_in: tuple[int, int],
    image_hw_out: tuple[int, int],
    *,
    keypoint_mirror: Sequence[int] | None = None,
    allow_skew: bool = False,
) -> dict[str, Any]:
    """The target of a picture whose pixels were mapped by H, by whatever library.

    Args:
        target: see Compose.
        H_out_in: (3, 3), px_out ~ H_out_in px_in; pixel centres sit at whole numbers. Of H and -H
            the one with w > 0 in the middle of the picture before is taken.
        image_hw_in: height and width before.
        image_hw_out: height and width after.
        keypoint_mirror: (J,) each keypoint's counterpart on the other side, if the target does not
            hold its own.
        allow_skew: let K'[0, 1] become non-zero.

    Returns:
        The target after, every field in the form in which it came; masks and depth are read at the
        nearest pixel.

    Raises:
        SampleError: naming the field that is wrong or cannot follow.

    Example:
        >>> H = np.array([[-1.0, 0, 79], [0, 1, 0], [0, 0, 1]])  # somebody mirrored 80 columns
        >>> target = {"boxes": np.array([[10.0, 5, 30, 25]])}
        >>> transform_target(target, H, (60, 80), (60, 80))["boxes"].tolist()
        [[49.0, 5.0, 69.0, 25.0]]
    """
    fields = read_target(target, image_hw_in)
    check_consistent(fields)
    H = oriented_homography(
        checked_map(H_out_in, fields),
        np.array([(image_hw_in[1] - 1) / 2, (image_hw_in[0] - 1) / 2]),
    )
    permutation = None if keypoint_mirror is None else np.array(list(keypoint_mirror))
    return write_target(
        mapped_with_pixels(
            fields, H, image_hw_out, keypoint_mirror=permutation, allow_skew=allow_skew
        )
    )


def inverse(
    predicted: Mapping[str, Any],
    H_out_in: Tensor | np.ndarray,
    image_hw: tuple[int, int],
    *,
    keypoint_mirror: Sequence[int] | None = None,
) -> dict[str, Any]:
    """Predictions for an augmented picture as predictions for the original one.

    Args:
        predicted: fields of a target, in the augmented camera's frame and pixels, with the
            augmented K (which cuboids need); no masks or depth.
        H_out_in: (3, 3) the augmented target's H_out_in.
        image_hw: height and width of the original.
        keypoint_mirror: (J,) each keypoint's counterpart, if the picture was mirrored and keypoints
            are predicted.

    Returns:
        The same fields under the original camera, whose K they get.

    Raises:
        SampleError: a field is wrong, see Compose; masks and depth cannot be read backwards without
            loss.

    Example:
        >>> H = np.array([[0.5, 0, -0.25], [0, 0.5, -0.25], [0, 0, 1]])  # the picture was halved
        >>> inverse({"boxes": np.array([[5.0, 5, 10, 10]])}, H, image_hw=(60, 80))
        {'boxes': array([[10.5, 10.5, 20.5, 20.5]])}
    """
    fields = read_target(
        {
            name: value
            for name, value in predicted.items()
            if name not in ("H_out_in", "mirrored", "masks", "depth")
        },
        image_hw,
    )
    for name in ("masks", "depth"):
        if name in predicted:
            raise SampleError(
                fields.sample_id,
                name,
                "cannot go back without loss: warp it yourself by the inverse of H_out_in",
            )
    H = checked_map(H_out_in, fields)
    permutation = None if keypoint_mirror is None else np.array(list(keypoint_mirror))
    back = write_target(
        map_fields(fields, np.linalg.inv(H), image_hw, keypoint_mirror=permutation, allow_skew=True)
    )
    return {name: value for name, value in back.items() if name not in ("H_out_in", "mirrored")}


def checked_map(H_out_in: Tensor | np.ndarray, fields: Fields) -> np.ndarray:
    """The map as a float64 array, or a SampleError if it is none that can be inverted."""
    H = np.asarray(as_numpy(H_out_in))
    if H.shape != (3, 3) or not np.isfinite(H).all():
        raise SampleError(
            fields.sample_id,
            "H_out_in",
            f"must be (3, 3) and finite, got shape {H.shape}: {H.tolist()}",
        )
    H = H.astype(np.float64)
    rows = np.sqrt((H * H).sum(axis=1)).prod()
    if abs(np.linalg.det(H)) <= 1e-14 * rows:
        raise SampleError(
            fields.sample_id,
            "H_out_in",
            "must be invertible, but its determinant is zero: it flattens the image",
        )
    return H
