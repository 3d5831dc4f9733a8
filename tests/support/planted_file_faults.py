"""Faults planted into an Animal3D folder, each of which makes its sample unusable."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

Entry = dict[str, Any]


def _bytes(field: str, change: Callable[[bytes], bytes | None]) -> Callable[[Entry, Path], None]:
    """Change an entry's file, or remove it."""

    def plant(entry: Entry, root: Path) -> None:
        path = root / entry[field]
        changed = change(path.read_bytes())
        if changed is None:
            path.unlink()
        else:
            path.write_bytes(changed)

    return plant


def _entry(**values: Any) -> Callable[[Entry, Path], None]:
    """Change what an entry says; a callable makes the new value of the old."""

    def plant(entry: Entry, root: Path) -> None:
        for name, value in values.items():
            entry[name] = value(entry[name]) if callable(value) else value

    return plant


def _small_mask(entry: Entry, root: Path) -> None:
    Image.fromarray(np.full((7, 9), 255, np.uint8)).save(root / entry["mask_path"])


FILE_FAULTS: dict[str, tuple[str, Callable[[Entry, Path], None]]] = {
    "image vanished": ("img_path", _bytes("img_path", lambda data: None)),
    "image cut": ("image", _bytes("img_path", lambda data: data[: len(data) // 2])),
    "image without a byte": ("image", _bytes("img_path", lambda data: b"")),
    "image of zeros": ("image", _bytes("img_path", lambda data: bytes(len(data)))),
    "image of words": ("image", _bytes("img_path", lambda data: b"<html>404</html>")),
    "image header damaged": (
        "image",
        _bytes("img_path", lambda data: data[:2] + b"\xff\xc0\x00" + data[5:]),
    ),
    "mask vanished": ("mask_path", _bytes("mask_path", lambda data: None)),
    "mask cut": ("mask", _bytes("mask_path", lambda data: data[: len(data) // 2])),
    "mask checksum damaged": (
        "mask",
        _bytes("mask_path", lambda data: data[:60] + bytes([data[60] ^ 0x55]) + data[61:]),
    ),
    "mask of words": ("mask", _bytes("mask_path", lambda data: b"words")),
    "mask of another size": ("mask", _small_mask),
}
"""Name -> the field that must be named, and how it is planted.

A file that is gone when the annotations are read is missed there, by its path's
field; one that vanishes later, by image or mask."""

ENTRY_FAULTS: dict[str, tuple[str, Callable[[Entry, Path], None]]] = {
    "too few keypoints": ("keypoint_2d", _entry(keypoint_2d=lambda rows: rows[:5])),
    "keypoints of one number": (
        "keypoint_2d",
        _entry(keypoint_2d=lambda rows: [row[:1] for row in rows]),
    ),
    "visibility of 7": (
        "keypoint_2d",
        _entry(keypoint_2d=lambda rows: [[x, y, 7] for x, y, _ in rows]),
    ),
    "keypoints far away": (
        "keypoints_2d",
        _entry(keypoint_2d=lambda rows: [[1e6, 1e6, 1] for _ in rows]),
    ),
    "keypoints in words": ("keypoint_2d", _entry(keypoint_2d="none")),
    "pose of 7 numbers": ("pose, trans", _entry(pose=lambda pose: pose[:7])),
    "translation of words": ("trans[0]", _entry(trans=["a", "b", "c"])),
    "shape missing": ("shape", _entry(shape=None)),
    "too many betas": (
        "shape",
        _entry(shape_extra=lambda extra: [*extra, *[0.5] * 40], keypoint_3d=None),
    ),
    "path out of the folder": ("img_path", _entry(img_path="../../etc/passwd")),
    "absolute path": ("img_path", _entry(img_path="/etc/passwd")),
    "path of zero bytes": ("img_path", _entry(img_path="")),
    "height of another image": ("image", _entry(height=lambda height: height + 1)),
    "no size": ("height, width", _entry(height=0)),
}


def plant(root: Path, file: str, number: int, fault: str) -> tuple[str, str]:
    """Plant a fault into one entry of a json.

    Gives the entry's image and the field that must be named.
    """
    field, how = {**FILE_FAULTS, **ENTRY_FAULTS}[fault]
    content = json.loads((root / file).read_text())
    entry = content["data"][number]
    image = str(entry["img_path"])
    how(entry, root)
    (root / file).write_text(json.dumps(content))
    return image, field


def plant_many(root: Path, faults: list[str], rng: np.random.Generator) -> list[str]:
    """Plant faults into entries of train.json, each into another image's; gives the images."""
    content = json.loads((root / "train.json").read_text())
    first = {str(entry["img_path"]): entry for entry in reversed(content["data"])}
    images = sorted(first)
    chosen = [images[k] for k in rng.permutation(len(images))[: len(faults)]]
    for image, fault in zip(chosen, faults, strict=True):
        {**FILE_FAULTS, **ENTRY_FAULTS}[fault][1](first[image], root)
    (root / "train.json").write_text(json.dumps(content))
    return [
        (
            str(first[image]["img_path"] or "entry")
            if fault.startswith(("absolute", "path"))
            else image
        )
        for image, fault in zip(chosen, faults, strict=True)
    ]
