"""Folders of images with a mesh file for each animal."""
