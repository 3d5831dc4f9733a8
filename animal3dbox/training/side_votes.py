"""Votes of keypoints' sides against their cuboids, counted over an epoch.

A cuboid says where an animal's left is. Of two keypoints that mirror each other the left one must
lie to the left of the right one; legs swing and cross, so that one pair of one animal proves
nothing, but over many animals a pair whose names were exchanged stands out, and so do single
animals all of whose pairs lie the other way round.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from animal3dbox.training.checked_fields import Target, meta_of
from animal3dbox.training.packed import Floats, Packed

APART, SPREAD = 0.45, (0.22, 0.25, 0.16)
"""How far a pair's keypoints lie apart across the body, and how much the way from one to the other
varies along, across and up: parts of length, width and height."""
NOISE = 0.01
"""Of a keypoint's place, as a part of the projected cuboid's diagonal."""
DECIDED_PAIR, DECIDED_ANIMAL = 3.0, 6.0
"""Log odds from which a pair, or all pairs of an animal, have a vote."""
FEWEST_VOTES = 30
"""Votes below which nothing is said of a pair, or of all animals."""
SIGMAS = 3.0
"""Standard deviations by which a share of votes must pass its limit."""
USUAL_OF_PAIRS, USUAL_OF_ANIMALS = 0.05, 0.02
"""The share of votes against right names that legs which cross explain."""
SIGNS: dict[str | None, float] = {"left": 1.0, "right": -1.0}
AS_GIVEN = "as given"
"""The labeling of a label that took the sides of its file as they are."""


@dataclass(frozen=True)
class SideVotes:
    """Votes on which of two keypoints is the left one; of several batches they add up.

    Attributes:
        pairs: (j, k, whether j is the left one) -> animals that say so; j < k.
        animals: whether an animal's pairs together lie the other way round than their names say
            -> animals; empty where targets do not say which keypoints are left.
        sides: the side of each keypoint, "left", "right" or None; empty if unknown.
        mended: labels that exchanged the sides of their file themselves.

    Example:
        >>> votes = SideVotes(Counter({(3, 4, True): 80, (3, 4, False): 20}))
        >>> print(*votes.warnings)
        keypoints 3 and 4 lie the other way round in 20 of 100 animals that tell: were left and \
