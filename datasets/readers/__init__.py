"""Readers of annotation files: one format a file or folder, each giving a RecordSet or a CuboidSet."""
