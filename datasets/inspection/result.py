"""The form of an inspection's outcome; docs/formats.md describes the JSON that is made of it."""

import msgspec

SCHEMA, VERSION = "animal3dbox.inspection", 3
"""Name and version of the JSON's form."""


class Residual(msgspec.Struct, frozen=True):
    """The distances of points from marked keypoints, over several animals.

    Attributes:
        animals: number of animals that were compared.
        median_px: median distance of all points.
        p95_px: 95th percentile of the distances of all points.
        median_percent: the median animal's median point, in percent of its keypoints' extent.
    """

    animals: int
    median_px: float
    p95_px: float
    median_percent: float


class ImageFacts(msgspec.Struct, frozen=True):
    """Counts on a sample of the image files.

    Attributes:
        looked_at: number of files in the sample.
        other_size: number of those of another size than annotated.
        turned_by_exif: number of those whose EXIF orientation is not upright.
        unreadable: number of those that cannot be read.
        examples: sentences on the first that are of another size or unreadable.
    """

    looked_at: int
    other_size: int
    turned_by_exif: int
    unreadable: int
    examples: list[str]


class MaskFacts(msgspec.Struct, frozen=True):
    """Counts on the masks, the levels on a sample.

    Attributes:
        animals: number of animals with a mask.
        looked_at: number of masks in the sample.
        levels: phrase on the levels that a mask holds -> number of masks.
        unusable: number of masks that cannot be used.
        examples: sentences on the first unusable ones.
    """

    animals: int
    looked_at: int
    levels: dict[str, int]
    unusable: int
    examples: list[str]


class KeypointFacts(msgspec.Struct, frozen=True):
    """Counts on where keypoints lie: in the frame, in their animal's box and on its mask.

    Attributes:
        looked_at: number of animals in the sample.
        misplaced: number of animals whose keypoints lie elsewhere.
        examples: sentences on the first of them.
    """

    looked_at: int
    misplaced: int
    examples: list[str]


class BodyFacts(msgspec.Struct, frozen=True):
    """Counts on a sample of the bodies that come with the dataset.

    Attributes:
        looked_at: number of bodies in the sample.
        unusable: number of those that cannot be made.
        examples: sentences on the first unusable ones.
    """

    looked_at: int
    unusable: int
    examples: list[str]


class CameraFacts(msgspec.Struct, frozen=True):
    """Counts on the cameras that come with the records.

    Attributes:
        intrinsics: source of K -> number of animals.
        exact_poses: number of animals whose camera pose is known exactly.
        stored_poses: number of animals whose camera pose is a guess.
        lenses: number of animals with a lens distortion.
        residual: of bodies under the known or stored poses; None without either.
    """

    intrinsics: dict[str, int]
    exact_poses: int
    stored_poses: int
    lenses: int
    residual: Residual | None


class FaultLine(msgspec.Struct, frozen=True):
    """One fault, as the reader tells it.

    Attributes:
        sample_id: the sample; "" if it has no name.
        field: the field that is wrong.
        problem: why it is wrong, and the remedy.
    """

    sample_id: str
    field: str
    problem: str


class FaultFacts(msgspec.Struct, frozen=True):
    """Counts on the samples that cannot be used.

    Attributes:
        count: number of faults.
        by_field: field -> number of faults.
        first: the first faults, in the file's order.
    """

    count: int
    by_field: dict[str, int]
    first: list[FaultLine]


class LabelingFacts(msgspec.Struct, frozen=True):
    """Which animals' keypoints have left and right exchanged.

    Attributes:
        labelled: number of animals that were labelled to find out.
        exchanged: part of the body, or "all" -> the samples.
    """

    labelled: int
    exchanged: dict[str, list[str]]


class PictureFit(msgspec.Struct, frozen=True):
    """The picture that 2D points of the file are for, by their distance from keypoint_2d.

    Attributes:
        key: of the file.
        relation: "as stored", "scaled", "scaled and shifted" or "none".
        residuals: one for each of the first three relations, fitted to each animal.
        scale: median scale of the relation; None of "as stored" and "none".
        shift_px: median shift x and y of the relation; None likewise.
    """

    key: str
    relation: str
    residuals: dict[str, Residual]
    scale: float | None
    shift_px: list[float] | None


