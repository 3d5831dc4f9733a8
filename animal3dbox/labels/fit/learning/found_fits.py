"""Fits of many animals by numbers that do not depend on the body's mean shape."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from animal3dbox.labels.fit.fit import EXCHANGED_ALL
from animal3dbox.labels.fit.fit_body import FitBody
from animal3dbox.labels.fit.fitted_body import FittedBody
from animal3dbox.labels.fit.problem import FitState

Array = NDArray[np.float64]


@dataclass(frozen=True)
class FoundFits:
    """The fits of A animals.

    Attributes:
        R: (A, 3, 3) R_cam_world, world being the model's frame.
        t: (A, 3) t_cam_world.
        focal: (A,) natural logarithms of the focal lengths by those known or guessed.
        pose: (A, joints, 3) axis-angle.
        betas: (A, S').
        exchanged: (A,) whether left and right keypoints have been exchanged.
        sureness: (A,) probability of the orientation among those that were considered.
    """

    R: Array
    t: Array
    focal: Array
    pose: Array
    betas: Array
    exchanged: NDArray[np.bool_]
    sureness: Array

    def __len__(self) -> int:
        return len(self.R)

    def __getitem__(self, ids: Any) -> "FoundFits":
        """The fits of the animals of some indices, or of a mask (A,)."""
        return FoundFits(*(getattr(self, name)[ids] for name in self.__dataclass_fields__))

    def in_body(self, body: FitBody) -> FitState:
        """The states nearest to them with a body of the same model."""
        prior, origin = body.shape_prior, body.skeleton.origin
        whitening = np.linalg.pinv(prior.directions)
        t = self.t + (self.R @ origin[:, None])[..., 0]
        scale = np.log(np.maximum(t[:, 2], 1e-9)) - self.focal
        theta = self.pose[:, body.skeleton.joints]
        return FitState(
            animal=np.arange(len(self)),
            R=self.R,
            aim=t[:, :2] / np.exp(scale)[:, None],
            scale=scale,
            focal=self.focal,
            pose=body.pose_prior.coefficients(theta),
            shape=(self.betas - prior.mean) @ whitening.T,
            exchanged=self.exchanged,
        )

    def moved(self, body: FitBody, state: FitState) -> "FoundFits":
        """The same animals at other states of a body."""
        theta, _ = body.frames(state.pose, state.shape)
        pose = self.pose.copy()
        pose[:, body.skeleton.joints] = theta
        return FoundFits(
            R=state.R,
            t=state.t - (state.R @ body.skeleton.origin[:, None])[..., 0],
            focal=state.focal,
            pose=pose,
            betas=body.shape_prior.mean + state.shape @ body.shape_prior.directions.T,
            exchanged=self.exchanged,
            sureness=self.sureness,
        )

    def replaced(self, ids: NDArray[np.intp], other: "FoundFits") -> "FoundFits":
        """These, those of some indices being the others."""
        values = []
        for name in self.__dataclass_fields__:
            value = getattr(self, name).copy()
            value[ids] = getattr(other, name)
            values.append(value)
        return FoundFits(*values)


def found_fits(fits: Sequence[FittedBody]) -> FoundFits:
    """The fits of at least one animal."""
    return FoundFits(
        R=np.stack([fit.R for fit in fits]),
        t=np.stack([fit.t for fit in fits]),
        focal=np.array([fit.log_focal for fit in fits]),
        pose=np.stack([fit.pose for fit in fits]),
        betas=np.stack([fit.betas for fit in fits]),
        exchanged=np.array([fit.labeling == EXCHANGED_ALL for fit in fits]),
        sureness=np.array([_sureness(fit) for fit in fits]),
    )


def joined_fits(parts: Sequence[FoundFits]) -> FoundFits:
    """One of the animals of several."""
    return FoundFits(
        *(
            np.concatenate([getattr(part, name) for part in parts])
            for name in FoundFits.__dataclass_fields__
        )
    )


def _sureness(fit: FittedBody) -> float:
    """How probable a fit's orientation is beside the best of another one."""
    return 1.0 if fit.margin is None else float(1 / (1 + np.exp(-fit.margin)))
