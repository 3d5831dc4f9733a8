"""The keypoint vocabularies of public datasets, mapped onto the body's landmarks.

Example:
    >>> list(VOCABULARIES)
    ['animal3d26', 'stanfordextra24', 'animalpose20', 'ap10k17', 'superanimal39']
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

from animal3dbox.errors import ConfigError
from animal3dbox.smal.keypoints.vocabulary import Vocabulary, load_vocabulary, vocabulary_from_names

Keypoints = Mapping[str, Sequence[str] | str | None]

ANIMAL3D_26 = (
    "left_eye", "right_eye", "chin", "left_front_paw", "right_front_paw", "left_back_paw",
    "right_back_paw", "tail_base",
    "left_front_elbow", "right_front_elbow", "left_back_knee", "right_back_knee", "left_shoulder",
    "right_shoulder",
    "left_front_wrist", "right_front_wrist", "left_back_hock", "right_back_hock", "neck",
    "tail_tip", "left_ear", "right_ear",
    "left_mouth", "right_mouth", "nose", "tail_middle",
)  # fmt: skip
"""Animal3D's keypoints, in its order and spelling."""

ANIMAL3D_LANDMARKS = tuple(
    f"{name}_blade" if name in ("left_shoulder", "right_shoulder") else name for name in ANIMAL3D_26
)
"""The landmark of each of Animal3D's keypoints; other vocabularies are mapped onto the same names.

Its "shoulder" is the upper edge of the shoulder blade: SMAL's groups of vertices say so.
"""


def _stanfordextra() -> Keypoints:
    """The keypoints of StanfordExtra, in its order and spelling."""
    legs: dict[str, Sequence[str] | str | None] = {}
    for side in ("left", "right"):
        for place, rear, joints in (
            ("front", "front", ("paw", "wrist", "elbow")),
            ("back", "rear", ("paw", "hock", "knee")),
        ):
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


def _animalpose() -> Keypoints:
    """The keypoints of AnimalPose, whose "back elbow" is the knee, and "back knee" the hock."""
    legs = {
        "F_Elbow": "front_elbow",
        "B_Elbow": "back_knee",
        "F_Knee": "front_wrist",
        "B_Knee": "back_hock",
        "F_Paw": "front_paw",
        "B_Paw": "back_paw",
    }
    named: dict[str, Sequence[str] | str | None] = {
        "L_Eye": "left_eye",
        "R_Eye": "right_eye",
        "L_EarBase": ("left_ear_base", "left_ear"),
        "R_EarBase": ("right_ear_base", "right_ear"),
        "Nose": "nose",
        "Throat": "throat",
        "TailBase": "tail_base",
        "Withers": "withers",
    }
    for joint, place in legs.items():
        named |= {f"L_{joint}": f"left_{place}", f"R_{joint}": f"right_{place}"}
    return named


AP10K = {
    "left_eye": "left_eye", "right_eye": "right_eye", "nose": "nose", "neck": "neck",
    "root_of_tail": "tail_base",
    "left_shoulder": "left_front_elbow", "left_elbow": "left_front_wrist",
    "left_front_paw": "left_front_paw",
    "right_shoulder": "right_front_elbow", "right_elbow": "right_front_wrist",
    "right_front_paw": "right_front_paw",
    "left_hip": "left_back_knee", "left_knee": "left_back_hock", "left_back_paw": "left_back_paw",
    "right_hip": "right_back_knee", "right_knee": "right_back_hock",
    "right_back_paw": "right_back_paw",
}  # fmt: skip
"""AP-10K's, in its order and spelling, by the joints that its annotators marked.

Its "shoulder" and "hip" are where the leg leaves the trunk, at the elbow and the knee; its "elbow"
and "knee" are the bends below, at the wrist and the hock.
"""

SUPERANIMAL: Keypoints = {
    "nose": "nose", "upper_jaw": None, "lower_jaw": None, "mouth_end_right": "right_mouth",
    "mouth_end_left": "left_mouth",
    "right_eye": "right_eye", "right_earbase": "right_ear", "right_earend": None,
    "right_antler_base": None, "right_antler_end": None,
    "left_eye": "left_eye", "left_earbase": "left_ear", "left_earend": None,
    "left_antler_base": None, "left_antler_end": None,
    "neck_base": "neck", "neck_end": None, "throat_base": None, "throat_end": None,
    "back_base": None, "back_end": None,
    "back_middle": None, "tail_base": "tail_base", "tail_end": "tail_tip",
    "front_left_thai": "left_front_elbow", "front_left_knee": "left_front_wrist",
    "front_left_paw": "left_front_paw",
    "front_right_thai": "right_front_elbow", "front_right_knee": "right_front_wrist",
    "front_right_paw": "right_front_paw",
    "back_left_paw": "left_back_paw", "back_left_thai": "left_back_knee",
    "back_right_thai": "right_back_knee",
    "back_left_knee": "left_back_hock", "back_right_knee": "right_back_hock",
    "back_right_paw": "right_back_paw",
    "belly_bottom": None, "body_middle_right": None, "body_middle_left": None,
}  # fmt: skip
"""DeepLabCut's SuperAnimal-Quadruped, in its order and spelling.

Places that no landmark of ours is are None.
"""

VOCABULARIES = {
    name: vocabulary_from_names(name, keypoints)
    for name, keypoints in {
        "animal3d26": dict(zip(ANIMAL3D_26, ANIMAL3D_LANDMARKS, strict=True)),
        "stanfordextra24": _stanfordextra(),
        "animalpose20": _animalpose(),
        "ap10k17": AP10K,
        "superanimal39": SUPERANIMAL,
    }.items()
}
"""Name -> vocabulary, of all that are known."""


def find_vocabulary(vocabulary: str | Vocabulary) -> Vocabulary:
    """The vocabulary of a name, or the user's own as it is.

    Raises:
        ConfigError: the name is not known; lists those that are.

    Example:
        >>> len(find_vocabulary("ap10k17"))
        17
    """
    if isinstance(vocabulary, Vocabulary):
        return vocabulary
    if vocabulary not in VOCABULARIES:
        raise ConfigError(
            f"vocabulary must be one of {', '.join(VOCABULARIES)} or a Vocabulary of your own"
            f" (load_vocabulary), got {vocabulary!r}"
        )
    return VOCABULARIES[vocabulary]


def vocabulary_of_option(option: str) -> Vocabulary:
    """The vocabulary that a user names on the command line: a known one's name, or a TOML file.

    Raises:
        ConfigError: neither.

    """
    return (
        load_vocabulary(Path(option))
        if option.endswith(".toml") or Path(option).is_file()
        else find_vocabulary(option)
    )
