"""Readers of animal data and the body sources that labels are made from."""

if __name__ != "animal3dbox.datasets":
    raise ImportError("import animal3dbox.datasets, not the folder datasets of its checkout: take the checkout's root off sys.path")
