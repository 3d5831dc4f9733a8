"""All parts of the model from the tables."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from animal3dbox.smal.quadruped.modelling.anatomy import Table, joints_of, mean_table, primitives_of
from animal3dbox.smal.quadruped.modelling.implicit import Array
from animal3dbox.smal.quadruped.modelling.landmarks import landmark_groups
from animal3dbox.smal.quadruped.modelling.measures import MEASURE_EDITS
from animal3dbox.smal.quadruped.modelling.meshing import HalfMesh, mesh_half, mirror_weld
from animal3dbox.smal.quadruped.modelling.skinning import joint_regressor, skin_weights
from animal3dbox.smal.quadruped.modelling.species import MASTER_SHARES, SPECIES, TEMPLATE_SHARES
from animal3dbox.smal.quadruped.modelling.transfer import transferred
from animal3dbox.smal.quadruped.modelling.variations import VARIATION_EDITS

SHAPE_COLUMNS = 41
UNIT = 0.65  # template units in a trunk length: the template is about 1 long from nose to rump
SIZE_STEP = 0.1
_GRID_STEP = 0.0075
_HALF_FACES = 5850
_MASTER_HEAD = 1.55
"""The head's scale on the animal that the mesh is made on, for more vertices there."""


@dataclass(frozen=True)
class Parts:
    """The contents of the asset, in template units.

    Attributes:
        half: the left half of the template.
        columns: name -> displacement (H, 3) of the half's vertices for one unit of beta.
        presets: species name -> its shape column's name.
        measures: names of the columns that change one measure.
        weights: (H, J) of the half.
        regressor: (J, V).
        symmetry: (V,).
        landmarks: name -> vertex ids.
    """

    half: HalfMesh
    columns: dict[str, Array]
    presets: tuple[str, ...]
    measures: tuple[str, ...]
    weights: Array
    regressor: Array
    symmetry: NDArray[np.int64]
    landmarks: dict[str, tuple[int, ...]]


def build_parts() -> Parts:
    """Build all parts of the asset from the tables; deterministic."""
    master_table = _master_table()
    master = primitives_of(master_table)
    master_half = mesh_half(master, _GRID_STEP, _HALF_FACES)
    table = template_table()
    primitives = primitives_of(table)
    half = HalfMesh(
        transferred(master, primitives, master_half, relax_rounds=4),
        master_half.faces,
        master_half.seam,
    )
    tables = {name: edit(table) for name, edit in MEASURE_EDITS.items()} | dict(SPECIES)
    tables |= {name: edit(table) for name, edit in VARIATION_EDITS.items()}
    shapes = {}
    for name, other in tables.items():
        if name in SPECIES:
            shapes[name] = transferred(master, primitives_of(other), master_half, relax_rounds=4)
        else:
            shapes[name] = transferred(primitives, primitives_of(other), half, relax_rounds=0)
    return _parts(table, half, shapes, tables)


def _parts(
    table: Table, half: HalfMesh, shapes: dict[str, Array], tables: dict[str, Table]
) -> Parts:
    _, _, symmetry = mirror_weld(half)
    joints = [joints_of(t) for t in (table, *tables.values())]
    whole = np.stack(
        [
            mirror_weld(HalfMesh(v, half.faces, half.seam))[0]
            for v in (half.vertices, *shapes.values())
        ]
    )
    columns = {"size": SIZE_STEP * UNIT * half.vertices}
    columns |= {name: UNIT * (vertices - half.vertices) for name, vertices in shapes.items()}
    if len(columns) != SHAPE_COLUMNS:
        raise ValueError(
            f"SMAL's structure has {SHAPE_COLUMNS} shape columns, the tables give {len(columns)}"
        )
    return Parts(
        half=HalfMesh(UNIT * half.vertices, half.faces, half.seam),
        columns=columns,
        presets=tuple(SPECIES),
        measures=("size", *MEASURE_EDITS),
        weights=skin_weights(table, primitives_of(table), half),
        regressor=joint_regressor(joints, whole, symmetry, len(half.vertices)),
        symmetry=symmetry,
        landmarks=landmark_groups(table, half, symmetry),
    )


def template_table() -> Table:
    """The mean of the species, without horns, and with ears of half the cat's size, upright.

    The ears' own mean would be neither up nor down.
    """
    table = mean_table([SPECIES[name] for name in TEMPLATE_SHARES], list(TEMPLATE_SHARES.values()))
    cat, dog = SPECIES["cat"], SPECIES["dog"]
    ear = np.hstack(
        [
            table["ear"][0, :3] + 0.6 * (cat["ear"][:, :3] - cat["ear"][0, :3]),
            0.6 * cat["ear"][:, 3:],
        ]
    )
    return {**table, "ear": ear, "ear_facing": cat["ear_facing"], "horn": dog["horn"]}


def _master_table() -> Table:
    table = mean_table([SPECIES[name] for name in MASTER_SHARES], list(MASTER_SHARES.values()))
    out = {key: value.copy() for key, value in table.items()}
    cat, cow = SPECIES["cat"], SPECIES["cow"]
    out["head_frame"][3] *= _MASTER_HEAD
    out["ear"][:, :3] = (
        out["ear"][0, :3] + [0.06, 0.02, -0.01] + 0.9 * (cat["ear"][:, :3] - cat["ear"][0, :3])
    )
    out["ear"][:, 3:] = 0.9 * cat["ear"][:, 3:]
    out["ear_facing"] = cat["ear_facing"]
    out["horn"] = cow["horn"] + [-0.04, 0.0, 0.02, 0.0]
    out["mane"][:, :2] += [-0.02, 0.02]
    return out
