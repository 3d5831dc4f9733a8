"""The keywords that every Dataset has."""

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
from animal3dbox.errors import ConfigError
from animal3dbox.labels.calibration import Calibration
from animal3dbox.labels.config import LabelConfig

OnBad = Literal["error", "skip"]
Partial = Literal["keep", "skip"]
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
