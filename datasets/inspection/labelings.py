"""Which animals of a dataset have left and right exchanged, by the labels that they would get."""

from collections.abc import Sequence

from animal3dbox.datasets.bodies.sources import BodySource
from animal3dbox.datasets.inspection.measures import spread
from animal3dbox.datasets.inspection.result import LabelingFacts
from animal3dbox.datasets.labelling.label_records import label_records
from animal3dbox.datasets.labelling.label_requests import request_of_record
from animal3dbox.datasets.records import AnimalRecord
from animal3dbox.errors import SampleError
from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.pose.problem import AS_GIVEN
from animal3dbox.labels.types import CuboidLabel
from animal3dbox.progress import watched

ANIMALS = 60
"""Number of animals that are labelled."""
QUICK = LabelConfig(surface_share=False, mask_iou=False)


def labeling_facts(records: Sequence[AnimalRecord], bodies: BodySource) -> LabelingFacts:
    """The parts of animals whose left and right a label would exchange.

    Args:
        records: the dataset's; ANIMALS of them are labelled, evenly spread. Those whose camera is
            known exactly tell nothing, since no pose is estimated.
        bodies: the dataset's own, or the preset that labels would take.

    """
    exchanged: dict[str, list[str]] = {}
    labelled = 0
    looked_at = spread([one for one in records if one.pose is None], ANIMALS)
    for record in watched(looked_at, "labelling some", unit="animal"):
        try:
            outcome = label_records([request_of_record(record, bodies)], QUICK)[0]
        except SampleError:
            continue  # counted among the faults
        if not isinstance(outcome, CuboidLabel):
            continue
        labelled += 1
        if outcome.quality.labeling != AS_GIVEN:
            exchanged.setdefault(outcome.quality.labeling, []).append(record.sample_id)
    return LabelingFacts(labelled=labelled, exchanged=exchanged)
