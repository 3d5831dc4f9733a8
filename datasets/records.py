"""Records: one annotated animal, or one box, in one form whatever dataset it comes from.

A reader checks the form of what its files say, not the sense; labelling does the rest.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from animal3dbox.datasets.images.masks import record_mask
from animal3dbox.datasets.images.remote_files import PicturePath
from animal3dbox.datasets.sightings import NO_SIGHTING, Sighting
from animal3dbox.errors import SampleError
from animal3dbox.smal.keypoints.vocabulary import Vocabulary


@dataclass(frozen=True)
class AnimalRecord:
    """One animal as its dataset annotates it, checked for form, not for sense.

    Attributes:
        sample_id: the image, as its dataset names it, and "#k" for the animals after the first.
        image_id: the image, as its dataset names it.
        image_path: the image's file or URL; None for an image that is only in memory.
        image_hw: height and width that the annotations are for.
        vocabulary: names of the J keypoints.
        keypoints_2d: (J, 3) x, y, confidence; 0 where missing.
        mask_runs: run lengths of the mask, as COCO writes them; None without a mask.
        category: the animal's category, as the dataset calls it.
        mask_path: the mask as a picture, when there are no runs; None without.
        mask_source: "dataset", or "rendered" if the mask shows the dataset's own fitted body.
        K: (3, 3) intrinsics in px, of the image or of all images of the dataset; None if the
            dataset says nothing.
        K_source: "given" of the image's own K, "dataset" of one for all.
        stored_pose: (R, t) of the dataset's own camera, X_cam = R X + t with X in the body source's
            frame, a guess; None without.
        pose: (R, t) of a camera that is known exactly (a calibrated rig), so that no keypoints are
            needed; None if it is not.
        distortion: (4,), (5,), (8,) or (12,) coefficients of OpenCV's lens; None of a pinhole.
        box: (4,) xyxy px that the dataset gives, pixels from their least edge to their greatest;
            None without.
        metres_per_unit: metres in a unit of the body's frame; None if it is not known.
        sighting: when, where and of whom the picture is, as the dataset says.
        upright: whether the picture, and a mask that is one, are turned as their headers say; else
            their pixels are as stored.

    Example:
        >>> from animal3dbox.smal import VOCABULARIES
        >>> vocabulary = VOCABULARIES["animal3d26"]
        >>> record = AnimalRecord(
        ...     sample_id="a.jpg",
        ...     image_id="a.jpg",
        ...     image_path=Path("a.jpg"),
        ...     image_hw=(2, 3),
        ...     vocabulary=vocabulary,
        ...     keypoints_2d=np.zeros((len(vocabulary), 3)),
        ...     mask_runs=(2, 3, 1),
        ...     category="dog",
        ... )
        >>> record.mask.astype(int).tolist()
        [[0, 1, 1], [0, 1, 0]]

    """

    sample_id: str
    image_id: str
    image_path: PicturePath | None
    image_hw: tuple[int, int]
    vocabulary: Vocabulary
    keypoints_2d: NDArray[np.float64]
    mask_runs: str | tuple[int, ...] | None
    category: str
    mask_path: Path | None = None
    mask_source: str = "dataset"
    K: NDArray[np.float64] | None = None
    K_source: str = "given"
    stored_pose: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None
    pose: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None
    distortion: NDArray[np.float64] | None = None
    box: NDArray[np.float64] | None = None
    metres_per_unit: float | None = None
    sighting: Sighting = NO_SIGHTING
    upright: bool = False

    @property
    def mask(self) -> NDArray[np.bool_] | None:
        """The mask (H, W), decoded anew each time; None without a mask.

        It is not kept, since the masks of a large dataset would fill the memory.

        Raises:
            SampleError: the mask's file cannot be read, or is of another size.

        """
        return record_mask(
            self.mask_runs,
            self.mask_path,
            sample_id=self.sample_id,
            image_hw=self.image_hw,
            upright=self.upright,
        )


@dataclass(frozen=True)
class CuboidRecord:
    """One box that a dataset comes with, of which nothing is estimated here.

    Attributes:
        sample_id: the image, as its dataset names it, and "#k" for the boxes after the first.
        image_id: the image, as its dataset names it.
        image_path: the image's file or URL; None for an image that is only in memory.
        image_hw: height and width that the annotations are for.
        category: the thing's category, as the dataset calls it.
        K: (3, 3) intrinsics in px.
        center: (3,) camera frame.
        rotation: (3, 3) R_cam_box: columns forward, left, up.
        size: (3,) length, width, height.
        metric: whether center and size are in metres.
        heading_known: whether forward and left mean something, so that the faces have names.
        box: (4,) xyxy px of the visible thing; None if it is not known.
        truncation: part outside the image, as the dataset says; None if it says nothing.
        visibility: part that nothing in front hides, 0 to 1, as the dataset says; None likewise.
        score: of a detector's box, as it says; None of an annotation.
        sighting: when, where and of whom the picture is, as the dataset says.
        upright: whether the picture is turned as its header says; else its pixels are as stored.

    Example:
        >>> record = CuboidRecord(
        ...     sample_id="a.jpg",
        ...     image_id="a.jpg",
        ...     image_path=None,
        ...     image_hw=(480, 640),
        ...     category="dog",
        ...     K=np.array([[500.0, 0, 319.5], [0, 500, 239.5], [0, 0, 1]]),
        ...     center=np.array([0.0, 0.0, 4.0]),
        ...     rotation=np.eye(3),
        ...     size=np.array([0.9, 0.3, 0.6]),
        ... )
        >>> record.metric, record.heading_known
        (True, True)

    """

    sample_id: str
    image_id: str
    image_path: PicturePath | None
    image_hw: tuple[int, int]
    category: str
    K: NDArray[np.float64]
    center: NDArray[np.float64]
    rotation: NDArray[np.float64]
    size: NDArray[np.float64]
    metric: bool = True
    heading_known: bool = True
    box: NDArray[np.float64] | None = None
    truncation: float | None = None
    visibility: float | None = None
    score: float | None = None
    sighting: Sighting = NO_SIGHTING
    upright: bool = False


@dataclass(frozen=True)
class CuboidImage:
    """One image of a dataset of boxes, with or without any box in it.

    Attributes:
        image_id: the image, as its dataset names it.
        image_path: the image's file or URL; None for an image that is only in memory.
        image_hw: height and width that the annotations are for.
        K: (3, 3) intrinsics in px.
        upright: whether the picture is turned as its header says; else its pixels are as stored.
    """

    image_id: str
    image_path: PicturePath | None
    image_hw: tuple[int, int]
    K: NDArray[np.float64]
    upright: bool = False


@dataclass(frozen=True)
class CuboidSet:
    """The boxes of a dataset, and the errors of those that could not be read.

    Attributes:
        name: the format's name.
        records: the boxes in the file's order, those of an image together.
        faults: one error a box or image that is unusable.
        notes: what a careful person should know of the dataset, in whole sentences.
        categories: every category that the file knows, in its order, whether an animal has it or
            not; empty if it does not say.
        images: every usable image in the file's order, also those without a box; empty if the
            format does not list them.

    Example:
        >>> boxes = CuboidSet("omni3d", records=(), faults=(), categories=("dog",))
        >>> len(boxes.records), boxes.listed_images()
        (0, ())

    """

    name: str
    records: tuple[CuboidRecord, ...]
    faults: tuple[SampleError, ...]
    notes: tuple[str, ...] = ()
    images: tuple[CuboidImage, ...] = ()
    categories: tuple[str, ...] = ()

    def listed_images(self) -> tuple[CuboidImage, ...]:
        """The listed images, then those that only records name, each once."""
        by_id = {image.image_id: image for image in self.images}
        for record in self.records:
            by_id.setdefault(
                record.image_id,
                CuboidImage(
                    record.image_id, record.image_path, record.image_hw, record.K, record.upright
                ),
            )
        return tuple(by_id.values())


@dataclass(frozen=True)
class RecordSet:
    """The animals of a dataset, and the errors of those that could not be read.

    Attributes:
        name: the format's name.
        records: the animals in the file's order, in memory, or decoded when they are asked for
            (storage/records_on_demand.py).
        faults: one error a sample that is unusable; nothing is dropped without one.
        notes: what a careful person should know of the dataset, in whole sentences.
        categories: every category that the file knows, in its order, whether an animal has it or
            not; empty if it does not say.

    Example:
        >>> fault = SampleError("a.jpg", "height", "must be positive, got 0")
        >>> animals = RecordSet("coco", records=(), faults=(fault,))
        >>> str(animals.faults[0])
        'a.jpg: height: must be positive, got 0'

    """

    name: str
    records: Sequence[AnimalRecord]
    faults: tuple[SampleError, ...]
    notes: tuple[str, ...] = ()
    categories: tuple[str, ...] = ()
