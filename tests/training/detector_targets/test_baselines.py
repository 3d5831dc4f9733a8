"""Detectors that see no pixels: what they learn, and that BoxMetrics takes their answers."""

from typing import Any

import pytest
import torch
from detections import F64, animals, turned
from scenes import scene
from torch.testing import assert_close

from animal3dbox.errors import ConfigError, SampleError
from animal3dbox.training.detector_targets import (
    BoxCoder,
    ConstantBaseline,
    NearestNeighbourBaseline,
)
from animal3dbox.training.metrics import BoxMetrics

CODER = BoxCoder()


def ahead(depth: float, side_px: float, degrees: float, label: int = 0) -> dict[str, Any]:
    """A target of one animal straight ahead, in a square 2D box of a side."""
    target = animals((0.0, 0, depth), size=(depth, 1, 1), degrees=degrees)
    half = side_px / 2
    box = [79.5 - half, 59.5 - half, 79.5 + half, 59.5 + half]
    target["boxes"] = torch.tensor([box], dtype=F64)
    target["labels"] = torch.tensor([label])
    return target


def test_the_constant_is_the_mean_of_depths_sizes_and_rotations_of_a_class() -> None:
    training = [ahead(2, 40, 10), ahead(8, 10, 50), ahead(30, 10, 180, label=1)]
    prediction = ConstantBaseline.fit(CODER, training).predict(ahead(100, 77, 0))
    assert_close(prediction["center"], torch.tensor([[0.0, 0, 4]], dtype=F64))
    assert_close(prediction["size"], torch.tensor([[4.0, 1, 1]], dtype=F64))
    assert_close(prediction["rotation"][0], turned(30), atol=1e-12, rtol=0)
    assert prediction["scores"].tolist() == [1.0]


def test_the_nearest_neighbour_is_the_animal_of_the_class_whose_box_is_most_alike() -> None:
    training = [ahead(2, 40, 10), ahead(8, 10, 50), ahead(30, 12, 180, label=1)]
    baseline = NearestNeighbourBaseline.fit(CODER, training)
    prediction = baseline.predict(ahead(100, 12, 0))
    assert_close(prediction["size"], torch.tensor([[8.0, 1, 1]], dtype=F64))
    assert_close(prediction["rotation"][0], turned(50), atol=1e-12, rtol=0)
    exact = baseline.predict(ahead(100, 10, 0))
    assert exact["scores"].item() == pytest.approx(1.0, abs=1e-6)
    assert 0 < float(prediction["scores"]) < float(exact["scores"])


def test_features_of_ones_own_choose_the_neighbour() -> None:
    training = [{**ahead(2, 40, 10), "code": 5.0}, {**ahead(8, 10, 50), "code": 1.0}]
    baseline = NearestNeighbourBaseline.fit(
        CODER, training, lambda target: torch.tensor([[target["code"]]])
    )
    prediction = baseline.predict({**ahead(100, 10, 0), "code": 4.0})
    assert_close(prediction["size"], torch.tensor([[2.0, 1, 1]], dtype=F64))


def test_a_training_set_is_found_again_by_its_nearest_neighbours() -> None:
    targets = [scene(3, seed=n) for n in range(6)] + [scene(0)]
    baseline = NearestNeighbourBaseline.fit(BoxCoder(virtual_focal_px=200.0), targets)
    constant = ConstantBaseline.fit(BoxCoder(virtual_focal_px=200.0), targets)
    results = []
    for detector in (baseline, constant):
        metrics = BoxMetrics(resamples=0)
        metrics.update([detector.predict(target) for target in targets], targets)
        results.append(metrics.compute())
    assert (results[0]["ap_3d"], results[0]["ap_3d_h30"]) == (1.0, 1.0)
    assert results[0]["corner_error"] == pytest.approx(0, abs=1e-6)
    assert results[1]["ap_3d"] < 0.5  # type: ignore[operator]


def test_animals_that_cannot_be_encoded_are_not_learned_from() -> None:
    behind = ahead(8, 10, 50)
    behind["center"] = -behind["center"]
    for kind in (ConstantBaseline, NearestNeighbourBaseline):
        with pytest.raises(ConfigError, match="there is no animal to learn from"):
            kind.fit(CODER, [behind])
        prediction = kind.fit(CODER, [behind, ahead(2, 40, 10)]).predict(ahead(100, 10, 0))
        assert_close(prediction["size"], torch.tensor([[2.0, 1, 1]], dtype=F64))


def test_a_class_that_was_not_learned_is_an_error_that_names_the_animal() -> None:
    for kind in (ConstantBaseline, NearestNeighbourBaseline):
        detector = kind.fit(CODER, [ahead(2, 40, 10)])
        with pytest.raises(SampleError, match=r"a\.jpg#0: labels: is 7, of which no animal was"):
            detector.predict({**ahead(2, 40, 10, label=7), "image_id": "a.jpg"})
