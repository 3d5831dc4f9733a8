"""The JSON of Omni3D: what a file may hold.

Numbers of -1 and null both mean that a value is not known.
"""

from typing import Final

import msgspec

from animal3dbox.datasets.readers.elements import Matrix

GENERATOR: Final = "animal3dbox"
"""Value of info.generator in the files that this package writes."""

Key = int | str
"""An id: Omni3D's own are whole numbers, files made after it have words, too."""


class Omni3DImage(msgspec.Struct, kw_only=True):
    """One element of "images"; K is written row by row, by some others as nine numbers.

    turned_upright is this package's own: that the boxes are for the picture turned as the EXIF
    header of its file says. It is there only if it is true.
    """

    id: Key
    dataset_id: Key = 0
    width: int
    height: int
    file_path: str
    K: Matrix
    turned_upright: bool | msgspec.UnsetType = msgspec.UNSET


class Omni3DCategory(msgspec.Struct, kw_only=True):
    """One element of "categories"."""

    id: Key
    name: str
    supercategory: str = ""


class Omni3DAnnotation(msgspec.Struct, kw_only=True, omit_defaults=False):
    """One element of "annotations": a box in its image.

    metric and heading_known are this package's own: that lengths are metres, that sides have names.
    track_id, the same animal's in all images of its sequence, is there if it is known; the faces in
    the order of FACE_NAMES (seen, px^2, parts of the area, parts of that in the frame) if they were
    asked for.
    """

    id: Key
    image_id: Key
    dataset_id: Key = 0
    category_id: Key
    category_name: str | None = None
    valid3D: bool | int | None = True
    bbox2D_tight: list[float] | None = None
    bbox2D_proj: list[float] | None = None
    bbox2D_trunc: list[float] | None = None
    bbox3D_cam: Matrix | float | None = None
    center_cam: list[float] | None = None
    dimensions: list[float] | None = None
    R_cam: Matrix | float | None = None
    behind_camera: bool | int | None = None
    visibility: float | None = None
    truncation: float | None = None
    segmentation_pts: float | None = None
    lidar_pts: float | None = None
    depth_error: float | None = None
    metric: bool | None = None
    heading_known: bool | None = None
    track_id: Key | msgspec.UnsetType | None = msgspec.UNSET
    face_visible: list[bool] | msgspec.UnsetType = msgspec.UNSET
    face_area: list[float] | msgspec.UnsetType = msgspec.UNSET
    face_share: list[float] | msgspec.UnsetType = msgspec.UNSET
    face_share_in_image: list[float] | msgspec.UnsetType = msgspec.UNSET

    def __post_init__(self) -> None:
        """Take a single -1 or 0 in the place of a rotation or corners for None.

        Files in the wild mean it so.
        """
        self.R_cam = None if self.R_cam in (-1, 0) else self.R_cam
        self.bbox3D_cam = None if self.bbox3D_cam in (-1, 0) else self.bbox3D_cam


class StatedAnnotation(Omni3DAnnotation, kw_only=True):
    """An annotation as others write it: with the keys of follow-ups, see `headings`."""

    face_locks: dict[str, int | None] | None = None
    heading_alpha: float | None = None
    heading_valid: bool | int | None = None


class Omni3DInfo(msgspec.Struct, kw_only=True):
    """The head of a file, of which generator, units and first_pixel are this package's own keys."""

    id: Key = 0
    source: str = "animal3dbox"
    name: str = "animal3dbox"
    split: str = "train"
    version: str = "1"
    url: str = ""
    known_category_ids: list[Key] = []
    generator: str | None = None
    units: str | None = None
    first_pixel: float | None = None


class Omni3DFile(msgspec.Struct, kw_only=True):
    """The content of a file, as it is written."""

    info: Omni3DInfo
    images: list[Omni3DImage]
    categories: list[Omni3DCategory]
    annotations: list[Omni3DAnnotation]


class RawOmni3DFile(msgspec.Struct, kw_only=True):
    """The content of a file, as it is read.

    Its elements are still undecoded, so that one bad element spoils no other.
    """

    info: msgspec.Raw = msgspec.Raw(b"null")
    images: list[msgspec.Raw]
    categories: list[msgspec.Raw]
    annotations: list[msgspec.Raw]
