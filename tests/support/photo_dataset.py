"""A small StanfordExtra dataset made in a folder.

Simple pictures of known bodies, and every fault a dataset can have.
"""

import copy
import json
import struct
import zlib
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from animals import camera_round, toy_landmarks, toy_mesh
from numpy.typing import NDArray
from PIL import Image
from torch import Tensor

from animal3dbox.datasets.images.rle import encode_mask
from animal3dbox.geometry.camera import intrinsics, project
from animal3dbox.geometry.rasterizer import silhouette
from animal3dbox.smal.keypoints.vocabularies import ANIMAL3D_26, VOCABULARIES

HW = (120, 160)
K = intrinsics(1.2 * max(HW), HW)  # what the package guesses when it is told none
WORDS = VOCABULARIES["stanfordextra24"]
Entry = dict[str, Any]
Picture = NDArray[np.uint8]


@dataclass(frozen=True)
class Scene:
    """A body, x forward, y left, z up, about one unit long."""

    vertices: Tensor
    faces: Tensor
    landmarks: Tensor


def toy_scene() -> Scene:
    """The toy animal with StanfordExtra's keypoints; NaN for those it has not."""
    vertices, faces = toy_mesh()
    groups = {name: [row] for row, name in enumerate(ANIMAL3D_26)}
    return Scene(vertices, faces, WORDS.on_body(groups, toy_landmarks()))


@dataclass(frozen=True)
class View:
    """What the camera sees: (H, W, 3), (H, W), (24, 3)."""

    picture: Picture
    mask: NDArray[np.bool_]
    joints: list[list[float]]


def view_of(
    scene: Scene, azimuth_deg: float, elevation_deg: float = 12.0, distance: float = 2.4
) -> View:
    """A grey animal before noise, seen from an azimuth: 0 ahead of it, 90 from its left."""
    R, t = camera_round(azimuth_deg, elevation_deg, distance)
    mask = silhouette(scene.vertices @ R.mT + t, scene.faces, K, HW).numpy()
    px, _ = project(K, scene.landmarks @ R.mT + t)
    has = torch.isfinite(px).all(1)
    joints = [
        [round(x, 3), round(y, 3), 1.0] if known else [0.0, 0.0, 0.0]
        for (x, y), known in zip(px.tolist(), has.tolist(), strict=True)
    ]
    picture = np.random.default_rng(0).integers(90, 130, (*HW, 3), dtype=np.uint8)
    picture[mask] = (170, 120, 80)
    return View(picture, mask, joints)


def entry_of(view: View, name: str) -> Entry:
    """The json's element for a view."""
    rows, columns = np.nonzero(view.mask)
    box = [int(columns.min()), int(rows.min()), int(np.ptp(columns)) + 1, int(np.ptp(rows)) + 1]
    return {
        "img_path": name, "img_width": HW[1], "img_height": HW[0],
        "joints": copy.deepcopy(view.joints), "img_bbox": box,
        "is_multiple_dogs": False, "seg": encode_mask(view.mask),
    }  # fmt: skip


def add_photo(root: Path, view: View, name: str) -> Entry:
    """Save a view's picture under root/images; its json element."""
    path = root / "images" / name
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(view.picture).save(path, "JPEG", quality=90)
    return entry_of(view, name)


def write_annotations(root: Path, entries: Iterable[Entry | bytes]) -> Path:
    """The dataset's json; an entry as bytes goes in as it is."""
    path = root / "annotations.json"
    path.write_bytes(
        b"["
        + b",\n".join(e if isinstance(e, bytes) else json.dumps(e).encode() for e in entries)
        + b"]"
    )
    return path


