"""The method.

From one animal in arrays to a cuboid with named faces, one step of the paper a file.
"""
