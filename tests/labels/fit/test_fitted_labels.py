"""label_animal with a body that is fitted to the picture."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch

from animal3dbox import CuboidLabel, label_animal
from animal3dbox.datasets.synthetic.foreign.animals import ForeignAnimal, foreign_animal
from animal3dbox.datasets.synthetic.foreign.config import ALONE, ForeignConfig
from animal3dbox.errors import SampleError
from animal3dbox.geometry.rigid_transforms import rotation_angle
from animal3dbox.labels.fit.fit import fit_animal
from animal3dbox.labels.fit.fitted_body import FittedBody
from animal3dbox.labels.label import label_many
from animal3dbox.labels.types import Rejection
from animal3dbox.smal.keypoints.exchanges import exchange_order

WORLD = ForeignConfig(
    world=replace(ALONE, fill=(0.4, 0.9)), proportions=0.0, places=0.0, places_of_animal=0.0
)


def animal(index: int) -> ForeignAnimal:
    return foreign_animal(7, index, WORLD)


def arguments(one: ForeignAnimal) -> dict[str, Any]:
    return {
        "image_hw": one.camera.image_hw,
        "keypoints_2d": one.keypoints_2d,
        "K": one.camera.K,
        "mask": one.mask,
        "sample_id": one.sample_id,
        "body": "fit",
    }


def labelled(outcome: CuboidLabel | Rejection) -> CuboidLabel:
    assert isinstance(outcome, CuboidLabel), outcome
    return outcome


def test_the_box_of_a_fitted_body_is_the_animals_but_for_its_size() -> None:
    one = animal(1)
    label = labelled(label_animal(**arguments(one)))
    assert float(torch.rad2deg(rotation_angle(label.rotation, one.cuboid.rotation))) < 15
    shape, truth = (size / size.norm() for size in (label.size, one.cuboid.size))
    assert float((shape - truth).abs().max()) < 0.1


def test_a_fitted_label_says_that_it_is_one_and_how_sure() -> None:
    quality = labelled(label_animal(**arguments(animal(1)))).quality
    assert (quality.body, quality.pose_hypothesis) == ("fit", "fit")
    assert quality.pose_source == "estimated"
    assert quality.rotation_sd_deg is not None
    assert 0 < quality.rotation_sd_deg < 15
    assert quality.mask_iou is not None
    assert quality.mask_iou > 0.8
    assert quality.confidence is not None
    given = labelled(label_animal(**animal(1).arguments(template=True)))
    assert given.quality.body == "given"


def test_the_camera_is_the_fits() -> None:
    one = animal(2)
    asked = {name: value for name, value in arguments(one).items() if name != "body"}
    fit = fit_animal(**asked)
    assert isinstance(fit, FittedBody)
    label = labelled(label_animal(**arguments(one)))
    assert np.array_equal(label.R.numpy(), fit.R)
    assert np.array_equal(label.t.numpy(), fit.t)


def test_exchanged_keypoints_are_the_labels_the_other_way_round() -> None:
    one = animal(2)
    order = list(exchange_order(one.vocabulary, "all"))
    label = labelled(label_animal(**{**arguments(one), "keypoints_2d": one.keypoints_2d[order]}))
    assert label.quality.labeling == "all"
    assert label.keypoints is not None
    seen = one.keypoints_2d[:, 2] > 0
    assert torch.equal(label.keypoints[seen], one.keypoints_2d[seen])
    assert "exchanged" in label.quality.flags


def test_labels_are_the_same_alone_and_among_others() -> None:
    mixed = [arguments(animal(0)), animal(1).arguments(template=True), arguments(animal(2))]
    few = {**arguments(animal(3)), "keypoints_2d": torch.zeros(26, 3)}
    together = label_many([*mixed, few])
    for one, label in zip(mixed, together, strict=False):
        alone = labelled(label_animal(**one))
        assert np.array_equal(alone.row, labelled(label).row)
    assert isinstance(together[3], Rejection)


def test_an_unknown_focal_length_is_told() -> None:
    quality = labelled(label_animal(**{**arguments(animal(2)), "K": None})).quality
    assert quality.K_source == "estimated"
    assert quality.log_focal_sd is not None
    assert 0 < quality.log_focal_sd <= 0.5


def test_few_keypoints_are_fitted_with_a_warning() -> None:
    one = animal(2)
    keypoints = one.keypoints_2d.clone()
    keypoints[torch.nonzero(keypoints[:, 2])[8:, 0]] = 0.0
    label = labelled(label_animal(**{**arguments(one), "keypoints_2d": keypoints}))
    assert any("8 keypoints" in warning for warning in label.quality.warnings)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"vertices": np.zeros((5, 3))}, "vertices"),
        ({"pose": (np.eye(3), np.zeros(3))}, "pose"),
        ({"distortion": np.zeros(4)}, "distortion"),
        ({"keypoints_2d": None}, "keypoints_2d"),
        ({"body": "found"}, "body"),
    ],
)
def test_what_a_fit_finds_itself_cannot_be_given(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(SampleError, match=words):
        label_animal(**{**arguments(animal(0)), **changes})
