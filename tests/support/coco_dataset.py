"""A small COCO keypoints dataset made in a folder.

AP-10K's keypoints of the toy animal, and every fault a file can have.
"""

import copy
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from animals import toy_landmarks, toy_mesh
from photo_dataset import HW, Scene, View, view_of
from PIL import Image

from animal3dbox.datasets.images.rle import encode_mask
from animal3dbox.smal.keypoints.vocabularies import ANIMAL3D_26, AP10K, VOCABULARIES

Content = dict[str, Any]
AP10K_NAMES = list(AP10K)


@cache
def ap10k_view(azimuth_deg: float) -> View:
    """The toy animal with AP-10K's keypoints; those it has not are zeros."""
    vertices, faces = toy_mesh()
    groups = {name: [row] for row, name in enumerate(ANIMAL3D_26)}
    return view_of(
        Scene(vertices, faces, VOCABULARIES["ap10k17"].on_body(groups, toy_landmarks())),
        azimuth_deg,
    )


def annotation_of(
    view: View, number: int, image_id: int, names: Sequence[str] = AP10K_NAMES, category_id: int = 3
) -> Content:
    """An element of "annotations", its keypoints in the order of names."""
    by_name = dict(zip(AP10K_NAMES, view.joints, strict=True))
    rows = [
        [x, y, 2 * int(seen)] for x, y, seen in (by_name.get(name, [0, 0, 0]) for name in names)
    ]
    columns, lines = np.nonzero(view.mask.any(0))[0], np.nonzero(view.mask.any(1))[0]
    box = [
        int(columns[0]),
        int(lines[0]),
        int(columns[-1] - columns[0]) + 1,
        int(lines[-1] - lines[0]) + 1,
    ]
    return {
        "id": number, "image_id": image_id, "category_id": category_id,
        "keypoints": [value for row in rows for value in row],
        "num_keypoints": sum(row[2] > 0 for row in rows), "iscrowd": 0, "bbox": box,
        "area": int(view.mask.sum()),
        "segmentation": {"size": list(HW), "counts": encode_mask(view.mask)},
    }  # fmt: skip


def coco_content(root: Path, names: Sequence[str] = AP10K_NAMES) -> Content:
    """Three images, saved under root/images: the second has two animals and the last none."""
    views = [ap10k_view(60), ap10k_view(110), ap10k_view(250)]
    files = ["a.jpg", "sub/b.jpg", "c.jpg"]
    for file, view in zip(files, views, strict=True):
        path = root / "images" / file
        path.parent.mkdir(parents=True, exist_ok=True)
        Image.fromarray(view.picture).save(path, quality=90)
    other = annotation_of(views[2], 2, 11, names)  # or it would be the first one's copy
    return {
        "info": {"description": "toy animals"},
        "images": [
            {"id": 10 + i, "file_name": file, "height": HW[0], "width": HW[1]}
            for i, file in enumerate(files)
        ],
        "annotations": [
            annotation_of(views[1], 0, 11, names),
            annotation_of(views[0], 1, 10, names),
            other,
        ],
        "categories": [
            {
                "id": 3,
                "name": "antelope",
                "supercategory": "Bovidae",
                "keypoints": list(names),
                "skeleton": [[1, 2]],
            }
        ],
    }


def write_coco(root: Path, content: Content, name: str = "annotations.json") -> Path:
    """Write a content as JSON into root; gives the file."""
    path = root / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content))
    return path


@dataclass(frozen=True)
class CocoFault:
    """One way for a file to be wrong.

    Attributes:
        samples: that the faults name.
        field: named in each.
        reason: words of each.
        spoil: changes the content in place; gets the root, too.
    """

    samples: tuple[str, ...]
    field: str
    reason: str
    spoil: Callable[[Content, Path], object]


def in_annotation(number: int = 1, **changes: Any) -> Callable[[Content, Path], object]:
    """Replace keys of an annotation; 1 is the only one of a.jpg."""
    return lambda content, root: content["annotations"][number].update(copy.deepcopy(changes))


def in_image(number: int = 0, **changes: Any) -> Callable[[Content, Path], object]:
    """Replace keys of an image; 0 is a.jpg."""
    return lambda content, root: content["images"][number].update(changes)


def keypoint(place: int, value: Any) -> Callable[[Content, Path], object]:
    """Replace a number of a.jpg's keypoints."""

    def spoil(content: Content, root: Path) -> None:
        content["annotations"][1]["keypoints"][place] = value

    return spoil


def other_category(content: Content, root: Path) -> None:
    """An animal one of whose keypoints is misspelt."""
    names = ["nse" if name == "nose" else name for name in AP10K_NAMES]
    content["categories"].append({"id": 4, "name": "deer", "keypoints": names})
    content["annotations"][1]["category_id"] = 4


def doubled_id(content: Content, root: Path) -> None:
    """The third annotation says that it is the second."""
    content["annotations"][2]["id"] = 1


def copy_without_ids(content: Content, root: Path) -> None:
    """The second annotation twice, neither with an id."""
    del content["annotations"][1]["id"]
    content["annotations"].append(content["annotations"][1])


def image_id_of_two(content: Content, root: Path) -> None:
    """The third image has the first one's id."""
    content["images"][2]["id"] = 10


