"""Names that mesh regressors give their files, and the names of this reader's that they mean."""

import re
from enum import IntEnum

_TTA = re.compile(r"(?P<name>.+)_(?P<when>before|after)_tta")
_SCORED = re.compile(r"(?P<name>.+_frame\d+)_score\d+(\.\d+)?")
_KEYPOINTS = re.compile(r"(?P<name>.+)_(?P<kind>prima26_kpts|mapped_keypoints)")


class Rank(IntEnum):
    """Which of several files of one animal is its own: the one of the lowest rank."""

    ADAPTED = 0
    PLAIN = 1
    NOT_YET_ADAPTED = 2


def own_name(name: str) -> tuple[str, Rank]:
    """A file's name without what a regressor adds to it, and its rank among files of that name.

    PRIMA adds _before_tta and _after_tta to meshes from before and after its test-time adaptation,
    _score0.987 to those of a video's frames, and _prima26_kpts to keypoints; FMPose3D adds
    _mapped_keypoints.

    Args:
        name: the file's path without suffix.

    Example:
        >>> own_name("dog_0_after_tta")[0], own_name("clip_frame000012_score0.987")[0]
        ('dog_0', 'clip_frame000012')
        >>> own_name("dog_0")
        ('dog_0', <Rank.PLAIN: 1>)
    """
    if match := _TTA.fullmatch(name):
        is_after = match["when"] == "after"
        return match["name"], Rank.ADAPTED if is_after else Rank.NOT_YET_ADAPTED
    match = _SCORED.fullmatch(name) or _KEYPOINTS.fullmatch(name)
    return (name if match is None else match["name"]), Rank.PLAIN


def is_of_crop(path: str) -> bool:
    """Whether a file of keypoints is PRIMA's, whose code writes pixels of the animal's crop."""
    match = _KEYPOINTS.fullmatch(path.rpartition(".")[0])
    return match is not None and match["kind"] == "prima26_kpts"
