"""Readers of annotation files.

One format a file or folder, each giving a RecordSet or a CuboidSet.
"""
