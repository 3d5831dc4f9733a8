"""Readers of annotation files: one format a file or folder.

Readers of annotated animals give a RecordSet (`animal3d`, `coco`, `deeplabcut`, `mesh_folder`,
`stanfordextra`), readers of boxes a CuboidSet (`omni3d`, `kitti`). `elements` has the checks that
several share, `cuboid_checks` those of all boxes; `cuboid_conventions` and `visible_boxes` are
shared with the writers of boxes. A new format is a new file or folder here, and a line in
formats.py, or in cuboid_formats.py if it is of boxes.
"""
