"""The places on a body that a keypoint can be: the quadruped's landmarks, by their names."""

import difflib
from collections.abc import Sequence

KNOWN_PLACES = (
    "left_eye", "right_eye", "chin", "left_front_paw", "right_front_paw", "left_back_paw",
    "right_back_paw", "tail_base", "left_front_elbow", "right_front_elbow", "left_back_knee",
    "right_back_knee", "left_shoulder_blade", "right_shoulder_blade", "left_front_wrist",
    "right_front_wrist", "left_back_hock", "right_back_hock", "neck", "tail_tip", "left_ear",
    "right_ear", "left_mouth", "right_mouth", "nose", "tail_middle", "withers", "throat",
    "left_hip", "right_hip", "left_ear_base", "right_ear_base", "left_ear_tip", "right_ear_tip",
    "left_shoulder_point", "right_shoulder_point",
)  # fmt: skip
"""In the quadruped's order. Other bodies have some of them, or places of their own."""


def nearest_places(name: str, others: Sequence[str] = ()) -> str:
    """The two known places, or others, whose names are most like another, in words.

    Example:
        >>> nearest_places("tailbase").partition(",")[0]
        'tail_base'
    """
    return ", ".join(difflib.get_close_matches(name, (*KNOWN_PLACES, *others), n=2, cutoff=0.0))
