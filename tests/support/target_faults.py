"""65 kinds of mistakes in a batch of targets, each planted into one target of the batch.

The kinds are those that users of 3D boxes make: a field that a transform forgot, another library's
form or frame, another animal's or picture's values. A plant changes the batch's target in place and
says whether there was anything to spoil (two animals to exchange, a mask).
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import torch
from torch import Tensor

from animal3dbox.geometry.camera import project
from animal3dbox.geometry.cuboid import MIRRORED_CORNERS, MIRRORED_FACES, corners_of

BARE = ("K", "center", "rotation", "size", "corners_3d", "boxes", "labels", "image_id")
"""The fields of somebody else's cuboids."""
CLASSES = 16
FACE_FIELDS = (
    "face_visible",
    "face_area",
    "face_share",
    "face_share_in_image",
    "surface_share",
)
HALF_TURN, UPSIDE_DOWN = [1, 0, 3, 2, 4, 5], [0, 1, 3, 2, 5, 4]
CARTESIAN, OMNI3D = [0, 4, 3, 7, 1, 5, 2, 6], [4, 5, 1, 0, 7, 6, 2, 3]


@dataclass
class Batch:
    """Targets, the sizes of their images, and which of them is to be spoiled.

    Attributes:
        targets: of the batch; the spoiled one is a copy.
        sizes: (height, width) of each image.
        number: the target that is spoiled.
        rng: which draws a neighbour, or noise.
    """

    targets: list[dict[str, Any]]
    sizes: list[tuple[int, int]]
    number: int
    rng: np.random.Generator = field(default_factory=np.random.default_rng)

    @property
    def target(self) -> dict[str, Any]:
        """The target that is spoiled."""
        return self.targets[self.number]

    @property
    def neighbour(self) -> dict[str, Any]:
        """The next target of the batch."""
        return self.targets[(self.number + 1) % len(self.targets)]

    @property
    def hw(self) -> tuple[int, int]:
        """The size of the spoiled target's image."""
        return self.sizes[self.number]


Plant = Callable[[Batch], bool]


def setting(name: str, change: Callable[[Tensor, Batch], Tensor]) -> Plant:
    """Change one field of the target; nothing where it is not there, or stays as it was."""

    def plant(batch: Batch) -> bool:
        old = batch.target.get(name)
        if old is None or len(old) == 0:
            return False
        batch.target[name] = new = change(old.clone(), batch)
        return new.shape != old.shape or not torch.equal(new, old)

    return plant


def rebuilt(target: dict[str, Any]) -> bool:
    """Make corners, their projection and the distance from center, rotation, size and K."""
    corners = corners_of(
        target["center"].double(), target["rotation"].double(), target["size"].double()
    )
    target["corners_3d"] = corners.float()
    if "corners_2d" in target:
        target["corners_2d"] = project(target["K"].double(), corners)[0].float()
    if "distance" in target:
        target["distance"] = target["center"].norm(dim=-1)
    return True


def and_rebuilt(*plants: Plant) -> Plant:
    """Plant all, then make what follows from the cuboid anew."""
    return lambda batch: all(plant(batch) for plant in plants) and rebuilt(batch.target)


def scaled_K(batch: Batch, x: float, y: float, dx: float = 0.0, dy: float = 0.0) -> bool:
    """Scale K's rows and move its principal point."""
    K = batch.target["K"].clone()
    K[0] *= x
    K[1] *= y
    K[0, 2] += dx
    K[1, 2] += dy
    batch.target["K"] = K
    return True


def exchanged_center(K: Tensor, batch: Batch) -> Tensor:
    K[0, 2], K[1, 2] = K[1, 2].item(), K[0, 2].item()
    return K


def mirrored_boxes(boxes: Tensor, batch: Batch) -> Tensor:
    x1, y1, x2, y2 = boxes.unbind(1)
    width = batch.hw[1]
    return torch.stack((width - 1 - x2, y1, width - 1 - x1, y2), 1)


def as_xywh(boxes: Tensor, batch: Batch) -> Tensor:
    return torch.cat((boxes[:, :2], boxes[:, 2:] - boxes[:, :2]), 1)


def as_cxcywh(boxes: Tensor, batch: Batch) -> Tensor:
    return torch.cat(((boxes[:, :2] + boxes[:, 2:]) / 2, boxes[:, 2:] - boxes[:, :2]), 1)


def normalised(boxes: Tensor, batch: Batch) -> Tensor:
    return (boxes + 0.5) / torch.tensor([batch.hw[1], batch.hw[0]] * 2)


