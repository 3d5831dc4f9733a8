"""Offsets of keypoints by their free numbers: mirrored left and right, none sideways in the middle.

With U the basis, offsets = U u: a keypoint on one side has three free numbers, which its twin takes
with y negated, and one in the middle two.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from animal3dbox.smal.keypoints.vocabulary import Vocabulary

Array = NDArray[np.float64]


@lru_cache(maxsize=16)
def offset_basis(vocabulary: Vocabulary) -> Array:
    """The basis U (3 L, G) of a vocabulary's offsets, keypoint by keypoint.

    Example:
        >>> from animal3dbox.smal.keypoints.vocabulary import vocabulary_from_names
        >>> names = ("nose", "left_eye", "right_eye")
        >>> offset_basis(vocabulary_from_names("own", {name: name for name in names})).shape
        (9, 5)
    """
    columns = []
    for landmark, twin in enumerate(vocabulary.flip):
        for axis in range(3) if landmark <= twin else ():
            if landmark == twin and axis == 1:  # sideways
                continue
            column = np.zeros((len(vocabulary), 3))
            column[landmark, axis] = 1.0
            column[twin, axis] = -1.0 if axis == 1 and twin != landmark else 1.0
            columns.append(column.ravel())
    return np.stack(columns, 1)
