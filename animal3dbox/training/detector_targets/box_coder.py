"""Targets as what a monocular detector regresses for each box in the picture, and back."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, get_args

import torch
from torch import Tensor

from animal3dbox.errors import ConfigError, SampleError, ShapeError
from animal3dbox.geometry.camera import project
from animal3dbox.geometry.checks import check_shape
from animal3dbox.geometry.distortion import undistort
from animal3dbox.training.detector_targets.rotations import (
    allocentric_from_egocentric,
    egocentric_from_allocentric,
    rotation_from_6d,
    rotation_to_6d,
)

Fields = Mapping[str, Any]
RotationFrame = Literal["allocentric", "egocentric"]
ENCODED = {
    "center_offset": (2,),
    "log_depth": (),
    "log_size": (3,),
    "rotation_6d": (6,),
    "face_visible": (6,),
}
"""The fields of an encoded target, and the shape of an entry; `face_visible` may be missing."""


@dataclass(frozen=True, kw_only=True)
class BoxCoder:
    """The way from targets to numbers a network can regress, and from its numbers to predictions.

    Of a box with centre (X, Y, Z) seen at pixel (u, v), in a 2D box of centre (a, b), width w and
    height h:

        center_offset = ((u - a) / w, (v - b) / h)
        log_depth     = ln(Z f_virtual / fy)
        log_size      = ln(size / class size)
        rotation_6d   = the first two columns of the rotation against the line of sight

    decode is the inverse of encode to the rounding of the type, whatever K and lens. Both keep
    device, type and derivatives.

    Attributes:
        class_sizes: (C, 3) length, width, height of each class, see class_sizes; None: log_size is
            that of the size itself.
        rotation: "allocentric", against the line of sight to the centre, or "egocentric", in the
            camera frame.
        virtual_focal_px: depths are told as a camera of this focal length would have to stand away
            to see the animal as large (Cube R-CNN's virtual depth), so that one network serves many
            cameras; in pixels of the picture that it is shown. None: depth as it is.

    Raises:
        ConfigError: an option cannot be.

    Example:
        >>> target = {
        ...     "center": torch.tensor([[1.0, 0, 10]]),
        ...     "rotation": torch.eye(3)[None],
        ...     "size": torch.tensor([[2.0, 1, 1]]),
        ...     "boxes": torch.tensor([[40.0, 40, 80, 60]]),
        ...     "K": torch.tensor([[100.0, 0, 49.5], [0, 100, 49.5], [0, 0, 1]]),
        ... }
        >>> coder = BoxCoder(virtual_focal_px=50.0)
        >>> encoded = coder.encode(target)
        >>> encoded["center_offset"].tolist(), round(float(encoded["log_depth"].exp()), 4)
        ([[-0.012500000186264515, -0.02500000037252903]], 5.0)
        >>> decoded = coder.decode(encoded, boxes=target["boxes"], K=target["K"])
        >>> [round(x, 4) for x in decoded["center"][0].tolist()]
        [1.0, 0.0, 10.0]
    """

    class_sizes: Tensor | None = None
    rotation: RotationFrame = "allocentric"
    virtual_focal_px: float | None = None

    def __post_init__(self) -> None:
        if self.rotation not in get_args(RotationFrame):
            raise ConfigError(f"rotation must be allocentric or egocentric, got {self.rotation!r}")
        if self.virtual_focal_px is not None and not self.virtual_focal_px > 0:
            raise ConfigError(f"virtual_focal_px must be positive, got {self.virtual_focal_px}")
        if self.class_sizes is not None and (
            self.class_sizes.ndim != 2
            or self.class_sizes.shape[1] != 3
            or not bool((self.class_sizes > 0).all())
        ):
            raise ConfigError(
                f"class_sizes must be (C, 3) and positive, got {self.class_sizes.tolist()}"
            )

    def encode(self, target: Fields) -> dict[str, Tensor]:
        """The numbers that a detector regresses for each animal of a target.

        Args:
            target: `center`, `rotation`, `size`, `boxes` (N, 4), `K` (3, 3) or (N, 3, 3) as of
                crops; `labels` if there are class sizes; `face_visible` and `distortion` if there
                are any.

        Returns:
            `center_offset` (N, 2), `log_depth` (N,), `log_size` (N, 3), `rotation_6d` (N, 6),
            `face_visible` (N, 6) as 0 and 1 if the target has it, and `encodable` (N,) bool: False
            where the centre is not in front of the camera or the 2D box has no area; the numbers
            are 0 there.

        Raises:
            SampleError: a field is missing or of the wrong shape, or a label has no class size.

        """
        center, rotation, size, boxes, K = self._fields(target)
        sides = boxes[:, 2:] - boxes[:, :2]
        encodable = (center[:, 2] > 0) & (sides > 0).all(1)
        keep = encodable[:, None]
        # What cannot be encoded gets harmless numbers, so that no derivative becomes NaN
        center = torch.where(keep, center, center.new_tensor([0.0, 0, 1]))
        sides = torch.where(keep, sides, torch.ones_like(sides))
        px, depth = project(K, center[:, None], target.get("distortion"))
        if self.rotation == "allocentric":
            rotation = allocentric_from_egocentric(rotation, center)
        encoded = {
            "center_offset": (px[:, 0] - (boxes[:, :2] + boxes[:, 2:]) / 2) / sides,
            "log_depth": torch.log(depth[:, 0] * self._depth_factor(K)),
            "log_size": torch.log(size / self._sizes(target.get("labels"), size, target)),
            "rotation_6d": rotation_to_6d(rotation),
        }
        if "face_visible" in target:
            encoded["face_visible"] = target["face_visible"].to(center.dtype)
        zero = {
            name: torch.where(encodable.view(-1, *[1] * (value.ndim - 1)), value, 0.0)
            for name, value in encoded.items()
        }
        return {**zero, "encodable": encodable}

    def decode(
        self,
        encoded: Fields,
        *,
        boxes: Tensor,
        K: Tensor,
        labels: Tensor | None = None,
        distortion: Tensor | None = None,
    ) -> dict[str, Tensor]:
        """The boxes of a detector's numbers, in the field names of a target.

        Args:
            encoded: `center_offset`, `log_depth`, `log_size`, `rotation_6d`, and `face_visible`,
                which is passed on, if there is one.
            boxes: (N, 4) xyxy px, the 2D boxes that the numbers are relative to.
            K: (3, 3) of the picture, or (N, 3, 3) of each box's crop.
            labels: (N,) class numbers; needed if there are class sizes.
            distortion: coefficients of OpenCV's lens; None for a pinhole.

        Returns:
            `center` (N, 3), `rotation` (N, 3, 3), `size` (N, 3) in the camera frame, `boxes`, and
            `labels` and `face_visible` if they were given.

        Raises:
            ShapeError: a field has the wrong shape.
            SampleError: a label has no class size.

        """
        count = len(boxes)
        check_shape("boxes", boxes, "N 4")
        check_shape("K", K, "... 3 3")
        for name, shape in ENCODED.items():
            if name in encoded or name != "face_visible":
                _check_entry(name, encoded[name], (count, *shape))
        sides, middle = boxes[:, 2:] - boxes[:, :2], (boxes[:, :2] + boxes[:, 2:]) / 2
        rays = _rays(middle + encoded["center_offset"] * sides, K, distortion)
        depth = torch.exp(encoded["log_depth"]) / self._depth_factor(K)
        rotation = rotation_from_6d(encoded["rotation_6d"])
        if self.rotation == "allocentric":
            rotation = egocentric_from_allocentric(rotation, rays)
        log_size = encoded["log_size"]
        decoded = {
            "center": rays * depth[:, None],
            "rotation": rotation,
            "size": torch.exp(log_size) * self._sizes(labels, log_size, {}),
            "boxes": boxes,
        }
        if labels is not None:
            decoded["labels"] = labels
        if "face_visible" in encoded:
            decoded["face_visible"] = encoded["face_visible"]
        return decoded

    def _fields(self, target: Fields) -> tuple[Tensor, Tensor, Tensor, Tensor, Tensor]:
        """Center, rotation, size, boxes and K of a target."""
        values = []
        for name, spec in (
            *(("center", "N 3"), ("rotation", "N 3 3"), ("size", "N 3"), ("boxes", "N 4")),
            ("K", "... 3 3"),
        ):
            if name not in target:
                raise SampleError(_image_of(target), name, "is missing, and encode needs it")
            try:
                check_shape(name, target[name], spec)
            except ShapeError as error:
                raise SampleError(_image_of(target), name, str(error)) from error
            values.append(target[name])
        center, rotation, size, boxes, K = values
        for name, value in (("rotation", rotation), ("size", size), ("boxes", boxes)):
            if len(value) != len(center):
                raise SampleError(
                    _image_of(target), name, f"has {len(value)} animals, center {len(center)}"
                )
        return center, rotation, size, boxes, K

    def _depth_factor(self, K: Tensor) -> Tensor | float:
        """By what a depth is multiplied to be the virtual camera's: f_virtual / fy."""
        return 1.0 if self.virtual_focal_px is None else self.virtual_focal_px / K[..., 1, 1]

    def _sizes(self, labels: Tensor | None, like: Tensor, target: Fields) -> Tensor:
        """The class size (N, 3) of each animal; ones if there are none."""
        if self.class_sizes is None:
            return torch.ones_like(like)
        if labels is None:
            raise SampleError(_image_of(target), "labels", "is missing, and class_sizes need it")
        classes = len(self.class_sizes)
        outside = (labels < 0) | (labels >= classes)
        if bool(outside.any()):
            animal = int(outside.nonzero()[0, 0])
            raise SampleError(
                f"{_image_of(target)}#{animal}",
                "labels",
                f"is {int(labels[animal])}, and class_sizes has the classes 0 to {classes - 1}",
            )
        return self.class_sizes.to(like)[labels]


def class_sizes(targets: Sequence[Fields], classes: int) -> Tensor:
    """The typical size of each class: the geometric mean of its animals' sizes.

    Args:
        targets: with `size` and `labels`; all lengths must be of one unit.
        classes: how many there are, C.

    Returns:
        (C, 3) length, width, height, float64; for BoxCoder.

    Raises:
        ConfigError: a class has no animal, or some lengths are metres and some are not.
        SampleError: a label is not below C.

    Example:
        >>> size = torch.tensor([[1.0, 1, 1], [4.0, 1, 1]])
        >>> class_sizes([{"size": size, "labels": torch.tensor([0, 0])}], 1).tolist()
        [[2.0, 1.0, 1.0]]
    """
    sums = torch.zeros(classes, 3, dtype=torch.float64)
    counts = torch.zeros(classes, dtype=torch.float64)
    units: set[bool] = set()
    for target in targets:
        labels, size = target["labels"].cpu(), target["size"].cpu().double()
        for animal in ((labels < 0) | (labels >= classes)).nonzero().flatten().tolist():
            raise SampleError(
                f"{_image_of(target)}#{animal}",
                "labels",
                f"is {int(labels[animal])}, and there are the classes 0 to {classes - 1}",
            )
        sums.index_add_(0, labels, size.log())
        counts.index_add_(0, labels, torch.ones(len(labels), dtype=torch.float64))
        if "scale_known" in target:
            units |= set(target["scale_known"].bool().tolist())
    if len(units) > 1:
        raise ConfigError(
            "some animals' lengths are metres (scale_known) and some are in their body's unit:"
            " leave out those of one kind"
        )
    if bool((counts == 0).any()):
        raise ConfigError(
            f"no animal of the classes {(counts == 0).nonzero().flatten().tolist()}: give targets"
            " of all classes, or fewer classes"
        )
    return (sums / counts[:, None]).exp()


def _rays(px: Tensor, K: Tensor, distortion: Tensor | None) -> Tensor:
    """The points (N, 3) at depth 1 that are seen at pixels (N, 2)."""
    homogeneous = torch.cat((px, torch.ones_like(px[:, :1])), dim=1)
    rays: Tensor = torch.linalg.solve_triangular(
        K.expand(len(px), 3, 3).to(px.dtype), homogeneous[..., None], upper=True
    )[..., 0]
    if distortion is None:
        return rays
    return torch.cat((undistort(rays[:, :2], distortion)[0], rays[:, 2:]), dim=1)


def _check_entry(name: str, value: Tensor, shape: tuple[int, ...]) -> None:
    if tuple(value.shape) != shape:
        raise ShapeError(f"{name} must have shape {shape}, got {tuple(value.shape)}")


def _image_of(target: Fields) -> str:
    return str(target.get("image_id", "target"))
