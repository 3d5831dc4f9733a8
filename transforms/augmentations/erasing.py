"""Random erasing that says what it hid."""

import math
from typing import Any

import numpy as np

from animal3dbox.errors import ConfigError
from animal3dbox.geometry.arrays import like, namespace
from animal3dbox.geometry.box_visibility import projected_faces, visible_faces
from animal3dbox.geometry.polygon import area_in_box, area_in_frame
from animal3dbox.transforms.augmentations.noise import SEEDS
from animal3dbox.transforms.camera_law.fields import Fields
from animal3dbox.transforms.camera_law.law import corners_of
from animal3dbox.transforms.randomness import check_range
from animal3dbox.transforms.steps import Erase, Step
from animal3dbox.transforms.transform import Transform
from animal3dbox.transforms.view import View


class RandomErasing(Transform):
    """Paint a rectangle over, and mark what it hides.

    Masks lose its pixels, depth becomes unknown (0), keypoints below it get visibility 0, and
    occlusion (N,) grows: the part of the animal (its mask, else its cuboid's silhouette in the
    picture) that is hidden. The cuboid, its faces and its 2D box stay.

    Args:
        p: probability.
        scale: range of the rectangle's area over the picture's.
        ratio: range of its aspect, width over height.
        value: colour in [0, 1], one or one a channel; "random" for noise.

    """

    def __init__(
        self,
        p: float = 0.5,
        scale: tuple[float, float] = (0.02, 0.2),
        ratio: tuple[float, float] = (0.3, 3.3),
        value: float | tuple[float, ...] | str = 0.0,
    ) -> None:
        super().__init__(p)
        self.scale = check_range("scale", scale, about=None, least=0)
        self.ratio = check_range("ratio", ratio, about=None, least=1e-3)
        if self.scale[1] > 1:
            raise ConfigError(f"scale must lie in [0, 1], got {scale!r}")
        if isinstance(value, str) and value != "random":
            raise ConfigError(f"value must be colours in [0, 1] or 'random', got {value!r}")
        self.value = value

    def steps(self, rng: np.random.Generator, view: View) -> tuple[Step, ...]:
        """The rectangle."""
        height, width = view.image_hw
        area = rng.uniform(*self.scale) * height * width
        aspect = math.exp(rng.uniform(math.log(self.ratio[0]), math.log(self.ratio[1])))
        wide, high = (
            min(width, round(math.sqrt(area * aspect))),
            min(height, round(math.sqrt(area / aspect))),
        )
        left, top, seed = (
            int(rng.integers(width - wide + 1)),
            int(rng.integers(height - high + 1)),
            int(rng.integers(SEEDS)),
        )
        if wide == 0 or high == 0:
            return ()
        value = (
            None
            if isinstance(self.value, str)
            else self.value
            if isinstance(self.value, tuple)
            else (float(self.value),)
        )
        return (Erase(((left, top, left + wide, top + high),), value, seed),)


def hide_fields(fields: Fields, erase: Erase, image_hw: tuple[int, int]) -> Fields:
    """The target after rectangles were painted over the picture."""
    out = fields
    for box in erase.boxes:
        hidden = _hidden_part(out, box, image_hw)
        values: dict[str, Any] = {}
        if hidden is not None:
            values["occlusion"] = 1 - (1 - out.values.get("occlusion", 0 * hidden)) * (1 - hidden)
        x_least, y_least, x_past, y_past = box
        for name in ("masks", "depth"):
            if name in out.values:
                values[name] = out.values[name] + 0  # a copy
                values[name][..., y_least:y_past, x_least:x_past] = 0
        if "keypoints" in out.values:
            keypoints = out.values["keypoints"]
            low, high = (
                like(keypoints, [x_least - 0.5, y_least - 0.5]),
                like(keypoints, [x_past - 0.5, y_past - 0.5]),
            )
            below = ((keypoints[..., :2] >= low) & (keypoints[..., :2] <= high)).all(-1)
            values["keypoints"] = namespace(keypoints).concatenate(
                (keypoints[..., :2], (keypoints[..., 2] * ~below)[..., None]), -1
            )
        out = out.updated(**values)
    return out


def _hidden_part(fields: Fields, box: tuple[int, int, int, int], image_hw: tuple[int, int]) -> Any:
    """The part (N,) of what was still visible of each animal that a rectangle hides.

    None if nothing tells.
    """
    x_least, y_least, x_past, y_past = box
    if "masks" in fields.values:
        masks = fields.values["masks"] > 0
        whole = masks.sum((-2, -1))
        return masks[:, y_least:y_past, x_least:x_past].sum((-2, -1)) / (whole + (whole == 0))
    corners = corners_of(fields.values) if "K" in fields.values else None
    if corners is None:
        return None
    hidden = ~visible_faces(corners, corners[:, 0] * 0)
    quads = projected_faces(corners, fields.values["K"], fields.values.get("distortion"))
    whole = (area_in_frame(quads, image_hw) * hidden).sum(-1)
    covered = (
        area_in_box(quads, like(quads, [x_least - 0.5, y_least - 0.5, x_past - 0.5, y_past - 0.5]))
        * hidden
    ).sum(-1)
    return covered / (whole + (whole == 0))
