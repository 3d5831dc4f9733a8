"""The label of one record, by the one route that there is."""

from animal3dbox.datasets.bodies.sources import BodySource
from animal3dbox.datasets.labelling.label_records import label_records
from animal3dbox.datasets.labelling.label_requests import request_of_record
from animal3dbox.datasets.labelling.scale import ScaleSource
from animal3dbox.datasets.records import AnimalRecord
from animal3dbox.errors import SampleError
from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.types import CuboidLabel, Rejection


def label_of(
    record: AnimalRecord, bodies: BodySource, config: LabelConfig, scale: ScaleSource | None = None
) -> CuboidLabel | Rejection:
    """The label or rejection of one animal; raises what is wrong with it."""
    outcome = label_records([request_of_record(record, bodies)], config, scale=scale)[0]
    if isinstance(outcome, SampleError):
        raise outcome
    return outcome
