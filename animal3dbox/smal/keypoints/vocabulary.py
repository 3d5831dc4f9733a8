"""Keypoint vocabularies: the landmark of each keypoint of a dataset, and its mirror image."""

import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec
from torch import Tensor

from animal3dbox.errors import ConfigError
from animal3dbox.geometry.arrays import AnyArray
from animal3dbox.smal.keypoints.known_places import KNOWN_PLACES, nearest_places
from animal3dbox.smal.keypoints.landmark_places import LandmarkPlaces

Groups = Mapping[str, Sequence[int] | Tensor]
"""Landmark name -> vertex ids, or weights (V,)."""

OLD_SHOULDERS = ("left_shoulder", "right_shoulder")
"""Landmarks of files from before the shoulder's blade and its point had names of their own."""


def aliases(landmark: str) -> tuple[str, ...]:
    """The names of groups of vertices that a landmark can be read off, best first.

    A body whose groups say only "left_shoulder" has one place for the blade and the point; a
    vocabulary that says so means the point, or the blade of a body that has no other.

    Example:
        >>> aliases("left_shoulder_blade"), aliases("nose")
        (('left_shoulder_blade', 'left_shoulder'), ('nose',))
    """
    if landmark in OLD_SHOULDERS:
        return landmark, f"{landmark}_point", f"{landmark}_blade"
    old, _, place = landmark.rpartition("_")
    is_shoulder = old in OLD_SHOULDERS and place in ("blade", "point")
    return (landmark, old) if is_shoulder else (landmark,)


