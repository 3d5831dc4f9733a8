"""What a user may choose of the metrics; two of them can be merged only if they chose alike."""

from dataclasses import dataclass
from typing import Literal, get_args

from animal3dbox.errors import ConfigError

PairBy = Literal["iou_3d", "boxes"]
LEAST_IOU: dict[PairBy, float] = {"iou_3d": 0.05, "boxes": 0.5}
"""The overlap from which a prediction and a truth are a pair, if the user names no other."""


@dataclass(frozen=True, kw_only=True)
class MetricOptions:
    """What BoxMetrics and TorchBoxMetrics are told beside the boxes.

    Attributes:
        classes: names of the labels 0, 1, ..., for the keys of AP by class; None: their numbers.
        class_agnostic: match boxes whatever their labels.
        max_detections: so many predictions an image and class count, those of the highest scores;
            COCO's 100.
        pair_by: which predictions the errors (of heading, corners, faces, sizes, distance) are
            taken of: those that hit a truth by the IoU of cuboids ("iou_3d"), or by that of the
            upright `boxes` in the picture ("boxes"), for detectors whose depth is not metric.
        pair_iou: the least such IoU; None: 0.05 of cuboids, 0.5 of boxes.
        metric: whether lengths are metres where a target has no `scale_known`.
        heading_known: whether the truth's front is known where a target has no `heading_known`;
            None: it is, but for targets of Datasets that name no faces because their boxes have no
            front.
        relative: compute Rel-AP3D, which is AP3D at 28 scales and takes longest; else it is None.
        resamples: resamples of the images for the 95 % intervals; 0 leaves the intervals out.
        seed: of the resampling.

    Raises:
        ConfigError: an option has a value that it cannot have.

    Example:
        >>> MetricOptions(pair_by="boxes").least_pair_iou
        0.5
    """

    classes: tuple[str, ...] | None = None
    class_agnostic: bool = False
    max_detections: int = 100
    pair_by: PairBy = "iou_3d"
    pair_iou: float | None = None
    metric: bool = False
    heading_known: bool | None = None
    relative: bool = True
    resamples: int = 200
    seed: int = 0

    def __post_init__(self) -> None:
        if isinstance(self.classes, str):
            raise ConfigError(f"classes must be a list of names, got {self.classes!r}")
        if self.classes is not None:  # a list is taken too, and two options stay comparable
            object.__setattr__(self, "classes", tuple(self.classes))
            if len(set(self.classes)) < len(self.classes):
                raise ConfigError(f"classes must be names that differ, got {self.classes}")
        if self.pair_by not in get_args(PairBy):
            raise ConfigError(f"pair_by must be iou_3d or boxes, got {self.pair_by!r}")
        if not 0 < self.least_pair_iou <= 1:
            raise ConfigError(f"pair_iou must lie in (0, 1], got {self.pair_iou}")
        if self.max_detections < 1 or self.resamples < 0 or self.seed < 0:
            raise ConfigError(
                "max_detections must be at least 1, resamples and seed not negative, got"
                f" {self.max_detections}, {self.resamples} and {self.seed}"
            )

    @property
    def least_pair_iou(self) -> float:
        """The IoU from which a prediction and a truth are a pair."""
        return LEAST_IOU[self.pair_by] if self.pair_iou is None else self.pair_iou
