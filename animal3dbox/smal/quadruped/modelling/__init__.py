"""The maker of the embedded quadruped: `python -m animal3dbox.smal.quadruped.modelling OUT.npz`.

Every number in this package was chosen by hand for this project; nothing is taken from SMAL or from
any scan. The steps, one file each: `species_*` (tables) -> `anatomy` (tables to primitives and
joints) -> `implicit` (the smooth union of the primitives) -> `meshing` (one master mesh) ->
`transfer` (the same mesh on another species) -> `measures`, `skinning`, `landmarks` -> `asset`
(packing).
"""
