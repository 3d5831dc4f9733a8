"""The landmarks of a mesh whose dataset says nothing of them: by its template or SMAL's order."""

from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from animal3dbox.geometry.arrays import AnyArray, as_numpy
from animal3dbox.labels.loose_vertices import read_off_surface
from animal3dbox.smal.keypoints.smal_recognition import SMAL_GROUPS, why_not_smal
from animal3dbox.smal.keypoints.vocabulary import Vocabulary
from animal3dbox.smal.model import SmalModel

SMAL_NOTE = (
    "the mesh has SMAL's topology, by its counts and the places and sides of SMAL's landmark ids:"
    " its landmarks were read off these"
)
"""What a label says of landmarks that topology_landmarks gave."""


def template_landmarks(
    template: SmalModel, words: Vocabulary, vertices: AnyArray, used: NDArray[np.bool_] | None
) -> AnyArray:
    """The keypoints (J, 3) of a vocabulary by a template's vertex groups; NaN where it has none.

    Args:
        template: what the vertices correspond to.
        words: names the keypoints.
        vertices: (V, 3).
        used: (V,) which of them some face uses; None: all.

    """
    return read_off_surface(partial(template.read_keypoints, words), vertices, used)


def topology_landmarks(
    words: Vocabulary, vertices: AnyArray, faces: Any, used: NDArray[np.bool_] | None
) -> AnyArray | str:
    """The keypoints (J, 3) of a mesh in SMAL's order; NaN where SMAL has none.

    Args:
        words: names the keypoints.
        vertices: (V, 3).
        faces: (F, 3), or None.
        used: (V,) which vertices some face uses; None: all.

    Returns:
        The keypoints, or why the mesh is not taken for SMAL's (see smal_recognition.py).

    Raises:
        ConfigError: a keypoint names a vertex that the body does not have.

    """
    reason = why_not_smal(as_numpy(vertices), None if faces is None else len(faces), used)
    if reason is not None:
        return reason
    return read_off_surface(partial(words.on_body, SMAL_GROUPS), vertices, used)
