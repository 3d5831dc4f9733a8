"""Findings of checks of targets, and the report that counts them."""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field

from animal3dbox.errors import SampleError
from animal3dbox.plurals import counted
from animal3dbox.training.side_votes import SideVotes

CHECKS = {
    "dtype": "a field has another type than targets have",
    "shape": "a field has another shape",
    "count": "fields of one target disagree on the number of animals",
    "batch": "a field differs between the targets, so that they are no batch",
    "finite": "NaN or infinite values",
    "K": "K is not upper triangular with positive focal lengths and K[2, 2] = 1",
    "orthogonal": "rotation or R is no rotation",
    "handedness": "rotation or R has determinant -1",
    "H_out_in": "H_out_in is not invertible",
    "mirrored": "mirrored contradicts H_out_in",
    "size": "size is not positive",
    "distance": "distance is not that of center from the camera",
    "corners_3d": "corners are not those of center, rotation and size",
    "corner_order": "they are, in another order: a mirror, or another library's order",
    "projection": "corners_2d are not the projection of the cuboid by K and its lens",
    "corner_in_front": "a corner is said to be in front, or not, against its depth",
    "behind_camera": "behind_camera contradicts corner_in_front, or the depths",
    "opposite_faces": "two opposite faces are both visible",
    "face_visible": "a face is said to be visible, or not, against where the camera stands",
    "hidden_area": "a hidden face has an area, or an area is negative",
    "face_area": "areas are not those of the projected faces; together they fill the outline",
    "share_of_area": "face_share is not face_area over its sum",
    "shares": "shares are negative, of hidden faces, or do not add to 1 or 0",
    "flank": "flank is not 0, 1 or 2, or is the one that the camera does not see",
    "boxes": "a box has no area, or its corners are exchanged",
    "boxes_in_frame": "a box leaves the frame",
    "boxes_on_cuboid": "less than half of a box lies on the projected cuboid, or it lies in 0 to 1",
    "truncation": "truncation is not in 0 to 1, or not what the frame cuts off",
    "share_in_image": "face_share_in_image is not that of the parts in the frame",
    "labels": "a label is negative, or not below the number of classes where it is given",
    "twice": "two animals of a target are one and the same",
    "range": "a measure of an animal or its camera lies outside the range that was stated",
    "keypoints": "a keypoint outside the frame is marked, or a visibility negative",
    "keypoints_on_animal": "keypoints lie off their animal, or on it only if mirrored",
    "masks": "a mask is not 0 and 1, of another size than the image, or not that of its box",
}
"""Every check, by the name under which a report counts it."""

WARNINGS = {
    "principal_point": "the principal point of an image that was not augmented lies outside it",
    "unusual": "a measure lies outside what right targets, from which it was learned, have shown",
    "empty_box": (
        "a box on the frame's border has no area, and no cuboid says that its animal left the"
        " picture"
    ),
}
"""Checks whose failure is unusual and no fault: they are counted, never raised."""

EXAMPLES = 3
"""First faults of each check that a report keeps."""


@dataclass(frozen=True)
class Finding:
    """One check that failed on one target.

    Attributes:
        check: its name, one of CHECKS or WARNINGS.
        target: which target of the batch.
        animal: which of its animals; None for what concerns the image.
        field: the field that is wrong.
        problem: what is wrong and what to do.
    """

    check: str
    target: int
    animal: int | None
    field: str
    problem: str


@dataclass(frozen=True)
class TargetReport:
    """Counts over any number of batches; can be pickled, sent between processes and added.

    Attributes:
        targets: targets that were looked at.
        animals: animals in them.
        counts: how many targets or animals failed each check; only those above 0.
        warnings: likewise what is unusual, and no fault.
        examples: the first faults of each check, as errors that name sample and field.
        labels: how many animals of each class number were among those counted for statistics: all
            without the number of a step, of every sixteenth step in a training loop.
        spans: measure -> least and greatest value of these animals (docs/checks.md).
        sides: of these animals, how often each pair of keypoints lies as its names say;
            ``sides.warnings`` are sentences on those that do not.
        left_picture: how many of these animals a transform moved out of the picture and kept.

    Example:
        >>> epoch = TargetReport(targets=16, animals=30) + TargetReport(targets=16, animals=41)
        >>> print(epoch)
        32 targets, 71 animals: 0 faults
    """

    targets: int = 0
    animals: int = 0
    counts: Counter[str] = field(default_factory=Counter)
    warnings: Counter[str] = field(default_factory=Counter)
    examples: tuple[tuple[str, SampleError], ...] = ()
    labels: Counter[int] = field(default_factory=Counter)
    spans: dict[str, tuple[float, float]] = field(default_factory=dict)
    sides: SideVotes = field(default_factory=SideVotes)
    left_picture: int = 0

    @property
    def faults(self) -> int:
        """How many faults there are in all."""
        return self.counts.total()

    def __add__(self, other: "TargetReport") -> "TargetReport":
        """The report of the batches of both."""
        return TargetReport(
            self.targets + other.targets,
            self.animals + other.animals,
            self.counts + other.counts,
            self.warnings + other.warnings,
            first_examples((*self.examples, *other.examples)),
            self.labels + other.labels,
            joined_spans(self.spans, other.spans),
            self.sides + other.sides,
            self.left_picture + other.left_picture,
        )

    def __str__(self) -> str:
        checked = f"{counted(self.targets, 'target')}, {counted(self.animals, 'animal')}"
        lines = [f"{checked}: {counted(self.faults, 'fault')}"]
        lines += [f"  {count} x {check}" for check, count in self.counts.most_common()]
        lines += [f"  warning: {count} x {check}" for check, count in self.warnings.most_common()]
        lines += [f"  warning: {sentence}" for sentence in self.sides.warnings]
        lines += [f"  {check}: {error}" for check, error in self.examples]
        if self.sides.mended:
            lines.append(
                f"  {self.sides.mended} labels exchanged left and right of their file's keypoints"
            )
        if self.left_picture:
            lines.append(
                f"  {self.left_picture} animals left the picture and have empty boxes, which some"
                " detectors refuse: the transforms' min_visible drops them"
            )
        if self.labels:
            animals = ", ".join(f"{number}: {n}" for number, n in sorted(self.labels.items()))
            lines.append(f"  animals by label: {animals}")
        lines += [f"  {name}: {low:.4g} to {high:.4g}" for name, (low, high) in self.spans.items()]
        return "\n".join(lines)


def joined_spans(
    first: dict[str, tuple[float, float]], other: dict[str, tuple[float, float]]
) -> dict[str, tuple[float, float]]:
    """The spans of the values of both."""
    spans = dict(first)
    for name, (low, high) in other.items():
        own_low, own_high = spans.get(name, (low, high))
        spans[name] = (min(own_low, low), max(own_high, high))
    return spans


def first_examples(
    examples: Iterable[tuple[str, SampleError]],
) -> tuple[tuple[str, SampleError], ...]:
    """The first EXAMPLES of each check."""
    counts: Counter[str] = Counter()
    first = []
    for check, error in examples:
        counts[check] += 1
        if counts[check] <= EXAMPLES:
            first.append((check, error))
    return tuple(first)
