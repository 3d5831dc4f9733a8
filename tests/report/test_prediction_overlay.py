"""Detections beside labels in one picture."""

import math
from typing import Any

import cv2
import numpy as np
import pytest
import torch
from detections import F64, animals, detected, turned

from animal3dbox.errors import SampleError, ShapeError
from animal3dbox.geometry import EDGES, Cuboid, project
from animal3dbox.report import draw_cuboid, draw_predictions
from animal3dbox.report.cuboid_pen import BACK

HW = (480, 640)
IMAGE = torch.full((3, *HW), 120, dtype=torch.uint8)
HERE = (0.0, 0, 6)


def target(degrees: float = -50.0) -> dict[str, Any]:
    fields = animals(HERE, degrees=degrees)
    fields["K"] = torch.tensor([[500.0, 0, 319.5], [0, 500, 239.5], [0, 0, 1]], dtype=F64)
    return fields


def drawn(prediction: dict[str, Any], truth: dict[str, Any], **options: Any) -> np.ndarray:
    return draw_predictions(IMAGE, truth, prediction, **options)[: HW[0]]


def changed(picture: np.ndarray, least: int = 1) -> np.ndarray:
    return np.asarray((np.abs(picture.astype(int) - 120) >= least).any(-1))


def pixels_of(picture: np.ndarray, color: tuple[int, int, int]) -> int:
    return int((np.abs(picture.astype(int) - color).max(-1) <= 2).sum())


def test_a_detection_is_dashed_along_the_lines_of_the_same_cuboid_drawn_solid() -> None:
    truth, nothing = target(), animals()
    box = Cuboid(truth["center"][0], truth["rotation"][0], truth["size"][0])
    solid, dashed = np.full((2, *HW, 3), 120, dtype=np.uint8)
    draw_cuboid(solid, box, truth["K"])
    draw_cuboid(dashed, box, truth["K"], dashed=True)
    within_a_pixel = cv2.dilate(changed(solid).astype(np.uint8), np.ones((3, 3))) > 0
    assert not (changed(dashed) & ~within_a_pixel).any()  # no line elsewhere
    px, _ = project(truth["K"], box.corners())
    for start, end in EDGES:
        along = torch.linspace(0, 1, 200)[:, None] * (px[end] - px[start]) + px[start]
        u, v = along.round().int().T.numpy()
        assert 0.4 < changed(dashed, least=30)[v, u].mean() < 0.9  # dashes and gaps
        assert changed(solid)[v, u].all()
    only = drawn(detected(truth, 0.9), {**nothing, "K": truth["K"]})
    assert np.array_equal(only, dashed)


def test_a_dashed_cuboid_leaves_its_faces_as_they_were() -> None:
    truth = target()
    (middle,), _ = project(truth["K"], truth["center"] + truth["rotation"][:, :, 0])  # of the front
    u, v = middle.round().int().tolist()
    empty = {**animals(), "K": truth["K"]}
    assert not changed(drawn(detected(truth, 0.9), empty))[v - 5 : v + 5, u - 5 : u + 5].any()
    assert changed(drawn(detected(empty), truth))[v - 5 : v + 5, u - 5 : u + 5].all()


def test_a_detection_that_looks_the_other_way_shows_blue_beside_the_green() -> None:
    truth = target()
    right, wrong = (detected(truth, 0.9, rotation=turned(d)[None]) for d in (-50, 130))
    assert pixels_of(drawn(right, truth), BACK) == 0
    assert pixels_of(drawn(wrong, truth), BACK) > 100


def test_low_scores_and_boxes_that_are_none_are_left_out_and_counted() -> None:
    truth = target()
    without = drawn(detected({**animals(), "K": truth["K"]}), truth)
    aside = detected(truth, 0.2, center=truth["center"] + 1)
    assert np.array_equal(drawn(aside, truth), without)
    assert not np.array_equal(drawn(aside, truth, least_score=0.1), without)
    broken = detected(truth, 0.9, size=truth["size"] * math.nan)
    assert np.array_equal(drawn(broken, truth), without)
    words = draw_predictions(IMAGE, truth, broken)[HW[0] :]
    assert not np.array_equal(words, draw_predictions(IMAGE, truth, detected(truth, 0.9))[HW[0] :])


def test_a_box_behind_and_around_the_camera_is_drawn_without_an_error() -> None:
    truth = target()
    for center in ((0.0, 0, -6), (0.0, 0, 0.1), (1e5, 0, 1)):
        prediction = detected(truth, 0.9, center=torch.tensor([center], dtype=F64))
        assert drawn(prediction, truth).shape == (*HW, 3)


def test_the_picture_stays_as_it_was_and_a_wrong_one_or_field_is_named() -> None:
    truth = {**target(), "image_id": "a.jpg"}
    draw_predictions(IMAGE, truth, detected(truth, 0.9))
    assert (IMAGE == 120).all()
    with pytest.raises(ShapeError, match="image must be uint8"):
        draw_predictions(IMAGE.float(), truth, detected(truth, 0.9))
    with pytest.raises(SampleError, match=r"a\.jpg: prediction scores: is missing"):
        draw_predictions(IMAGE, truth, truth)
    no_camera = {name: value for name, value in truth.items() if name != "K"}
    with pytest.raises(SampleError, match=r"a\.jpg: target K: is missing"):
        draw_predictions(IMAGE, no_camera, detected(truth, 0.9))
    with pytest.raises(SampleError, match=r"a\.jpg: prediction size: size must have shape"):
        draw_predictions(IMAGE, truth, detected(truth, 0.9, size=torch.ones(3)))
