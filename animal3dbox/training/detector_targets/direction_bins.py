"""Where an animal's nose points as one of many directions, so that a network can be of two minds.

What looks nearly alike from ahead and from behind has two likely directions. A network that
regresses one rotation answers their mean, which is neither; one that says how likely each of many
directions is can be asked for the likeliest.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from animal3dbox.errors import ConfigError


@dataclass(frozen=True, kw_only=True)
class DirectionBins:
    """Directions spread evenly over the sphere, as classes of the forward axis.

    They are told in the frame of BoxCoder's rotation: against the line of sight if that is
    allocentric, so that one picture means one direction wherever it is seen.

    Attributes:
        count: how many there are.
        sharpness: of what a network learns: the likelihood of a bin at the angle a from the truth
            goes with exp(sharpness cos a); 20 makes it fall to a half at 15 degrees.

    Raises:
        ConfigError: an option cannot be.

    Example:
        >>> bins = DirectionBins(count=64)
        >>> ahead = torch.tensor([[0.0, 0, 1, 1, 0, 0]])  # rotation_6d: forward is away from us
        >>> likelihoods = bins.likelihoods(ahead)
        >>> likelihoods.shape, bins.vectors[bins.nearest(ahead)].mul(10).round().tolist()
        (torch.Size([1, 64]), [[1.0, -2.0, 10.0]])
    """

    count: int = 64
    sharpness: float = 20.0

    def __post_init__(self) -> None:
        if self.count < 1 or not self.sharpness > 0:
            raise ConfigError(
                f"count and sharpness must be positive, got {self.count} and {self.sharpness}"
            )

    @property
    def vectors(self) -> Tensor:
        """The directions (count, 3), unit: a spiral of Fibonacci."""
        k = torch.arange(self.count) + 0.5
        z, angle = 1 - 2 * k / self.count, k * torch.pi * (1 + 5**0.5)
        level = (1 - z * z).sqrt()
        return torch.stack((level * angle.cos(), level * angle.sin(), z), -1)

    def likelihoods(self, rotation_6d: Tensor) -> Tensor:
        """What a network learns, (N, count) with sums of 1, of rotations (N, 6) as encoded."""
        return self._spread(rotation_6d[:, :3])

    def nearest(self, rotation_6d: Tensor) -> Tensor:
        """The bin (N,) whose direction is nearest to forward of rotations (N, 6)."""
        return (rotation_6d[:, :3] @ self.vectors.to(rotation_6d).T).argmax(1)

    def unmirrored(self, likelihoods: Tensor) -> Tensor:
        """The likelihoods (N, count) of animals, given those of their mirrored pictures."""
        mirrored = self.vectors * torch.tensor([-1.0, 1, 1])
        return likelihoods @ self._spread(mirrored.to(likelihoods))

    def _spread(self, forward: Tensor) -> Tensor:
        """The likelihoods (N, count) about directions (N, 3)."""
        cosines = forward @ self.vectors.to(forward).T
        return torch.softmax(self.sharpness * cosines, 1)
