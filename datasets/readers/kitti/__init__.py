"""Cuboids of KITTI: the text files and their reader."""
