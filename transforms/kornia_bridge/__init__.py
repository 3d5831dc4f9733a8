"""kornia's augmentations as transforms of cameras and cuboids."""
