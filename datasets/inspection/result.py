"""What an inspection finds; docs/formats.md describes the JSON that is made of it."""

import msgspec

SCHEMA, VERSION = "animal3dbox.inspection", 1


class Residual(msgspec.Struct, frozen=True):
    """How far points lie from marked keypoints, over so many animals.

    Attributes:
        animals: that were compared.
        median_px: of all points.
        p95_px: of all points.
        median_percent: the median animal's median point, in percent of its keypoints' extent.
    """

    animals: int
    median_px: float
    p95_px: float
    median_percent: float


class ImageFacts(msgspec.Struct, frozen=True):
    """Image files, sampled.

    Looked_at of them, of another size than annotated, turned by EXIF, unreadable.
    """

    looked_at: int
    other_size: int
    turned_by_exif: int
    unreadable: int
    examples: list[str]


class MaskFacts(msgspec.Struct, frozen=True):
    """Masks: animals that have one.

    Of those looked at, which levels they hold, and how many cannot be used.
    """

    animals: int
    looked_at: int
    levels: dict[str, int]
    unusable: int
    examples: list[str]


class BodyFacts(msgspec.Struct, frozen=True):
    """Bodies that come with the dataset.

    So many were looked at, and so many of these cannot be used.
    """

    looked_at: int
    unusable: int
    examples: list[str]


class CameraFacts(msgspec.Struct, frozen=True):
    """What records know of cameras.

    Residual is of bodies under the known or stored poses, None without either.
    """

    intrinsics: dict[str, int]
    exact_poses: int
    stored_poses: int
    lenses: int
    residual: Residual | None


class FaultLine(msgspec.Struct, frozen=True):
    """One fault."""

    sample_id: str
    field: str
    problem: str


class FaultFacts(msgspec.Struct, frozen=True):
    """Faults by field, and the first of them."""

    count: int
    by_field: dict[str, int]
    first: list[FaultLine]


class PictureFit(msgspec.Struct, frozen=True):
    """In which picture 2D points of the file live, by their distance from keypoint_2d.

    Attributes:
        key: of the file.
        relation: "as stored", "scaled", "scaled and shifted" or "none".
        residuals: of each of the first three, fitted to each animal.
        scale: median, of the relation; None for others.
        shift_px: likewise, median x and y.
    """

    key: str
    relation: str
    residuals: dict[str, Residual]
    scale: float | None
    shift_px: list[float] | None


class CameraFit(msgspec.Struct, frozen=True):
    """3D points of the file, or of its bodies, under a pinhole camera.

    Attributes:
        points: what is projected, with or without trans.
        frame: their camera frame.
        target: the 2D points it is compared with.
        stored: under the file's focal length and a centred principal point; None without, or behind
            the camera.
        free: under each animal's best focal length and principal point.
        focal_px: their median.
        focal_range_px: their 5th and 95th percentile.
        offset_px: median of the principal point less the image's middle.
    """

    points: str
    frame: str
    target: str
    stored: Residual | None
    free: Residual
    focal_px: float
    focal_range_px: list[float]
    offset_px: list[float]


class StoredPoints(msgspec.Struct, frozen=True):
    """Stored keypoint_3d against the posed bodies' own, by what maps one onto the other.

    Attributes:
        compared: animals.
        relations: "same", "less trans", "shifted", "other frame", "sides exchanged", "turned or
            scaled", "other" -> animals.
        median_percent: greatest difference of the median animal, up to a shift, in percent of its
            extent.
    """

    compared: int
    relations: dict[str, int]
    median_percent: float


class SideFacts(msgspec.Struct, frozen=True):
    """Whether left is left.

    Attributes:
        template_wrong: landmarks of the model that lie on the other side of its template.
        left_is_left: animals whose stored keypoint_3d have the named left on the left.
        left_is_right: whose have it on the right: names exchanged, or a mirrored frame.
        swapped_in_image: animals whose keypoint_2d fit the projected points far better with left
            and right exchanged.
        compared_in_image: animals that were compared.
    """

    template_wrong: list[str]
    left_is_left: int
    left_is_right: int
    swapped_in_image: int
    compared_in_image: int


class Animal3DFacts(msgspec.Struct, frozen=True):
    """What is said only in Animal3D's files.

    Attributes:
        top_keys: file -> its keys.
        entries: file -> entries.
        keys: key -> entries that have it, not null.
        forms: key -> form (105, 26x3, ...) -> entries.
        visibility: value -> keypoints.
        flength: of the first file that has one.
        with_tail: value -> entries; "absent" where there is none.
        supercategories: likewise, by name where the file has names.
        pictures: of reproj_kp_2d and joints_2d.
        cameras: the best of each target, best first.
        stored_points: None without --model.
        sides: None if nothing tells.
    """

    top_keys: dict[str, list[str]]
    entries: dict[str, int]
    keys: dict[str, int]
    forms: dict[str, dict[str, int]]
    visibility: dict[str, int]
    flength: float | None
    with_tail: dict[str, int]
    supercategories: dict[str, int]
    pictures: list[PictureFit]
    cameras: list[CameraFit]
    stored_points: StoredPoints | None
    sides: SideFacts | None


class Inspection(msgspec.Struct, frozen=True):
    """A dataset, inspected.

    Attributes:
        path: as given.
        format: as recognised.
        images: with a readable animal.
        animals: that can be read.
        largest_group: animals of one image at most.
        splits: file -> entries, where the format has several.
        vocabularies: name -> animals.
        categories: name -> animals.
        keypoints_marked: of the median animal.
        confidences: value -> keypoints, as they were read.
        image_files, masks, bodies, cameras, faults: see there.
        animal3d: None of other formats.
        notes: the reader's own.
        answers: what follows from all this, in whole sentences.
    """

    path: str
    format: str
    images: int
    animals: int
    largest_group: int
    splits: dict[str, int]
    vocabularies: dict[str, int]
    categories: dict[str, int]
    keypoints_marked: float
    confidences: dict[str, int]
    image_files: ImageFacts
    masks: MaskFacts
    bodies: BodyFacts
    cameras: CameraFacts
    faults: FaultFacts
    animal3d: Animal3DFacts | None
    notes: list[str]
    answers: list[str]
    schema: str = SCHEMA
    version: int = VERSION
