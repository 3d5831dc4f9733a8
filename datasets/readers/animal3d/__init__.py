"""Animal3D and datasets written like it.

`entries` checks the elements of its files, `camera` finds the frame that its bodies stand in,
`reader` makes the records and the bodies.
"""
