"""What the fit of some animals is made from, and the states that it moves through."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from animal3dbox.labels.fit.kinematics import LandmarkTables
from animal3dbox.labels.pose.levenberg_marquardt import small_turns

Array = NDArray[np.float64]
LOOSE_SD = 0.5
"""Standard deviation of a landmark moved by a joint that is not fitted, by its distance from it."""
FOCAL_SD = 0.5
"""Of the logarithm of a focal length that is not known, about the guess."""
FOCAL_KNOWN_SD = 1e-4
MOST_LOG = 50.0
"""Greatest logarithm of a camera's distance and focal length: a step beyond is never taken, but its
cost must be a number."""
CAMERA = 7
"""Numbers of a camera: turn (3), aim (2), logarithms of scale and of focal length."""


@dataclass(frozen=True)
class FitProblem:
    """The keypoints and cameras of A animals.

    Attributes:
        pixels: (A, 2, L) about the principal point.
        weights: (A, L) by which residuals are multiplied, 1 / px; 0 where nothing is seen.
        linear: (A, 2, 2) K's upper left.
        extent: (A,) px, the longer side of the keypoints' box.
        focal_sd: (A,) of the logarithm of the focal length about K's.
        frame: (A, 4) least and greatest u, v of the picture, about the principal point.
        up_weight: (A,) by which the costs of a rolled camera, and of one under the ground, count:
            1, or 0 where gravity tells more.
        down: (A, 3) unit, gravity in the camera's frame; NaN where it is not known.
    """

    pixels: Array
    weights: Array
    linear: Array
    extent: Array
    focal_sd: Array
    frame: Array
    up_weight: Array
    down: Array

    def __getitem__(self, ids: Any) -> "FitProblem":
        """The problem of the animals of some indices alone."""
        return FitProblem(*(getattr(self, name)[ids] for name in self.__dataclass_fields__))


def fit_problem(
    keypoints_2d: Array,
    K: Array,
    tables: LandmarkTables,
    *,
    image_hw: tuple[int, int],
    focal_is_known: bool,
    is_upright: bool,
    down: Array | None,
    noise_px: Array,
    places_sd: Array,
) -> FitProblem:
    """The problem of one animal, A = 1.

    Args:
        keypoints_2d: (L, 3) x, y px and confidence, 0 where nothing is seen.
        K: (3, 3) known or guessed.
        tables: of the landmarks.
        image_hw: height and width.
        focal_is_known: whether K is.
        is_upright: whether cameras seldom roll or stand under the ground, and gravity counts.
        down: (3,) unit, gravity in the camera's frame; None: not known.
        noise_px: (L,) standard deviations of the keypoints.
        places_sd: (L,) see FitBody.

    """
    used = (keypoints_2d[:, 2] > 0) & tables.known
    seen = keypoints_2d[used, :2]
    extent = max(float((seen.max(0) - seen.min(0)).max()), 1.0)
    places = extent * np.hypot(places_sd, LOOSE_SD * tables.loose)
    weights = np.where(used, 1 / np.hypot(noise_px, places), 0.0)
    pixels = np.where(used[:, None], keypoints_2d[:, :2] - K[:2, 2], 0.0)
    return FitProblem(
        np.ascontiguousarray(pixels.T)[None],
        weights[None],
        K[None, :2, :2].copy(),
        np.array([extent]),
        np.array([FOCAL_KNOWN_SD if focal_is_known else FOCAL_SD]),
        frame_about(image_hw, K[:2, 2])[None],
        np.array([float(is_upright and down is None)]),
        np.array(down if is_upright and down is not None else [np.nan] * 3)[None],
    )


def frame_about(image_hw: tuple[int, int], center: Array) -> Array:
    """Least and greatest u, v (4,) of a picture's pixels about a point (2,)."""
    height, width = image_hw
    frame: Array = np.array([-0.5, -0.5, width - 0.5, height - 0.5]) - np.tile(center, 2)
    return frame


def joined(problems: list[FitProblem]) -> FitProblem:
    """One problem of the animals of several."""
    return FitProblem(
        *(
            np.concatenate([getattr(one, name) for one in problems])
            for name in FitProblem.__dataclass_fields__
        )
    )


@dataclass(frozen=True)
class FitState:
    """Cameras, poses and shapes of B hypotheses.

    A point x of the body, about its origin, is seen from X = R x + t with
    t = (aim e^scale, e^(scale + focal)), its focal length being K's times e^focal.

    Attributes:
        animal: (B,) the animal that each is of.
        R: (B, 3, 3) R_cam_body.
        aim: (B, 2) the origin's place in the picture, in focal lengths of K.
        scale: (B,) logarithm of the depth by the focal length's factor.
        focal: (B,) logarithm of the focal length's factor.
        pose: (B, P) coefficients.
        shape: (B, S) coefficients.
        exchanged: (B,) whether left and right keypoints have been exchanged.
    """

    animal: NDArray[np.intp]
    R: Array
    aim: Array
    scale: Array
    focal: Array
    pose: Array
    shape: Array
    exchanged: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.R)

    def __getitem__(self, ids: Any) -> "FitState":
        """Those of some indices, or of a mask (B,)."""
        return FitState(*(getattr(self, name)[ids] for name in self.__dataclass_fields__))

    @property
    def t(self) -> Array:
        """The translations (B, 3) from the body's frame to the camera's."""
        depth = np.exp(self.scale)
        return np.concatenate(
            (self.aim * depth[:, None], (depth * np.exp(self.focal))[:, None]), axis=1
        )

    def moved(self, step: Array, pose_count: int) -> "FitState":
        """The states after a step (B, CAMERA + pose_count + shape directions)."""
        pose, shape = self.pose.copy(), self.shape.copy()
        pose[:, :pose_count] += step[:, CAMERA : CAMERA + pose_count]
        by_shape = step[:, CAMERA + pose_count :]
        shape[:, : by_shape.shape[1]] += by_shape
        return FitState(
            self.animal,
            small_turns(step[:, :3]) @ self.R,
            self.aim + step[:, 3:5],
            np.clip(self.scale + step[:, 5], -MOST_LOG, MOST_LOG),
            np.clip(self.focal + step[:, 6], -MOST_LOG, MOST_LOG),
            pose,
            shape,
            self.exchanged,
        )

    def replaced(self, ids: NDArray[np.intp], other: "FitState") -> "FitState":
        """These states, those of some indices being the others."""
        values = []
        for name in self.__dataclass_fields__:
            value = getattr(self, name).copy()
            value[ids] = getattr(other, name)
            values.append(value)
        return FitState(*values)

    def where(self, mask: NDArray[np.bool_], other: "FitState") -> "FitState":
        """These states where a mask (B,) says so, else the others."""
        values = []
        for name in self.__dataclass_fields__:
            own, its = getattr(self, name), getattr(other, name)
            values.append(np.where(mask.reshape(-1, *(1,) * (own.ndim - 1)), own, its))
        return FitState(*values)
