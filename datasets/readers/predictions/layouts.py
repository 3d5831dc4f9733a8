"""The layouts of detectors' files: what each says of a box, and in which frame and order.

Where a file has the eight corners, its orders are inferred from them; the conventions here hold
where it has none. Nothing is ever matched to the truth. Sources: Cube R-CNN's and OVMono3D's
evaluation (instances_predictions.pth), WildDet3D's wilddet3d/eval/detect3d.py (the evaluator of
3D-MOOD), DetAny3D's train_utils.py, the OBB csv of Project Aria's tools, WildLIFT's README.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from animal3dbox.datasets.readers.cuboid_conventions import (
    FORWARD_DOWN_LEFT,
    KITTI,
    OMNI3D,
    Convention,
)
from animal3dbox.datasets.readers.kitti.layout import is_kitti
from animal3dbox.datasets.readers.predictions.plain_json import plain_json
from animal3dbox.datasets.storage.json_files import read_json_bytes
from animal3dbox.errors import ConfigError, DatasetFormatError, DatasetNotFoundError

CategoryIds = Literal["dataset", "contiguous"]
"""The numbers by which a file names categories: the truth's ids, or their places from 0 on."""


@dataclass(frozen=True)
class DetectionLayout:
    """The meaning of one kind of detectors' files.

    Attributes:
        name: of the layout, as the user may say it.
        written_by: the programs that write it.
        convention: frames and orders of a box without corners.
        frame: whose axes boxes are in; those of a world need the cameras' poses.
        heading_known: whether forward means something: False where a convention folds yaw, so that
            head and tail are one, and where nothing says which end of x is the front.
        categories: how they are named: by numbers (see CategoryIds), or by "name".
    """

    name: str
    written_by: str
    convention: Convention
    frame: Literal["camera", "world"]
    heading_known: bool
    categories: Literal["dataset", "contiguous", "name"]


_TRACKS = Convention("wilddet3d-tracks", box_axes=FORWARD_DOWN_LEFT, dimensions=(2, 0, 1))
_BOXER = Convention("boxer")
_FRAMES = Convention("frames")

LAYOUTS = {
    layout.name: layout
    for layout in (
        DetectionLayout(
            "cubercnn", "Cube R-CNN, OVMono3D", OMNI3D, "camera", True, "contiguous"
        ),
        DetectionLayout(
            "detect3d", "3D-MOOD, WildDet3D", OMNI3D, "camera", False, "dataset"
        ),
        DetectionLayout("detany3d", "DetAny3D", OMNI3D, "camera", True, "dataset"),
        DetectionLayout("boxer", "Boxer", _BOXER, "world", False, "name"),
        DetectionLayout("tracks", "WildDet3D's tracking", _TRACKS, "camera", False, "name"),
        DetectionLayout("frames", "WildLIFT", _FRAMES, "world", False, "name"),
        DetectionLayout("kitti", "KITTI's results", KITTI, "camera", True, "name"),
    )
}  # fmt: skip
"""Every layout that is read, by name."""
PICKLES = frozenset({".pth", ".pt", ".pkl", ".pickle"})
"""Suffixes of files that torch or pickle wrote."""
BOXER_COLUMN = "tx_world_object"
"""A column of Boxer's csv that no other table has."""
EXAMINED = 100
"""Number of a list's elements that are looked at for keys."""


def recognised_layout(path: Path, layout: str | None = None) -> DetectionLayout:
    """The layout of a file or folder of detections.

    Args:
        path: the file or folder.
        layout: its name, if the user says it; None: it is recognised by its suffix and keys.

    Raises:
        ConfigError: no layout of this name.
        DatasetNotFoundError: nothing there.
        DatasetFormatError: in no layout that is known.

    """
    if layout is not None:
        if layout not in LAYOUTS:
            raise ConfigError(f"layout must be one of {', '.join(LAYOUTS)}, got {layout!r}")
        return LAYOUTS[layout]
    if not path.exists():
        raise DatasetNotFoundError(f"there is no file or folder {path}")
    name = _of_folder(path) if path.is_dir() else _of_file(path)
    if name is None:
        raise DatasetFormatError(
            f"{path} is in no layout of detections that is known ({', '.join(LAYOUTS)}); if it is"
            " one of them, name it (layout=, --layout)"
        )
    return LAYOUTS[name]


def _of_folder(path: Path) -> str | None:
    if is_kitti(path):
        return "kitti"
    first = next(iter(sorted(path.glob("*.json"))), None)
    return None if first is None else _of_file(first)


def _of_file(path: Path) -> str | None:
    suffix = path.suffix.lower()
    if suffix in PICKLES:
        return "cubercnn"
    if suffix == ".csv":
        head = read_json_bytes(path).partition(b"\n")[0]
        return "boxer" if BOXER_COLUMN.encode() in head else None
    return _of_json(plain_json(path)) if suffix in (".json", "") else None


def _of_json(content: Any) -> str | None:
    """The layout of the content of a JSON file, by the keys of its first elements."""
    if isinstance(content, dict):
        return "tracks" if isinstance(content.get("tracks"), dict) else None
    if not isinstance(content, list):
        return None
    keys = {key for one in content[:EXAMINED] if isinstance(one, dict) for key in one}
    for key, name in (
        ("instances", "cubercnn"),
        ("rotation_matrix", "frames"),
        ("pose", "detany3d"),
        ("R_cam", "detect3d"),
    ):
        if key in keys:
            return name
    return "detect3d" if not content else None
