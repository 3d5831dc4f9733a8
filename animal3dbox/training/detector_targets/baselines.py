"""Detectors that look at no pixels: what any trained one must beat.

Both are told the true 2D boxes and classes of an image and its K, and answer in a target's field
names, as BoxMetrics takes them.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from animal3dbox.errors import ConfigError, SampleError
from animal3dbox.geometry.rigid_transforms import nearest_rotation
from animal3dbox.training.detector_targets.box_coder import BoxCoder
from animal3dbox.training.detector_targets.rotations import rotation_from_6d, rotation_to_6d

Fields = Mapping[str, Any]
Features = Callable[[Fields], Tensor]
"""From a target to numbers (N, F) of its animals, by which like ones are found."""


def box_features(target: Fields) -> Tensor:
    """Where a 2D box lies and how large it is, in units of the focal length, (N, 4)."""
    boxes, K = target["boxes"].double(), target["K"].double()
    focal, principal = K[..., [0, 1], [0, 1]], K[..., :2, 2]
    middle = ((boxes[:, :2] + boxes[:, 2:]) / 2 - principal) / focal
    return torch.cat((middle, ((boxes[:, 2:] - boxes[:, :2]) / focal).log()), dim=1)


@dataclass(frozen=True, kw_only=True)
class EncodedAnimals:
    """The encoded animals of a training set, M of them.

    Attributes:
        fields: those of BoxCoder.encode that all targets have, each (M, ...).
        labels: (M,) their classes.
        features: (M, F).
    """

    fields: dict[str, Tensor]
    labels: Tensor
    features: Tensor

    @classmethod
    def of(cls, coder: BoxCoder, targets: Sequence[Fields], features: Features) -> "EncodedAnimals":
        """Encode all animals that can be encoded; raises ConfigError if there are none."""
        encoded, labels, numbers = [], [], []
        for target in targets:
            fields = coder.encode(target)
            keep = fields.pop("encodable")
            encoded.append({name: value[keep].double() for name, value in fields.items()})
            labels.append(_labels(target)[keep])
            numbers.append(features(target)[keep].double())
        if not sum(map(len, labels)):
            raise ConfigError("there is no animal to learn from: no target has one in front of K")
        names = set.intersection(*(set(fields) for fields in encoded))
        joined = {name: torch.cat([fields[name] for fields in encoded]) for name in sorted(names)}
        return cls(fields=joined, labels=torch.cat(labels), features=torch.cat(numbers))


@dataclass(frozen=True, kw_only=True)
class ConstantBaseline:
    """Says the same of every animal of a class: the mean of the encoded training animals.

    The rotation is their chordal mean; centre, depth and size are means of what BoxCoder encodes,
    so sizes and depths are geometric means.

    Attributes:
        coder: by which the animals are encoded.
        means: class -> the mean of each encoded field.

    Example:
        >>> target = {
        ...     "center": torch.tensor([[0.0, 0, 4], [0, 0, 9]]),
        ...     "rotation": torch.eye(3).repeat(2, 1, 1),
        ...     "size": torch.tensor([[1.0, 1, 1], [4.0, 1, 1]]),
        ...     "boxes": torch.tensor([[40.0, 40, 60, 60]]).repeat(2, 1),
        ...     "K": torch.tensor([[100.0, 0, 50], [0, 100, 50], [0, 0, 1]]),
        ... }
        >>> prediction = ConstantBaseline.fit(BoxCoder(), [target]).predict(target)
        >>> prediction["center"].round(decimals=3)[1].tolist()  # of depths 4 and 9
        [0.0, 0.0, 6.0]
    """

    coder: BoxCoder
    means: dict[int, dict[str, Tensor]]

    @classmethod
    def fit(cls, coder: BoxCoder, targets: Sequence[Fields]) -> "ConstantBaseline":
        """Learn from targets; see BoxCoder.encode for their fields.

        Raises:
            ConfigError: they have no animal that can be encoded.
            SampleError: a field is missing or of the wrong shape.

        """
        animals = EncodedAnimals.of(coder, targets, box_features)
        means = {}
        for label in sorted(set(animals.labels.tolist())):
            mine = animals.labels == label
            mean = {name: value[mine].mean(0) for name, value in animals.fields.items()}
            rotations = rotation_from_6d(animals.fields["rotation_6d"][mine])
            mean["rotation_6d"] = rotation_to_6d(nearest_rotation(rotations.mean(0)))
            means[label] = mean
        return cls(coder=coder, means=means)

    def predict(self, target: Fields) -> dict[str, Tensor]:
        """The predictions for an image, of which `boxes`, `labels` and `K` are looked at.

        Returns:
            A prediction as BoxMetrics takes it; all `scores` are 1.

        Raises:
            SampleError: an animal is of a class that was not learned.

        """
        labels = _labels(target).tolist()
        for animal, label in enumerate(labels):
            _check_class(target, animal, label, self.means)
        any_mean = next(iter(self.means.values()))
        encoded = {
            name: torch.stack([self.means[label][name] for label in labels])
            if labels
            else value.new_zeros(0, *value.shape)
            for name, value in any_mean.items()
        }
        return _decoded(self.coder, encoded, target, torch.ones(len(labels), dtype=torch.float64))


@dataclass(frozen=True, kw_only=True)
class NearestNeighbourBaseline:
    """Says of an animal what is true of the training animal of its class that is most like it.

    Attributes:
        coder: by which the animals are encoded.
        animals: those of the training set.
        features: by which animals are alike: the place and size of the 2D box in units of the focal
            length, or your own, as of an image network.

    Example:
        >>> target = {
        ...     "center": torch.tensor([[0.0, 0, 4], [0, 0, 9]]),
        ...     "rotation": torch.eye(3).repeat(2, 1, 1),
        ...     "size": torch.tensor([[1.0, 1, 1], [4.0, 1, 1]]),
        ...     "boxes": torch.tensor([[40.0, 40, 60, 60], [45.0, 45, 55, 55]]),
        ...     "K": torch.tensor([[100.0, 0, 50], [0, 100, 50], [0, 0, 1]]),
        ... }
        >>> baseline = NearestNeighbourBaseline.fit(BoxCoder(), [target])
        >>> small = {**target, "boxes": torch.tensor([[20.0, 50, 31, 60]])}
        >>> [round(x, 3) for x in baseline.predict(small)["size"][0].tolist()]
        [4.0, 1.0, 1.0]
    """

    coder: BoxCoder
    animals: EncodedAnimals
    features: Features = box_features

    @classmethod
    def fit(
        cls, coder: BoxCoder, targets: Sequence[Fields], features: Features = box_features
    ) -> "NearestNeighbourBaseline":
        """Learn from targets; see BoxCoder.encode for their fields.

        Raises:
            ConfigError: they have no animal that can be encoded.
            SampleError: a field is missing or of the wrong shape.

        """
        animals = EncodedAnimals.of(coder, targets, features)
        return cls(coder=coder, animals=animals, features=features)

    def predict(self, target: Fields) -> dict[str, Tensor]:
        """The predictions for an image, of which `boxes`, `labels` and `K` are looked at.

        Returns:
            A prediction as BoxMetrics takes it; `scores` are e^-d of the distance d in features.

        Raises:
            SampleError: an animal is of a class that was not learned.

        """
        labels = _labels(target)
        known = set(self.animals.labels.tolist())
        for animal, label in enumerate(labels.tolist()):
            _check_class(target, animal, label, known)
        distance = torch.cdist(self.features(target).double(), self.animals.features)
        distance = distance.masked_fill(labels[:, None] != self.animals.labels, torch.inf)
        nearest = distance.min(1)
        encoded = {name: value[nearest.indices] for name, value in self.animals.fields.items()}
        return _decoded(self.coder, encoded, target, torch.exp(-nearest.values))


def _labels(target: Fields) -> Tensor:
    """The classes (N,) of a target's animals; 0 if it names none."""
    labels: Tensor | None = target.get("labels")
    return torch.zeros(len(target["boxes"]), dtype=torch.int64) if labels is None else labels


def _check_class(target: Fields, animal: int, label: int, known: Any) -> None:
    if label not in known:
        raise SampleError(
            f"{target.get('image_id', 'target')}#{animal}",
            "labels",
            f"is {label}, of which no animal was learned from; the classes are {sorted(known)}",
        )


def _decoded(
    coder: BoxCoder, encoded: dict[str, Tensor], target: Fields, scores: Tensor
) -> dict[str, Tensor]:
    """A prediction of encoded animals in the 2D boxes of a target."""
    decoded = coder.decode(
        encoded,
        boxes=target["boxes"].double(),
        K=target["K"].double(),
        labels=_labels(target),
        distortion=target.get("distortion"),
    )
    return {**decoded, "scores": scores}
