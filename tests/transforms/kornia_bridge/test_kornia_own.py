"""Operations that users derive from kornia's.

Accepted if their pixels follow their matrix, refused otherwise.
"""

from typing import Any

import kornia.augmentation as kornia
import pytest
import torch
from kornia_cases import photo
from torch import Tensor

from animal3dbox.errors import ConfigError
from animal3dbox.transforms import Compose, KorniaTransform


class Shifted(kornia.GeometricAugmentationBase2D):
    """A user's own operation: moves the picture right, and says so or not."""

    def __init__(self, pixels: float, said: float, p: float = 1.0) -> None:
        super().__init__(p=p)
        self.pixels, self.said = pixels, said
        self.flags = {}

    def compute_transformation(self, input: Tensor, params: Any, flags: Any) -> Tensor:
        H = self.identity_matrix(input).clone()
        H[:, 0, 2] = self.said
        return H

    def apply_transform(
        self, input: Tensor, params: Any, flags: Any, transform: Any = None
    ) -> Tensor:
        whole = int(self.pixels)
        moved = torch.roll(input, whole, dims=-1)
        part = self.pixels - whole
        return (1 - part) * moved + part * torch.roll(moved, 1, dims=-1)


class Mirror(Shifted):
    def __init__(self) -> None:
        super().__init__(0, 0, p=0.3)

    def compute_transformation(self, input: Tensor, params: Any, flags: Any) -> Tensor:
        H = self.identity_matrix(input).clone()
        H[:, 0, 0], H[:, 0, 2] = -1, input.shape[-1] - 1
        return H

    def apply_transform(
        self, input: Tensor, params: Any, flags: Any, transform: Any = None
    ) -> Tensor:
        return input.flip(-1)


class Halved(Shifted):
    def apply_transform(
        self, input: Tensor, params: Any, flags: Any, transform: Any = None
    ) -> Tensor:
        return input[..., : input.shape[-2] // 2, :]


class NotSkipped(Shifted):
    def generate_transformation_matrix(self, input: Tensor, params: Any, flags: Any) -> Tensor:
        return self.compute_transformation(input, params, flags)


def test_operations_of_a_users_own_are_accepted_if_their_pixels_follow_their_matrix() -> None:
    _, target = Compose([Shifted(2.25, 2.25)])(photo(), {}, key=(0, 0))
    assert target["H_out_in"][0].tolist() == [1, 0, 2.25]
    assert KorniaTransform(Mirror()).mirrors
    assert not KorniaTransform(Shifted(1, 1, p=0.5)).mirrors


def test_operations_of_a_users_own_that_leave_the_camera_stale_are_refused() -> None:
    with pytest.raises(ConfigError, match=r"0\.2 px from where its matrix says"):
        Compose([Shifted(2.25, 2.05)])
    with pytest.raises(ConfigError, match="announces"):
        Compose([Halved(0, 0)])
    with pytest.raises(ConfigError, match="from where its matrix says"):
        Compose([NotSkipped(3, 3, p=0.5)])
    with pytest.raises(ConfigError, match="nothing to measure"):
        Compose([Shifted(500, 500)])
    with pytest.raises(ConfigError, match="cannot be measured"):
        Compose([Shifted(3, float("nan"))])
    assert KorniaTransform(Shifted(60, 60), probe_hw=((200, 300),)).geometric


def test_a_mirror_that_nobody_expected_raises() -> None:
    op = Mirror()
    op.p = 1.0
    compose = Compose([KorniaTransform(op, mirrors=False)], mirror="forbid")
    with pytest.raises(ConfigError, match="mirrored the picture unexpectedly"):
        compose(photo(), {}, key=(0, 0))
    with pytest.raises(ConfigError, match="may mirror"):
        Compose([Mirror()], mirror="forbid")
