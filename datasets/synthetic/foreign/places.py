"""Where another dataset's annotators put keypoints on a body: near the quadruped's places.

A place is a point of the template that the skin carries, so that it moves with the pose.
"""

import numpy as np
import torch
from torch import Tensor

from animal3dbox.datasets.synthetic.foreign.config import ForeignConfig
from animal3dbox.smal.keypoints.vocabulary import Vocabulary
from animal3dbox.smal.linear_blend_skinning import PosedBody
from animal3dbox.smal.model import SmalModel

MIRROR = (1.0, -1.0, 1.0)


def drawn_offsets(rng: np.random.Generator, vocabulary: Vocabulary) -> Tensor:
    """Standard normal offsets (J, 3) of keypoints, mirrored left and right."""
    draws = torch.from_numpy(rng.standard_normal((len(vocabulary), 3)))
    mirrored = draws[list(vocabulary.flip)] * torch.tensor(MIRROR, dtype=torch.float64)
    is_right = torch.tensor([side == "right" for side in vocabulary.sides])
    offsets = torch.where(is_right[:, None], mirrored, draws)
    in_middle = torch.tensor([side is None for side in vocabulary.sides])
    offsets[in_middle, 1] = 0.0
    return offsets


def template_places(
    model: SmalModel, vocabulary: Vocabulary, offsets: Tensor, config: ForeignConfig
) -> Tensor:
    """The keypoints' places (J, 3) in the template; NaN for those that the body does not have.

    Args:
        model: the body.
        vocabulary: the keypoints.
        offsets: (J, 3), as parts of the trunk's length.
        config: where the shoulders are.

    """
    places: Tensor = vocabulary.on_body(model.landmark_groups, model.v_template).clone()
    if config.shoulders == "level":
        tail = model.v_template[list(model.landmark_groups["tail_base"])].mean(0)
        for j, names in enumerate(vocabulary.landmarks):
            if any("shoulder" in name for name in names):
                places[j, 2] = tail[2]
    return places + trunk_length(model) * offsets


def trunk_length(model: SmalModel) -> float:
    """The distance from the first to the last joint of the spine in the template."""
    joints = model.J_regressor[[0, 6]] @ model.v_template
    return float(torch.linalg.vector_norm(joints[1] - joints[0]))


def carried_places(
    model: SmalModel, vocabulary: Vocabulary, places: Tensor, body: PosedBody
) -> Tensor:
    """Places (J, 3) of the template on a posed body, moved by the skin about them.

    Args:
        model: the body's model.
        vocabulary: the keypoints.
        places: (J, 3) in the template.
        body: the posed one, of which the first counts.

    """
    weights: Tensor = vocabulary.on_body(model.landmark_groups, model.weights)
    rest = model.J_regressor @ model.v_template
    R, joints = body.R_world_joint[0], body.joints[0]
    offsets = joints - (R @ rest[..., None])[..., 0]
    weights = weights.nan_to_num()
    blended = torch.einsum("kj,jcd->kcd", weights, R)
    return (blended @ places[..., None])[..., 0] + weights @ offsets
