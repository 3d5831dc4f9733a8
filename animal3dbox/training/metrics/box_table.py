"""Boxes of many images as one table, a row a box: what the metrics keep between updates.

A plain table of float64 can be appended to, sent between processes and concatenated; what a box
does not say is NaN in its columns, and never leaves this room as a number.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from animal3dbox.geometry.cuboid import Cuboid, corners_of

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
Whole = NDArray[np.int64]

SHAPES: dict[str, tuple[int, ...]] = {
    "score": (),
    "label": (),
    "center": (3,),
    "rotation": (3, 3),
    "size": (3,),
    "box": (4,),
    "face_score": (6,),
    "face_share": (6,),
    "flank": (),
    "usable": (),
    "heading_known": (),
    "metric": (),
    "crowd": (),
}
"""The columns of a table in their order: the shape of each entry."""
ENDS = np.cumsum([int(np.prod(shape)) for shape in SHAPES.values()])
WIDTH = int(ENDS[-1])
"""How many numbers a row holds."""


@dataclass(frozen=True, kw_only=True)
class BoxTable:
    """N boxes in the camera frames of their images.

    Attributes:
        score: (N,) of predictions; 0 of truths.
        label: (N,) class numbers.
        center: (N, 3).
        rotation: (N, 3, 3) R_cam_box.
        size: (N, 3) length, width, height.
        box: (N, 4) xyxy px; NaN if not said.
        face_score: (N, 6) 0 to 1, how sure it is that a face is seen; above 0.5: it is. NaN if the
            faces have no names.
        face_share: (N, 6) parts of the visible area; NaN if neither said nor K known.
        flank: (N,) 0 undecided, 1 left, 2 right; NaN if not said.
        usable: (N,) whether it is a box at all; what is none has IoU 0 with everything.
        heading_known: (N,) whether front and left mean something.
        metric: (N,) whether lengths are metres.
        crowd: (N,) whether a truth is to be ignored: hits of it count neither way.
    """

    score: Floats
    label: Whole
    center: Floats
    rotation: Floats
    size: Floats
    box: Floats
    face_score: Floats
    face_share: Floats
    flank: Floats
    usable: Flags
    heading_known: Flags
    metric: Flags
    crowd: Flags

    @classmethod
    def from_rows(cls, rows: Floats) -> "BoxTable":
        """The table whose rows (N, WIDTH) these are."""
        columns: dict[str, Any] = {
            name: part.reshape(len(rows), *SHAPES[name])
            for name, part in zip(SHAPES, np.split(rows, ENDS[:-1], axis=1), strict=True)
        }
        for name in ("usable", "heading_known", "metric", "crowd"):
            columns[name] = columns[name] > 0
        columns["label"] = columns["label"].astype(np.int64)
        return cls(**columns)

    def rows(self) -> Floats:
        """The table as numbers, (N, WIDTH)."""
        return np.concatenate(
            [
                np.asarray(getattr(self, name), dtype=np.float64).reshape(len(self), -1)
                if len(self)
                else np.zeros((0, int(np.prod(shape))))
                for name, shape in SHAPES.items()
            ],
            axis=1,
        )

    def __len__(self) -> int:
        return len(self.score)

    @cached_property
    def corners(self) -> Floats:
        """The corners (N, 8, 3) in the camera frame, in our corner order."""
        return corners_of(self.center, self.rotation, self.size)

    @cached_property
    def distance(self) -> Floats:
        """How far the centres are from the camera, (N,)."""
        return np.asarray(np.linalg.norm(self.center, axis=1))

    def cuboids(self, index: Whole, scale: float = 1.0) -> Cuboid:
        """The boxes at (P,) indices, in a unit 1 / scale as long."""
        return Cuboid(
            torch.from_numpy(self.center[index] * scale),
            torch.from_numpy(self.rotation[index]),
            torch.from_numpy(self.size[index] * scale),
        )
