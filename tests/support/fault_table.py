"""The table of faults: kinds of mistakes, each planted in every format of JSON that can have it.

A kind says once what is wrong; how the formats write it is in KEYS.
"""

import copy
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from photo_dataset import HW, png_that_claims
from PIL import Image
from written_otherwise import JsonSet

from animal3dbox.datasets.images.rle import encode_mask

Plant = Callable[[JsonSet], None]
COCO, STANFORDEXTRA, ANIMAL3D = "coco", "stanfordextra", "animal3d"
ALL = (COCO, STANFORDEXTRA, ANIMAL3D)
KEYS = {
    "image": {COCO: "file_name", STANFORDEXTRA: "img_path", ANIMAL3D: "img_path"},
    "width": {COCO: "width", STANFORDEXTRA: "img_width", ANIMAL3D: "width"},
    "height": {COCO: "height", STANFORDEXTRA: "img_height", ANIMAL3D: "height"},
    "keypoints": {COCO: "keypoints", STANFORDEXTRA: "joints", ANIMAL3D: "keypoint_2d"},
    "box": {COCO: "bbox", STANFORDEXTRA: "img_bbox"},
    "mask": {COCO: "segmentation", STANFORDEXTRA: "seg", ANIMAL3D: "mask_path"},
    "twice": {COCO: "id", STANFORDEXTRA: "entry", ANIMAL3D: "entry"},
}
"""What an element says -> the key of it, by format."""
LISTS = {COCO: "annotations", ANIMAL3D: "data"}
"""The key of the list of animals' elements."""
OF_IMAGES = ("image", "width", "height")
"""What stands in COCO's list of images, not with the animal."""


@dataclass(frozen=True)
class Kind:
    """A kind of mistake.

    Attributes:
        part: of KEYS, whose key or whose own name the fault's field must hold; or the field.
        plant: makes the mistake in the first animal, or its image.
        formats: that can have it.
        names_image: whether the fault names the image; else the place of the element in the file.
    """

    part: str
    plant: Plant
    formats: tuple[str, ...] = ALL
    names_image: bool = True

    def fields(self, format: str) -> tuple[str, ...]:
        """What the fault's field must hold one of: the file's key, or the part of a record."""
        return self.part, KEYS.get(self.part, {}).get(format, self.part)


def element_of(made: JsonSet, part: str) -> dict[str, Any]:
    """The element that says a part of the first animal."""
    return image_of(made) if part in OF_IMAGES else made.animals[0]


def image_of(made: JsonSet) -> dict[str, Any]:
    """The element that names the first animal's image."""
    if made.format != COCO:
        return made.animals[0]
    wanted = made.animals[0]["image_id"]
    return next(image for image, _ in made.images if image["id"] == wanted)


def file_of(made: JsonSet) -> Path:
    """The first animal's picture."""
    return made.root / "images" / str(image_of(made)[KEYS["image"][made.format]])


def setting(part: str, value: Any) -> Plant:
    """Write a value for a part."""
    return lambda made: element_of(made, part).update(
        {KEYS[part][made.format]: copy.deepcopy(value)}
    )


def without(part: str) -> Plant:
    """Leave a part out."""

    def plant(made: JsonSet) -> None:
        element_of(made, part).pop(KEYS[part][made.format], None)

    return plant


def rows(change: Callable[[list[Any]], list[Any]]) -> Plant:
    """Change the rows of x, y and visibility of the first animal's keypoints."""

    def plant(made: JsonSet) -> None:
        animal, key = made.animals[0], KEYS["keypoints"][made.format]
        own = animal[key]
        if made.format == COCO:
            changed = change([own[i : i + 3] for i in range(0, len(own), 3)])
            own = [number for row in changed for number in row]
        else:
            own = change(own)
        animal[key] = own

    return plant


def in_file(write: Callable[[Path], object]) -> Plant:
    """Change the first animal's picture."""

    def plant(made: JsonSet) -> None:
        write(file_of(made))

    return plant


def resaved(change: Callable[[Image.Image], Image.Image], format: str = "JPEG") -> Plant:
    """Save the first animal's picture anew."""

    def write(path: Path) -> None:
        image = change(Image.open(path))
        image.save(path, format=format)

    return in_file(write)


