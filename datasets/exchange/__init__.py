"""Writers of cuboids in other tools' formats: Omni3D, COCO keypoints and KITTI.

Each writes by the Convention by which its format is read (readers/cuboid_conventions.py); `export`
has what they share.
"""