def png_that_claims(width: int, height: int) -> bytes:
    """A PNG of a few bytes whose header promises any size, its checksums right."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return (
            struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        )

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", header)
        + chunk(b"IDAT", zlib.compress(b"\0" * 64))
        + chunk(b"IEND", b"")
    )


@dataclass(frozen=True)
class Fault:
    """One way for a sample to be unusable.

    Attributes:
        field: named in the error.
        reason: words of the error.
        spoil: gets the good element, the images' folder and the image's file; gives the bad
            element.
        when_read: found when the json is read, not when the animal is labelled.
        sample: the sample that the error names, if it is not the image.
    """

    field: str
    reason: str
    spoil: Callable[[Entry, Path, Path], Entry | bytes]
    when_read: bool = True
    sample: str = ""


def setting(**changes: Any) -> Callable[[Entry, Path, Path], Entry]:
    """Replace keys."""
    return lambda entry, root, file: {**entry, **changes}


def without(key: str) -> Callable[[Entry, Path, Path], Entry]:
    """Leave a key out."""
    return lambda entry, root, file: {k: v for k, v in entry.items() if k != key}


def joint(row: list[Any]) -> Callable[[Entry, Path, Path], Entry]:
    """Replace the third joint."""
    return lambda entry, root, file: {
        **entry,
        "joints": [*entry["joints"][:2], row, *entry["joints"][3:]],
    }


def moved(x: float, y: float) -> Callable[[Entry, Path, Path], Entry]:
    """Joints in another unit."""
    return lambda entry, root, file: {
        **entry,
        "joints": [[x * u, y * v, seen] for u, v, seen in entry["joints"]],
    }


def written(data: Callable[[bytes], bytes]) -> Callable[[Entry, Path, Path], Entry]:
    """Change the bytes of the image's file."""

    def spoil(entry: Entry, root: Path, file: Path) -> Entry:
        file.write_bytes(data(file.read_bytes()))
        return entry

    return spoil


def saved(
    image: Callable[[Image.Image], Image.Image], **options: Any
) -> Callable[[Entry, Path, Path], Entry]:
    """Change the image itself."""

    def spoil(entry: Entry, root: Path, file: Path) -> Entry:
        with Image.open(file) as old:
            changed = image(old.convert("RGB"))
        changed.save(file, **{"format": "JPEG", **options})
        return entry

    return spoil


def turned_by_exif(entry: Entry, root: Path, file: Path) -> Entry:
    """Annotations for the picture as turned by its EXIF orientation."""
    exif = Image.Exif()
    exif[274] = 6
    saved(lambda image: image, exif=exif)(entry, root, file)
    return {**entry, "img_width": HW[0], "img_height": HW[1], "seg": None}


def linked_out(entry: Entry, root: Path, file: Path) -> Entry:
    """The image's file as a link to one outside the root."""
    outside = root.parent / f"outside-{file.name}"
    file.rename(outside)
    file.symlink_to(outside)
    return entry


def folder_linked_out(entry: Entry, root: Path, file: Path) -> Entry:
    """The image in a folder that is a link to one outside the root."""
    outside = root.parent / "outside"
    outside.mkdir()
    file.rename(outside / file.name)
    (root / "way_out").symlink_to(outside)
    return {**entry, "img_path": f"way_out/{file.name}"}


def linked_to_itself(entry: Entry, root: Path, file: Path) -> Entry:
    """The image's file as a link to itself."""
    file.unlink()
    file.symlink_to(file.name)
    return entry


def as_folder(entry: Entry, root: Path, file: Path) -> Entry:
    """A folder of the image's name."""
    file.unlink()
    file.mkdir()
    return entry


def missing(entry: Entry, root: Path, file: Path) -> Entry:
    """No image."""
    file.unlink()
    return entry


def as_text(old: bytes, new: bytes) -> Callable[[Entry, Path, Path], bytes]:
    """Change the element's own text, to what json.dumps would not write."""
    return lambda entry, root, file: json.dumps(entry).encode().replace(old, new, 1)


def infinite_joint(entry: Entry, root: Path, file: Path) -> bytes:
    """A number beyond all floats."""
    marked: Entry = joint(["MARK", 3, 1])(entry, root, file)
    return json.dumps(marked).encode().replace(b'"MARK"', b"1e999")


