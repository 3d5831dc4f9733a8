"""The parameters of a fitted body, as labels and files keep them: enough to pose it again."""

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from animal3dbox.errors import ConfigError
from animal3dbox.geometry.arrays import as_numpy
from animal3dbox.smal.model import SmalModel
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped

Array = NDArray[np.float64]
QUADRUPED = "quadruped"
"""What fits of the embedded quadruped are called; the species that was told may follow a colon."""


@dataclass(frozen=True, eq=False)
class FitParameters:
    """The shape and pose of a fitted body, and which body they belong to.

    Its camera is the label's R, t and K, which hold for these vertices. The parameters of one body
    mean another animal on another: `digest` says whose they are.

    Attributes:
        body: "quadruped", "quadruped:<species>" if the species was told, or "model".
        digest: of the body's model, see SmalModel.digest.
        vocabulary: the name of the keypoints that it was fitted to.
        betas: (S,) shape.
        pose: (J, 3) axis-angle in radians, root first; the root's is zero, the camera carries it.

    Example:
        >>> body, dog = load_quadruped(), np.zeros(41)
        >>> fit = FitParameters("quadruped", body.digest, "animal3d26", dog, np.zeros((35, 3)))
        >>> fit.is_of_quadruped
        True
    """

    body: str
    digest: str
    vocabulary: str
    betas: Array
    pose: Array

    @property
    def is_of_quadruped(self) -> bool:
        """Whether the body is the embedded quadruped, of this version of the package or another."""
        return self.body.partition(":")[0] == QUADRUPED


def fitted_vertices(parameters: FitParameters, model: SmalModel | None = None) -> Array:
    """The vertices (V, 3) of a fitted body, in its model's frame and unit: the very same again.

    Args:
        parameters: of the body.
        model: whose they are; None: the embedded quadruped.

    Raises:
        ConfigError: they belong to another model.

    Example:
        >>> from animal3dbox import label_animal
        >>> from animal3dbox.datasets.synthetic import synthetic_animal
        >>> animal = synthetic_animal(seed=0, index=2)
        >>> label = label_animal(animal.image_hw, animal.keypoints_2d, K=animal.K, body="fit")
        >>> fitted_vertices(label.fit).shape
        (5852, 3)
    """
    model = model or load_quadruped()
    check_whose(parameters, model)
    posed = model.posed(
        torch.from_numpy(parameters.betas.copy())[None],
        torch.from_numpy(parameters.pose.copy())[None],
        torch.zeros(1, 3, dtype=torch.float64),
    )
    return as_numpy(posed.vertices[0])


def check_whose(parameters: FitParameters, model: SmalModel) -> None:
    """Raise a ConfigError unless parameters are a model's own."""
    if parameters.digest == model.digest:
        return
    remedy = (
        "fit the animal again with this version, or take the one that fitted it"
        if parameters.is_of_quadruped and model is load_quadruped()
        else "take the file that it was fitted with"
    )
    raise ConfigError(
        f"the parameters are those of the body {parameters.body!r} with digest"
        f" {parameters.digest}, but the model's digest is {model.digest}: {remedy}"
    )
