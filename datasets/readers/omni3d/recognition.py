"""Telling a file of cuboids in Omni3D's format from one of keypoints in COCO's.

Both have images, annotations and categories.
"""

from pathlib import Path

import msgspec

from animal3dbox.datasets.storage.json_files import decode_json

BOX_KEYS = frozenset({"bbox3D_cam", "center_cam", "dimensions", "R_cam"})


class _Listed(msgspec.Struct):
    images: msgspec.Raw = msgspec.Raw(b"[]")
    annotations: msgspec.Raw = msgspec.Raw(b"[]")


def is_omni3d(path: Path) -> bool:
    """Whether a path is a JSON file whose annotations are boxes in three dimensions, or whose images have intrinsics.

    Raises:
        DatasetFormatError: a .json file that is none.

    """
    if not path.is_file() or path.suffix.lower() not in (".json", ""):
        return False
    listed = decode_json(path, _Listed | list[msgspec.Raw])
    if not isinstance(listed, _Listed):
        return False
    annotation, image = _first_keys(listed.annotations), _first_keys(listed.images)
    return bool(annotation & BOX_KEYS) or (not annotation and "K" in image)


def _first_keys(raw: msgspec.Raw) -> frozenset[str]:
    """The keys of the first element of a list of dictionaries; none of anything else."""
    try:
        elements = msgspec.json.decode(raw, type=list[msgspec.Raw])
        return (
            frozenset(msgspec.json.decode(elements[0], type=dict[str, msgspec.Raw]))
            if elements
            else frozenset()
        )
    except msgspec.DecodeError:
        return frozenset()
