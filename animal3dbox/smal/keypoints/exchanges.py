"""Parts of the body whose left and right keypoints annotators exchange."""

from functools import lru_cache

from animal3dbox.smal.keypoints.vocabulary import Vocabulary

PARTS: dict[str, tuple[str, ...]] = {
    "all": ("",),
    "legs": ("front_", "back_"),
    "fore": ("front_",),
    "hind": ("back_",),
    "head": ("eye", "ear", "mouth"),
}
"""Part -> pieces of the names of its keypoints and landmarks, of which one is enough."""


@lru_cache(maxsize=256)
def exchange_order(vocabulary: Vocabulary, part: str) -> tuple[int, ...]:
    """The keypoints (J,) that take each keypoint's place when a part's left and right change.

    Example:
        >>> from animal3dbox.smal.keypoints.vocabularies import VOCABULARIES
        >>> exchange_order(VOCABULARIES["ap10k17"], "head")[:3]  # left eye, right eye, nose
        (1, 0, 2)
    """
    names = [
        " ".join((keypoint, *places))
        for keypoint, places in zip(vocabulary.keypoints, vocabulary.landmarks, strict=True)
    ]
    in_part = [any(piece in name for piece in PARTS[part]) for name in names]
    return tuple(
        partner if in_part[i] and in_part[partner] else i
        for i, partner in enumerate(vocabulary.flip)
    )
