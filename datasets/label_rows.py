"""A label as one row of numbers: what a cache stores and what targets are made of.

The row is float64 with a fixed layout, so that reading one costs no more than looking at it; booleans are 0 and 1.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from animal3dbox.datasets.codec import Codec
from animal3dbox.errors import ShapeError
from animal3dbox.labels.types import CuboidLabel, Rejection

LAYOUT: dict[str, tuple[int, ...]] = {
    "corners_3d": (8, 3), "center": (3,), "rotation": (3, 3), "size": (3,), "corners_2d": (8, 2), "face_area": (6,), "face_share": (6,),
    "face_share_in_image": (6,), "K": (3, 3), "R": (3, 3), "t": (3,), "box": (4,), "truncation": (), "surface_share": (6,),
    "corner_in_front": (8,), "face_visible": (6,), "behind_camera": (),
}  # fmt: skip
"""Fields of a CuboidLabel in the row, in order, the boolean ones last; surface_share is all -1 where it was not measured."""
BOOLEAN = ("corner_in_front", "face_visible", "behind_camera")
_WIDTHS = {name: int(np.prod(shape)) for name, shape in LAYOUT.items()}
SPANS = {name: (start, start + width) for (name, width), start in zip(_WIDTHS.items(), np.cumsum([0, *_WIDTHS.values()]).tolist(), strict=False)}
"""Where each field stands in the row."""
WIDTH = sum(_WIDTHS.values())
_CODEC = Codec()
_FLOAT32, _BOOL = np.dtype(np.float32), np.dtype(np.bool_)


@dataclass(frozen=True, eq=False)
class LabelRow:
    """One animal's label.

    Attributes:
        sample_id: the animal.
        values: (WIDTH,) float64, see LAYOUT.
        keypoints: (J, 3) x, y, visibility as used; None without keypoints.
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


def label_row(label: CuboidLabel) -> LabelRow:
    """The row of a label."""
    parts = []
    for name, width in _WIDTHS.items():
        value = getattr(label, name)
        parts.append(np.full(width, -1.0) if value is None else value.numpy().ravel() if isinstance(value, Tensor) else (value,))
    keypoints = None if label.keypoints is None else label.keypoints.numpy()
    quality = {**vars(label.quality), "confidence": label.confidence}
    distortion = None if label.distortion is None else label.distortion.numpy()
    scale = (label.scale_m_per_unit, label.scale_source)
    return LabelRow(label.sample_id or "", np.concatenate(parts), keypoints, quality, *scale, distortion)


def packed_outcome(outcome: LabelRow | Rejection) -> bytes:
    """The bytes of a row or a rejection."""
    return (b"R" if isinstance(outcome, Rejection) else b"L") + _CODEC.pack(outcome)


def unpacked_outcome(data: bytes | memoryview) -> LabelRow | Rejection:
    """A row or a rejection of its bytes.

    Raises:
        ShapeError: the bytes are of another layout.

    """
    kind, content = bytes(data[:1]), _CODEC.unpack(data[1:])
    if kind == b"R":
        return Rejection(**content)
    if kind != b"L" or content["values"].shape != (WIDTH,):
        raise ShapeError(f"a label row must have {WIDTH} numbers, got kind {kind!r} and {getattr(content.get('values'), 'shape', None)}")
    return LabelRow(**content)


def columns(rows: Sequence[LabelRow]) -> dict[str, NDArray[Any]]:
    """The fields of several animals, (N, ...) each, contiguous: float32, bool where LAYOUT's field is one."""
    count = len(rows)
    flat = rows[0].values if count == 1 else np.concatenate([row.values for row in rows])[_by_field(count)] if rows else np.zeros(0)
    booleans = SPANS[BOOLEAN[0]][0] * count
    numbers, flags = flat[:booleans].astype(np.float32), flat[booleans:] > 0.5
    found = {name: np.ndarray(shape, _FLOAT32, numbers, offset) for name, shape, offset in _places(count, False)}
    found.update((name, np.ndarray(shape, _BOOL, flags, offset)) for name, shape, offset in _places(count, True))
    return found


@lru_cache(maxsize=64)
def _by_field(count: int) -> NDArray[np.int64]:
    """The order that puts the fields of several rows, one row after the other, together field by field."""
    places = np.arange(count * WIDTH).reshape(count, WIDTH)
    return np.concatenate([places[:, start:stop].ravel() for start, stop in SPANS.values()])


@lru_cache(maxsize=128)
def _places(count: int, boolean: bool) -> tuple[tuple[str, tuple[int, ...], int], ...]:
    """Name, shape and offset in bytes of the boolean fields of several rows, or of the others, field by field."""
    first, size = (SPANS[BOOLEAN[0]][0], 1) if boolean else (0, 4)
    return tuple((name, (count, *LAYOUT[name]), (start - first) * count * size) for name, (start, _) in SPANS.items() if (name in BOOLEAN) == boolean)