EMPTY = encode_mask(np.zeros(HW, dtype=bool))
OTHER_SIZE = encode_mask(np.ones((HW[0], HW[1] + 1), dtype=bool))
HUGE = 1_000_000

FAULTS = {
    "missing_image": Fault("img_path", "there is no file", missing),
    "folder_as_image": Fault("img_path", "there is no file", as_folder),
    "path_out_of_root": Fault("img_path", "leads out of", setting(img_path="../x.jpg"),
        sample="../x.jpg"),
    "path_to_sibling": Fault("img_path", "leads out of", setting(img_path="../images-2/x.jpg"),
        sample="../images-2/x.jpg"),
    "absolute_path": Fault("img_path", "leads out of", setting(img_path="/etc/hostname"),
        sample="/etc/hostname"),
    "linked_file": Fault("img_path", "leads out of", linked_out),
    "linked_folder": Fault("img_path", "leads out of", folder_linked_out,
        sample="way_out/linked_folder.jpg"),
    "loop_of_links": Fault("img_path", "names no file", linked_to_itself),
    "long_path": Fault("img_path", "names no file", setting(img_path="x" * 300 + ".jpg"),
        sample="x" * 300 + ".jpg"),
    "nul_in_path": Fault("img_path", "names no file", setting(img_path="a\0b.jpg"),
        sample="a\0b.jpg"),
    "no_path": Fault("img_path", "missing required field", without("img_path"), sample="entry "),
    "path_is_a_number": Fault("img_path", "Expected `str`", setting(img_path=7), sample="entry "),
    "entry_is_null": Fault("entry", "Expected `object`", lambda entry, root, file: b"null",
        sample="entry "),
    "entry_is_a_list": Fault("entry", "Expected `object`", lambda entry, root, file: b"[1, 2]",
        sample="entry "),
    "no_joints": Fault("joints", "missing required field", without("joints")),
    "null_joints": Fault("joints", "Expected `array`", setting(joints=None)),
    "joints_of_words": Fault("joints", "Expected `float | null`", joint(["1", 2, 1])),
    "too_few_joints": Fault("joints", "24 x 3",
        lambda entry, root, file: {**entry, "joints": entry["joints"][:23]}),
    "too_many_joints": Fault("joints", "24 x 3",
        lambda entry, root, file: {**entry, "joints": [*entry["joints"], [1, 1, 1]]}),
    "no_joint_at_all": Fault("joints", "24 x 3", setting(joints=[])),
    "short_joint": Fault("joints", "24 x 3", joint([10.0, 10.0])),
    "long_joint": Fault("joints", "24 x 3", joint([10.0, 10.0, 1.0, 1.0])),
    "infinite_joint": Fault("joints", "out of range", infinite_joint),
    "joints_as_parts_of_the_image": Fault(
        "keypoints_2d", "look normalised", moved(1 / HW[1], 1 / HW[0]), when_read=False
    ),
    "joints_of_a_larger_image": Fault(
        "keypoints_2d", "4 times as large", moved(4, 4), when_read=False
    ),
    "no_width": Fault("img_width", "missing required field", without("img_width")),
    "no_height": Fault("img_height", "missing required field", without("img_height")),
    "width_of_words": Fault("img_width", "Expected `int`", setting(img_width="160")),
    "broken_width": Fault("img_width", "Expected `int`", setting(img_width=160.5)),
    "zero_width": Fault("img_width", "must be positive", setting(img_width=0)),
    "negative_height": Fault("img_height", "must be positive", setting(img_height=-120)),
    "huge_size": Fault("img_width", "at most",
        setting(img_width=HUGE, img_height=HUGE, seg={"counts": [HUGE * HUGE]})),
    "no_box": Fault("img_bbox", "positive area, got None", without("img_bbox")),
    "null_box": Fault("img_bbox", "positive area, got None", setting(img_bbox=None)),
    "flat_box": Fault("img_bbox", "positive area", setting(img_bbox=[5, 5, 20, 0])),
    "negative_box": Fault("img_bbox", "positive area", setting(img_bbox=[5, 5, -20, 20])),
    "short_box": Fault("img_bbox", "positive area", setting(img_bbox=[5, 5, 20])),
    "long_box": Fault("img_bbox", "positive area", setting(img_bbox=[5, 5, 20, 20, 1])),
    "empty_mask": Fault("seg", "is an empty mask", setting(seg=EMPTY)),
    "mask_of_another_size": Fault("seg", "another image's", setting(seg=OTHER_SIZE)),
    "cut_off_mask": Fault("seg", "cut off",
        lambda entry, root, file: {**entry, "seg": entry["seg"][:-2]}),
    "mask_ends_within_a_number": Fault("seg", "ends within a number", setting(seg="`")),
    "mask_with_foreign_characters": Fault("seg", "has the character 'é'",
        lambda entry, root, file: {**entry, "seg": entry["seg"] + "é"}),
    "mask_without_runs": Fault("seg", "another image's", setting(seg="")),
    "mask_is_a_polygon": Fault("seg", "run-length string",
        setting(seg=[[1, 2, 3, 4, 5, 6]])),
    "mask_is_a_number": Fault("seg", "run-length string", setting(seg=7)),
    "mask_says_another_size": Fault("seg", "is a mask of size [160, 120]",
        setting(seg={"size": [HW[1], HW[0]], "counts": EMPTY})),
    "mask_without_counts": Fault("seg", "run-length string", setting(seg={"size": list(HW)})),
    "mask_of_broken_counts": Fault("seg", "run-length string",
        setting(seg={"size": list(HW), "counts": [1.5, 2.5]})),
    "not_utf8": Fault("entry", "cannot be decoded", as_text(b'"seg": "', b'"seg": "\xff'),
        sample="not_utf8.jpg"),
    "visibility_2": Fault("keypoints_2d", "visibility must be 0 or a confidence",
        joint([50, 50, 2]), when_read=False),
    "negative_visibility": Fault("keypoints_2d", "visibility must be 0 or a confidence",
        joint([50, 50, -0.5]), when_read=False),
    "keypoint_beyond_reason": Fault("keypoints_2d", "keypoint 2 is over ten image sizes away",
        joint([1e6, 50, 1]), when_read=False),
    "resized_image": Fault("image", "80 x 60, but the annotations are for 160 x 120",
        saved(lambda image: image.resize((80, 60))), when_read=False),
    "turned_by_exif": Fault("image", "EXIF orientation 6", turned_by_exif, when_read=False),
    "truncated_jpeg": Fault("image", "cannot be decoded", written(lambda old: old[: len(old) // 2]),
        when_read=False),
    "empty_file": Fault("image", "cannot be decoded", written(lambda old: b""), when_read=False),
    "text_file": Fault("image", "cannot be decoded", written(lambda old: b"<html>404</html>"),
        when_read=False),
    "bomb": Fault("image", "too large to decode",
        written(lambda old: png_that_claims(60_000, 60_000)), when_read=False),
    "large_image": Fault("image", "12000 x 10000 pixels, more than",
        written(lambda old: png_that_claims(12_000, 10_000)), when_read=False),
    "float_image": Fault("image", "floating-point",
        saved(lambda image: image.convert("F"), format="TIFF"), when_read=False),
}  # fmt: skip


@dataclass(frozen=True)
class Spoilt:
    """A faulty sample in its dataset."""

    entry: Entry | bytes
    sample_id: str


def add_fault(root: Path, view: View, name: str) -> Spoilt:
    """Save a photo named after a fault and spoil it."""
    fault, file = FAULTS[name], f"{name}.jpg"
    entry = add_photo(root, view, file)
    return Spoilt(fault.spoil(entry, root / "images", root / "images" / file), fault.sample or file)
