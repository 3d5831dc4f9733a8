"""Masks as COCO writes them: run lengths, compressed or not, and polygons, read as run lengths."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from animal3dbox.datasets.images.rle import RleError, encode_mask, mask_area
from animal3dbox.errors import SampleError

Runs = str | tuple[int, ...]
"""Run lengths of a mask, compressed or not; see rle.py."""


def read_runs(seg: object, image_hw: tuple[int, int], sample_id: str, field: str) -> Runs:
    """The run lengths of a string, or of COCO's {size, counts}, checked by decoding them once.

    Args:
        seg: what stands in the file.
        image_hw: height and width that the mask must have.
        sample_id: named in every error.
        field: the file's key, named in every error.

    Raises:
        SampleError: no run lengths, those of another size, or an empty mask.

    """
    counts: object = seg
    if isinstance(seg, dict):
        counts = seg.get("counts")
        if seg.get("size") not in (None, list(image_hw)):
            raise SampleError(
                sample_id,
                field,
                f"is a mask of size {seg.get('size')}, but the image is {list(image_hw)} (height,"
                " width)",
            )
    if not isinstance(counts, str) and not (
        isinstance(counts, list) and all(isinstance(c, int) for c in counts)
    ):
        raise SampleError(sample_id, field, "must be a run-length string or {size, counts}")
    runs = counts if isinstance(counts, str) else tuple(counts)
    try:
        if not mask_area(runs, image_hw):
            raise SampleError(
                sample_id, field, f"is an empty mask: leave {field} out if there is none"
            )
    except RleError as error:
        raise SampleError(sample_id, field, str(error)) from error
    return runs


def read_segmentation(seg: object, image_hw: tuple[int, int], sample_id: str) -> Runs | None:
    """The run lengths of any of COCO's segmentations: polygons, run lengths, or none.

    Args:
        seg: what stands in the file; null and an empty list are no segmentation.
        image_hw: height and width of the image.
        sample_id: named in every error.

    Raises:
        SampleError: another form, another size, or no pixel of the image.

    """
    if seg is None or seg == []:
        return None
    if not isinstance(seg, list):
        return read_runs(seg, image_hw, sample_id, "segmentation")
    rings = [_ring(ring, image_hw, sample_id) for ring in seg]
    mask = polygon_mask(rings, image_hw)
    if not mask.any():
        raise SampleError(
            sample_id,
            "segmentation",
            "its polygons hold no pixel of the image: leave segmentation out if there is none",
        )
    return encode_mask(mask)


def _ring(ring: object, image_hw: tuple[int, int], sample_id: str) -> NDArray[np.float64]:
    """A polygon's points (N, 2) in the file's pixels; raises SampleError."""
    if (
        not isinstance(ring, list)
        or len(ring) < 6
        or len(ring) % 2
        or not all(isinstance(v, (int, float)) for v in ring)
    ):
        raise SampleError(
            sample_id,
            "segmentation",
            "must be lists of x, y, x, y, ... of at least three points each, or {size, counts}",
        )
    points = np.array(ring, dtype=np.float64).reshape(-1, 2)
    if not np.isfinite(points).all() or np.abs(points).max() > 10 * max(image_hw):
        raise SampleError(
            sample_id,
            "segmentation",
            "has points over ten image sizes away: are they pixels of this image?",
        )
    return points


def polygon_mask(
    rings: Sequence[NDArray[np.float64]], image_hw: tuple[int, int]
) -> NDArray[np.bool_]:
    """The pixels whose centres lie in one of COCO's polygons, each filled by the even-odd rule.

    COCO's polygons count from the image's corner: the pixel (row, column) goes from (column, row)
    to (column + 1, row + 1), so that its centre, which is (column, row) in our pixels, is at
    (column + 0.5, row + 0.5) in theirs.

    Args:
        rings: (N, 2) x, y each, closed by themselves.
        image_hw: height and width.

    Returns:
        (H, W).

    """
    height, width = image_hw
    mask = np.zeros(image_hw, dtype=bool)
    for ring in rings:
        start = ring - 0.5
        end = np.roll(start, -1, axis=0)
        first = np.clip(np.ceil(np.minimum(start[:, 1], end[:, 1])), 0, height).astype(np.int64)
        # Half-open, so that a row at a corner belongs to one of the two edges that meet there.
        last = np.clip(np.ceil(np.maximum(start[:, 1], end[:, 1])), 0, height).astype(np.int64)
        edge = np.repeat(np.arange(len(ring)), last - first)
        row = (
            np.arange(len(edge))
            - np.repeat(np.cumsum(last - first) - (last - first), last - first)
            + first[edge]
        )
        slope = (end[edge, 0] - start[edge, 0]) / (end[edge, 1] - start[edge, 1])
        x = start[edge, 0] + (row - start[edge, 1]) * slope
        crossed = np.zeros((height, width + 1), dtype=bool)
        np.logical_xor.at(crossed, (row, np.clip(np.ceil(x), 0, width).astype(np.int64)), True)
        lines = slice(row.min(initial=height), row.max(initial=-1) + 1)
        mask[lines] |= np.logical_xor.accumulate(crossed[lines], axis=1)[:, :width]
    return mask
