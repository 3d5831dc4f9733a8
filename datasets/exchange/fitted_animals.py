"""Fitted bodies as the exports of fits take them: parameters, camera, keypoints."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from animal3dbox.labels.fit_parameters import FitParameters, fitted_vertices
from animal3dbox.smal.model import SmalModel

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class FittedAnimal:
    """One animal with the parameters of its fitted body.

    Attributes:
        sample_id: named in every error.
        image_id: its image, as its dataset names it.
        image_hw: height and width.
        category: as the dataset calls the animal.
        parameters: of the body.
        K: (3, 3) intrinsics in px.
        R: (3, 3) X_cam = R v + t for the body's vertices v, in its own unit.
        t: (3,).
        keypoints_2d: (J, 3) x, y in px and visibility, as the fit used them.
        box: (4,) xyxy px.

    Example:
        >>> fit = FitParameters("model", "0", "animal3d26", np.zeros(41), np.zeros((35, 3)))
        >>> animal = FittedAnimal(
        ...     sample_id="a.jpg", image_id="a.jpg", image_hw=(48, 64), category="dog",
        ...     parameters=fit, K=np.eye(3), R=np.eye(3), t=np.array([0.0, 0.0, 4.0]),
        ...     keypoints_2d=np.zeros((26, 3)), box=np.zeros(4))
        >>> animal.parameters.is_of_quadruped
        False
    """

    sample_id: str
    image_id: str
    image_hw: tuple[int, int]
    category: str
    parameters: FitParameters
    K: Array
    R: Array
    t: Array
    keypoints_2d: Array
    box: Array

    def vertices_cam(self, model: SmalModel | None = None) -> Array:
        """The body's vertices (V, 3) in the camera frame, in its own unit.

        Args:
            model: whose parameters they are; None: the embedded quadruped.

        Raises:
            ConfigError: they belong to another model.

        """
        vertices: Array = fitted_vertices(self.parameters, model) @ self.R.T + self.t
        return vertices
