"""A label as one row of numbers: what a cache stores and what targets are made of.

The row is float64 with a fixed layout, so that reading one costs no more than looking at it;
booleans are 0 and 1.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from animal3dbox.errors import ShapeError
from animal3dbox.labels.types import CuboidLabel, Rejection

LAYOUT: dict[str, tuple[int, ...]] = {
    "corners_3d": (8, 3), "center": (3,), "rotation": (3, 3), "size": (3,), "corners_2d": (8, 2), "face_area": (6,), "face_share": (6,),
    "face_share_in_image": (6,), "K": (3, 3), "R": (3, 3), "t": (3,), "box": (4,), "truncation": (), "surface_share": (6,),
    "corner_in_front": (8,), "face_visible": (6,), "behind_camera": (),
}  # fmt: skip
"""Fields of a CuboidLabel in the row, in order, the boolean ones last.

Surface_share is all -1 where it was not measured.
"""
BOOLEAN = ("corner_in_front", "face_visible", "behind_camera")
_WIDTHS = {name: int(np.prod(shape)) for name, shape in LAYOUT.items()}
SPANS = {
    name: (start, start + width)
    for (name, width), start in zip(
        _WIDTHS.items(), np.cumsum([0, *_WIDTHS.values()]).tolist(), strict=False
    )
}
"""Where each field stands in the row."""
WIDTH = sum(_WIDTHS.values())


def _plain(value: Any) -> Any:
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"a {type(value).__name__} cannot be packed")


_ENCODER = msgspec.msgpack.Encoder(enc_hook=_plain)
_Said = dict[str, str | bool | int | float | tuple[str, ...] | None]
_ROW = msgspec.msgpack.Decoder(
    tuple[str, bytes, bytes | None, _Said, float | None, str, bytes | None]
)
_REJECTION = msgspec.msgpack.Decoder(tuple[str | None, str, str])


@dataclass(frozen=True, eq=False)
class LabelRow:
    """One animal's label.

    Attributes:
        sample_id: the animal.
        values: (WIDTH,) float64, see LAYOUT.
        keypoints: (J, 3) x, y, visibility as used, but 0 outside the frame; None without keypoints.
        quality: the fields of Quality, and confidence.
        scale_m_per_unit: see CuboidLabel.
        scale_source: see CuboidLabel.
        distortion: of the lens; None of a pinhole.
    """

    sample_id: str
    values: NDArray[np.float64]
    keypoints: NDArray[np.float64] | None
    quality: dict[str, Any]
    scale_m_per_unit: float | None = None
    scale_source: str = "unknown"
    distortion: NDArray[np.float64] | None = None

    def field(self, name: str) -> NDArray[np.float64]:
        """A field of LAYOUT in its shape."""
        start, stop = SPANS[name]
        return self.values[start:stop].reshape(LAYOUT[name])


def _in_frame(keypoints: NDArray[np.float64], image_hw: tuple[int, int]) -> NDArray[np.float64]:
    """Keypoints (J, 3) whose visibility is 0 outside the frame."""
    px = keypoints[:, :2]
    inside = ((px >= -0.5) & (px <= (image_hw[1] - 0.5, image_hw[0] - 0.5))).all(1)
    return (
        keypoints if inside.all() else np.concatenate((px, (keypoints[:, 2] * inside)[:, None]), 1)
    )


def label_row(label: CuboidLabel) -> LabelRow:
    """The row of a label."""
    parts = []
    for name, width in _WIDTHS.items():
        value = getattr(label, name)
        parts.append(
            np.full(width, -1.0)
            if value is None
            else value.numpy().ravel()
            if isinstance(value, Tensor)
            else (value,)
        )
    keypoints = (
        None if label.keypoints is None else _in_frame(label.keypoints.numpy(), label.image_hw)
    )
    quality = {**vars(label.quality), "confidence": label.confidence}
    distortion = None if label.distortion is None else label.distortion.numpy()
    scale = (label.scale_m_per_unit, label.scale_source)
    return LabelRow(
        label.sample_id or "", np.concatenate(parts), keypoints, quality, *scale, distortion
    )


def packed_outcome(outcome: LabelRow | Rejection) -> bytes:
    """The bytes of a row or a rejection."""
    if isinstance(outcome, Rejection):
        return b"R" + _ENCODER.encode((outcome.sample_id, outcome.reason, outcome.detail))
    keypoints, distortion = (
        None if part is None else part.astype(np.float64).tobytes()
        for part in (outcome.keypoints, outcome.distortion)
    )
    told = (outcome.quality, outcome.scale_m_per_unit, outcome.scale_source, distortion)
    return b"L" + _ENCODER.encode((outcome.sample_id, outcome.values.tobytes(), keypoints, *told))


def unpacked_outcome(data: bytes) -> LabelRow | Rejection:
    """A row or a rejection of its bytes; a row's arrays cannot be written to.

    Raises:
        ShapeError: the bytes are of another layout.

    """
    kind = data[:1]
    if kind == b"R":
        return Rejection(*_REJECTION.decode(data[1:]))
    if kind != b"L":
        raise ShapeError(f"an outcome must be a label row or a rejection, got kind {kind!r}")
    sample_id, numbers, points, quality, scale, scale_source, lens = _ROW.decode(data[1:])
    values = np.frombuffer(numbers)
    if len(values) != WIDTH:
        raise ShapeError(f"a label row must have {WIDTH} numbers, got {len(values)}")
    keypoints = None if points is None else np.frombuffer(points).reshape(-1, 3)
    return LabelRow(
        sample_id,
        values,
        keypoints,
        quality,
        scale,
        scale_source,
        None if lens is None else np.frombuffer(lens),
    )


def columns(rows: Sequence[LabelRow]) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """The fields of several animals one after the other, each of all animals.

    The numbers, and the booleans. places says where each is.
    """
    count = len(rows)
    flat = (
        rows[0].values
        if count == 1
        else np.concatenate([row.values for row in rows])[_by_field(count)]
        if rows
        else np.zeros(0)
    )
    booleans = SPANS[BOOLEAN[0]][0] * count
    return flat[:booleans].astype(np.float32), flat[booleans:].astype(np.bool_)


def places(count: int, boolean: bool) -> dict[str, tuple[tuple[int, ...], int]]:
    """Shape (N, ...) and first byte of the boolean fields of several animals in columns' booleans,
    or of the others in its numbers."""
    first, size = (SPANS[BOOLEAN[0]][0], 1) if boolean else (0, 4)
    return {
        name: ((count, *LAYOUT[name]), (start - first) * count * size)
        for name, (start, _) in SPANS.items()
        if (name in BOOLEAN) == boolean
    }


@lru_cache(maxsize=64)
def _by_field(count: int) -> NDArray[np.int64]:
    """The order that puts the fields of several rows, one row after the other, together field by
    field."""
    places = np.arange(count * WIDTH).reshape(count, WIDTH)
    return np.concatenate([places[:, start:stop].ravel() for start, stop in SPANS.values()])
