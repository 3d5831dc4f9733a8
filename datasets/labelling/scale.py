"""Metres: what a unit of an animal's body is worth, and who says so.

A body's own unit is arbitrary, so a label is metric only if something tells its size. Whatever it
is, is recorded.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from animal3dbox.datasets.records import AnimalRecord
from animal3dbox.errors import ConfigError, SampleError
from animal3dbox.labels.body import Body
from animal3dbox.labels.label_row import LENGTHS
from animal3dbox.labels.types import CuboidLabel
from animal3dbox.smal.keypoints.vocabulary import Vocabulary

UNKNOWN = "unknown"

HEAD_AND_BODY_M: Mapping[str, float] = MappingProxyType({
    "antelope": 1.4, "bear": 1.8, "bison": 3.0, "boar": 1.4, "bobcat": 0.8, "buffalo": 2.7,
    "camel": 3.0, "cat": 0.46, "cattle": 2.4, "cheetah": 1.3, "coyote": 0.85, "cow": 2.4,
    "deer": 1.8, "dog": 0.85, "donkey": 2.0, "elephant": 6.0, "elk": 2.3, "fox": 0.65,
    "gazelle": 1.1, "giraffe": 4.2, "goat": 1.3, "hippo": 3.6, "hippopotamus": 3.6, "horse": 2.4,
    "hyena": 1.2, "impala": 1.3, "jaguar": 1.5, "leopard": 1.4, "lion": 1.8, "lynx": 0.95,
    "moose": 2.8, "ox": 2.4, "panda": 1.5, "pig": 1.4, "puma": 1.3, "rabbit": 0.4,
    "raccoon": 0.55, "rhino": 3.6, "rhinoceros": 3.6, "sheep": 1.2, "tiger": 1.9, "warthog": 1.2,
    "weasel": 0.22, "wolf": 1.2, "yak": 2.8, "zebra": 2.3,
})  # fmt: skip
"""Nominal head-and-body lengths of adults, nose to tail base along the back, in metres.

Single animals differ by 30 % and more, breeds of
dogs by a factor of five: for ranking and rough depth, not for measuring."""


class ScaleSource(Protocol):
    """Tells how many metres a unit of an animal's body is."""

    def metres_per_unit(
        self, record: AnimalRecord, body: Body, label: CuboidLabel
    ) -> tuple[float | None, str]:
        """The scale and what it is from; None and "unknown" if it cannot tell."""
        ...


@dataclass(frozen=True)
class KnownScale:
    """One scale for all bodies, by the user.

    Attributes:
        value: metres per unit of the body.

    Example:
        >>> from animal3dbox.datasets import KnownScale, SyntheticDataset
        >>> dataset = SyntheticDataset(1, seed=0, image_hw=(120, 160), scale=KnownScale(1.2))
        >>> dataset[0][1]["scale_m_per_unit"]
        tensor([1.2000])
    """

    value: float

    def __post_init__(self) -> None:
        if not 0 < self.value < float("inf"):
            raise ConfigError(f"metres per unit must be positive, got {self.value}")

    def metres_per_unit(
        self, record: AnimalRecord, body: Body, label: CuboidLabel
    ) -> tuple[float | None, str]:
        """The user's scale, of source "user"."""
        return self.value, "user"


