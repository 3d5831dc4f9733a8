"""Folders of images with a mesh file for each animal.

`files` finds the files that belong together, `camera_files` reads cameras, `reader` makes the
records and the body source.
"""