def as_folder(path: Path) -> None:
    """Put a folder in a file's place."""
    path.unlink()
    path.mkdir()


def linked_to(target: str | None) -> Callable[[Path], object]:
    """Put a link in a file's place; None: to itself."""

    def write(path: Path) -> None:
        path.unlink()
        path.symlink_to(target or path.name)

    return write


def turned(path: Path) -> None:
    """Store a picture sideways, with the EXIF tag that turns it back."""
    exif = Image.Exif()
    exif[274] = 6
    Image.open(path).transpose(Image.Transpose.ROTATE_90).save(path, format="JPEG", exif=exif)


def mask_runs(mask: np.ndarray) -> Plant:
    """Write a mask in runs for the first animal."""
    runs = {"size": list(mask.shape), "counts": encode_mask(mask)}
    return setting("mask", runs)


def mask_file(write: Callable[[Path], object]) -> Plant:
    """Give the first animal a mask's file."""

    def plant(made: JsonSet) -> None:
        path = made.root / "images" / "masks" / "a.png"
        path.parent.mkdir(exist_ok=True)
        write(path)
        made.animals[0]["mask_path"] = "masks/a.png"

    return plant


def appended(make: Callable[[dict[str, Any]], Any]) -> Plant:
    """One more element at the end, made of the first."""

    def plant(made: JsonSet) -> None:
        content = made.content
        elements = content if made.format == STANFORDEXTRA else content[LISTS[made.format]]
        elements.append(make(made.animals[0]))

    return plant


def first_row(row: list[Any]) -> Plant:
    return rows(lambda own: [row, *own[1:]])


