"""A foreign animal's mirror image: the picture, the world and the animal are mirrored together.

With S = diag(1, -1, 1) in the world and Q = diag(-1, 1, 1) in the camera frame, a point x of the
animal becomes S x, and the camera (R, t) becomes (Q R S, Q t). Left becomes right, so vertices,
joints and keypoints take each other's places.
"""

from dataclasses import replace

import torch
from torch import Tensor

from animal3dbox.datasets.synthetic.foreign.animals import ForeignAnimal
from animal3dbox.errors import ConfigError
from animal3dbox.geometry.camera import PinholeCamera
from animal3dbox.smal.linear_blend_skinning import PosedBody

SIDES = torch.diag(torch.tensor([1.0, -1.0, 1.0], dtype=torch.float64))


def mirrored_animal(animal: ForeignAnimal) -> ForeignAnimal:
    """The animal as a mirrored picture shows it, its keypoints named by the mirrored sides.

    Raises:
        ConfigError: its model does not say which vertices are each other's mirror images.

    Example:
        >>> from animal3dbox.datasets.synthetic.foreign.animals import foreign_animal
        >>> animal = foreign_animal(0, 0)
        >>> mirrored = mirrored_animal(animal)
        >>> bool((mirrored.mask == animal.mask.flip(1)).all())
        True
    """
    symmetry = animal.model.symmetry
    if symmetry is None:
        raise ConfigError(f"{animal.sample_id}: its model has no symmetry")
    flip = list(animal.vocabulary.flip)
    height, width = animal.camera.image_hw
    K = animal.camera.K.clone()
    K[0, 2] = width - 1 - K[0, 2]
    columns, sides = torch.tensor([[-1.0, 1, 1, 1], [1, -1, 1, 1]], dtype=torch.float64)
    T = torch.diag(columns) @ animal.camera.T_cam_world @ torch.diag(sides)
    fitted_vertices, fitted_landmarks = animal.fitted
    return replace(
        animal,
        sample_id=f"{animal.sample_id}-mirrored",
        camera=PinholeCamera(K, T, (height, width)),
        body=_mirrored_body(animal, symmetry),
        landmarks=animal.landmarks[flip] @ SIDES,
        exact=_mirrored_keypoints(animal.exact[flip], width),
        keypoints_2d=_mirrored_keypoints(animal.keypoints_2d[flip], width),
        mask=animal.mask.flip(1),
        fitted=(fitted_vertices[symmetry] @ SIDES, fitted_landmarks[flip] @ SIDES),
    )


def _mirrored_body(animal: ForeignAnimal, symmetry: Tensor) -> PosedBody:
    """The posed body; joints of the right take those of the left."""
    names, swap = animal.model.joint_names, {"L": "R", "R": "L"}
    mirror = [names.index(swap[name[0]] + name[1:] if name[0] in swap else name) for name in names]
    body = animal.body
    return PosedBody(
        body.vertices[:, symmetry] @ SIDES,
        body.joints[:, mirror] @ SIDES,
        SIDES @ body.R_world_joint[:, mirror] @ SIDES,
    )


def _mirrored_keypoints(keypoints: Tensor, width: int) -> Tensor:
    """Keypoints (J, 3) of the mirrored picture; those without a place keep their zeros."""
    mirrored = keypoints.clone()
    is_placed = keypoints[:, 2] > 0
    mirrored[is_placed, 0] = width - 1 - mirrored[is_placed, 0]
    return mirrored
