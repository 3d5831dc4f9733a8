"""The fields of a target, each said once.

A target is the plain dict that a Dataset gives beside an image, and that augmentations and training
checks work on (docs/datasets.md). What they know of its fields is derived from `FIELDS`: the layout
of a cached label, the transforms' tables, the forms that training checks, the rows of labels.json,
the table of the docs and the shapes that the tests expect. A new field is one line here, and the
formula that computes it.

The package's lowest layer: it imports nothing of the package, so that `transforms` and `datasets`,
which never import each other, share it.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

Per = Literal["animal", "image", "either"]
Kind = Literal["float", "flag", "whole"]
UnderMap = Literal["mapped", "unmoved", "mirrored"]


@dataclass(frozen=True, kw_only=True)
class Field:
    """One field of a target.

    Attributes:
        name: its key in the target.
        shape: of one entry, axis by axis: numbers, and letters for sizes that are the dataset's
            own; empty for a single number.
        per: whether a target holds one entry an "animal", one an "image", or "either".
        kind: "float", "flag" (booleans) or "whole" (whole numbers).
        dtype: of a Dataset's target, as torch and NumPy call it.
        under_map: what a map of pixels does to it: it is "mapped" by the camera law, or "unmoved",
            or names a side of the animal (0 neither, 1 left, 2 right), which a map that mirrors
            exchanges: "mirrored".
        camera_frame: whether it means nothing without the camera's frame, and so needs K.
        is_length: whether it grows with the unit of the body, and so becomes metric with it.
        label_name: its name in a CuboidLabel, in cached rows and in labels.json; None: not there.
        named_faces: whether it speaks of faces by their names, and so is absent where the heading
            is unknown.
        in_labels_json: whether each row of labels.json has it: "always", "optional" (files of this
            version exist without it), or "never".
        made_by: whether a "dataset" gives it, "transforms" leave it, or it is the "user"'s own.
        meaning: one phrase for the docs.

    Example:
        >>> field_of("corners_3d").entry_shape
        (8, 3)
    """

    name: str
    shape: str
    per: Per = "animal"
    kind: Kind = "float"
    dtype: str = "float32"
    under_map: UnderMap = "mapped"
    camera_frame: bool = False
    is_length: bool = False
    label_name: str | None = None
    named_faces: bool = False
    in_labels_json: Literal["always", "optional", "never"] = "always"
    made_by: Literal["dataset", "transforms", "user"] = "dataset"
    meaning: str = ""

    @cached_property
    def entry_shape(self) -> tuple[int, ...] | None:
        """The shape of one entry; None if a size of it is the dataset's own."""
        sizes = self.shape.split()
        return tuple(map(int, sizes)) if all(size.isdecimal() for size in sizes) else None

    @cached_property
    def width(self) -> int:
        """How many numbers one entry holds; of a field of fixed shape."""
        if self.entry_shape is None:
            raise ValueError(f"{self.name} has no fixed shape: {self.shape}")
        return math.prod(self.entry_shape)

    @property
    def spec(self) -> str:
        """The shape in the target, as geometry.checks.check_shape reads it: "N 8 3"."""
        return self.shape if self.per == "image" else f"N {self.shape}".strip()


