"""From the augmented picture back to the one that came in."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from torch import Tensor

from animal3dbox.errors import ConfigError
from animal3dbox.transforms.fields import read_target, write_target
from animal3dbox.transforms.law import map_fields


def inverse(
    predicted: Mapping[str, Any],
    H_out_in: Tensor | np.ndarray,
    image_hw: tuple[int, int],
    *,
    keypoint_mirror: Sequence[int] | None = None,
) -> dict[str, Any]:
    """Predictions for an augmented picture as predictions for the original one.

    Args:
        predicted: fields of a target, in the augmented camera's frame and pixels, with the augmented K (which cuboids need); no
            masks or depth.
        H_out_in: (3, 3) the augmented target's H_out_in.
        image_hw: height and width of the original.
        keypoint_mirror: (J,) each keypoint's counterpart, if the picture was mirrored and keypoints are predicted.

    Returns:
        The same fields under the original camera, whose K they get.

    Raises:
        SampleError: a field is wrong, see Compose.
        ConfigError: there are masks or depth, which cannot be read backwards without loss.

    """
    pixel_fields = [name for name in ("masks", "depth") if name in predicted]
    if pixel_fields:
        raise ConfigError(f"inverse takes no {pixel_fields[0]}: warp them yourself with the inverse of H_out_in")
    H = (H_out_in.detach().cpu().numpy() if isinstance(H_out_in, Tensor) else H_out_in).astype(np.float64)
    fields = read_target({name: value for name, value in predicted.items() if name not in ("H_out_in", "mirrored")}, image_hw)
    permutation = None if keypoint_mirror is None else np.array(list(keypoint_mirror))
    # The sign that makes w > 0 in the augmented picture is that of the original's middle.
    x, y, w = H @ np.array([(image_hw[1] - 1) / 2, (image_hw[0] - 1) / 2, 1.0])
    about_hw = (round(2 * y / w + 1), round(2 * x / w + 1))
    back = write_target(map_fields(fields, np.linalg.inv(H), about_hw, image_hw, keypoint_mirror=permutation, allow_skew=True))
    return {name: value for name, value in back.items() if name not in ("H_out_in", "mirrored")}
