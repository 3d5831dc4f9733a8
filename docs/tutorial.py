"""The tutorial of the documentation, in the percent format: open it as a notebook, or read it.

Run: python docs/hooks/tutorial_page.py FOLDER  (runs it, and writes the page and a notebook)
"""

# %% [markdown]
# # Tutorial
#
# This page follows a few drawn animals from their pictures to a batch for training. It needs no
# files and no download: the animals come from the synthetic world, where the true box of every
# animal is known. Everything below was run when this page was built.

# %%
import torch
from PIL import Image

from animal3dbox import CuboidLabel, LabelConfig, label_animal
from animal3dbox.datasets.synthetic import synthetic_animal
from animal3dbox.geometry import FACE_NAMES, box_iou
from animal3dbox.report import draw_label

animal = synthetic_animal(seed=0, index=12, preset="horse", pose="trot")
Image.fromarray(animal.image.numpy())

# %% [markdown]
# ## Label one animal
#
# `animal` stands in for what you have: a picture, 2D keypoints, a posed mesh of the animal and a
# mask. The keypoints are moved by two pixels, as a person or a network would mark them.

# %%
noise_px = 2 * torch.randn(26, 2, generator=torch.Generator().manual_seed(0))
keypoints_2d = animal.keypoints_2d.clone()
keypoints_2d[:, :2] += noise_px

label = label_animal(
    image_hw=animal.image_hw,
    keypoints_2d=keypoints_2d,  # (26, 3): x, y, visibility
    vertices=animal.vertices,  # (V, 3): a posed mesh, in any frame and unit
    faces=animal.model.faces,
    template=animal.model,  # what the mesh corresponds to
    K=animal.K,
    mask=animal.mask,
    sample_id="first",
    config=LabelConfig(),
)
if not isinstance(label, CuboidLabel):
    raise SystemExit(f"no label: {label.reason}: {label.detail}")
Image.fromarray(draw_label(animal.image.numpy(), label))

# %% [markdown]
# The front of the box is green, with a cross where it is seen, and its back is blue; a white arrow
# points to the front. Left and right are the animal's own, never the picture's:
# [Conventions](conventions.md) has every frame, and the numbers of the corners.
#
# A label says which side the picture shows, how much of it, and how far it may be trusted.

# %%
print(f"the {label.side} side is seen most, from {label.viewpoint}; flank: {label.flank}")
for name, share in zip(FACE_NAMES, label.face_share.tolist(), strict=True):
    print(f"{name:>6} {share:5.2f}")
print(f"confidence {label.confidence:.2f}")

# %% [markdown]
# The world knows the truth, so the label can be compared with it: the exact overlap of the two
# boxes, as intersection over union. [Confidence](confidence.md) says what the number above it is
# worth on animals whose truth nobody knows.

# %%
print(f"overlap with the true box: {float(box_iou(label.cuboid, animal.cuboid)):.2f}")

# %% [markdown]
# ## Refusals
#
# What cannot be labelled comes back as a `Rejection` with its reason. Input that cannot be right
# raises an error that names the sample, the field and the remedy.

# %%
three_keypoints = keypoints_2d.clone()
three_keypoints[3:, 2] = 0
refused = label_animal(
    image_hw=animal.image_hw,
    keypoints_2d=three_keypoints,
    vertices=animal.vertices,
    faces=animal.model.faces,
    template=animal.model,
    K=animal.K,
    sample_id="second",
)
print(refused.reason, refused.detail, sep=": ")

# %%
from animal3dbox.errors import Animal3DBoxError

try:
    label_animal(image_hw=(480, 640), vertices=animal.vertices[:, :2], sample_id="third")
except Animal3DBoxError as error:
    print(error)

# %% [markdown]
# ## A Dataset, and transforms that keep the camera true
#
# A Dataset gives pictures and targets. A transform changes both: the camera, the box, its faces
# and its keypoints follow every map of the pixels by one law ([Transforms](transforms.md)).

# %%
from animal3dbox.datasets import SyntheticDataset
from animal3dbox.transforms import Compose, RandomHorizontalFlip, RandomVirtualCamera

dataset = SyntheticDataset(4, seed=3, image_hw=(240, 320))
image, target = dataset[0]
for name in ("corners_3d", "corners_2d", "face_visible", "face_share", "K", "flank"):
    print(f"{name:>12} {tuple(target[name].shape)}")

# %%
mirror = Compose([RandomHorizontalFlip(p=1), RandomVirtualCamera(1, 1, 15)], seed=0)
mirrored_image, mirrored_target = mirror(image, target)


def side_of(target: dict) -> str:
    """The side of the first animal that is seen most."""
    return FACE_NAMES[int(target["face_share"][0].argmax())]


print("before:", side_of(target), "- after the mirror:", side_of(mirrored_target))

# %%
import numpy as np

from animal3dbox.geometry import Cuboid
from animal3dbox.report import draw_cuboid


def drawn(image: torch.Tensor, target: dict) -> np.ndarray:
    """A picture (H, W, 3) with the boxes of its target."""
    canvas = image.permute(1, 2, 0).contiguous().numpy().copy()
    for center, rotation, size in zip(
        target["center"], target["rotation"], target["size"], strict=True
    ):
        draw_cuboid(canvas, Cuboid(center, rotation, size), target["K"])
    return canvas


both = [drawn(image, target), drawn(mirrored_image, mirrored_target)]
Image.fromarray(np.concatenate(both, axis=1))

# %% [markdown]
# ## A batch, and a check of what reaches the loss
#
# `check_targets` raises what cannot be true, and names the animal and the field. Here a camera was
# left behind by a crop that somebody wrote by hand.

# %%
from torch.utils.data import DataLoader

from animal3dbox.training import check_targets

loader = DataLoader(dataset, batch_size=2, collate_fn=dataset.collate_fn)
images, targets = next(iter(loader))
check_targets((images, targets))
print(len(images), "pictures, nothing wrong")

targets[1]["K"] = targets[1]["K"].clone()
targets[1]["K"][0, 2] += 40
try:
    check_targets((images, targets))
except Animal3DBoxError as error:
    print(str(error).split(". ")[0])

# %% [markdown]
# ## Where to go from here
#
# - You have photographs with keypoints: [Use camera traps](camera-traps.md).
# - You have a dataset in a format that is not known here: [Read your dataset](your-reader.md).
# - You train a detector: [Targets for detectors](detector_targets.md), [Metrics](metrics.md).
# - Your boxes are not of animals: [Which side is the front of a 3D box?](front.md)
