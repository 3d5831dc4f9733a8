"""From a record to its label: the one way that every dataset and command goes."""

from animal3dbox.datasets.bodies import BodySource
from animal3dbox.datasets.records import AnimalRecord
from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.label import label_animal
from animal3dbox.labels.types import CuboidLabel, Rejection


def label_record(record: AnimalRecord, bodies: BodySource, config: LabelConfig) -> CuboidLabel | Rejection:
    """The label of a record's animal with the body that a source gives it.

    Raises:
        SampleError: the record is unusable; names the sample, the field and the remedy.

    """
    body = bodies.body(record)
    return label_animal(
        record.image_hw,
        keypoints_2d=record.keypoints_2d,
        keypoints_3d=body.landmarks,
        vertices=body.vertices,
        faces=body.faces,
        template=body.template,
        mask=record.mask,
        vocabulary=record.vocabulary,
        sample_id=record.sample_id,
        config=config,
    )
