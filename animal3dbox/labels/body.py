"""An animal's body as labelling takes it."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from animal3dbox.smal.model import SmalModel

Array = NDArray[np.float64]
ArrayLike = Any
"""A tensor, a NumPy array or nested lists of numbers."""


@dataclass(frozen=True)
class Body:
    """One animal's body, in a frame and unit of its own.

    Attributes:
        vertices: (V, 3); None if only landmarks are known.
        faces: (F, 3) the triangles between them; None if they are not known.
        landmarks: (J, 3) the places of the keypoints on the body; NaN for those it does not have.
            None: read off the template's vertex groups.
        landmark_sigma: (J,) how far each may be from where the body has it, in the body's unit, for
            a body that is not in the animal's own pose; None: the body is.
        template: what the vertices correspond to one to one; None if nothing is known of that.
        notes: what a careful person should know of the body, in whole sentences; they become
            warnings of its label.

    Example:
        >>> import numpy as np
        >>> from animal3dbox.labels import Body
        >>> corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
        >>> body = Body(corners, faces=None, landmarks=None, landmark_sigma=None, template=None)
        >>> body.vertices.shape
        (4, 3)
    """

    vertices: ArrayLike
    faces: ArrayLike
    landmarks: ArrayLike
    landmark_sigma: ArrayLike
    template: SmalModel | None
    notes: tuple[str, ...] = ()
