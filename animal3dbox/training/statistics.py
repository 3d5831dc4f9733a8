"""Statistics of a run: its classes, between which values each measure lay, and votes on sides."""

from collections import Counter

import numpy as np

from animal3dbox.training.box_checks import left_picture
from animal3dbox.training.findings import TargetReport
from animal3dbox.training.measures import measures_of
from animal3dbox.training.packed import Packed
from animal3dbox.training.side_votes import side_votes

STATISTICS_EVERY = 16
"""In a training loop statistics are of every sixteenth step."""


def statistics_of(packed: Packed) -> TargetReport:
    """A report of nothing but statistics."""
    if packed.count == 0:
        return TargetReport()
    spans = {}
    for name, values in measures_of(packed).items():
        known = values[np.isfinite(values)]
        if len(known):
            spans[name] = (float(known.min()), float(known.max()))
    labels = packed.others.get("labels")
    counts = Counter[int]() if labels is None else Counter(labels.tolist())
    return TargetReport(
        labels=counts,
        spans=spans,
        sides=side_votes(packed),
        left_picture=int(left_picture(packed).sum()),
    )
