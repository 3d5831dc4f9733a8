"""Fit a body to the keypoints of one photograph; the README shows this file.

Run: python examples/label_a_photograph.py
"""

from animal3dbox import CuboidLabel, label_animal
from animal3dbox.datasets.synthetic import synthetic_animal

photograph = synthetic_animal(seed=0, index=2)  # stands in for your own
label = label_animal(
    image_hw=photograph.image_hw,
    keypoints_2d=photograph.keypoints_2d,  # (26, 3) x, y in px, visibility
    vocabulary="animal3d26",  # or ap10k17, ...: `animal3dbox vocabularies`
    mask=photograph.mask,  # (H, W); None if there is none
    body="fit",
)
if isinstance(label, CuboidLabel):  # else a Rejection with its reason
    print(f"{label.side} side, seen from {label.viewpoint}", label.corners_2d, label.face_visible)