@dataclass(frozen=True)
class SpeciesScale:
    """The scale by species: a typical head-and-body length over that of the animal's body.

    Attributes:
        lengths_m: species -> length in metres from nose to tail base along the back. A category is
            looked up as it is, then by its last word ("polar bear" is a bear).

    Example:
        >>> from animal3dbox.datasets import SpeciesScale
        >>> SpeciesScale({"dog": 0.9}).lengths_m["dog"]
        0.9
    """

    lengths_m: Mapping[str, float] = field(
        default_factory=lambda: dict(HEAD_AND_BODY_M)
    )  # a copy: HEAD_AND_BODY_M cannot be pickled

    def __post_init__(self) -> None:
        wrong = {
            name: length for name, length in self.lengths_m.items() if not 0 < length < float("inf")
        }
        if wrong:
            raise ConfigError(f"lengths_m must be positive, got {wrong}")

    def metres_per_unit(
        self, record: AnimalRecord, body: Body, label: CuboidLabel
    ) -> tuple[float | None, str]:
        """The scale by the table.

        Unknown for other species, and for bodies without nose or tail base.
        """
        name = record.category.lower().replace("_", " ").strip()
        metres = self.lengths_m.get(name) or self.lengths_m.get(name.split(" ")[-1])
        length = head_and_body(record.vocabulary, body.landmarks)
        if metres is None or length is None:
            return None, UNKNOWN
        return metres / length, f"species:{name}"


@dataclass(frozen=True)
class AltitudeScale:
    """The scale by a camera's known height over the animal's ground, as a drone reports it.

    Attributes:
        altitude_m: one for all images, or image -> metres.
        down_cam: the direction of gravity in the camera frame, of any length; (0, 0, 1) looks
            straight down.

    Example:
        >>> from animal3dbox.datasets import AltitudeScale
        >>> AltitudeScale({"flight/0001.jpg": 42.0}).altitude_m["flight/0001.jpg"]
        42.0
    """

    altitude_m: float | Mapping[str, float]
    down_cam: tuple[float, float, float] = (0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        given = (
            self.altitude_m.values() if isinstance(self.altitude_m, Mapping) else (self.altitude_m,)
        )
        if not all(0 < value < float("inf") for value in given) or not any(self.down_cam):
            raise ConfigError("altitude_m must be positive and down_cam a direction")

    def metres_per_unit(
        self, record: AnimalRecord, body: Body, label: CuboidLabel
    ) -> tuple[float | None, str]:
        """Altitude over the depth of the box's lowest corner along gravity."""
        altitude = (
            self.altitude_m.get(record.image_id)
            if isinstance(self.altitude_m, Mapping)
            else self.altitude_m
        )
        if altitude is None:
            return None, UNKNOWN
        down = torch.tensor(self.down_cam, dtype=torch.float64)
        below = float((label.corners_3d @ (down / down.norm())).amax())
        if not below > 0:
            raise SampleError(
                record.sample_id,
                "altitude_m",
                "the animal stands above the camera by down_cam: does down_cam point to the"
                " ground?",
            )
        return altitude / below, "altitude"


def head_and_body(vocabulary: Vocabulary, landmarks: Tensor | NDArray[np.float64]) -> float | None:
    """Length of a body from nose over neck or withers to tail base, in its own unit.

    None if it lacks one of them.

    Args:
        vocabulary: names the J landmarks.
        landmarks: (J, 3) of one body; NaN where it has none.

    """
    places: dict[str, Tensor] = {}
    for landmark, names in zip(torch.as_tensor(landmarks), vocabulary.landmarks, strict=True):
        if bool(torch.isfinite(landmark).all()):
            for name in names:
                places.setdefault(name, landmark)
    middle = places.get("neck", places.get("withers"))
    if middle is None or "nose" not in places or "tail_base" not in places:
        return None
    length = float(
        torch.linalg.vector_norm(places["nose"] - middle)
        + torch.linalg.vector_norm(middle - places["tail_base"])
    )
    return length if length > 0 else None


def in_metres(label: CuboidLabel, metres: float | None, source: str) -> CuboidLabel:
    """A label whose lengths in the camera frame (label_row.LENGTHS) are in metres.

    R and t then map vertices that are scaled too.

    Args:
        label: in the unit of its body.
        metres: a unit of the body; None if nothing tells, and the label stays as it is.
        source: what tells it.

    """
    if metres is not None:
        label = label.with_fields(**{name: label.field(name) * metres for name in LENGTHS})
    return replace(label, scale_m_per_unit=metres, scale_source=source)
