"""One annotated animal, whatever dataset it comes from."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from animal3dbox.datasets.rle import decode_mask
from animal3dbox.errors import SampleError
from animal3dbox.smal.vocabulary import Vocabulary


@dataclass(frozen=True)
class AnimalRecord:
    """What a dataset says about one animal; checked for form, not for sense.

    Attributes:
        sample_id: the image, as its dataset names it, and "#k" for the animals after the first.
        image_id: the image, as its dataset names it.
        image_path: the file.
        image_hw: height and width that the annotations are for.
        vocabulary: what the keypoints are.
        keypoints_2d: (J, 3) x, y, confidence; 0 where missing.
        mask_runs: run lengths of the mask, as COCO writes them; None without a mask.
        category: what the dataset calls the animal.
    """

    sample_id: str
    image_id: str
    image_path: Path
    image_hw: tuple[int, int]
    vocabulary: Vocabulary
    keypoints_2d: NDArray[np.float64]
    mask_runs: str | tuple[int, ...] | None
    category: str

    @property
    def mask(self) -> NDArray[np.bool_] | None:
        """The mask (H, W), decoded when it is asked for: the masks of a large dataset would fill the memory."""
        return None if self.mask_runs is None else decode_mask(self.mask_runs, self.image_hw)


@dataclass(frozen=True)
class RecordSet:
    """A dataset's records, and the samples that could not be read.

    Attributes:
        name: the format.
        records: in the file's order.
        faults: one error a sample that is unusable; nothing is dropped without one.
    """

    name: str
    records: tuple[AnimalRecord, ...]
    faults: tuple[SampleError, ...]