right exchanged there?
    """

    pairs: Counter[tuple[int, int, bool]] = field(default_factory=Counter)
    animals: Counter[bool] = field(default_factory=Counter)
    sides: tuple[str | None, ...] = ()
    mended: int = 0

    def __add__(self, other: "SideVotes") -> "SideVotes":
        """The votes of both; sides are unknown where they differ."""
        known = [votes.sides for votes in (self, other) if votes.pairs or votes.sides]
        sides = known[0] if known and all(one == known[0] for one in known) else ()
        return SideVotes(
            self.pairs + other.pairs,
            self.animals + other.animals,
            sides,
            self.mended + other.mended,
        )

    @property
    def warnings(self) -> tuple[str, ...]:
        """Whole sentences on exchanged sides; none where all is as it should be."""
        return (*self._of_animals(), *self._of_pairs())

    def _of_animals(self) -> list[str]:
        """The sentence on animals all of whose keypoints lie the other way round."""
        against, total = self.animals[True], self.animals.total()
        if not passes(against, total, USUAL_OF_ANIMALS):
            return []
        return [
            f"the keypoints of {against} of {total} animals that tell lie on the other side than"
            " their names say: were left and right exchanged in their annotations, or by a flip"
            " that renamed keypoints or boxes only?"
        ]

    def _of_pairs(self) -> list[str]:
        """A sentence on each pair of keypoints that lie the other way round too often."""
        sentences = []
        for j, k in sorted({(j, k) for j, k, _ in self.pairs}):
            first, second = self.pairs[j, k, True], self.pairs[j, k, False]
            against = min(first, second)
            if self.sides and self.sides[j] is not None:
                against = second if self.sides[j] == "left" else first
            if passes(against, first + second, USUAL_OF_PAIRS):
                sentences.append(
                    f"keypoints {j} and {k} lie the other way round in {against} of"
                    f" {first + second} animals that tell: were left and right exchanged there?"
                )
        return sentences


def passes(count: int, total: int, usual: float) -> bool:
    """Whether a share of votes lies above what is usual, by more than chance explains.

    Example:
        >>> passes(10, 100, 0.05), passes(30, 100, 0.05), passes(3, 3, 0.05)
        (False, True, False)
    """
    if total < FEWEST_VOTES:
        return False
    spread = np.sqrt(usual * (1 - usual) * total)
    return bool(count > usual * total + SIGMAS * spread)


def side_votes(packed: Packed) -> SideVotes:
    """The votes of some targets; none without keypoints, their counterparts, K and cuboids."""
    votes = SideVotes(mended=sum(map(mended_labels, packed.targets)))
    if packed.keypoints is None or not packed.has_box or packed.K is None or packed.outline is None:
        return votes
    names = [(pairs_of(target), sides_of(target)) for target in packed.targets]
    for pairs, sides in dict.fromkeys(names):
        if pairs and max(map(max, pairs)) < packed.keypoints.shape[1]:
            same = np.array([name == (pairs, sides) for name in names])
            odds = left_odds(packed, np.array(pairs)) * same[packed.owner, None]
            votes += counted(odds, pairs, sides)
    return votes


def counted(
    odds: Floats, pairs: Sequence[tuple[int, int]], sides: tuple[str | None, ...]
) -> SideVotes:
    """The votes that log odds (N, P) make, and those of whole animals if sides are known."""
    votes = Counter[tuple[int, int, bool]]()
    for (j, k), column in zip(pairs, odds.T, strict=True):
        votes[j, k, True] = int((column > DECIDED_PAIR).sum())
        votes[j, k, False] = int((column < -DECIDED_PAIR).sum())
    if len(sides) <= max(map(max, pairs)):
        return SideVotes(+votes)
    whole = odds @ np.array([SIGNS.get(sides[j], 0.0) for j, _ in pairs])
    agree, differ = int((whole > DECIDED_ANIMAL).sum()), int((whole < -DECIDED_ANIMAL).sum())
    return SideVotes(+votes, +Counter({False: agree, True: differ}), sides)


def left_odds(packed: Packed, pairs: NDArray[np.intp]) -> Floats:
    """Log odds (N, P) that the first keypoint of each pair is the left one; 0 where unknown.

    With A = d(px)/d(box) at the cuboid's centre, (2, 3), a way w between the keypoints in the box
    shows as A w. For w normal about (0, +m, 0) or (0, -m, 0) with covariance S the log odds of the
    two are 2 m a_y^T C^-1 d, where d is the way in pixels and C = A S A^T + noise.

    Args:
        packed: targets with keypoints, K and cuboids.
        pairs: (P, 2) keypoints that mirror each other.
    """
    keypoints = np.asarray(packed.keypoints)
    shown = _image_axes(packed)
    low, high = packed.outline or (np.zeros((packed.count, 2)),) * 2
    noise_px = NOISE * np.linalg.norm(high - low, axis=1) + 1.0
    covariance = np.einsum("nai,i,nbi->nab", shown, np.square(SPREAD), shown)
    covariance += 2 * np.square(noise_px)[:, None, None] * np.eye(2)
    weights = 2 * APART * np.linalg.solve(covariance, shown[:, :, 1:2])[..., 0]
    way = keypoints[:, pairs[:, 0], :2] - keypoints[:, pairs[:, 1], :2]
    both = (keypoints[:, pairs, 2] > 0).all(2)
    usable = both & np.asarray(packed.all_in_front, dtype=np.bool_)[:, None]
    return np.where(usable, np.einsum("npa,na->np", way, weights), 0.0)


def _image_axes(packed: Packed) -> Floats:
    """How pixels move (N, 2, 3) with a step along, across and up the cuboid, in its own sides."""
    K, center = np.asarray(packed.K), packed.floats["center"]
    axes = K @ (packed.floats["rotation"] * packed.floats["size"][:, None])
    point = np.einsum("nij,nj->ni", K, center)
    depth = np.where(np.abs(point[:, 2:]) < 1e-9, 1e-9, point[:, 2:])
    px = point[:, :2] / depth
    return np.asarray((axes[:, :2] - px[:, :, None] * axes[:, 2:]) / depth[:, :, None])


def pairs_of(target: Target) -> tuple[tuple[int, int], ...]:
    """The pairs of a target's keypoints that mirror each other, the lesser index first."""
    mirror = target.get("keypoint_mirror")
    counterparts = [] if mirror is None else np.asarray(mirror).tolist()
    return tuple((j, k) for j, k in enumerate(counterparts) if j < k)


def sides_of(target: Target) -> tuple[str | None, ...]:
    """The side of each keypoint, as its book-keeping says; empty if it does not."""
    sides = meta_of(target).get("keypoint_sides")
    return tuple(sides) if isinstance(sides, tuple | list) else ()


def mended_labels(target: Mapping[str, Any]) -> int:
    """How many of a target's labels exchanged the sides that their file gave."""
    quality = meta_of(target).get("quality")
    records = quality if isinstance(quality, tuple | list) else ()
    return sum(
        isinstance(record, Mapping) and record.get("labeling", AS_GIVEN) != AS_GIVEN
        for record in records
    )
