"""Matching of a file's keypoint names to a vocabulary: by names, never by positions."""

import difflib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from animal3dbox.errors import ConfigError
from animal3dbox.smal.keypoints.vocabularies import VOCABULARIES
from animal3dbox.smal.keypoints.vocabulary import Vocabulary

SLIP = 0.85
"""Likeness to a known name, by difflib's ratio, from which on another one is a slip of it."""
LEAST = 4
"""Fewer names than this, which are too few for a pose, do not tell a vocabulary."""

_LEGS = {
    f"{side}_{place}_{joint}": f"{side[0].upper()}_{place[0].upper()}_{joint.capitalize()}"
    for side in ("left", "right")
    for place in ("front", "back")
    for joint in ("elbow", "knee", "paw")
}
_EARS = {
    f"{side}_{ear}": f"{side[0].upper()}_EarBase"
    for side in ("left", "right")
    for ear in ("ear", "earbase", "ear_base")
}
SPELLINGS: Mapping[str, Mapping[str, str]] = {
    "animalpose20": {
        "left_eye": "L_Eye", "right_eye": "R_Eye", "nose": "Nose", "throat": "Throat",
        "withers": "Withers",
        "tailbase": "TailBase", "tail_base": "TailBase",
        **_EARS, **_LEGS,
    },
}  # fmt: skip
"""Vocabulary -> other spelling -> its keypoint.

AnimalPose's own json spells its names out, conversions abbreviate them.
"""


@dataclass(frozen=True)
class NameMatch:
    """The match of a file's keypoint names with a vocabulary.

    Attributes:
        vocabulary: what they are.
        columns: (J,) for each keypoint of the vocabulary its place among the names; None if it is
            not there.
        unused: names that the vocabulary does not have.

    Example:
        >>> match = match_by_name(["Nose", "Throat", "Withers", "TailBase"])
        >>> match.vocabulary.name, match.columns[4:6], match.is_exact
        ('animalpose20', (0, 1), False)
    """

    vocabulary: Vocabulary
    columns: tuple[int | None, ...]
    unused: tuple[str, ...]

    @property
    def is_exact(self) -> bool:
        """Whether both have the same keypoints."""
        return not self.unused and None not in self.columns

    def rows(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """The vocabulary's keypoints (J, 3) of points (N, 3) in the order of the file's names.

        Zeros for those that the file does not have.
        """
        return np.array(
            [(0.0, 0.0, 0.0) if column is None else points[column] for column in self.columns],
            dtype=np.float64,
        )


def match_by_name(names: Sequence[str], own: Vocabulary | None = None) -> NameMatch:
    """The vocabulary that a source's keypoint names belong to, and their order in it.

    Case, blanks, dashes and underscores are the same, and so are L_ and left_. A known vocabulary
    fits if it has all the names, or if the names have all of it: others are then unused. Of several
    the one with the very same names is taken, then the largest that is there in whole, then the
    smallest that holds them; those that mean different places by one name are not chosen between.

    Args:
        names: as the source lists them, in any order.
        own: the user's vocabulary, which must have every name.

    Raises:
        ConfigError: a name comes twice, or no vocabulary fits; gives the nearest names.

    Example:
        >>> match_by_name(["nose", "left_eye", "right_eye", "neck"]).vocabulary.name
        'ap10k17'
    """
    plain = [plain_name(name) for name in names]
    twice = sorted({name for name in names if plain.count(plain_name(name)) > 1})
    if twice:
        raise ConfigError(
            f"the keypoint names {', '.join(twice)} come more than once: there is no telling them"
            " apart"
        )
    if own is not None:
        match = _matched(names, own)
        if match.unused or not names:
            raise ConfigError(
                f"{_unknown(names, match)}; add them to the vocabulary {own.name} (name = [] for"
                " one that is nowhere on the body)"
            )
        return match
    matches = [_matched(names, vocabulary) for vocabulary in VOCABULARIES.values()]
    whole = [match for match in matches if None not in match.columns]
    within = [match for match in matches if not match.unused] if len(names) >= LEAST else []
    if not whole and not within:
        near = max(matches, key=lambda match: len(names) - len(match.unused))
        raise ConfigError(
            f"{_unknown(names, near)}; they are no known vocabulary ({', '.join(VOCABULARIES)}):"
            " rename them, or give a vocabulary of your own (--vocabulary, a TOML file:"
            " `animal3dbox vocabularies` shows one)"
        )
    if whole:
        return max(whole, key=lambda match: (match.is_exact, len(match.vocabulary)))
    _check_agreement(names, within)
    return min(within, key=lambda match: len(match.vocabulary))


def plain_name(name: str) -> str:
    """A keypoint's name without what programs write otherwise: case, blanks, dashes, L_ and R_.

    Example:
        >>> [plain_name(name) for name in ("LeftFrontPaw", "L_Front-Paw", "front paw left")]
        ['left_front_paw', 'left_front_paw', 'left_front_paw']
    """
    words = re.split(r"[\W_]+", re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name).casefold())
    words = [word for word in words if word]
    if len(words) > 1:
        for place in (0, -1):
            words[place] = {"l": "left", "r": "right"}.get(words[place], words[place])
        if words[-1] in ("left", "right") and words[0] not in ("left", "right"):
            words = [words[-1], *words[:-1]]
    return "_".join(words)


