"""Augmentations that keep the camera true, for any cuboid dataset (they arrive with a later version)."""

if __name__ != "animal3dbox.transforms":
    raise ImportError("import animal3dbox.transforms, not the folder transforms of its checkout: take the checkout's root off sys.path")
