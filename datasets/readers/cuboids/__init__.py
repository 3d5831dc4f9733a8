"""Other people's cuboids: Omni3D and KITTI."""
