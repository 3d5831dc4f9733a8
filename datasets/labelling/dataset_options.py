"""The keywords that every Dataset has."""

import operator
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Literal, TypedDict, get_args

from torch import Tensor

from animal3dbox.datasets.labelling.filters import LabelFilter
from animal3dbox.datasets.labelling.keypoint_places import Misplaced
from animal3dbox.datasets.labelling.label_records import CameraPolicy
from animal3dbox.datasets.labelling.scale import ScaleSource
from animal3dbox.datasets.labelling.skipped import Target
from animal3dbox.datasets.readers.tolerance import BadParts
from animal3dbox.errors import ConfigError, SampleError
from animal3dbox.labels.calibration import Calibration
from animal3dbox.labels.config import LabelConfig

OnBad = Literal["error", "skip"]
Partial = Literal["keep", "skip"]
SampleIndex = int | tuple[int, int]
TransformCall = Callable[[Tensor, Target], tuple[Any, Target]]


class Options(TypedDict, total=False):
    """LabelDataset's options."""

    config: LabelConfig | None
    on_bad: OnBad
    partial: Partial
    filters: LabelFilter | None
    classes: Sequence[str] | None
    transform: TransformCall | None
    scale: ScaleSource | None
    stored_cameras: CameraPolicy
    misplaced: Misplaced
    optional: BadParts
    cache: Path | str | None
    masks: bool
    report_to: Path | str | None
    reuse: bool
    calibration: Calibration | Path | str | None


def check_choices(on_bad: str, partial: str, scale: object) -> None:
    """Raise a ConfigError for options that have a value that they cannot have."""
    for name, value, known in (
        ("on_bad", on_bad, get_args(OnBad)),
        ("partial", partial, get_args(Partial)),
    ):
        if value not in known:
            raise ConfigError(f"{name} must be {' or '.join(map(repr, known))}, got {value!r}")
    if scale is not None and not hasattr(scale, "metres_per_unit"):
        raise ConfigError(
            "scale must be a KnownScale, SpeciesScale or AltitudeScale"
            f" (datasets.labelling.scale), got {scale!r}"
        )


def sample_key(index: Any, epoch: int, count: int) -> tuple[int, int]:
    """Epoch and place of a sample's index.

    Args:
        index: a whole number of any type that is one, or a pair (epoch, index).
        epoch: of an index alone.
        count: images of the Dataset; indices below 0 count from the end.

    Raises:
        IndexError: there is no such image.
        TypeError: no index.

    Example:
        >>> sample_key(-1, 0, 10), sample_key((2, 3), 0, 10)
        ((0, 9), (2, 3))
    """
    try:
        of_epoch, place = index if isinstance(index, tuple) else (epoch, index)
        of_epoch, place = operator.index(of_epoch), operator.index(place)
    except (TypeError, ValueError):
        raise TypeError(
            f"an index must be a whole number or a pair (epoch, index), got {index!r}"
        ) from None
    if not -count <= place < count:
        raise IndexError(f"index {place} of {count} images")
    return of_epoch, place % count


def first_fault(faults: Sequence[SampleError]) -> SampleError:
    """The error that a dataset with unreadable annotations raises where none may be left out."""
    first, more = faults[0], len(faults) - 1
    others = (
        f"(and {more} more that cannot be read; on_bad='skip' leaves them out and reports them)"
    )
    return SampleError(first.sample_id, first.field, f"{first.problem} {others}")


def default_config(stored_cameras: CameraPolicy, filters: LabelFilter) -> LabelConfig:
    """How a Dataset labels.

    Without what needs drawing, but for the mask's overlap where the pose is estimated or a filter
    looks at it.
    """
    return LabelConfig(
        surface_share=False,
        mask_iou=stored_cameras == "hypothesis"
        or filters.min_mask_iou is not None
        or filters.min_confidence is not None,
    )
