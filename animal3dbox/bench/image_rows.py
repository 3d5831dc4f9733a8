"""One image of a split: its pixels, and everything that the benchmark's files say of it.

An image is a pure function of its split and its number, so that any process can draw any of them.
"""

import hashlib
import io
from dataclasses import replace

import msgspec
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from animal3dbox.bench.plan import SplitPlan
from animal3dbox.datasets.records import CuboidImage, CuboidRecord
from animal3dbox.datasets.storage.fingerprint import content_digest
from animal3dbox.datasets.synthetic.annotation import marked_keypoints
from animal3dbox.datasets.synthetic.faults import faulty_keypoints
from animal3dbox.datasets.synthetic.scenes import SyntheticAnimal, synthetic_scene
from animal3dbox.geometry.pixel_boxes import mask_box

Pixels = NDArray[np.uint8]
"""A picture (H, W, 3), RGB."""
PNG_LEVEL = 1
"""Sensor noise cannot be compressed: higher levels take six times as long for 2 % of the size."""


class AnimalRow(msgspec.Struct, kw_only=True, frozen=True):
    """One animal of an image, in the camera frame and the world's unit.

    Attributes:
        category: the species.
        center: (3,) of the true box.
        rotation: (3, 3) R_cam_box.
        size: (3,) length, width, height.
        box: (4,) xyxy px round the animal's visible pixels.
        visibility: part of the silhouette in the frame that nothing hides.
        keypoints: (J, 3) x, y, v as a detector would give them; v = 0 where it gives none.
        body: digest of the individual: its shape, whatever its pose.

    Example:
        >>> from animal3dbox.bench import bench_plan
        >>> row, _ = draw_image(bench_plan("small").split("val"), 0)
        >>> row.animals[0].category, len(row.animals[0].keypoints)
        ('dog', 26)
    """

    category: str
    center: list[float]
    rotation: list[list[float]]
    size: list[float]
    box: list[float]
    visibility: float
    keypoints: list[list[float]]
    body: str


class ImageRow(msgspec.Struct, kw_only=True, frozen=True):
    """One image of a split.

    Attributes:
        name: its path below the benchmark's folder.
        image_hw: height and width.
        K: (3, 3) in px.
        pixels: digest of the decoded pixels, see pixel_digest.
        scene: digest of everything in the scene: camera, animals, things, ground and light.
        animals: the visible ones; an image may have none.

    Example:
        >>> from animal3dbox.bench import bench_plan
        >>> row, pixels = draw_image(bench_plan("small").split("val"), 0)
        >>> row.name, row.pixels == pixel_digest(pixels)
        ('images/val/000000.png', True)
    """

    name: str
    image_hw: tuple[int, int]
    K: list[list[float]]
    pixels: str
    scene: str
    animals: list[AnimalRow]

    def image(self) -> CuboidImage:
        """The image as writers of cuboids take it."""
        return CuboidImage(self.name, None, self.image_hw, np.array(self.K))

    def records(self) -> list[CuboidRecord]:
        """The animals as writers of cuboids take them; their lengths are no metres."""
        return [
            CuboidRecord(
                sample_id=self.name + (f"#{number}" if number else ""),
                image_id=self.name,
                image_path=None,
                image_hw=self.image_hw,
                category=animal.category,
                K=np.array(self.K),
                center=np.array(animal.center),
                rotation=np.array(animal.rotation),
                size=np.array(animal.size),
                metric=False,
                box=np.array(animal.box),
                visibility=animal.visibility,
            )
            for number, animal in enumerate(self.animals)
        ]


def draw_image(split: SplitPlan, index: int) -> tuple[ImageRow, Pixels]:
    """The image of a split by its number: what is said of it, and its pixels (H, W, 3).

    Example:
        >>> from animal3dbox.bench import bench_plan
        >>> row, pixels = draw_image(bench_plan("small").split("test-focal"), 3)
        >>> pixels.shape, 110 <= row.K[0][0] <= 190
        ((192, 256, 3), True)
    """
    scene = synthetic_scene(split.seed, index, split.world)
    pixels = scene.image.numpy()
    row = ImageRow(
        name=split.image_name(index),
        image_hw=scene.camera.image_hw,
        K=scene.camera.K.tolist(),
        pixels=pixel_digest(pixels),
        scene=content_digest(replace(scene.plan, seed=0, index=0)).hex(),  # of the content alone
        animals=[_animal_row(animal, split) for animal in scene.animals],
    )
    return row, pixels


def _animal_row(animal: SyntheticAnimal, split: SplitPlan) -> AnimalRow:
    """The row of one animal: its box, and its keypoints as a detector would give them."""
    detected = faulty_keypoints(
        animal.sample_id,
        animal.image_hw,
        marked_keypoints(animal),
        faults=split.faults,
        seed=split.seed,
    )
    keypoints = detected * (detected[:, 2:] > 0)  # a missing one has no place
    return AnimalRow(
        category=animal.preset,
        center=animal.cuboid.center.tolist(),
        rotation=animal.cuboid.rotation.tolist(),
        size=animal.cuboid.size.tolist(),
        box=mask_box(animal.mask).tolist(),
        visibility=animal.visible_part,
        keypoints=keypoints.tolist(),
        body=content_digest(animal.parameters[0]).hex(),
    )


def pixel_digest(pixels: Pixels) -> str:
    """SHA-256 of a picture's size and its RGB bytes, row by row; of decoded pixels, not of a file.

    Example:
        >>> pixel_digest(np.zeros((1, 2, 3), np.uint8))[:16]
        '8e7c85e0b0346ce2'
    """
    height, width = pixels.shape[:2]
    size = f"{height} {width} 3 uint8\n".encode()
    return hashlib.sha256(size + np.ascontiguousarray(pixels).tobytes()).hexdigest()


def png_bytes(pixels: Pixels) -> bytes:
    """A picture (H, W, 3) as a PNG file.

    Example:
        >>> png_bytes(np.zeros((1, 2, 3), np.uint8))[1:4]
        b'PNG'
    """
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, "PNG", compress_level=PNG_LEVEL)
    return buffer.getvalue()
