"""2D boxes of labels in pixels whose edges, not centres, are whole numbers, cut by the frame."""

from collections.abc import Sequence

from animal3dbox.errors import SampleError
from animal3dbox.report.label_files import AnimalRow

EdgeBox = tuple[float, float, float, float]
"""x, y, width, height in px from the frame's corner."""


def edge_box(row: AnimalRow) -> EdgeBox:
    """What the frame shows of an animal's 2D box.

    Our pixels have their centres at whole numbers: a frame reaches from -0.5 to its side - 0.5.

    Raises:
        SampleError: the box lies outside the frame, or has no area.

    Example:
        >>> from types import SimpleNamespace
        >>> edge_box(SimpleNamespace(box=[-3.0, 4.5, 9.5, 14.5], image_hw=(120, 160)))
        (0.0, 5.0, 10.0, 10.0)
    """
    height, width = row.image_hw
    x0, y0, x1, y1 = (px + 0.5 for px in row.box)
    left, right = max(x0, 0.0), min(x1, float(width))
    top, bottom = max(y0, 0.0), min(y1, float(height))
    if not (right > left and bottom > top):
        raise SampleError(
            row.sample_id, "box", f"has no area in the frame of {width} x {height} px: {row.box}"
        )
    return left, top, right - left, bottom - top


def rows_with_boxes(
    animals: Sequence[AnimalRow],
) -> tuple[list[tuple[AnimalRow, EdgeBox]], tuple[SampleError, ...]]:
    """The animals that the frame shows, each with its box, and an error for each other."""
    pairs: list[tuple[AnimalRow, EdgeBox]] = []
    faults: list[SampleError] = []
    for row in animals:
        try:
            pairs.append((row, edge_box(row)))
        except SampleError as fault:
            faults.append(fault)
    return pairs, tuple(faults)


def turned_notes(animals: Sequence[AnimalRow]) -> tuple[str, ...]:
    """What to tell of boxes in pictures that were turned upright; nothing if there are none."""
    count = sum(row.upright for row in animals)
    if not count:
        return ()
    return (
        f"{count} of {len(animals)} boxes are for pictures turned as their EXIF headers say: a tool"
        " that shows pixels as they are stored shows them elsewhere",
    )
