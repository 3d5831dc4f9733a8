"""The pictures of a synthetic world: posed quadrupeds under known cameras, the same for a seed.

`config` has the dials; `scene` plans a scene from `animals`, `coats`, `things`, `ground` and
`cameras`; `shading` and `render` make its picture.
"""