EMPTY = encode_mask(np.zeros(HW, dtype=bool))
A, B = ("a.jpg",), ("sub/b.jpg",)
COCO_FAULTS = {
    "missing_image": CocoFault(A, "file_name", "there is no file",
        lambda content, root: (root / "images" / "a.jpg").unlink()),
    "image_out_of_root": CocoFault(("../a.jpg",), "file_name", "leads out of",
        in_image(file_name="../a.jpg")),
    "absolute_image": CocoFault(("/etc/hostname",), "file_name", "leads out of",
        in_image(file_name="/etc/hostname")),
    "unreadable_image_of_unknown_size": CocoFault(
        A, "image", "cannot be decoded",
        lambda content, root: (in_image(height=None)(content, root),
            (root / "images" / "a.jpg").write_text("<html>")),
    ),
    "negative_size": CocoFault(A, "width, height", "must be positive", in_image(height=-1)),
    "height_of_words": CocoFault(("a.jpg", "annotation 1"), "", "", in_image(height="120")),
    "image_id_of_two": CocoFault(("c.jpg", "annotation 1"), "id", "10 is the id of",
        image_id_of_two),
    "image_listed_twice": CocoFault(("sub/b.jpg", "annotation 0", "annotation 2"), "", "",
        in_image(file_name="sub/b.jpg")),
    "unknown_image": CocoFault(("annotation 1",), "image_id",
        "there is no usable image of the id 99", in_annotation(image_id=99)),
    "image_id_of_null": CocoFault(("annotation 1",), "image_id", "Expected `int | str`",
        in_annotation(image_id=None)),
    "unknown_category": CocoFault(A, "category_id", "no category has the id 7 (annotation 1)",
        in_annotation(category_id=7)),
    "unknown_keypoints_of_a_category": CocoFault(A, "keypoints", "'nse' (nearest: nose",
        other_category),
    "doubled_id": CocoFault(("sub/b.jpg (annotation 2)",), "id", "1 is annotation 1 once more",
        doubled_id),
    "copied_annotation": CocoFault(
        ("a.jpg (annotation 3)",), "id", "is annotation 1 once more",
        lambda content, root: content["annotations"].append(content["annotations"][1])
    ),
    "copied_annotation_with_an_id_of_its_own": CocoFault(
        ("a.jpg (annotation 3)",), "entry", "is annotation 1 once more, but for the id",
        lambda content, root: content["annotations"].append(
            {**dict(reversed(content["annotations"][1].items())), "id": 7}
        ),
    ),
    "copied_annotation_without_ids": CocoFault(("a.jpg (annotation 3)",), "entry",
        "is annotation 1 once more", copy_without_ids),
    "annotation_of_null": CocoFault(
        ("annotation 3",), "entry", "Expected `object`",
        lambda content, root: content["annotations"].append(None)
    ),
    "too_few_keypoints": CocoFault(A, "keypoints", "for 17 keypoints, got 48 numbers",
        in_annotation(keypoints=[1.0] * 48)),
    "keypoints_as_words": CocoFault(A, "keypoints", "Expected", keypoint(0, "12")),
    "visibility_of_3": CocoFault(A, "keypoints", "visibility must be 0, 1 or 2", keypoint(2, 3)),
    "scores_for_visibility": CocoFault(A, "keypoints", "are these scores?", keypoint(2, 0.93)),
    "flat_box": CocoFault(A, "bbox", "positive area", in_annotation(bbox=[10, 10, 20, 0])),
    "short_box": CocoFault(A, "bbox", "[x, y, w, h]", in_annotation(bbox=[10, 10, 20])),
    "box_outside": CocoFault(A, "bbox", "lies outside the image of 160 x 120",
        in_annotation(bbox=[200, 10, 20, 20])),
    "mask_of_another_size": CocoFault(A, "segmentation", "mask of size [5, 5]",
        in_annotation(segmentation={"size": [5, 5], "counts": "0"})),
    "mask_cut_off": CocoFault(A, "segmentation", "but the image has",
        in_annotation(segmentation={"size": list(HW), "counts": [5, 3]})),
    "empty_mask": CocoFault(A, "segmentation", "is an empty mask",
        in_annotation(segmentation={"size": list(HW), "counts": EMPTY})),
    "polygon_of_two_points": CocoFault(A, "segmentation", "at least three points",
        in_annotation(segmentation=[[1, 1, 9, 9]])),
    "polygon_of_half_a_point": CocoFault(A, "segmentation", "at least three points",
        in_annotation(segmentation=[[1, 1, 9, 9, 9, 1, 5]])),
    "polygon_outside": CocoFault(A, "segmentation", "hold no pixel",
        in_annotation(segmentation=[[200, 1, 220, 1, 220, 20]])),
    "polygon_far_away": CocoFault(A, "segmentation", "ten image sizes",
        in_annotation(segmentation=[[2e4, 1, 3e4, 1, 3e4, 20]])),
    "polygon_of_words": CocoFault(A, "segmentation", "must be lists of x, y",
        in_annotation(segmentation=["1 2 3 4 5 6"])),
    "mask_is_a_number": CocoFault(A, "segmentation", "must be a run-length string",
        in_annotation(segmentation=7)),
}  # fmt: skip
