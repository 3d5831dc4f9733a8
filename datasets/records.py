"""One annotated animal, or one box, whatever dataset it comes from."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from animal3dbox.datasets.images.masks import record_mask
from animal3dbox.errors import SampleError
from animal3dbox.smal.keypoints.vocabulary import Vocabulary


@dataclass(frozen=True)
class AnimalRecord:
    """What a dataset says about one animal; checked for form, not for sense.

    Attributes:
        sample_id: the image, as its dataset names it, and "#k" for the animals after the first.
        image_id: the image, as its dataset names it.
        image_path: the file; None for an image that is only in memory.
        image_hw: height and width that the annotations are for.
        vocabulary: what the keypoints are.
        keypoints_2d: (J, 3) x, y, confidence; 0 where missing.
        mask_runs: run lengths of the mask, as COCO writes them; None without a mask.
        category: what the dataset calls the animal.
        mask_path: the mask as a picture, when there are no runs; read when it is asked for.
        mask_source: "dataset", or "rendered" of the dataset's own fitted body.
        K: (3, 3) intrinsics in px that the dataset gives or all its images share; None if it says
            nothing.
        K_source: "given" of the image's own, "dataset" of one for all.
        stored_pose: (R, t) of the dataset's own camera, X_cam = R X + t with X in the body source's
            frame, a guess; None without.
        pose: (R, t) likewise, known exactly (a calibrated rig): no keypoints are needed; None if it
            is not.
        distortion: (4,), (5,), (8,) or (12,) coefficients of OpenCV's lens; None of a pinhole.
        box: (4,) xyxy px that the dataset gives, pixels from their least edge to their greatest;
            None without.
        metres_per_unit: metres in a unit of the body's frame; None if it is not known.
    """

    sample_id: str
    image_id: str
    image_path: Path | None
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

    @property
    def mask(self) -> NDArray[np.bool_] | None:
        """The mask (H, W), decoded when it is asked for.

        The masks of a large dataset would fill the memory.

        Raises:
            SampleError: the mask's file cannot be read, or is of another size.

        """
        return record_mask(
            self.mask_runs, self.mask_path, sample_id=self.sample_id, image_hw=self.image_hw
        )


@dataclass(frozen=True)
class CuboidRecord:
    """A box that a dataset comes with: nothing of it is estimated here.

    Attributes:
        sample_id: the image, as its dataset names it, and "#k" for the boxes after the first.
        image_id: the image, as its dataset names it.
        image_path: the file.
        image_hw: height and width that the annotations are for.
        category: what the dataset calls the thing.
        K: (3, 3) intrinsics in px.
        center: (3,) camera frame.
        rotation: (3, 3) R_cam_box: columns forward, left, up.
        size: (3,) length, width, height.
        metric: whether center and size are in metres.
        heading_known: whether forward and left mean something, so that the faces have names.
        box: (4,) xyxy px of the visible thing; None if it is not known.
        truncation: as the dataset says; None if it says nothing.
    """

    sample_id: str
    image_id: str
    image_path: Path | None
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


@dataclass(frozen=True)
class CuboidImage:
    """An image of a dataset of boxes, with or without any.

    Attributes:
        image_id: the image, as its dataset names it.
        image_path: the file.
        image_hw: height and width that the annotations are for.
        K: (3, 3) intrinsics in px.
    """

    image_id: str
    image_path: Path | None
    image_hw: tuple[int, int]
    K: NDArray[np.float64]


@dataclass(frozen=True)
class CuboidSet:
    """A dataset of boxes.

    Attributes:
        name: the format.
        records: in the file's order, those of an image together.
        faults: one error a box or image that is unusable.
        notes: what was found out about the dataset, in whole sentences.
        categories: every category that the file knows, in its order, whether an animal has it or
            not; empty if it does not say.
        images: every usable image in the file's order, also those without a box; empty if the
            format does not list them.
    """

    name: str
    records: tuple[CuboidRecord, ...]
    faults: tuple[SampleError, ...]
    notes: tuple[str, ...] = ()
    images: tuple[CuboidImage, ...] = ()
    categories: tuple[str, ...] = ()

    def listed_images(self) -> tuple[CuboidImage, ...]:
        """The images, and those of the records that are not listed, each once."""
        listed = {image.image_id: image for image in self.images}
        for record in self.records:
            listed.setdefault(
                record.image_id,
                CuboidImage(record.image_id, record.image_path, record.image_hw, record.K),
            )
        return tuple(listed.values())


@dataclass(frozen=True)
class RecordSet:
    """A dataset's records, and the samples that could not be read.

    Attributes:
        name: the format.
        records: in the file's order.
        faults: one error a sample that is unusable; nothing is dropped without one.
        notes: what was found out about the dataset, in whole sentences.
        categories: every category that the file knows, in its order, whether an animal has it or
            not; empty if it does not say.
    """

    name: str
    records: tuple[AnimalRecord, ...]
    faults: tuple[SampleError, ...]
    notes: tuple[str, ...] = ()
    categories: tuple[str, ...] = ()
