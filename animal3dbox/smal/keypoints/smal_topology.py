"""SMAL's public topology: the vertices of its keypoints, the names and the tree of its joints."""

from collections.abc import Mapping, Sequence

from torch import Tensor

SMAL_VERTICES = 3889
"""How many vertices the models have that these facts are about."""
SMAL_FACES = 7774
"""How many triangles they have."""

SMAL_LANDMARKS: dict[str, tuple[int, ...]] = {
    "left_eye": (1068, 1080, 1029, 1226),
    "right_eye": (2660, 3030, 2675, 3038),
    "chin": (910,),
    "left_front_paw": (360, 1203, 1235, 1230),
    "right_front_paw": (3188, 3156, 2327, 3183),
    "left_back_paw": (1976, 1974, 1980, 856),
    "right_back_paw": (3854, 2820, 3852, 3858),
    "tail_base": (452, 1811),
    "left_front_elbow": (416, 235, 182),
    "right_front_elbow": (2156, 2382, 2203),
    "left_back_knee": (829,),
    "right_back_knee": (2793,),
    "left_shoulder_blade": (60, 114, 186, 59),
    "right_shoulder_blade": (2091, 2037, 2036, 2160),
    "left_front_wrist": (384, 799, 1169, 431),
    "right_front_wrist": (2351, 2763, 2397, 3127),
    "left_back_hock": (221, 104),
    "right_back_hock": (2754, 2192),
    "neck": (191, 1158, 3116, 2165),
    "tail_tip": (28, 1109, 1110, 1111, 1835, 1836, 3067, 3068, 3069),
    "left_ear": (498, 499, 500, 501, 502, 503),
    "right_ear": (2463, 2464, 2465, 2466, 2467, 2468),
    "left_mouth": (764, 915, 916, 917, 934, 935, 956),
    "right_mouth": (2878, 2879, 2880, 2897, 2898, 2919, 3751),
    "nose": (1039, 1845, 1846, 1870, 1879, 1919, 2997, 3761, 3762),
    "tail_middle": (0, 464, 465, 726, 1824, 2429, 2430, 2690),
}
"""Keypoint -> vertex ids, in Animal3D's order."""

SMAL_EXTRA_LANDMARKS: dict[str, tuple[int, ...]] = {
    "left_ear_tip": (542,),
    "right_ear_tip": (2507,),
}

_LEGS = tuple(f"{side}{part}" for side in "LR" for part in ("Leg1", "Leg2", "Leg3", "Foot"))
_BACK_LEGS = tuple(
    f"{side}{part}" for side in "LR" for part in ("LegBack1", "LegBack2", "LegBack3", "FootBack")
)
SMAL_JOINTS = (
    *("pelvis", "pelvis0", "spine", "spine0", "spine1", "spine2", "spine3"),
    *(*_LEGS, "Neck", "Head", *_BACK_LEGS),
    *("Tail1", "Tail2", "Tail3", "Tail4", "Tail5", "Tail6", "Tail7", "Mouth", "LEar", "REar"),
)
"""The joints of the 35-joint files; those of 2017 end at the mouth."""

SMAL_PARENTS = (
    *(-1, 0, 1, 2, 3, 4, 5),
    *(6, 7, 8, 9, 6, 11, 12, 13, 6, 15),
    *(0, 17, 18, 19, 0, 21, 22, 23),
    *(0, 25, 26, 27, 28, 29, 30, 16, 16, 16),
)


def joint_names(parents: tuple[int, ...]) -> tuple[str, ...]:
    """SMAL's names if the tree is SMAL's, with ears or without; else joint0, joint1, ..."""
    count = len(parents)
    if count in (33, 35) and parents == SMAL_PARENTS[:count]:
        return SMAL_JOINTS[:count]
    return tuple(f"joint{j}" for j in range(count))


def misplaced_sides(v_template: Tensor, landmarks: Mapping[str, Sequence[int]]) -> tuple[str, ...]:
    """The left landmarks that lie no further left than their right twins.

    Any such means that the vertices are not in the order for which the landmarks were made, or that
    the frame is another.

    Args:
        v_template: (V, 3) with y to the animal's left.
        landmarks: name -> vertex ids.

    """
    y = {name: float(v_template[list(ids), 1].mean()) for name, ids in landmarks.items()}
    twins = {name: name.replace("left_", "right_") for name in y if name.startswith("left_")}
    return tuple(name for name, twin in twins.items() if twin in y and y[name] <= y[twin])
