"""Keypoint vocabularies: which landmark of the body each keypoint of a dataset is, and what a mirror does to it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from animal3dbox.errors import ConfigError

ANIMAL3D_26 = (
    "left_eye", "right_eye", "chin", "left_front_paw", "right_front_paw", "left_back_paw", "right_back_paw", "tail_base",
    "left_front_elbow", "right_front_elbow", "left_back_knee", "right_back_knee", "left_shoulder", "right_shoulder",
    "left_front_wrist", "right_front_wrist", "left_back_hock", "right_back_hock", "neck", "tail_tip", "left_ear", "right_ear",
    "left_mouth", "right_mouth", "nose", "tail_middle",
)  # fmt: skip
"""Landmarks of the body in Animal3D's order; every other vocabulary is mapped onto these names."""


@dataclass(frozen=True)
class Vocabulary:
    """The keypoints of a dataset.

    Attributes:
        name: what the vocabulary is called.
        keypoints: (J,) the dataset's own names, in its order.
        landmarks: (J,) for each keypoint the names of the body landmarks that it can be read off, best first; none if
            the body has no such place.
        flip: (J,) the index of each keypoint's mirror image; itself in the middle of the body.
    """

    name: str
    keypoints: tuple[str, ...]
    landmarks: tuple[tuple[str, ...], ...]
    flip: tuple[int, ...]

    def __post_init__(self) -> None:
        if not len(self.keypoints) == len(self.landmarks) == len(self.flip) == len(set(self.keypoints)):
            raise ConfigError(f"vocabulary {self.name}: keypoints, landmarks and flip must have one entry a keypoint, and names must differ")
        if sorted(self.flip) != list(range(len(self.flip))) or any(self.flip[self.flip[i]] != i for i in range(len(self.flip))):
            raise ConfigError(f"vocabulary {self.name}: flip must be a permutation that undoes itself, got {self.flip}")

    def __len__(self) -> int:
        return len(self.keypoints)

    def index_of(self, landmark: str) -> int | None:
        """The keypoint that a landmark is best read as, or None if the vocabulary has none."""
        return next((i for i, names in enumerate(self.landmarks) if landmark in names), None)

    def on_body(self, groups: Mapping[str, Sequence[int]], vertices: Tensor) -> Tensor:
        """The keypoints of a body: means of its vertex groups.

        Args:
            groups: landmark name -> vertex ids.
            vertices: (V, 3) in any frame.

        Returns:
            (J, 3) in the same frame; NaN for a keypoint that the body has no group for.

        """
        points = torch.full((len(self), 3), torch.nan, dtype=vertices.dtype, device=vertices.device)
        for row, names in enumerate(self.landmarks):
            found = next((groups[name] for name in names if name in groups), None)
            if found is not None:
                points[row] = vertices[list(found)].mean(0)
        return points


def swap_sides(name: str) -> str:
    """The name of the same place on the other side of the body."""
    for left, right in (("left", "right"), ("Left", "Right")):
        if left in name:
            return name.replace(left, right)
        if right in name:
            return name.replace(right, left)
    return name


def vocabulary_from_names(name: str, keypoints: Mapping[str, Sequence[str] | str | None]) -> Vocabulary:
    """A vocabulary whose keypoints say left and right in their names.

    Args:
        name: what to call it.
        keypoints: in order, each keypoint's name -> the landmark(s) it is, or None.

    Returns:
        The vocabulary; its flip pairs the names that differ only in left and right.

    """
    names = tuple(keypoints)
    landmarks = tuple((value,) if isinstance(value, str) else tuple(value or ()) for value in keypoints.values())
    flip = tuple(names.index(mirrored) if (mirrored := swap_sides(k)) in names else i for i, k in enumerate(names))
    return Vocabulary(name, names, landmarks, flip)


def _stanfordextra() -> dict[str, Sequence[str] | str | None]:
    legs: dict[str, Sequence[str] | str | None] = {}
    for side in ("left", "right"):
        for place, rear, joints in (("front", "front", ("paw", "wrist", "elbow")), ("back", "rear", ("paw", "hock", "knee"))):
            for joint, word in zip(joints, ("paw", "middle joint", "top"), strict=True):
                legs[f"{side.capitalize()} {rear} leg: {word}"] = f"{side}_{place}_{joint}"
    return legs | {
        "Tail start": "tail_base",
        "Tail end": "tail_tip",
        "Base of left ear": ("left_ear_base", "left_ear"),
        "Base of right ear": ("right_ear_base", "right_ear"),
        "Nose": "nose",
        "Chin": "chin",
        "Left ear tip": "left_ear_tip",
        "Right ear tip": "right_ear_tip",
        "Left eye": "left_eye",
        "Right eye": "right_eye",
        "Withers": "withers",
        "Throat": "throat",
    }


VOCABULARIES = {
    "animal3d26": vocabulary_from_names("animal3d26", {name: name for name in ANIMAL3D_26}),
    "stanfordextra24": vocabulary_from_names("stanfordextra24", _stanfordextra()),
}


def find_vocabulary(vocabulary: str | Vocabulary) -> Vocabulary:
    """The vocabulary of a name, or the user's own as it is.

    Raises:
        ConfigError: the name is not known; lists those that are.

    """
    if isinstance(vocabulary, Vocabulary):
        return vocabulary
    if vocabulary not in VOCABULARIES:
        raise ConfigError(
            f"vocabulary must be one of {', '.join(VOCABULARIES)} or a Vocabulary of your own (see vocabulary_from_names), got {vocabulary!r}"
        )
    return VOCABULARIES[vocabulary]
