"""Telling a file of cuboids in Omni3D's format from one of keypoints in COCO's.

Both have images, annotations and categories, so the first annotation or image decides.
"""

from pathlib import Path

import msgspec

from animal3dbox.datasets.storage.json_files import decode_json

BOX_KEYS = frozenset({"bbox3D_cam", "center_cam", "dimensions", "R_cam"})
"""Keys of an annotation of which COCO's keypoints have none."""


class _Lists(msgspec.Struct):
    """A file's lists of images and annotations, undecoded."""

    images: msgspec.Raw = msgspec.Raw(b"[]")
    annotations: msgspec.Raw = msgspec.Raw(b"[]")


def is_omni3d(path: Path) -> bool:
    """Whether a path is a JSON file whose annotations are boxes in three dimensions.

    One without annotations is if its images have intrinsics.

    Raises:
        DatasetFormatError: a .json file that is none.

    """
    if not path.is_file() or path.suffix.lower() not in (".json", ""):
        return False
    content = decode_json(path, _Lists | list[msgspec.Raw])
    if not isinstance(content, _Lists):
        return False
    annotation_keys, image_keys = _first_keys(content.annotations), _first_keys(content.images)
    return bool(annotation_keys & BOX_KEYS) or (not annotation_keys and "K" in image_keys)


def _first_keys(raw: msgspec.Raw) -> frozenset[str]:
    """The keys of the first element of a list of dictionaries; none of anything else."""
    try:
        elements = msgspec.json.decode(raw, type=list[msgspec.Raw])
        first = msgspec.json.decode(elements[0], type=dict[str, msgspec.Raw]) if elements else ()
    except msgspec.DecodeError:
        return frozenset()
    return frozenset(first)