@dataclass(frozen=True)
class Vocabulary:
    """The keypoints of a dataset: their names, their places on a body, and their mirror images.

    Attributes:
        name: what the vocabulary is called.
        keypoints: (J,) the dataset's own names, in its order.
        landmarks: (J,) for each keypoint the places on the body that it can be read off, best
            first: a landmark's name, "joint:NAME", "vertex:12" or "vertices:12+13"; none if the
            body has no such place.
        flip: (J,) the index of each keypoint's mirror image; itself in the middle of the body.

    Raises:
        ConfigError: the attributes do not fit together, or a left keypoint lies on the right.

    Example:
        >>> own = Vocabulary("own", ("L_Ear", "R_Ear"), (("left_ear",), ("right_ear",)), (1, 0))
        >>> own.sides, own.index_of("right_ear")
        (('left', 'right'), 1)
    """

    name: str
    keypoints: tuple[str, ...]
    landmarks: tuple[tuple[str, ...], ...]
    flip: tuple[int, ...]

    def __post_init__(self) -> None:
        if (
            not len(self.keypoints)
            == len(self.landmarks)
            == len(self.flip)
            == len(set(self.keypoints))
        ):
            raise ConfigError(
                f"vocabulary {self.name}: keypoints, landmarks and flip must have one entry a"
                " keypoint, and names must differ"
            )
        if sorted(self.flip) != list(range(len(self.flip))) or any(
            self.flip[self.flip[i]] != i for i in range(len(self.flip))
        ):
            raise ConfigError(
                f"vocabulary {self.name}: flip must be a permutation that undoes itself, got"
                f" {self.flip}"
            )
        for keypoint, names, side in zip(self.keypoints, self.landmarks, self.sides, strict=True):
            crossed = [name for name in names if side_of(name) not in (side, None)]
            if crossed and side_of(keypoint) is not None:
                raise ConfigError(
                    f"vocabulary {self.name}: keypoint {keypoint!r} is {side}, but its landmark"
                    f" {crossed[0]!r} is not"
                )
        for i, (keypoint, side) in enumerate(zip(self.keypoints, self.sides, strict=True)):
            if side is not None and self.flip[i] == i:
                raise ConfigError(
                    f"vocabulary {self.name}: keypoint {keypoint!r} is {side}"
                    f" ({', '.join(self.landmarks[i])}), but is its own mirror image: say in [flip]"
                    " which keypoint is the one of the other side"
                )
            self._check_twin(i)

    def _check_twin(self, i: int) -> None:
        """Raise a ConfigError if a keypoint's mirror image is another place of the body."""
        own, twin = self.landmarks[i], self.landmarks[self.flip[i]]
        mirrored = {swap_sides(name) for name in own if ":" not in name}
        known = {name for name in twin if ":" not in name}
        if mirrored and known and not mirrored & known:
            raise ConfigError(
                f"vocabulary {self.name}: {self.keypoints[i]!r} is at {own[0]}, but its mirror"
                f" image {self.keypoints[self.flip[i]]!r} at {twin[0]}: say in [flip] which"
                " keypoint is at the same place of the other side"
            )

    def __len__(self) -> int:
        return len(self.keypoints)

    @property
    def sides(self) -> tuple[str | None, ...]:
        """The side (J,) of each keypoint: "left", "right", or None in the middle of the body.

        By the keypoint's own name, else by its landmark's.
        """
        return tuple(
            side_of(k) or next((side_of(name) for name in names), None)
            for k, names in zip(self.keypoints, self.landmarks, strict=True)
        )

    @property
    def notes(self) -> tuple[str, ...]:
        """Whole sentences about landmarks that may not be what was meant; usually none."""
        notes = [
            f"The vocabulary {self.name} names the place {name!r} of {keypoint!r}, which is on no"
            f" body but perhaps one of your own (nearest: {nearest_places(name)})."
            for keypoint, names in zip(self.keypoints, self.landmarks, strict=True)
            for name in names
            if ":" not in name and not any(alias in KNOWN_PLACES for alias in aliases(name))
        ]
        if any(name in OLD_SHOULDERS for names in self.landmarks for name in names):
            notes.append(
                f"The vocabulary {self.name} says left_shoulder or right_shoulder, which is taken"
                " for the point of the shoulder, the joint, as before: say left_shoulder_point if"
                " it is that, or left_shoulder_blade if it is the upper edge of the blade."
            )
        return tuple(notes)

    def index_of(self, landmark: str) -> int | None:
        """The keypoint that a landmark is best read as, or None if the vocabulary has none."""
        return next((i for i, names in enumerate(self.landmarks) if landmark in names), None)

    def on_body(self, groups: Groups, vertices: AnyArray) -> AnyArray:
        """The keypoints (J, 3) of a body.

        Args:
            groups: landmark name -> vertex ids, whose mean it is, or weights (V,) of all vertices,
                as a joint has.
            vertices: (V, 3) in any frame.

        Returns:
            (J, 3) in the same frame; NaN for a keypoint that the body has no place for.

        Raises:
            ConfigError: a keypoint names a vertex that the body does not have, or a place that
                neither this body has nor any other.

        """
        return LandmarkPlaces.of(self.places(groups, len(vertices)), len(vertices)).read(vertices)

    def places(self, groups: Groups, n_vertices: int) -> list[Sequence[int] | Tensor | None]:
        """The place (J,) of each keypoint: vertex ids, weights (V,), or None; see on_body."""
        places: list[Sequence[int] | Tensor | None] = []
        for keypoint, names in zip(self.keypoints, self.landmarks, strict=True):
            known = (
                groups.get(alias, _vertex_ids(alias)) for name in names for alias in aliases(name)
            )
            place = next((place for place in known if place is not None), None)
            self._check_known(keypoint, names, groups)
            ids = () if place is None or isinstance(place, Tensor) else place
            if not all(0 <= i < n_vertices for i in ids):
                raise ConfigError(
                    f"vocabulary {self.name}: keypoint {keypoint!r} is at vertices {list(ids)},"
                    f" but the body has {n_vertices}"
                )
            places.append(place)
        return places

    def _check_known(self, keypoint: str, names: Sequence[str], groups: Groups) -> None:
        """Raise a ConfigError for a keypoint whose places are none that a body could have."""
        joints = [name for name in groups if name.startswith("joint:")]
        unknown = [
            name
            for name in names
            if not any(alias in KNOWN_PLACES or alias in groups for alias in aliases(name))
            and (":" not in name or (name.startswith("joint:") and joints))
        ]
        if unknown and len(unknown) == len(names):
            raise ConfigError(
                f"vocabulary {self.name}: keypoint {keypoint!r} is at {unknown[0]!r}, which no body"
                f" has (nearest: {nearest_places(unknown[0], joints)}); say [] for a keypoint that"
                " is not on the body"
            )


def _vertex_ids(name: str) -> tuple[int, ...] | None:
    """The ids of "vertex:12" or "vertices:12+13"; None for any other name."""
    kind, _, ids = name.partition(":")
    return tuple(int(i) for i in ids.split("+")) if kind in ("vertex", "vertices") else None


