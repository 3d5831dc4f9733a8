"""Writers for other tools: cuboids as Omni3D, COCO keypoints and KITTI, and fits' parameters.

Each writer of cuboids goes by the Convention by which its format is read
(readers/cuboid_conventions.py); `export` has what they share. `animal3d_writer` and
`quadruped_file` write the parameters of fitted bodies, which `fitted_animals` holds.
"""
