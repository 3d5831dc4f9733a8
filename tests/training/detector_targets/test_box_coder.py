"""Encoded targets by hand, and the laws that decoding is the inverse of encoding."""

import math
from dataclasses import replace
from typing import Any

import pytest
import torch
from detections import F64
from hypothesis import given
from scenes import scene, scenes, target_of
from thorough import thorough
from torch.testing import assert_close

from animal3dbox.errors import ConfigError, SampleError, ShapeError
from animal3dbox.geometry import Cuboid
from animal3dbox.training.detector_targets import BoxCoder, class_sizes
from animal3dbox.training.detector_targets.box_coder import RotationFrame
from animal3dbox.training.metrics import BoxMetrics

SIZES = torch.tensor([[1.0, 0.5, 0.6], [2.0, 0.7, 1.5], [0.4, 0.2, 0.3]], dtype=F64)
CODERS = [
    BoxCoder(rotation=rotation, virtual_focal_px=focal, class_sizes=sizes)
    for rotation in ("allocentric", "egocentric")
    for focal, sizes in ((None, None), (512.0, SIZES))
]


def decoded(coder: BoxCoder, target: dict[str, Any]) -> dict[str, Any]:
    return coder.decode(
        coder.encode(target),
        boxes=target["boxes"],
        K=target["K"],
        labels=target["labels"],
        distortion=target.get("distortion"),
    )


@pytest.mark.parametrize("coder", CODERS, ids=str)
@thorough(60)
@given(scenes())
def test_what_is_encoded_is_decoded_again(coder: BoxCoder, scene: Any) -> None:
    target, _ = scene
    assert coder.encode(target)["encodable"].all()
    back = decoded(coder, target)
    for name in ("center", "rotation", "size"):
        assert_close(back[name], target[name], atol=1e-10, rtol=1e-9)
    assert_close(back["face_visible"], target["face_visible"].to(F64))
    assert back["labels"].tolist() == target["labels"].tolist()


@pytest.mark.parametrize("coder", CODERS, ids=str)
def test_what_is_decoded_is_encoded_again(coder: BoxCoder) -> None:
    rng = torch.Generator().manual_seed(0)
    target = scene(3)
    encoded = coder.encode(target)
    for name in ("center_offset", "log_depth", "log_size"):
        encoded[name] = encoded[name] + 0.3 * torch.randn(
            encoded[name].shape, generator=rng, dtype=F64
        )
    boxes = coder.decode(encoded, boxes=target["boxes"], K=target["K"], labels=target["labels"])
    again = coder.encode({**target, **boxes})
    for name, value in encoded.items():
        assert_close(again[name], value, atol=1e-10, rtol=1e-9)


def test_a_lens_is_gone_through_in_both_directions() -> None:
    plain = scene(3)
    box = Cuboid(plain["center"], plain["rotation"], plain["size"])
    lens = torch.tensor([-0.2, 0.05, 0.001, -0.002], dtype=F64)
    target = target_of(box, plain["K"], (120, 160), distortion=lens)
    assert_close(decoded(BoxCoder(), target)["center"], target["center"], atol=1e-8, rtol=0)
    no_lens = BoxCoder().decode(
        BoxCoder().encode(target), boxes=target["boxes"], K=target["K"], labels=target["labels"]
    )
    assert float((no_lens["center"] - target["center"]).abs().max()) > 1e-3


def test_the_numbers_are_those_of_the_formulas() -> None:
    target = {
        "center": torch.tensor([[1.0, -2.0, 10.0]], dtype=F64),
        "rotation": torch.eye(3, dtype=F64)[None],
        "size": torch.tensor([[3.0, 1.0, 1.0]], dtype=F64),
        "boxes": torch.tensor([[40.0, 20.0, 80.0, 40.0]], dtype=F64),
        "K": torch.tensor([[200.0, 0, 50], [0, 100, 50], [0, 0, 1]], dtype=F64),
        "labels": torch.tensor([1]),
    }
    coder = BoxCoder(rotation="egocentric", virtual_focal_px=500.0, class_sizes=SIZES)
    encoded = coder.encode(target)
    # u = 200 / 10 + 50 = 70, v = -200 / 10 + 50 = 30; the box's centre is (60, 30)
    assert encoded["center_offset"].tolist() == [[10 / 40, 0.0]]
    assert encoded["log_depth"].item() == pytest.approx(math.log(10 * 500 / 100))
    assert encoded["log_size"][0].tolist() == pytest.approx(
        [math.log(3 / 2), math.log(1 / 0.7), math.log(1 / 1.5)]
    )
    assert encoded["rotation_6d"].tolist() == [[1.0, 0, 0, 0, 1, 0]]
    assert "face_visible" not in encoded


def test_virtual_depth_does_not_change_when_the_picture_and_its_camera_are_enlarged() -> None:
    target = scene(2)
    larger = target["K"] * torch.tensor([[2.0], [2], [1]], dtype=F64)
    virtual, plain = BoxCoder(virtual_focal_px=100.0), BoxCoder()
    # twice the focal length at twice the distance: the animal looks as large
    there = {**target, "center": target["center"] * 2, "K": larger}
    assert_close(virtual.encode(there)["log_depth"], virtual.encode(target)["log_depth"])
    assert_close(plain.encode(there)["log_depth"], plain.encode(target)["log_depth"] + math.log(2))


