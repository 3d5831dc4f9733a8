"""Cuboids of KITTI's text files.

`layout` finds the files, `files` has their lines, `checks` holds the fields of a line against each
other; `reader` makes the records.
"""
