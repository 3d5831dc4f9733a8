"""Many labels at once."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch

from animal3dbox import CuboidLabel, LabelConfig, Rejection, label_animal, label_many
from animal3dbox.datasets.bodies.sources import ParametersBody
from animal3dbox.datasets.synthetic.synthetic_set import SyntheticSet
from animal3dbox.errors import SampleError
from animal3dbox.smal.parameters import posed_bodies

SET = SyntheticSet(5, 8)
STILL = np.eye(3), np.zeros(3)
TENSORS = (
    "corners_3d", "center", "rotation", "size", "corners_2d", "corner_in_front", "face_visible",
    "face_area", "face_share",
    "face_share_in_image", "K", "R", "t", "box", "keypoints",
)  # fmt: skip


def arguments() -> list[dict[str, Any]]:
    """Every animal of a small world, posed many at once."""
    records, bodies = SET.records().records, SET.bodies()
    vertices = posed_bodies(
        bodies.model, [bodies.parameters[record.sample_id] for record in records]
    ).vertices
    return [
        {
            "image_hw": record.image_hw, "keypoints_2d": record.keypoints_2d, "vertices": body,
            "faces": bodies.model.faces, "template": bodies.model,
            "K": np.array(record.K), "pose": STILL, "vocabulary": record.vocabulary,
            "sample_id": record.sample_id,
        }
        for record, body in zip(records, vertices, strict=True)
    ]  # fmt: skip


@pytest.mark.parametrize(
    "config", [LabelConfig(), LabelConfig(surface_share=False, mask_iou=False)]
)
def test_many_labels_are_those_of_one_by_one_to_the_last_bit(config: LabelConfig) -> None:
    animals = arguments()
    animals[1] |= {"image_hw": (500, 700)}
    animals[2] |= {"distortion": [-0.1, 0.02, 0.001, 0.0]}
    animals[3] |= {"distortion": [-3.0, 0.0, 0.0, 0.0]}  # shows next to nothing
    animals[4] |= {"pose": None, "keypoints_2d": None}
    animals[5] |= {
        "vertices": animals[5]["vertices"] * torch.tensor([1.0, -1, 1])
    }  # mirrored, as no rotation makes it
    many = label_many(animals, config)
    assert [type(one) for one in many[:6]] == [
        CuboidLabel,
        CuboidLabel,
        CuboidLabel,
        Rejection,
        Rejection,
        CuboidLabel,
    ]
    for animal, label in zip(animals, many, strict=True):
        alone = label_animal(**animal, config=config)
        if isinstance(alone, Rejection):
            assert label == alone
            continue
        assert isinstance(label, CuboidLabel)
        assert (label.quality, label.truncation, label.behind_camera) == (
            alone.quality,
            alone.truncation,
            alone.behind_camera,
        )
        for name in TENSORS:
            assert torch.equal(getattr(label, name), getattr(alone, name)), name


def test_a_wrong_argument_of_one_animal_is_an_error_that_names_it() -> None:
    animals = arguments()[:2]
    animals[1]["K"] = np.eye(4)
    with pytest.raises(SampleError) as caught:
        label_many(animals)
    assert (caught.value.sample_id, caught.value.field) == (animals[1]["sample_id"], "K")


def test_no_animals_give_no_labels() -> None:
    assert label_many([]) == []


def test_labels_of_a_batch_do_not_share_memory() -> None:
    first, second = label_many(arguments()[:2])
    assert isinstance(first, CuboidLabel)
    assert isinstance(second, CuboidLabel)
    assert first.corners_3d.untyped_storage().nbytes() == 8 * 3 * 8
    assert first.K.data_ptr() != second.K.data_ptr()


def test_a_label_keeps_nothing_of_its_arguments_memory() -> None:
    animal = arguments()[0]
    before = animal["vertices"].clone()
    label = label_animal(**animal)
    assert isinstance(label, CuboidLabel)
    corners, K = label.corners_3d.clone(), label.K.clone()
    assert torch.equal(animal["vertices"], before)
    animal["K"][:] = 0
    animal["vertices"][:] = 0
    assert torch.equal(label.K, K)
    assert torch.equal(label.corners_3d, corners)


@pytest.mark.parametrize("away", [0.0, 1000.0])
def test_vertices_in_float32_move_a_far_box_by_less_than_a_millionth_of_it(
    away: float,
) -> None:
    bodies = SET.bodies()
    there = {
        name: replace(one, trans=one.trans + torch.tensor([0.0, 0.0, away]))
        for name, one in bodies.parameters.items()
    }
    quick, exact = (
        ParametersBody(bodies.model, there),
        ParametersBody(bodies.model, there, torch.float64),
    )
    assert quick.fingerprint != exact.fingerprint
    for record in SET.records().records:
        one, other = (
            label_animal(
                record.image_hw,
                vertices=body.vertices,
                template=body.template,
                K=record.K,
                pose=STILL,
            )
            for body in (exact.body(record), quick.body(record))
        )
        assert isinstance(one, CuboidLabel)
        assert isinstance(other, CuboidLabel)
        assert (
            0
            < float((one.corners_3d - other.corners_3d).abs().amax())
            < 1e-6 * float(one.size.norm())
        )