def test_what_cannot_be_encoded_is_flagged_and_has_no_nan_even_in_derivatives() -> None:
    target = scene(4)
    target["center"][0, 2] = -1.0
    target["boxes"][1] = target["boxes"][1][[0, 1, 0, 1]]
    target["center"][2] = 0.0
    target["center"].requires_grad_(True)
    target["boxes"].requires_grad_(True)
    encoded = BoxCoder().encode(target)
    assert encoded["encodable"].tolist() == [False, False, False, True]
    for name, value in encoded.items():
        if name != "encodable":
            assert not value[:3].any(), name
            assert value[3].isfinite().all(), name
    sum(v.sum() for k, v in encoded.items() if k != "encodable").backward()  # type: ignore[union-attr]
    for name in ("center", "boxes"):
        assert target[name].grad.isfinite().all()
        assert not target[name].grad[:3].any()
        assert target[name].grad[3].any()


def test_float32_targets_stay_float32_and_come_back_within_its_rounding() -> None:
    target = scene(3, dtype=torch.float32)
    coder = BoxCoder(class_sizes=SIZES, virtual_focal_px=300.0)
    back = decoded(coder, target)
    assert {value.dtype for name, value in back.items() if name != "labels"} == {torch.float32}
    assert_close(back["center"], target["center"], atol=1e-5, rtol=0)


def test_an_image_without_animals_is_encoded_and_decoded() -> None:
    target = scene(0)
    for coder in CODERS:
        assert decoded(coder, target)["rotation"].shape == (0, 3, 3)


def test_derivatives_of_decoding_are_right() -> None:
    target = scene(2)
    encoded = BoxCoder(virtual_focal_px=300.0).encode(target)
    names = ("center_offset", "log_depth", "log_size", "rotation_6d")

    def decode(*values: torch.Tensor) -> tuple[torch.Tensor, ...]:
        boxes = BoxCoder(virtual_focal_px=300.0).decode(
            dict(zip(names, values, strict=True)), boxes=target["boxes"], K=target["K"]
        )
        return boxes["center"], boxes["rotation"], boxes["size"]

    inputs = tuple(encoded[name].requires_grad_(True) for name in names)
    assert torch.autograd.gradcheck(decode, inputs)


def test_decoded_targets_as_predictions_have_an_ap_of_1() -> None:
    targets = [scene(3, seed=n) for n in range(5)]
    metrics = BoxMetrics(resamples=0)
    for target in targets:
        metrics.update([{**decoded(CODERS[1], target), "scores": torch.ones(3)}], [target])
    result = metrics.compute()
    assert (result["ap_3d"], result["ap_3d_h30"], result["face_f1"]) == (1.0, 1.0, 1.0)
    assert result["corner_error"] == pytest.approx(0, abs=1e-9)


def test_class_sizes_are_geometric_means() -> None:
    targets = [
        {"size": torch.tensor([[1.0, 2, 3], [1, 1, 1]]), "labels": torch.tensor([0, 1])},
        {"size": torch.tensor([[4.0, 8, 3]]), "labels": torch.tensor([0])},
    ]
    assert_close(class_sizes(targets, 2), torch.tensor([[2.0, 4, 3], [1, 1, 1]], dtype=F64))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"boxes": None}, "a.jpg: boxes: is missing, and encode needs it"),
        ({"rotation": torch.zeros(3, 3)}, "a.jpg: rotation: rotation must have shape"),
        ({"size": torch.ones(3, 3)}, "a.jpg: size: has 3 animals, center 2"),
        ({"labels": None}, "a.jpg: labels: is missing, and class_sizes need it"),
        ({"labels": torch.tensor([0, 3])}, "a.jpg#1: labels: is 3, and class_sizes has the cl"),
    ],
)
def test_a_wrong_field_is_named(changes: dict[str, Any], message: str) -> None:
    target = {**scene(2), "image_id": "a.jpg", **changes}
    target = {name: value for name, value in target.items() if value is not None}
    with pytest.raises(SampleError, match=message):
        BoxCoder(class_sizes=SIZES).encode(target)


def test_numbers_of_a_wrong_shape_are_named() -> None:
    target = scene(2)
    encoded = {**BoxCoder().encode(target), "log_depth": torch.zeros(2, 1)}
    with pytest.raises(ShapeError, match=r"log_depth must have shape \(2,\), got \(2, 1\)"):
        BoxCoder().decode(encoded, boxes=target["boxes"], K=target["K"])


def test_options_that_cannot_be_are_refused() -> None:
    wrong: RotationFrame = "world"  # type: ignore[assignment]
    with pytest.raises(ConfigError, match="rotation must be allocentric or egocentric"):
        BoxCoder(rotation=wrong)
    with pytest.raises(ConfigError, match="virtual_focal_px must be positive"):
        BoxCoder(virtual_focal_px=0.0)
    with pytest.raises(ConfigError, match="class_sizes must be"):
        replace(BoxCoder(), class_sizes=torch.zeros(2, 3))


def test_sizes_of_two_units_and_classes_without_animals_are_refused() -> None:
    mixed = {
        "size": torch.ones(2, 3),
        "labels": torch.zeros(2, dtype=torch.int64),
        "scale_known": torch.tensor([True, False]),
    }
    with pytest.raises(ConfigError, match="some animals' lengths are metres"):
        class_sizes([mixed], 1)
    metric = {**mixed, "scale_known": torch.tensor([True, True])}
    with pytest.raises(ConfigError, match=r"no animal of the classes \[1\]"):
        class_sizes([metric], 2)
    with pytest.raises(SampleError, match="target#0: labels: is 5"):
        class_sizes([{**metric, "labels": torch.tensor([5, 0])}], 2)
