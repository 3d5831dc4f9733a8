"""Cuboids of KITTI: `files` has the lines of its text files, `reader` makes the records."""
