"""Which vertices of a mesh its faces use."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from animal3dbox.geometry.arrays import as_numpy


def used_vertices(faces: Any, count: int) -> NDArray[np.bool_] | None:
    """Which of a mesh's vertices some face uses, (V,); None if all are, or if there are no faces.

    Args:
        faces: (F, 3) vertex numbers from 0 to V - 1, or None.
        count: V.

    Example:
        >>> used_vertices([[0, 1, 3]], count=5).tolist()
        [True, True, False, True, False]
        >>> used_vertices([[0, 1, 2]], count=3) is None
        True
    """
    if faces is None or not len(faces):
        return None
    used = np.zeros(count, dtype=np.bool_)
    used[as_numpy(faces) if isinstance(faces, Tensor) else np.asarray(faces)] = True
    return None if used.all() else used
