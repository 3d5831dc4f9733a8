"""A body of another topology: each bone carries a convex part of its own, none joined to another.

No vertex, edge or face is the quadruped's; what stays is the skeleton, so that the trunk's truth
and the poses do.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
import trimesh
from numpy.typing import NDArray

from animal3dbox.smal.model import SmalModel

Array = NDArray[np.float64]
CARRIED = 0.2
"""Skinning weight from which on a vertex belongs to a bone's part: parts overlap at the joints."""
FLESH_SPREAD = 0.1
"""Standard deviation of the logarithm of a part's size about its middle."""
DIRECTIONS = trimesh.creation.icosphere(subdivisions=1).vertices
"""(42, 3): a part's corners are the farthest points in these."""
SUBDIVISIONS = 1
NEAREST = 3
"""Vertices that a landmark is the mean of."""
INSIDE = 1e-9
"""A vertex deeper than this within a part lies inside it."""


@dataclass(frozen=True)
class _Part:
    """The convex mesh of a bone.

    Attributes:
        joint: the bone's.
        vertices: (V, 3) in the template.
        faces: (F, 3).
        planes: (P, 4) outward normals and offsets; n x + d is negative inside.
    """

    joint: int
    vertices: Array
    faces: NDArray[np.int64]
    planes: Array

    def holds(self, points: Array) -> NDArray[np.bool_]:
        """Which of points (N, 3) lie inside."""
        heights: Array = points @ self.planes[:, :3].T + self.planes[:, 3]
        inside: NDArray[np.bool_] = np.less(heights.max(1), -INSIDE)
        return inside


def model_of_parts(model: SmalModel, rng: np.random.Generator) -> SmalModel:
    """A model's skeleton under a surface of convex parts, one a bone, each a little larger or less.

    Args:
        model: with closed faces; its template alone counts.
        rng: of the parts' sizes, alike left and right.

    Example:
        >>> from animal3dbox.smal import load_quadruped
        >>> other = model_of_parts(load_quadruped(), np.random.default_rng(0))
        >>> other.joint_count, other.beta_count
        (35, 0)
    """
    names = [_without_side(name) for name in model.joint_names]
    factors = {
        name: float(np.exp(FLESH_SPREAD * rng.standard_normal())) for name in dict.fromkeys(names)
    }
    template, carried = model.v_template.numpy(), model.weights.numpy() > CARRIED
    parts = [
        _part(j, template[carried[:, j]], factors[name])
        for j, name in enumerate(names)
        if carried[:, j].any()
    ]
    starts = np.cumsum([0, *(len(part.vertices) for part in parts)])
    vertices = np.concatenate([part.vertices for part in parts])
    faces = [part.faces + start for part, start in zip(parts, starts[:-1], strict=True)]
    weights = np.zeros((len(vertices), model.joint_count))
    for part, start in zip(parts, starts[:-1], strict=True):
        weights[start : start + len(part.vertices), part.joint] = 1.0
    joints = (model.J_regressor @ model.v_template).numpy()
    outside = _outside(parts)
    return replace(
        model,
        v_template=torch.from_numpy(vertices),
        faces=torch.from_numpy(np.concatenate(faces)),
        shapedirs=torch.zeros(len(vertices), 3, 0, dtype=torch.float64),
        posedirs=torch.zeros(len(vertices), 3, 9 * (model.joint_count - 1), dtype=torch.float64),
        J_regressor=torch.from_numpy(_regressor(vertices, joints)),
        weights=torch.from_numpy(weights),
        landmarks=_moved(model.landmarks, template, vertices, outside),
        extra_landmarks=_moved(model.extra_landmarks, template, vertices, outside),
        symmetry=None,
    )


def _without_side(joint: str) -> str:
    """A joint's name without the letter of its side."""
    is_paired = joint.startswith(("LLeg", "RLeg", "LFoot", "RFoot", "LEar", "REar"))
    return joint[1:] if is_paired else joint


def _part(joint: int, points: Array, factor: float) -> _Part:
    """A convex mesh about points (N, 3), its size times a factor, with vertices on faces too."""
    middle = points.mean(0)
    corners = points[np.unique((points @ DIRECTIONS.T).argmax(0))]
    hull = trimesh.convex.convex_hull(middle + factor * (corners - middle))
    normals = np.asarray(hull.face_normals)
    offsets = -(normals * hull.triangles[:, 0]).sum(1)
    for _ in range(SUBDIVISIONS):
        hull = hull.subdivide()
    faces = np.asarray(hull.faces, dtype=np.int64)
    return _Part(joint, np.asarray(hull.vertices), faces, np.column_stack((normals, offsets)))


def _outside(parts: Sequence[_Part]) -> NDArray[np.bool_]:
    """Which of all parts' vertices lie inside no other part."""
    return np.concatenate(
        [
            ~np.any([other.holds(part.vertices) for other in parts if other is not part], axis=0)
            for part in parts
        ]
    )


def _regressor(vertices: Array, joints: Array) -> Array:
    """The least weights (J, V), of sum 1, that give joints (J, 3) from vertices (V, 3)."""
    homogeneous = np.column_stack((vertices, np.ones(len(vertices))))
    wanted = np.column_stack((joints, np.ones(len(joints))))
    weights = np.linalg.lstsq(homogeneous.T, wanted.T, rcond=None)[0]
    return np.asarray(weights.T, dtype=np.float64)


def _moved(
    landmarks: Mapping[str, Sequence[int]],
    template: Array,
    vertices: Array,
    outside: NDArray[np.bool_],
) -> dict[str, tuple[int, ...]]:
    """Landmarks as groups of the vertices nearest to where they were, of those on the outside."""
    ids = np.flatnonzero(outside)
    moved = {}
    for name, group in landmarks.items():
        distance = np.linalg.norm(vertices[ids] - template[list(group)].mean(0), axis=1)
        moved[name] = tuple(ids[np.argsort(distance, kind="stable")[:NEAREST]].tolist())
    return moved
