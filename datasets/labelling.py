"""From a record to its label: the one way that every dataset and command goes."""

from dataclasses import replace

from animal3dbox.datasets.bodies import BodySource
from animal3dbox.datasets.images import orientation_warning
from animal3dbox.datasets.records import AnimalRecord
from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.label import label_animal
from animal3dbox.labels.types import CuboidLabel, Rejection


def label_record(record: AnimalRecord, bodies: BodySource, config: LabelConfig) -> CuboidLabel | Rejection:
    """The label of a record's animal with the body that a source gives it.

    An EXIF orientation of the image, which is not applied, is among the label's warnings.

    Raises:
        SampleError: the record is unusable; names the sample, the field and the remedy.

    """
    body = bodies.body(record)
    hypotheses = () if record.stored_pose is None else (record.stored_pose,)
    outcome = label_animal(
        record.image_hw,
        keypoints_2d=record.keypoints_2d,
        keypoints_3d=body.landmarks,
        landmark_sigma=body.landmark_sigma,
        vertices=body.vertices,
        faces=body.faces,
        template=body.template,
        K=record.K,
        pose=record.pose,
        pose_hypotheses=hypotheses,
        mask=record.mask,
        vocabulary=record.vocabulary,
        sample_id=record.sample_id,
        config=config,
    )
    if isinstance(outcome, Rejection):
        return outcome
    turned = None if record.image_path is None else orientation_warning(record.image_path)
    warnings = outcome.quality.warnings if turned is None else (*outcome.quality.warnings, turned)
    K_source = outcome.quality.K_source if record.K is None else record.K_source
    return replace(outcome, quality=replace(outcome.quality, warnings=warnings, K_source=K_source))
