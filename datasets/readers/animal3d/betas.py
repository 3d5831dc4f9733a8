"""Bodies with more betas than their model: SMAL+'s files have 145, SMAL's models 41.

Further betas of 0 say nothing. Others belong to another space of shapes, whose first 41 need not be
SMAL's: they are left out only where the file's own landmarks say that the body stays the same.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from animal3dbox.datasets.readers.animal3d.camera import SAME, landmarks_differ
from animal3dbox.errors import SampleError, ShapeError
from animal3dbox.smal.keypoints.vocabulary import Vocabulary
from animal3dbox.smal.model import SmalModel
from animal3dbox.smal.parameters import SmalParameters, posed_body

Parameters = dict[str, SmalParameters]


def with_betas_of(
    model: SmalModel,
    parameters: Mapping[str, SmalParameters],
    landmarks: Mapping[str, NDArray[np.float64]],
    vocabulary: Vocabulary,
) -> tuple[Parameters, dict[str, SampleError], tuple[str, ...]]:
    """Parameters with no more betas than a model has, errors of those that it cannot pose, notes.

    Args:
        model: what poses them.
        parameters: sample id -> an animal's parameters.
        landmarks: sample id -> the file's landmarks (J, 3) of the posed body, up to a shift.
        vocabulary: names these J keypoints.

    """
    kept, faults, zero, close = Parameters(), dict[str, SampleError](), list[str](), list[str]()
    for sample_id, one in parameters.items():
        further = one.betas[model.beta_count :]
        short = replace(one, betas=one.betas[: model.beta_count])
        if bool(further.any()) and not _agrees(model, short, landmarks.get(sample_id), vocabulary):
            faults[sample_id] = SampleError(
                sample_id,
                "shape",
                f"has {len(one.betas)} betas, but --model {model.beta_count}, and nothing says that"
                " the body is the same without the others: they are of another space of shapes, as"
                " SMAL+'s 145 are to SMAL; give the model that they were fitted with, or leave"
                " --model out",
            )
            continue
        kept[sample_id] = short
        if len(further):
            (close if bool(further.any()) else zero).append(sample_id)
    return kept, faults, _notes(model, zero, close)


def _agrees(
    model: SmalModel,
    parameters: SmalParameters,
    landmarks: NDArray[np.float64] | None,
    vocabulary: Vocabulary,
) -> bool:
    """Whether the posed body has a file's landmarks, up to a shift."""
    if landmarks is None:
        return False
    try:
        vertices = posed_body(model, parameters).vertices
    except ShapeError:
        return True  # posing says it better when the animal is labelled
    own = model.read_keypoints(vocabulary, vertices.numpy())[0]
    return not landmarks_differ(landmarks, np.asarray(own, dtype=np.float64))


def _notes(model: SmalModel, zero: list[str], close: list[str]) -> tuple[str, ...]:
    """Sentences on animals some of whose betas are not used."""
    notes = []
    if zero:
        notes.append(
            f"{len(zero)} animals have more betas than the model's {model.beta_count}, all further"
            f" ones 0; the first is {zero[0]}"
        )
    if close:
        notes.append(
            f"{len(close)} animals have more betas than the model's {model.beta_count}: the further"
            f" ones are left out, since without them the body has its keypoint_3d to within"
            f" {100 * SAME:g} % of their extent; the first is {close[0]}"
        )
    return tuple(notes)
