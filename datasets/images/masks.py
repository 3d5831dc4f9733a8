"""The mask of a record, from its runs or its picture: which pixels are the animal.

`record_mask` is the one decoder of a record's mask. `read_mask` reads a mask stored as a picture,
in which one file means the animal by 1, another by 255, another by ids; what cannot be told is an
error that names the sample.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from animal3dbox.datasets.images.photos import converted_image, deep_values, rgb_pixels
from animal3dbox.datasets.images.rle import decode_mask
from animal3dbox.errors import SampleError

MOST_IDS = 31
"""A mask whose levels go no higher holds ids, of which every one is the animal.

A higher one holds brightness.
"""
EXTREME, MOST_BETWEEN = 0.2, 0.35
"""Of a mask, be it compressed or blurred, no more than this part lies between the lowest and the
highest fifth of its range; of photographs far more does."""
OTHER_ID = 100
"""Most pixels that one level in the lower half of a mask's range has as the blur of an edge.

More are an id of their own, if they are also more than a quarter of the upper half's pixels.
"""


def record_mask(
    runs: str | Sequence[int] | None,
    path: Path | str | None,
    *,
    sample_id: str,
    image_hw: tuple[int, int],
    upright: bool = False,
) -> NDArray[np.bool_] | None:
    """The mask (H, W) of one annotated animal, decoded from its runs, else from its picture.

    Args:
        runs: the run lengths, as COCO writes them; None without.
        path: the mask's picture; None without.
        sample_id: named in every error.
        image_hw: height and width that the annotations are for.
        upright: whether the picture is turned as its own header says, see photos.read_photo.

    Returns:
        The mask; None if the animal has neither runs nor a picture.

    Raises:
        RleError: the runs do not fill the image exactly.
        SampleError: the picture cannot be read, or is of another size.

    """
    if runs is not None:
        return decode_mask(runs, image_hw)
    return None if path is None else read_mask(path, sample_id, image_hw, upright=upright)


def read_mask(
    path: Path | str, sample_id: str, expected_hw: tuple[int, int], *, upright: bool = False
) -> NDArray[np.bool_]:
    """The mask (H, W) that a picture stores: every pixel above 0, be it 1, 255 or an id.

    Of a picture that was compressed or smoothed it is the upper half of the range.

    Raises:
        SampleError: no image, of another size than the annotations', without a pixel of the animal,
            or of ids above MOST_IDS.

    """
    levels = mask_levels(path, sample_id, expected_hw, upright=upright)
    top = int(levels.max())
    if top == 0:
        raise SampleError(
            sample_id,
            "mask",
            f"{Path(path).name} has no pixel above 0; leave its path out if there is no mask",
        )
    if top <= MOST_IDS:
        return np.asarray(levels > 0)
    _check_two_levels(levels, top, Path(path).name, sample_id)
    mask = np.asarray(levels > top // 2)
    area = int(np.count_nonzero(mask))
    if np.count_nonzero(levels) - area > max(OTHER_ID, area / 4):
        _check_smoothed(levels, top, area, sample_id)
    return mask


def _check_two_levels(levels: NDArray[np.integer], top: int, name: str, sample_id: str) -> None:
    """Raise a SampleError for a picture most of which is neither dark nor bright: a photograph."""
    between = (levels > EXTREME * top) & (levels < (1 - EXTREME) * top)
    if between.mean() > MOST_BETWEEN and len(np.unique(levels[between])) > MOST_IDS:
        raise SampleError(
            sample_id,
            "mask",
            f"{name} looks like a photograph: {between.mean():.0%} of its pixels are neither dark"
            " nor bright; give the mask's path, or leave it out",
        )


def mask_levels(
    path: Path | str, sample_id: str, expected_hw: tuple[int, int], *, upright: bool = False
) -> NDArray[np.integer]:
    """The values (H, W) of a mask's picture, before it is decided which of them are the animal.

    They are greys as stored, the brightest channel of colours, the alpha of a picture of one
    colour, and 0 and 1 of a palette.

    Raises:
        SampleError: no image, or of another size than the annotations'.

    """
    try:
        return converted_image(path, sample_id, expected_hw, _levels, upright=upright)
    except SampleError as error:
        raise SampleError(sample_id, "mask", error.problem) from error


def _check_smoothed(levels: NDArray[np.integer], top: int, area: int, sample_id: str) -> None:
    """Raise a SampleError if one level of the lower half has an area of its own.

    Such a level is an id: an edge has less, and a background that is not quite 0 has more.

    Args:
        levels: (H, W), the highest of which is top.
        top: the highest level.
        area: pixels of the upper half.
        sample_id: named in the error.

    """
    areas = np.bincount(levels[(levels > 0) & (levels <= top // 2)])
    largest = int(areas.max())
    if np.count_nonzero(levels == 0) > largest > max(OTHER_ID, area / 4):
        raise SampleError(
            sample_id,
            "mask",
            f"has {largest} pixels of {int(areas.argmax())} beside its {top}: ids of animals or"
            f" parts are read up to {MOST_IDS}; save this animal's pixels as 255, all others as 0",
        )


def _levels(image: Image.Image, sample_id: str) -> NDArray[np.integer]:
    """The values (H, W) of a decoded picture of any mode; see mask_levels."""
    if image.mode == "L":
        return np.array(image)
    if image.mode == "P":
        return _of_palette(image, sample_id)
    if image.mode.startswith("I"):
        return deep_values(image, sample_id)
    colors = rgb_pixels(image, sample_id)
    if image.mode in ("RGBA", "LA") and (colors == colors[0, 0]).all():
        alpha = np.array(image.getchannel("A"))
        if alpha.min() < alpha.max():
            return alpha
    red, green, blue = np.moveaxis(colors, 2, 0)
    levels: NDArray[np.uint8] = np.maximum(np.maximum(red, green), blue)
    return levels


def _of_palette(image: Image.Image, sample_id: str) -> NDArray[np.uint8]:
    """The mask (H, W) of a palette: 0 for index 0, 1 for all others.

    Raises SampleError if another index is black, since then index 0 may be the animal.
    """
    indices = np.array(image)
    palette = np.array(image.getpalette("RGB") or [0, 0, 0]).reshape(-1, 3)
    black = np.flatnonzero(~palette.any(axis=1))
    if palette[0].any() and np.isin(indices, black).any():
        raise SampleError(
            sample_id,
            "image",
            "has a palette whose black is not index 0: what is the animal? Save it as grey, 0"
            " and 255",
        )
    return (indices > 0).astype(np.uint8)
