"""Cuboids in Omni3D's JSON.

`schema` says what a file may hold, `recognition` tells such a file from COCO's, `elements` checks
its elements, `layout` finds the order of its corners, `image_roots` its images; `reader` makes the
records.
"""