class CameraFit(msgspec.Struct, frozen=True):
    """3D points of the file, or of its bodies, compared with 2D points under a pinhole camera.

    Attributes:
        points: the 3D points, with or without trans.
        frame: the camera frame that they are taken to be in.
        target: the 2D points that they are compared with.
        stored: residual under the file's focal length and a centred principal point; None without,
            or behind the camera.
        free: residual under each animal's best focal length and principal point.
        focal_px: median of the best focal lengths.
        focal_range_px: 5th and 95th percentile of the best focal lengths.
        offset_px: median of the best principal points less the image's middle.
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
    """Stored keypoint_3d beside the posed bodies' own, by the map from one onto the other.

    Attributes:
        compared: number of animals that have both.
        relations: "same", "less trans", "shifted", "other frame", "sides exchanged", "turned or
            scaled" or "other" -> number of animals.
        median_percent: greatest difference of the median animal, up to a shift, in percent of its
            extent.
    """

    compared: int
    relations: dict[str, int]
    median_percent: float


class SideFacts(msgspec.Struct, frozen=True):
    """Counts on whether the named left is the animal's left.

    Attributes:
        template_wrong: landmarks of the model that lie on the other side of its template.
        left_is_left: number of animals whose stored keypoint_3d have the named left on the left.
        left_is_right: number of animals that have it on the right: names exchanged, or a mirrored
            frame.
        swapped_in_image: number of animals whose keypoint_2d fit the projected points far better
            with left and right exchanged.
        compared_in_image: number of animals whose keypoint_2d were compared.
    """

    template_wrong: list[str]
    left_is_left: int
    left_is_right: int
    swapped_in_image: int
    compared_in_image: int


class Animal3DFacts(msgspec.Struct, frozen=True):
    """Facts that only Animal3D's files have.

    Attributes:
        top_keys: file -> its keys.
        entries: file -> number of entries.
        keys: key -> number of entries that have it, not null.
        forms: key -> form (105, 26x3, ...) -> number of entries.
        visibility: value -> number of keypoints.
        flength: the focal length of the first file that has one; None without.
        with_tail: value -> number of entries; "absent" where there is none.
        supercategories: value -> number of entries, by name where the file has names.
        pictures: the fits of reproj_kp_2d and joints_2d.
        cameras: the best fits of each target, best first.
        stored_points: stored and posed 3D keypoints; None without --model.
        sides: left and right; None if nothing tells.
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


class StoredFitFacts(msgspec.Struct, frozen=True):
    """Stored bodies beside bodies that were fitted here to the same keypoints.

    Attributes:
        compared: number of animals.
        unsure: number of those whose fit tells no orientation.
        turned: animals whose stored trunk is another than the fit's.
        worse: animals whose stored body misses keypoints that the fitted one meets.
        examples: a sentence on each of these.
    """

    compared: int
    unsure: int
    turned: list[str]
    worse: list[str]
    examples: list[str]


class Inspection(msgspec.Struct, frozen=True):
    """The outcome of a dataset's inspection.

    Attributes:
        path: of the dataset, as the user wrote it.
        format: of the dataset, as recognised.
        images: number of images with a readable animal.
        animals: number of animals that can be read.
        largest_group: greatest number of animals in one image.
        splits: file -> number of entries, where the format has several.
        vocabularies: name -> number of animals.
        categories: name -> number of animals.
        keypoints_marked: number of marked keypoints of the median animal.
        confidences: value -> number of keypoints, as they were read.
        image_files: counts on the images.
        masks: counts on the masks.
        bodies: counts on the animals' own bodies.
        cameras: counts on the cameras.
        keypoint_places: counts on where keypoints lie.
        labelings: which keypoints have left and right exchanged.
        faults: counts on the samples that cannot be used.
        animal3d: facts of Animal3D's files; None of other formats.
        notes: the reader's own sentences.
        answers: sentences on what follows from all this.
        schema: name of the JSON's form.
        version: of the JSON's form.
        stored_fits: stored bodies beside fits; None unless asked for, or without stored bodies.
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
    keypoint_places: KeypointFacts
    labelings: LabelingFacts
    faults: FaultFacts
    animal3d: Animal3DFacts | None
    notes: list[str]
    answers: list[str]
    schema: str = SCHEMA
    version: int = VERSION
    stored_fits: StoredFitFacts | None = None
