"""The door of all pipelines: other libraries' pixel origin, tensor classes and grey levels.

Inside, pixel centres lie at whole numbers and a picture covers [-0.5, W - 0.5]. torchvision and
albumentations put whole numbers on the edges between pixels: their picture covers [0, W], and every
coordinate is larger by half a pixel. Values are moved where they come in and where they leave.
"""

from collections.abc import Mapping, Sequence
from typing import Any, Literal

import torch
from torch import Tensor

from animal3dbox.errors import SampleError
from animal3dbox.geometry.arrays import as_numpy, like
from animal3dbox.transforms.camera_law.fields import Declared, Fields
from animal3dbox.transforms.camera_law.target_dict import read_target, write_target
from animal3dbox.transforms.rendering.images import Image
from animal3dbox.transforms.steps import Colour, KorniaPixels, Noise, Standardise, Step

PixelOrigin = Literal["center", "edge"]
PIXEL_ORIGINS = ("center", "edge")
HALF = 0.5
"""From one origin to the other, px."""
FAR_SIDE_PX = 1e-4
"""By how much a box's far side may miss W or H to be taken for it."""
OVERSHOOT = 1e-3
"""By how much a float colour may leave 0 to 1, as interpolation and rounding make it."""
POINTS = ("boxes", "corners_2d")
"""Fields of pixel coordinates alone."""


def open_target(
    target: Mapping[str, Any], image_hw: tuple[int, int], declared: Declared, origin: PixelOrigin
) -> Fields:
    """A target opened and checked, its pixel coordinates counted from pixel centres.

    Raises:
        SampleError: see read_target; or a box ends before it begins; or a box's far side lies at
            exactly W or H and none farther out though pixels are counted from centres, as in a
            target that counts from edges.
    """
    _check_box_format(target)
    fields = read_target(target, image_hw, declared)
    _check_box_order(fields)
    if origin == "edge":
        return _moved(fields, -HALF)
    _check_far_sides(fields, image_hw)
    return fields


def close_target(
    fields: Fields,
    target: Mapping[str, Any],
    *,
    image_hw: tuple[int, int],
    origin: PixelOrigin,
) -> dict[str, Any]:
    """The target as a plain dict, in the pixel origin and the tensor classes in which it came.

    Args:
        fields: after the transforms.
        target: as it came.
        image_hw: of the image after the transforms.
        origin: of the target.
    """
    written = write_target(_moved(fields, HALF) if origin == "edge" else fields)
    return {
        name: as_subclass(value, target[name], image_hw) if name in target else value
        for name, value in written.items()
    }


def _moved(fields: Fields, by: float) -> Fields:
    """The fields with all pixel coordinates moved: x' = x + by, K' = S K, H' = S H S^-1."""
    values = fields.values
    moved = {name: values[name] + by for name in POINTS if name in values}
    if "keypoints" in values:
        moved["keypoints"] = values["keypoints"] + like(values["keypoints"], [by, by, 0.0])
    shift = [[1.0, 0, by], [0, 1, by], [0, 0, 1]]
    back = [[1.0, 0, -by], [0, 1, -by], [0, 0, 1]]
    if "K" in values:
        moved["K"] = like(values["K"], shift) @ values["K"]
    if "H_out_in" in values:
        H = values["H_out_in"]
        moved["H_out_in"] = like(H, shift) @ H @ like(H, back)
    return fields.updated(**moved)


def _check_box_order(fields: Fields) -> None:
    """Raise a SampleError if a box ends before it begins, as one given as x, y, w, h may.

    Its corners would be put in order by the next map, as those of a box that nobody marked. An
    empty box, whose sides meet, is one.
    """
    boxes = fields.values.get("boxes")
    if boxes is None or boxes.shape[0] == 0:
        return
    turned = as_numpy((boxes[:, 2:] < boxes[:, :2]).any(-1))
    if turned.any():
        worst = int(turned.argmax())
        raise SampleError(
            fields.sample_id,
            "boxes",
            f"must be xyxy with x1 <= x2 and y1 <= y2, but animal {worst}'s is"
            f" {[round(float(side), 3) for side in boxes[worst]]}: if it is x, y, width, height,"
            " convert it to x, y, x + width, y + height",
        )


def _check_far_sides(fields: Fields, image_hw: tuple[int, int]) -> None:
    """Raise a SampleError if boxes end at exactly W or H, and none of them farther out."""
    boxes = fields.values.get("boxes")
    if boxes is None or boxes.shape[0] == 0:
        return
    right, bottom = boxes[:, 2].max(), boxes[:, 3].max()
    for far, length, name in ((right, image_hw[1], "W"), (bottom, image_hw[0], "H")):
        if abs(float(far) - length) <= FAR_SIDE_PX:
            raise SampleError(
                fields.sample_id,
                "boxes",
                f"end at exactly {name} = {length}, so the picture's edge is counted as 0 to"
                f" {name}; here pixel centres lie at whole numbers and it ends at {name} - 0.5: use"
                ' Compose([...], pixel_origin="edge"), or take 0.5 off all pixel coordinates and K',
            )


def as_subclass(value: Any, original: Any, image_hw: tuple[int, int] | None = None) -> Any:
    """A tensor as what the original was: torchvision's Image, BoundingBoxes and the like.

    What the original's attributes say goes with it, but for the size of its picture.
    """
    kind = type(original)
    if not isinstance(value, Tensor) or not isinstance(original, Tensor):
        return value
    if kind in (Tensor, torch.nn.Parameter) or isinstance(value, kind):
        return value
    dressed = value.as_subclass(kind)
    dressed.__dict__.update(original.__dict__)
    if image_hw is not None and hasattr(dressed, "canvas_size"):
        dressed.canvas_size = image_hw
    return dressed


def check_colours(image: Image, steps: Sequence[Step], sample_id: str | None) -> None:
    """Raise a SampleError if colours are to be changed that are floats outside 0 to 1.

    Maps of pixels take floats of any range, such as those of a normalised image. Operations of
    kornia's are clipped to 0 to 1 (see KorniaTransform), which would turn other pictures white.
    """
    changing = [
        step for step in steps if isinstance(step, Colour | Standardise | Noise | KorniaPixels)
    ]
    if not changing or str(image.dtype).endswith("uint8"):
        return
    levels = image.detach() if isinstance(image, Tensor) else image
    low, high = float(levels.min()), float(levels.max())
    if low >= -OVERSHOOT and high <= 1 + OVERSHOOT:
        return
    first = changing[0]
    name = repr(first.op) if isinstance(first, KorniaPixels) else type(first).__name__
    raise SampleError(
        sample_id,
        "image",
        f"holds floats from {low:.4g} to {high:.4g}, but operations on colours"
        f" ({name}) need 0 to 1: divide by 255, or change colours before"
        " normalising",
    )


def _check_box_format(target: Mapping[str, Any]) -> None:
    """Raise a SampleError if torchvision's boxes are in another form than x1, y1, x2, y2."""
    form = getattr(target.get("boxes"), "format", None)
    if form is not None and str(getattr(form, "value", form)).upper() != "XYXY":
        raise SampleError(
            str(target["image_id"]) if "image_id" in target else None,
            "boxes",
            f"have the format {getattr(form, 'value', form)}; convert them to XYXY first",
        )
