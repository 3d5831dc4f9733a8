"""Bodies beyond the quadruped's presets: parts stretched, the surface cut into another mesh.

A part of the skeleton is stretched by a matrix D of its own, about its joints. With J a joint's
place in the template, J' the stretched one's, p its parent and w a vertex's skinning weights:

    J'_j = J'_p + D_p (J_j - J_p),    v' = sum_j w_j (J'_j + D_j (v - J_j))
"""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import torch
from torch import Tensor

from animal3dbox.smal.model import SPINE_JOINTS, SmalModel

PART_SPREAD = {
    "trunk_length": 0.18,
    "trunk_width": 0.15,
    "trunk_height": 0.15,
    "leg_length": 0.25,
    "leg_width": 0.2,
    "neck": 0.25,
    "head": 0.2,
    "tail": 0.3,
}
"""Standard deviations of the logarithms of measures, at a spread of 1."""
MOST = 1.8
"""Standard deviations beyond which no measure is drawn: it is turned back to there."""


def part_scales(rng: np.random.Generator, spread: float) -> dict[str, float]:
    """Factors of the measures of PART_SPREAD, drawn with a spread."""
    draws = np.clip(rng.standard_normal(len(PART_SPREAD)), -MOST, MOST)
    return {
        name: float(np.exp(spread * deviation * draw))
        for (name, deviation), draw in zip(PART_SPREAD.items(), draws, strict=True)
    }


def stretched_model(model: SmalModel, betas: Tensor, scales: dict[str, float]) -> SmalModel:
    """A model without shape columns, of a shape (S,) whose parts are stretched.

    Args:
        model: any with SMAL's joints.
        betas: of its shape.
        scales: factors of the measures of PART_SPREAD.

    """
    vertices = model.shaped(betas[None])[0]
    rest = model.J_regressor @ vertices
    stretch = torch.stack([_stretch(j, name, scales) for j, name in enumerate(model.joint_names)])
    places = [rest[0]]
    for j in range(1, len(rest)):
        parent = model.parents[j]
        places.append(places[parent] + stretch[parent] @ (rest[j] - rest[parent]))
    moved = torch.stack(places)
    # sum_j w_j (J'_j + D_j (v - J_j)) = (sum_j w_j D_j) v + sum_j w_j (J'_j - D_j J_j)
    linear = torch.einsum("vj,jcd->vcd", model.weights, stretch)
    offset = model.weights @ (moved - (stretch @ rest[..., None])[..., 0])
    v_template = (linear @ vertices[..., None])[..., 0] + offset
    return replace(model, v_template=v_template, shapedirs=model.shapedirs[..., :0])


def _stretch(joint: int, name: str, scales: dict[str, float]) -> Tensor:
    """The matrix D (3, 3) of a joint."""
    if joint in SPINE_JOINTS:
        factors = (scales["trunk_length"], scales["trunk_width"], scales["trunk_height"])
    elif "Leg" in name or "Foot" in name:
        factors = (scales["leg_width"], scales["leg_width"], scales["leg_length"])
    elif name == "Neck":
        factors = (scales["neck"],) * 3
    elif name.startswith("Tail"):
        factors = (scales["tail"],) * 3
    else:
        factors = (scales["head"],) * 3
    return torch.diag(torch.tensor(factors, dtype=torch.float64))


def merged_mesh(vertices: Tensor, faces: Tensor, cell: float) -> tuple[Tensor, Tensor]:
    """Another mesh of the same body, in no correspondence with its template.

    Vertices that share a cell become one.

    Args:
        vertices: (V, 3).
        faces: (F, 3).
        cell: side of a cell, as a part of the body's diagonal.

    Returns:
        vertices (V', 3) and faces (F', 3).

    """
    side = cell * torch.linalg.vector_norm(vertices.amax(0) - vertices.amin(0))
    cells = torch.floor(vertices / side).long()
    _, owner = torch.unique(cells, dim=0, return_inverse=True)
    count = int(owner.max()) + 1
    sums = torch.zeros(count, 3, dtype=vertices.dtype).index_add(0, owner, vertices)
    merged = sums / torch.bincount(owner, minlength=count)[:, None]
    corners = owner[faces]
    has_area = torch.stack([corners[:, a] != corners[:, b] for a, b in pairwise((0, 1, 2, 0))])
    return merged, corners[has_area.all(0)]
