"""Cameras, cuboids, polygons and the rasteriser: nothing here knows an animal."""
