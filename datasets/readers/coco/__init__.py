"""COCO keypoints, AnimalPose and what is converted to them.

`file` takes the JSON apart, image by image; `reader` makes the records.
"""
