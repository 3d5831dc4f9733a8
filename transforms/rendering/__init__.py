"""Executors that read the pixels of images, masks and depth maps under a map."""