def exchanged_animals(name: str) -> Plant:
    """Exchange a field of the first two animals."""

    def plant(batch: Batch) -> bool:
        values = batch.target.get(name)
        if values is None or len(values) < 2:
            return False
        batch.target[name] = values[[1, 0, *range(2, len(values))]]
        return True

    return plant


def of_neighbour(name: str) -> Plant:
    """Take a field of the next target, for as many animals as both have."""

    def plant(batch: Batch) -> bool:
        own, other = batch.target.get(name), batch.neighbour.get(name)
        if own is None or other is None:
            return False
        if name == "K":
            batch.target["K"] = other
            return not torch.equal(own, other)
        if len(own) == 0 or len(other) == 0:
            return False
        batch.target[name] = torch.cat((other[:1], own[1:]))
        return not torch.equal(own[0], other[0])

    return plant


def neighbours_target(batch: Batch) -> bool:
    batch.targets[batch.number] = dict(batch.neighbour)
    return batch.hw == batch.sizes[(batch.number + 1) % len(batch.targets)]


def only_pixels(batch: Batch) -> bool:
    """A mistake that leaves every field as it was."""
    return True


def eroded(masks: Tensor, batch: Batch) -> Tensor:
    """The tenth of each mask that lies farthest to the left."""
    out = torch.zeros_like(masks)
    for n, mask in enumerate(masks):
        rows, columns = mask.nonzero(as_tuple=True)
        few = columns.argsort()[: max(len(columns) // 10, 1)]
        out[n, rows[few], columns[few]] = 1
    return out


def keypoints(change: Callable[[Tensor, Batch], Tensor]) -> Plant:
    """Change keypoints, and take the marks from those that leave the frame."""

    def changed(values: Tensor, batch: Batch) -> Tensor:
        values = change(values, batch)
        height, width = batch.hw
        x, y, v = values.unbind(-1)
        inside = (x >= -0.5) & (y >= -0.5) & (x <= width - 0.5) & (y <= height - 0.5)
        return torch.stack((x, y, v * inside), -1)

    plain = setting("keypoints", changed)
    return lambda batch: (
        int((batch.target.get("keypoints", torch.zeros(1, 1, 3))[..., 2] > 0).sum(1).max()) >= 6
        and plain(batch)
    )


def names_exchanged(values: Tensor, batch: Batch) -> Tensor:
    counterparts: Tensor = batch.target["keypoint_mirror"]
    return values[:, counterparts]


def half_turn(batch: Batch, keep_faces: bool) -> bool:
    """Turn boxes head for tail, about their up axis."""
    target = batch.target
    target["rotation"] = target["rotation"] * torch.tensor([-1.0, -1, 1])
    if not keep_faces:
        if "face_share" not in target:
            return False
        renamed(target, HALF_TURN)
    return rebuilt(target)


def upside_down(batch: Batch) -> bool:
    target = batch.target
    if "face_share" not in target:
        return False
    target["rotation"] = target["rotation"] * torch.tensor([1.0, -1, -1])
    renamed(target, UPSIDE_DOWN)
    return rebuilt(target)


def renamed(target: dict[str, Any], order: list[int]) -> None:
    """Give faces other names in all that is said of them, and the flank with them."""
    for name in FACE_FIELDS:
        if name in target:
            target[name] = target[name][:, order]
    if "flank" in target:
        target["flank"] = torch.where(target["flank"] > 0, 3 - target["flank"], target["flank"])


def turned_by_ray(rotation: Tensor, batch: Batch) -> Tensor:
    """The rotation as if it were said about the ray to the box: allocentric for egocentric."""
    center = batch.target["center"]
    angle = torch.atan2(center[:, 0], center[:, 2])
    cos, sin, zero = angle.cos(), angle.sin(), torch.zeros_like(angle)
    turn = torch.stack((cos, zero, sin, zero, zero + 1, zero, -sin, zero, cos), 1)
    turned: Tensor = turn.reshape(-1, 3, 3) @ rotation
    return turned


def at_bottom(center: Tensor, batch: Batch) -> Tensor:
    up = batch.target["rotation"][:, :, 2]
    bottom: Tensor = center - up * batch.target["size"][:, 2:] / 2
    return bottom


def opengl(batch: Batch) -> bool:
    target, flip = batch.target, torch.tensor([1.0, -1, -1])
    target["center"] = target["center"] * flip
    target["rotation"] = flip[:, None] * target["rotation"]
    target["corners_3d"] = target["corners_3d"] * flip
    return True


def lengths_by(factor: float, first_only: bool) -> Plant:
    """Scale all lengths of a target, or of its first animal; pixels stay what they are."""

    def plant(batch: Batch) -> bool:
        target = batch.target
        count = len(target["center"])
        if count == 0:
            return False
        scale = torch.ones(count)
        scale[: 1 if first_only else count] = factor
        for name in ("center", "size", "corners_3d", "distance", "t"):
            if name in target:
                values = target[name]
                target[name] = values * scale.reshape(-1, *[1] * (values.ndim - 1))
        return True

    return plant


def farther(center: Tensor, batch: Batch) -> Tensor:
    center[:, 2] *= 1.2
    return center


def with_shares(change: Callable[[Tensor], Tensor]) -> Plant:
    return setting("face_share", lambda shares, _: change(shares))


def noisy_shares(shares: Tensor, batch: Batch) -> Tensor:
    noise = torch.from_numpy(batch.rng.normal(0, 0.03, shares.shape)).float()
    spoiled = (shares + noise * (shares > 0)).clamp(min=0)
    return spoiled / spoiled.sum(1, keepdim=True).clamp(min=1e-9)


def faces_exchanged(*names: str) -> Plant:
    def plant(batch: Batch) -> bool:
        if "face_visible" not in batch.target or not batch.target["face_visible"][:, 2:4].any():
            return False
        for name in names:
            if name in batch.target:
                batch.target[name] = batch.target[name][:, list(MIRRORED_FACES)]
        return True

    return plant


def twice(batch: Batch) -> bool:
    target = batch.target
    count = len(target["labels"])
    shared = ("K", "keypoint_mirror", "H_out_in")
    for name, values in target.items():
        if isinstance(values, Tensor) and name not in shared:
            target[name] = torch.cat((values, values[:1]))
    meta = target.get("meta")
    if meta is not None:
        per_animal = {
            name: [*values, values[0]]
            for name, values in meta.items()
            if isinstance(values, list) and len(values) == count
        }
        target["meta"] = {**meta, **per_animal}
    return count > 0


def behind(batch: Batch) -> bool:
    target = batch.target
    shift = target["center"] * torch.tensor([0.0, 0, 2])
    target["center"] = target["center"] - shift
    target["corners_3d"] = target["corners_3d"] - shift[:, None]
    return True


def image_of_size(change: Callable[[int, int], tuple[int, int]]) -> Plant:
    """Another size of the image, masks left behind."""

    def plant(batch: Batch) -> bool:
        batch.sizes[batch.number] = change(*batch.hw)
        return True

    return plant


def before_the_flip(batch: Batch) -> bool:
    target = batch.target
    if "R" not in target:
        return False
    target["R"] = torch.diag(torch.tensor([-1.0, 1, 1])) @ target["R"] * torch.tensor([1.0, -1, 1])
    return True


def long_dog(batch: Batch) -> bool:
    """An animal 30 m long; its box is consistent, and farther, so that its picture stays."""
    length = float(batch.target["size"][0, 0])
    return lengths_by(30.0 / length, first_only=True)(batch)


KINDS: dict[str, Plant] = {
    "K not rescaled after resize x0.5": lambda b: scaled_K(b, 2, 2),
    "cx stale after crop of 12 px": lambda b: scaled_K(b, 1, 1, dx=12),
    "cx, cy exchanged": setting("K", exchanged_center),
    "fy 5 % off": setting("K", lambda K, _: K * torch.tensor([[1.0] * 3, [1, 1.05, 1], [1.0] * 3])),
    "K as W - cx (1 px) after flip": lambda b: scaled_K(b, 1, 1, dx=1),
    "K half a pixel off": lambda b: scaled_K(b, 1, 1, dx=0.5, dy=0.5),
    "K transposed": setting("K", lambda K, _: K.T.contiguous()),
    "K of the neighbour": of_neighbour("K"),
    "boxes xywh": setting("boxes", as_xywh),
    "boxes cx, cy, w, h": setting("boxes", as_cxcywh),
    "boxes normalised to 0..1": setting("boxes", normalised),
    "boxes in the space before a resize x0.75": setting("boxes", lambda v, _: v / 0.75),
    "boxes mirrored, nothing else": setting("boxes", mirrored_boxes),
    "boxes of two animals exchanged": exchanged_animals("boxes"),
    "whole target of the neighbour": neighbours_target,
    "image mirrored, target not": only_pixels,
    "image and masks mirrored, target not": setting("masks", lambda v, _: v.flip(-1)),
    "masks of two animals exchanged": exchanged_animals("masks"),
    "mask inverted": setting("masks", lambda v, _: 1 - v),
    "mask eroded to a tenth": setting("masks", eroded),
    "keypoints mirrored, nothing else": keypoints(
        lambda v, b: v * torch.tensor([-1.0, 1, 1]) + torch.tensor([b.hw[1] - 1.0, 0, 0])
    ),
    "keypoints left/right names exchanged": keypoints(names_exchanged),
    "keypoints (y, x)": keypoints(lambda v, _: v[..., [1, 0, 2]]),
    "keypoints in half resolution": keypoints(lambda v, _: v * torch.tensor([0.5, 0.5, 1])),
    "keypoints of another animal": of_neighbour("keypoints"),
    "size as (w, h, l), the rest right": setting("size", lambda v, _: v[:, [1, 2, 0]]),
    "size as (w, h, l), all made from it": and_rebuilt(
        setting("size", lambda v, _: v[:, [1, 2, 0]])
    ),
    "size halved, all made from it": and_rebuilt(setting("size", lambda v, _: v / 2)),
    "rotation transposed, the rest right": setting("rotation", lambda v, _: v.mT.contiguous()),
    "rotation transposed, all made from it": and_rebuilt(
        setting("rotation", lambda v, _: v.mT.contiguous())
    ),
    "rotation with noise of 1e-3": setting(
        "rotation",
        lambda v, b: v + torch.from_numpy(b.rng.normal(0, 1e-3, v.shape)).float(),
    ),
    "rotation egocentric for allocentric, all made from it": and_rebuilt(
        setting("rotation", turned_by_ray)
    ),
    "centre as KITTI's bottom, the rest right": setting("center", at_bottom),
    "centre as KITTI's bottom, all made from it": and_rebuilt(setting("center", at_bottom)),
    "OpenGL camera in all 3D fields": opengl,
    "millimetres in corners_3d only": setting("corners_3d", lambda v, _: v * 1000),
    "millimetres in every length": lengths_by(1000.0, first_only=False),
    "one animal 10 times farther and larger": lengths_by(10.0, first_only=True),
    "depth 20 % too large, lateral kept, all made from it": and_rebuilt(setting("center", farther)),
    "head for tail, faces kept": lambda b: half_turn(b, keep_faces=True),
    "head for tail, faces too": lambda b: half_turn(b, keep_faces=False),
    "upside down, all fields": upside_down,
    "corners in Cartesian order": lambda b: reordered(b, CARTESIAN),
    "corners in Omni3D's order": lambda b: reordered(b, OMNI3D),
    "corners left/right mirrored": lambda b: reordered(b, list(MIRRORED_CORNERS)),
    "face_visible: left and right exchanged": faces_exchanged("face_visible"),
    "all face fields: left and right exchanged": faces_exchanged(*FACE_FIELDS),
    "face_share in percent": with_shares(lambda v: v * 100),
    "face_share 3 % of noise, renormalised": setting("face_share", noisy_shares),
    "truncation always 0": setting("truncation", lambda v, _: v * 0),
    "label beyond the classes (99)": setting("labels", lambda v, _: v * 0 + 99),
    "labels from 1": setting("labels", lambda v, _: v + 1),
    "label -1": setting("labels", lambda v, _: v * 0 - 1),
    "3D fields through float16": lambda b: all(
        setting(name, lambda v, _: v.half().float())(b)
        for name in ("center", "rotation", "size", "corners_3d")
    ),
    "corners_3d through bfloat16": setting("corners_3d", lambda v, _: v.bfloat16().float()),
    "corners_2d rounded to whole px": setting("corners_2d", lambda v, _: v.round()),
    "one NaN in size": setting("size", lambda v, _: v * torch.tensor([1, float("nan"), 1])),
    "an animal twice": twice,
    "one field lost an animal": setting("size", lambda v, _: v[:-1]),
    "box behind the camera, 2D kept": behind,
    "image padded by 16 px at the left": image_of_size(lambda h, w: (h, w + 16)),
    "image resized x0.5, target not": image_of_size(lambda h, w: (h // 2, w // 2)),
    "R not mirrored with the rest": before_the_flip,
    "t of another animal": of_neighbour("t"),
    "a dog 30 m long, box consistent": long_dog,
}
"""Each kind, and what plants it."""


def reordered(batch: Batch, order: list[int]) -> bool:
    """Corners in another order, in 2D too."""
    for name in ("corners_3d", "corners_2d"):
        if name in batch.target:
            batch.target[name] = batch.target[name][:, order]
    return True
