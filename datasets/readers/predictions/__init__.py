"""Boxes of other people's detectors, in the layouts that their programs write.

`layouts` states what each means, `reader` has the door; each other file reads one layout.
"""
