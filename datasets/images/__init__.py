"""The pixels of a dataset: photographs, EXIF headers, and masks as pictures, runs and polygons.

`photos` reads pictures, `exif` their headers, `masks` the mask of a record; `rle` and
`segmentation` read masks as COCO writes them.
"""
