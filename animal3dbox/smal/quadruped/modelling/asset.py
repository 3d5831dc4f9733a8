"""Packing of the parts into one small .npz of plain arrays, which preset_bodies.py unpacks."""

from pathlib import Path

import numpy as np

from animal3dbox.smal.quadruped.modelling.assemble import Parts
from animal3dbox.smal.quadruped.modelling.implicit import Array
from animal3dbox.smal.quadruped.modelling.skinning import JOINT_NAMES, MAX_INFLUENCES, PARENTS

PROVENANCE = (
    "Made by animal3dbox.smal.quadruped.modelling from hand-written tables of stations; no scan, no"
    " SMAL data. MIT licence as the package. Only the left half is stored: seam vertices (y = 0)"
    " first."
)
_INT16 = 32767


def write_asset(parts: Parts, path: Path) -> None:
    """Write the asset: int16 lengths with a scale, indices, and names joined by spaces."""
    vertices, vertices_scale = _quantised(parts.half.vertices)
    packed = [_quantised(column) for column in parts.columns.values()]
    order = np.argsort(-parts.weights, axis=1, kind="stable")[:, :MAX_INFLUENCES]
    rows, cols = np.nonzero(parts.regressor)
    names = list(parts.landmarks)
    np.savez_compressed(
        path,
        provenance=np.array(PROVENANCE),
        vertices=vertices,
        vertices_scale=np.array(vertices_scale),
        faces=parts.half.faces.astype(np.uint16),
        seam=np.array(parts.half.seam),
        columns=np.stack([column for column, _ in packed]).transpose(0, 2, 1).copy(),
        columns_scale=np.array([scale for _, scale in packed]),
        column_names=np.array(" ".join(parts.columns)),
        preset_names=np.array(" ".join(parts.presets)),
        measure_names=np.array(" ".join(parts.measures)),
        weight_joints=order.astype(np.uint8),
        weight_values=np.round(np.take_along_axis(parts.weights, order, axis=1) * 65535).astype(
            np.uint16
        ),
        regressor_rows=rows.astype(np.uint8),
        regressor_cols=cols.astype(np.uint16),
        regressor_values=parts.regressor[rows, cols],
        joint_names=np.array(" ".join(JOINT_NAMES)),
        parents=np.array(PARENTS, dtype=np.int8),
        landmark_names=np.array(" ".join(names)),
        landmark_counts=np.array([len(parts.landmarks[name]) for name in names], dtype=np.uint8),
        landmark_vertices=np.concatenate([parts.landmarks[name] for name in names]).astype(
            np.uint16
        ),
    )


def _quantised(values: Array) -> tuple[np.ndarray, float]:
    """Values as int16 times a scale."""
    scale = max(float(np.abs(values).max()), 1e-9) / _INT16
    return np.round(values / scale).astype(np.int16), scale