FIELDS: tuple[Field, ...] = (
    Field(name="corners_3d", shape="8 3", camera_frame=True, is_length=True,
          label_name="corners_3d", meaning="the cuboid's corners in the documented order"),
    Field(name="center", shape="3", camera_frame=True, is_length=True, label_name="center",
          meaning="the cuboid's centre"),
    Field(name="rotation", shape="3 3", camera_frame=True, label_name="rotation",
          meaning="R_cam_box: columns forward, left, up"),
    Field(name="size", shape="3", under_map="unmoved", is_length=True, label_name="size",
          meaning="length, width, height"),
    Field(name="distance", shape="", under_map="unmoved", is_length=True, label_name="distance",
          in_labels_json="optional", meaning="from the camera's centre to the cuboid's"),
    Field(name="corners_2d", shape="8 2", label_name="corners_2d",
          meaning="projected corners, px; without meaning where corner_in_front is false"),
    Field(name="face_area", shape="6", label_name="face_area", named_faces=True,
          meaning="projected area of the faces seen, px^2"),
    Field(name="face_share", shape="6", label_name="face_share", named_faces=True,
          meaning="part of the visible area, summing to 1"),
    Field(name="face_share_in_image", shape="6", label_name="face_share_in_image",
          named_faces=True, meaning="the same inside the frame"),
    Field(name="K", shape="3 3", per="image", label_name="K", meaning="intrinsics, px"),
    Field(name="R", shape="3 3", per="either", camera_frame=True, label_name="R",
          meaning="X_cam = R X + t, X in each body's own frame"),
    Field(name="t", shape="3", per="either", camera_frame=True, is_length=True, label_name="t",
          meaning="see R"),
    Field(name="boxes", shape="4", label_name="box", meaning="xyxy px of the animal"),
    Field(name="truncation", shape="", label_name="truncation",
          meaning="part of the projected cuboid outside the frame"),
    Field(name="surface_share", shape="6", label_name="surface_share",
          meaning="part of the animal's own visible surface by the side it faces"),
    Field(name="flank_confidence", shape="", under_map="unmoved", label_name="flank_confidence",
          named_faces=True, in_labels_json="optional", meaning="probability of `flank`"),
    Field(name="flank", shape="", kind="whole", dtype="int64", under_map="mirrored",
          label_name="flank", named_faces=True, in_labels_json="never",
          meaning="the flank that is seen: 0 undecided, 1 left, 2 right"),
    Field(name="corner_in_front", shape="8", kind="flag", dtype="bool",
          label_name="corner_in_front", in_labels_json="never",
          meaning="which corners are in front of the camera"),
    Field(name="face_visible", shape="6", kind="flag", dtype="bool", label_name="face_visible",
          named_faces=True, meaning="which faces the camera sees"),
    Field(name="behind_camera", shape="", kind="flag", dtype="bool", label_name="behind_camera",
          meaning="whether a corner is nearer than the near plane"),
    Field(name="labels", shape="", kind="whole", dtype="int64", under_map="unmoved",
          meaning="number in dataset.classes"),
    Field(name="keypoints", shape="J 3", meaning="x, y in px and visibility, as used"),
    Field(name="keypoint_mirror", shape="J", per="image", kind="whole", dtype="int64",
          under_map="unmoved", meaning="each keypoint's counterpart on the other side"),
    Field(name="masks", shape="H W", kind="whole", dtype="uint8", meaning="0 and 1"),
    Field(name="scale_known", shape="", kind="flag", dtype="bool", under_map="unmoved",
          meaning="whether lengths are in metres, not in the body's unit"),
    Field(name="scale_m_per_unit", shape="", under_map="unmoved",
          meaning="by which factor they were made so"),
    Field(name="distortion", shape="D", per="image", meaning="coefficients of OpenCV's lens"),
    Field(name="H_out_in", shape="3 3", per="image", made_by="transforms",
          meaning="all maps of pixels since the image was read; left by transforms"),
    Field(name="depth", shape="H W", per="image", made_by="user", meaning="z of each pixel"),
    Field(name="occlusion", shape="", under_map="unmoved", made_by="user", meaning="hidden part"),
    Field(name="heading_known", shape="", kind="flag", dtype="bool", under_map="unmoved",
          made_by="user", meaning="whether front and left mean something"),
    Field(name="scores", shape="", under_map="unmoved", made_by="user", meaning="of detections"),
    Field(name="iscrowd", shape="", kind="whole", dtype="int64", under_map="unmoved",
          made_by="user", meaning="COCO's flag"),
    Field(name="track_ids", shape="", kind="whole", dtype="int64", under_map="unmoved",
          made_by="user", meaning="which individual"),
    Field(name="keypoints_3d", shape="J 3", made_by="user",
          meaning="landmarks in the bodies' frames"),
    Field(name="vertices", shape="V 3", made_by="user", meaning="meshes in the bodies' frames"),
)  # fmt: skip
"""Every field that the package knows, those of a label first and in the order of its row."""

META_PER_ANIMAL = ("sample_ids", "quality", "scale_source", "sightings")
"""Book-keeping in ``target["meta"]`` with one entry an animal; it follows animals left out."""
META_PER_IMAGE = (
    *("sample_key", "K_source", "exif_orientation", "turned_upright"),
    "keypoint_sides",
)
"""Book-keeping in ``target["meta"]`` of the whole image; whatever else lies there is passed on."""

_BY_NAME = {field.name: field for field in FIELDS}
LABEL_FIELDS: tuple[Field, ...] = tuple(field for field in FIELDS if field.label_name is not None)
"""The fields that a label holds as numbers, whole numbers and then flags last."""
FILE_FIELDS = tuple(field for field in LABEL_FIELDS if field.in_labels_json != "never")
"""The fields of a row of labels.json."""


def field_of(name: str) -> Field:
    """The field of a name; raises KeyError of an unknown one."""
    return _BY_NAME[name]


def names_of(
    *, per: Per | None = None, kind: Kind | None = None, under_map: UnderMap | None = None
) -> tuple[str, ...]:
    """The names of the fields that are of this kind, in the schema's order.

    Example:
        >>> names_of(per="image", kind="float")
        ('K', 'distortion', 'H_out_in', 'depth')
    """
    return tuple(
        field.name
        for field in FIELDS
        if per in (None, field.per)
        and kind in (None, field.kind)
        and under_map in (None, field.under_map)
    )


def target_table() -> str:
    """The fields of a Dataset's target as a Markdown table: that of docs/datasets.md."""
    rows = ["| key | shape | dtype | |", "| --- | --- | --- | --- |"]
    for field in FIELDS:
        if field.made_by == "dataset":
            shape = " x ".join(("N " * (field.per != "image") + field.shape).split())
            rows.append(f"| `{field.name}` | {shape} | {field.dtype} | {field.meaning} |")
    return "\n".join(rows) + "\n"