BOXED, IN_RUNS, NESTED = (COCO, STANFORDEXTRA), (COCO, STANFORDEXTRA), (STANFORDEXTRA, ANIMAL3D)
KINDS: dict[str, Kind] = {
    # the image's name
    "image left out": Kind("image", without("image"), names_image=False),
    "image null": Kind("image", setting("image", None), names_image=False),
    "image a number": Kind("image", setting("image", 7), names_image=False),
    "image a list": Kind("image", setting("image", ["a.jpg"]), names_image=False),
    "image without a name": Kind("image", setting("image", " "), names_image=False),
    "image that is not there": Kind("image", in_file(Path.unlink)),
    "image is a folder": Kind("image", in_file(as_folder)),
    "image outside the root": Kind("image", setting("image", "../a.jpg")),
    "image anywhere": Kind("image", setting("image", "/etc/hostname")),
    "image with a zero byte": Kind("image", setting("image", "a\0.jpg")),
    "image of a long name": Kind("image", setting("image", "x" * 300 + ".jpg")),
    "image a link to itself": Kind("image", in_file(linked_to(None))),
    "image a link out of the root": Kind("image", in_file(linked_to("/etc/hostname"))),
    # the picture
    "picture empty": Kind("image", in_file(lambda p: p.write_bytes(b""))),
    "picture a text": Kind("image", in_file(lambda p: p.write_bytes(b"<html>404</html>"))),
    "picture cut off": Kind(
        "image", in_file(lambda p: p.write_bytes(p.read_bytes()[: p.stat().st_size // 2]))
    ),
    "picture too large": Kind(
        "image", in_file(lambda p: p.write_bytes(png_that_claims(60_000, 60_000)))
    ),
    "picture resized": Kind("image", resaved(lambda image: image.resize((80, 60)))),
    "picture turned by EXIF": Kind("image", in_file(turned)),
    "picture of floats": Kind("image", resaved(lambda image: image.convert("F"), format="TIFF")),
    # the size
    **{
        f"{side} {name}": Kind(side, setting(side, value))
        for side in ("width", "height")
        for name, value in (
            ("zero", 0),
            ("negative", -120),
            ("in words", "120"),
            ("of a part of a pixel", 120.5),
            ("a list", [120]),
            ("beyond reason", 10**9),
        )
    },
    "width left out": Kind("width", without("width"), (STANFORDEXTRA,)),
    "height left out": Kind("height", without("height"), (STANFORDEXTRA,)),
    # the keypoints
    "keypoints left out": Kind("keypoints", without("keypoints"), NESTED),
    "keypoints null": Kind("keypoints", setting("keypoints", None), NESTED),
    "keypoints in words": Kind("keypoints", setting("keypoints", "1 2 3")),
    "keypoints a dictionary": Kind("keypoints", setting("keypoints", {"nose": [1, 2, 1]})),
    "keypoints an empty list": Kind("keypoints", setting("keypoints", []), NESTED),
    "keypoint too few": Kind("keypoints", rows(lambda own: own[:-1])),
    "keypoint too many": Kind("keypoints", rows(lambda own: [*own, [1.0, 1.0, 1.0]])),
    "keypoint of one number": Kind("keypoints", first_row([5.0])),
    "keypoint of four numbers": Kind("keypoints", first_row([5.0, 5.0, 1.0, 1.0])),
    "keypoint in words": Kind("keypoints", first_row(["5", "5", "1"])),
    "keypoint too deep": Kind("keypoints", first_row([[5.0, 5.0, 1.0]] * 3)),
    "keypoint of visibility 3": Kind("keypoints", first_row([5.0, 5.0, 3])),
    "keypoint of negative visibility": Kind("keypoints", first_row([5.0, 5.0, -0.5])),
    "keypoint far away": Kind("keypoints_2d", first_row([1e7, 5.0, 1])),
    "keypoint beyond numbers": Kind("keypoints_2d", first_row([1e300, 5.0, 1])),
    "keypoints normalised": Kind(
        "keypoints_2d",
        rows(lambda own: [[x / HW[1], y / HW[0], v] for x, y, v in own]),
    ),
    "keypoints of a larger picture": Kind(
        "keypoints_2d", rows(lambda own: [[4 * x, 4 * y, v] for x, y, v in own])
    ),
    # the box
    "box null": Kind("box", setting("box", None), (STANFORDEXTRA,)),
    "box in words": Kind("box", setting("box", "5 5 20 20"), BOXED),
    "box of three numbers": Kind("box", setting("box", [5, 5, 20]), BOXED),
    "box of five numbers": Kind("box", setting("box", [5, 5, 20, 20, 1]), BOXED),
    "box flat": Kind("box", setting("box", [5, 5, 20, 0]), BOXED),
    "box negative": Kind("box", setting("box", [5, 5, -20, 20]), BOXED),
    "box too deep": Kind("box", setting("box", [[5, 5, 20, 20]]), BOXED),
    "box beside the image": Kind("box", setting("box", [500, 500, 20, 20]), (COCO,)),
    "box of another animal": Kind("keypoints_2d", setting("box", [1, 1, 3, 3]), BOXED),
    # the mask
    "mask a number": Kind("mask", setting("mask", 7)),
    "mask of another size": Kind("mask", mask_runs(np.ones((5, 5), dtype=bool)), IN_RUNS),
    "mask without a pixel": Kind("mask", mask_runs(np.zeros(HW, dtype=bool)), IN_RUNS),
    "mask without runs": Kind("mask", setting("mask", {"size": list(HW)}), IN_RUNS),
    "mask of letters that are none": Kind(
        "mask", setting("mask", {"size": list(HW), "counts": "é"}), IN_RUNS
    ),
    "mask ends within a number": Kind(
        "mask", setting("mask", {"size": list(HW), "counts": "`"}), IN_RUNS
    ),
    "mask of two points": Kind("mask", setting("mask", [[1, 2, 3, 4]]), IN_RUNS),
    "mask that is not there": Kind("mask", setting("mask", "masks/x.png"), (ANIMAL3D,)),
    "mask outside the root": Kind("mask", setting("mask", "../x.png"), (ANIMAL3D,)),
    "mask file of another size": Kind(
        "mask",
        mask_file(lambda p: Image.fromarray(np.full((5, 5), 255, np.uint8)).save(p)),
        (ANIMAL3D,),
    ),
    "mask file a text": Kind("mask", mask_file(lambda p: p.write_text("no")), (ANIMAL3D,)),
    # the element
    "element null": Kind("entry", appended(lambda own: None), names_image=False),
    "element a number": Kind("entry", appended(lambda own: 5), names_image=False),
    "element a list": Kind("entry", appended(lambda own: [own]), names_image=False),
    "element twice": Kind("twice", appended(copy.deepcopy)),
}
"""The mistake in words -> how it is made and what must be said of it."""