_SIDE = re.compile(r"(?<![A-Za-z])(left|right|[LR](?=_))(?![a-z])|(?<![A-Z])(Left|Right)(?![a-z])")
_TWIN = {"left": "right", "Left": "Right", "L": "R", "right": "left", "Right": "Left", "R": "L"}


def side_of(name: str) -> str | None:
    """The side that a name says as a word of its own (left, Left, L_): "left", "right" or None."""
    word = _SIDE.search(name)
    return None if word is None else ("left" if word.group()[0] in "lL" else "right")


def swap_sides(name: str) -> str:
    """The name of the same place on the other side of the body."""
    return _SIDE.sub(lambda word: _TWIN[word.group()], name, count=1)


def vocabulary_from_names(
    name: str,
    keypoints: Mapping[str, Sequence[str] | str | None],
    pairs: Mapping[str, str] | None = None,
) -> Vocabulary:
    """A vocabulary whose keypoints say left and right in their names, or by their places.

    Args:
        name: what to call it.
        keypoints: in order, each keypoint's name -> the landmark(s) it is, or None.
        pairs: keypoint -> its mirror image, where the names do not say left and right.

    Returns:
        The vocabulary; its flip pairs the names that differ only in left and right, and those
        without a side whose places do.

    Raises:
        ConfigError: a name says a side, but its twin is missing.

    Example:
        >>> own = vocabulary_from_names(
        ...     "own", {"left_ear": "left_ear", "nose": "nose", "right_ear": "right_ear"}
        ... )
        >>> own.flip
        (2, 1, 0)
    """
    names = tuple(keypoints)
    landmarks = tuple(
        (value,) if isinstance(value, str) else tuple(value or ()) for value in keypoints.values()
    )
    partners = dict(pairs or {}) | {b: a for a, b in (pairs or {}).items()}
    flip = []
    for keypoint in names:
        partner = partners.get(keypoint) or _twin_of(keypoint, names, landmarks)
        if partner not in names:
            raise ConfigError(
                f"vocabulary {name}: {keypoint!r} has no twin {partner!r}: name it, or say in flip"
                " whose mirror image it is"
            )
        flip.append(names.index(partner))
    return Vocabulary(name, names, landmarks, tuple(flip))


def _twin_of(keypoint: str, names: Sequence[str], landmarks: Sequence[tuple[str, ...]]) -> str:
    """The name of a keypoint's mirror image, by its own name, else by the places of both.

    Of "LF_paw" at left_front_paw it is the one other keypoint at right_front_paw whose name says no
    side either; itself if there is none.
    """
    if side_of(keypoint) is not None:
        return swap_sides(keypoint)
    own = landmarks[names.index(keypoint)][:1]
    if not own or side_of(own[0]) is None:
        return keypoint
    silent = [
        (name, places[0])
        for name, places in zip(names, landmarks, strict=True)
        if places and side_of(name) is None
    ]
    twins = [name for name, place in silent if place == swap_sides(own[0])]
    is_alone = [place for _, place in silent].count(own[0]) == 1
    return twins[0] if is_alone and len(twins) == 1 else keypoint


def load_vocabulary(path: Path) -> Vocabulary:
    """Read a user's vocabulary from a small TOML file.

    The file holds ``name``; ``[keypoints]``, in the order of the data, name = landmark, a list of
    landmarks of which the first that the body has is taken, or [] for none; ``[flip]``, left =
    right, where neither names nor landmarks say their side.

    Raises:
        ConfigError: no such file, not TOML, or no vocabulary.

    Example:
        >>> from tempfile import TemporaryDirectory
        >>> with TemporaryDirectory() as folder:
        ...     file = Path(folder, "own.toml")
        ...     _ = file.write_text('name = "own"' + chr(10) + 'keypoints = {snout = "nose"}')
        ...     load_vocabulary(file).keypoints
        ('snout',)
    """
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
        parsed = msgspec.convert(content, _VocabularyFile)
    except OSError as error:
        raise ConfigError(f"{path} cannot be read: {error}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, msgspec.ValidationError) as error:
        raise ConfigError(f"{path} is no vocabulary: {error}") from error
    return vocabulary_from_names(parsed.name, parsed.keypoints, parsed.flip)


class _VocabularyFile(msgspec.Struct, forbid_unknown_fields=True):
    """The TOML file of a user's vocabulary."""

    name: str
    keypoints: dict[str, str | list[str]]
    flip: dict[str, str] = {}