def is_misspelt(names: Sequence[str]) -> bool:
    """Whether keypoint names are an animal's but for slips of the pen, and there is one."""
    known = {plain_name(name) for words in VOCABULARIES.values() for name in words.keypoints}
    unknown = [name for name in map(plain_name, names) if name not in known]
    return bool(unknown) and all(
        difflib.get_close_matches(name, known, n=1, cutoff=SLIP) for name in unknown
    )


def _matched(names: Sequence[str], vocabulary: Vocabulary) -> NameMatch:
    """The match with one vocabulary, however bad."""
    keypoint_of = {plain_name(keypoint): keypoint for keypoint in vocabulary.keypoints}
    keypoint_of |= {keypoint.casefold(): keypoint for keypoint in vocabulary.keypoints}
    spelled = SPELLINGS.get(vocabulary.name, {})
    column_of: dict[str, int] = {}
    unused = []
    for i, name in enumerate(names):
        spellings = (name.casefold(), plain_name(name))
        known = ({**spelled, **keypoint_of}.get(spelling) for spelling in spellings)
        keypoint = next((keypoint for keypoint in known if keypoint), None)
        if keypoint is None or keypoint in column_of:
            unused.append(name)
        else:
            column_of[keypoint] = i
    columns = tuple(column_of.get(keypoint) for keypoint in vocabulary.keypoints)
    return NameMatch(vocabulary, columns, tuple(unused))


def _unknown(names: Sequence[str], match: NameMatch) -> str:
    """The names that a vocabulary does not have, with its nearest, for an error's beginning."""
    vocabulary, unknown = match.vocabulary, []
    for name in match.unused[:5]:
        keypoint_of = {plain_name(keypoint): keypoint for keypoint in vocabulary.keypoints}
        plain = plain_name(name)
        side = plain.partition("_")[0]
        of_its_side = [one for one in keypoint_of if one.partition("_")[0] == side]
        candidates = of_its_side if side in ("left", "right") and of_its_side else keypoint_of
        likest = difflib.get_close_matches(plain, candidates, n=2, cutoff=0.0)
        near = [keypoint_of[one] for one in likest]
        unknown.append(f"{name!r} (nearest: {', '.join(near)})")
    more = f" and {len(match.unused) - 5} more" if len(match.unused) > 5 else ""
    missing = ", ".join(unknown) + more if unknown else "only " + (", ".join(names) or "nothing")
    return f"the keypoint names have {missing}, of {len(names)}; nearest is {vocabulary.name}"


def _check_agreement(names: Sequence[str], matches: Sequence[NameMatch]) -> None:
    """Raise if two vocabularies mean different places by one of the names."""
    places: dict[str, tuple[str, tuple[str, ...]]] = {}
    for match in matches:
        for landmarks, column in zip(match.vocabulary.landmarks, match.columns, strict=True):
            if column is None:
                continue
            first, known = places.setdefault(names[column], (match.vocabulary.name, landmarks))
            if known and landmarks and not set(known) & set(landmarks):
                raise ConfigError(
                    f"the keypoint {names[column]!r} is another place in {first} than in"
                    f" {match.vocabulary.name}: give --vocabulary"
                )
