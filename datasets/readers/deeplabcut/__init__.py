"""DeepLabCut's tables of bodyparts.

`table` has their form and reads csv, `h5` reads HDF5, `reader` makes the records.
"""
