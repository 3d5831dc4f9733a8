"""Label one animal from arrays; the README shows this file.

Run: python examples/label_one_animal.py
"""

from animal3dbox import CuboidLabel, LabelConfig, label_animal
from animal3dbox.datasets.synthetic import synthetic_animal
from animal3dbox.geometry import FACE_NAMES

animal = synthetic_animal(seed=0, index=2)  # stands in for your own image, keypoints, mesh and mask

label = label_animal(
    image_hw=animal.image_hw,
    keypoints_2d=animal.keypoints_2d,  # (26, 3) x, y, visibility
    vertices=animal.vertices,  # (V, 3) a posed mesh, in any frame and unit
    faces=animal.model.faces,
    template=animal.model,  # what the mesh corresponds to; without it, give keypoints_3d
    K=animal.K,
    mask=animal.mask,
    sample_id=animal.sample_id,
    config=LabelConfig(method="default"),
)
if not isinstance(label, CuboidLabel):
    raise SystemExit(f"no label: {label.reason}: {label.detail}")

print(f"{label.sample_id}: {label.side} side, seen from {label.viewpoint}")
print("shares:", dict(zip(FACE_NAMES, label.face_share.tolist(), strict=True)))
print("corners in the image:", label.corners_2d.round().tolist())
