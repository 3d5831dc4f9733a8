"""Where an animal's body comes from: a preset, a model's parameters, or a mesh file.

`sources` defines what a body source is; `mesh_file` and `mesh_folder` are sources of files, which
`mesh_formats` reads; `options` finds the source that a user's words name.
"""
