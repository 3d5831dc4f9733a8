"""The camera law: the fields of a target, their checks, and how a map of pixels changes them."""
