"""The metrics as an object: its states, its intervals, what it refuses, and torchmetrics' form."""

import ast
import importlib
import pickle
import re
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from cuboid_sets import standing_set
from detections import animals, detected
from PIL import Image
from scenes import scene

from animal3dbox.datasets import Omni3DDataset, write_omni3d
from animal3dbox.errors import ConfigError, SampleError
from animal3dbox.geometry import FACE_NAMES
from animal3dbox.training.metrics import BoxMetrics, MetricOptions, TorchBoxMetrics
from animal3dbox.training.metrics.evaluation import Evaluation

HERE, ASIDE = (0.0, 0, 8), (4.0, 0, 8)
Pairs = list[tuple[dict[str, Any], dict[str, Any]]]


def noisy_images(count: int, seed: int = 0) -> Pairs:
    """Predictions and targets of images, some right, some turned, some shifted, some alarms."""
    rng = np.random.default_rng(seed)
    images = []
    for number in range(count):
        target = {**scene(3, seed=100 * seed + number), "scale_known": torch.ones(3)}
        target["labels"] = torch.from_numpy(rng.integers(0, 2, 3))
        which = torch.from_numpy(rng.integers(0, 3, 5))
        turn = torch.from_numpy(np.where(rng.random((5, 1, 1)) < 0.3, [-1.0, -1, 1], 1.0))
        prediction = {
            "center": target["center"][which] + torch.from_numpy(rng.normal(0, 0.1, (5, 3))),
            "rotation": target["rotation"][which] * turn,
            "size": target["size"][which] * torch.from_numpy(rng.uniform(0.8, 1.2, (5, 3))),
            "labels": target["labels"][which],
            "scores": torch.from_numpy(rng.uniform(0, 1, 5)),
        }
        images.append((prediction, target))
    return images


def fed(images: Pairs, batch: int = 4, **options: Any) -> BoxMetrics:
    metrics = BoxMetrics(**{"relative": False, **options})
    for start in range(0, len(images), batch):
        part = images[start : start + batch]
        metrics.update([p for p, _ in part], [t for _, t in part])
    return metrics


def test_the_size_of_batches_changes_nothing() -> None:
    images = noisy_images(9)
    result = fed(images, 1).compute()
    assert 0 < result["ap_3d_h30"] < result["ap_3d"] < 1  # type: ignore[operator]
    assert fed(images, 4).compute() == result == fed(images, 9).compute()


def test_merged_metrics_are_those_of_all_images_in_that_order() -> None:
    images = noisy_images(7)
    first, second = fed(images[:3]), fed(images[3:])
    first.merge(pickle.loads(pickle.dumps(second)))  # as it comes from another process
    assert first.compute() == fed(images).compute()
    first.reset()
    assert first.compute() == BoxMetrics().compute()


def test_metrics_of_other_options_are_not_merged() -> None:
    with pytest.raises(ConfigError, match="other options cannot be merged"):
        BoxMetrics(metric=True).merge(BoxMetrics())
    BoxMetrics(classes=["cat", "dog"]).merge(BoxMetrics(classes=("cat", "dog")))


def test_without_images_and_without_truths_all_is_unknown_and_nothing_is_negative() -> None:
    alarms = fed([(detected(animals(HERE), 0.9), animals())], relative=True)
    for metrics, counts in ((BoxMetrics(relative=True), 0), (alarms, 1)):
        result = metrics.compute()
        assert (result["images"], result["predictions"], result["truths"]) == (counts, counts, 0)
        known = {name for name, value in result.items() if value is not None}
        assert known == {
            *("images", "truths", "predictions", "degenerate_predictions"),
            *("pairs", "heading_count", "flank_count"),
        }


def test_nothing_found_is_an_ap_of_0_and_errors_unknown() -> None:
    result = fed([(detected(animals()), animals(HERE))]).compute()
    assert (result["ap_3d"], result["ap_3d_h30"], result["ap_3d_near"]) == (0.0, 0.0, 0.0)
    assert result["heading_error_deg"] is result["nhd"] is result["face_f1"] is None


def test_an_image_taken_twice_by_weight_counts_as_one_given_twice() -> None:
    images = noisy_images(8)
    weights = np.array([[1, 2, 0, 3, 1, 0, 0, 1]])
    repeated = [image for image, n in zip(images, weights[0], strict=True) for _ in range(n)]
    expected = fed(repeated, relative=False, resamples=0).compute()
    metrics = fed(images)
    evaluation = Evaluation(metrics._candidates(), metrics.options)
    for statistic in evaluation.statistics():
        for name, value in statistic(weights).items():
            if expected[name] is None:
                assert np.isnan(value[0]), name
            else:
                assert value[0] == pytest.approx(expected[name], abs=1e-12), name


def test_intervals_hold_the_value_and_shrink_with_the_number_of_images() -> None:
    widths = []
    for count in (8, 72):
        result = fed(noisy_images(count)).compute()
        for name in ("ap_3d", "ap_3d_h45", "heading_error_deg", "face_f1", "nhd"):
            assert result[f"{name}_low"] <= result[name] <= result[f"{name}_high"]  # type: ignore[operator]
        widths.append(result["flip_rate_high"] - result["flip_rate_low"])  # type: ignore[operator]
    assert 0 < widths[1] < 0.6 * widths[0]  # a third for nine times as many


def test_the_interval_of_a_mean_is_that_of_its_standard_error() -> None:
    rng = np.random.default_rng(0)
    errors = rng.normal(0, 0.02, 400)
    target = animals(HERE)
    images = [(detected(target, 0.9, center=target["center"] * (1 + e)), target) for e in errors]
    result = fed(images, resamples=1000).compute()
    half = 1.96 * np.abs(errors).std() / np.sqrt(400)
    assert result["distance_error"] == pytest.approx(np.abs(errors).mean())
    width = result["distance_error_high"] - result["distance_error_low"]  # type: ignore[operator]
    assert width == pytest.approx(2 * half, rel=0.08)  # of 90 % it would be 16 % less
    middle = result["distance_error_high"] + result["distance_error_low"]  # type: ignore[operator]
    assert middle / 2 == pytest.approx(np.abs(errors).mean(), abs=0.2 * half)


def test_intervals_are_left_out_if_none_are_asked_for_and_unknown_of_one_image() -> None:
    assert not any(name.endswith("_low") for name in fed(noisy_images(3), resamples=0).compute())
    one_image = fed(noisy_images(1)).compute()
    assert one_image["ap_3d"] is not None
    assert one_image["ap_3d_low"] is one_image["ap_3d_high"] is None
    assert all(f"{name}_high" in one_image for name in one_image if f"{name}_low" in one_image)


def test_named_classes_have_their_keys_whether_or_not_a_truth_is_there() -> None:
    names = ("cat", "dog", "okapi")
    result = fed(noisy_images(3), classes=names).compute()
    assert [f"ap_3d_class_{name}" in result for name in names] == [True] * 3
    assert result["ap_3d_class_okapi"] is result["ap_3d_class_okapi_low"] is None


def test_a_dataset_of_boxes_without_a_front_has_no_headings_to_be_measured(tmp_path: Path) -> None:
    boxes = standing_set()
    for record in boxes.records:
        Image.fromarray(np.zeros((*record.image_hw, 3), np.uint8)).save(tmp_path / record.image_id)
    write_omni3d(boxes, tmp_path / "boxes.json")
    for heading_known in (True, False):
        dataset = Omni3DDataset(tmp_path / "boxes.json", heading_known=heading_known)
        samples = [dataset[index] for index in range(len(dataset))]
        targets = [sample[1] for sample in samples if isinstance(sample, tuple)]
        images = [(detected(target, *[0.9] * len(target["center"])), target) for target in targets]
        result = fed(images).compute()
        assert (result["ap_3d"], result["truths"], result["pairs"]) == (1.0, 4, 4)
        headings = (result["ap_3d_h30"], result["heading_count"])
        assert headings == ((1.0, 4) if heading_known else (None, 0))


WRONG: dict[str, tuple[dict[str, Any], dict[str, Any], str]] = {
    "no scores": ({"scores": None}, {}, "a.jpg: prediction scores: is missing"),
    "NaN score": ({"scores": [0.5, np.nan]}, {}, r"a.jpg#1: prediction scores: must be finite"),
    "a score too few": ({"scores": [0.5]}, {}, r"prediction scores: must have shape \(2\), got"),
    "no labels": ({"labels": None}, {}, "prediction labels: is missing, and the target has"),
    "broken labels": ({"labels": [0, 0.5]}, {}, "a.jpg#1: prediction labels: must be whole"),
    "vectors": ({"rotation": torch.zeros(2, 3)}, {}, r"prediction rotation: must have shape \(2, "),
    "corners": (
        {"center": None, "corners_3d": torch.zeros(2, 8, 3)},
        {},
        "prediction center: is missing; animal3dbox.geometry.corners_to_cuboid gives",
    ),
    "logits": (
        {"face_visible": torch.tensor([[0.0] * 6, [0, 3, 0, 0, -2, 0]])},
        {},
        r"a.jpg#1: prediction face_visible: must be flags or probabilities.*torch.sigmoid",
    ),
    "words": ({"scores": ["a", "b"]}, {}, "prediction scores: must be a tensor or an array"),
    "a true box without volume": (
        {},
        {"size": torch.tensor([[2.0, 1, 1], [2, 0, 1]])},
        "a.jpg#1: target center, rotation or size: is no box",
    ),
    "x, y, w, h": (
        {"boxes": torch.tensor([[0.0, 0, 9, 9], [50, 60, 20, 30]])},
        {},
        "a.jpg#1: prediction boxes: must be x0, y0, x1, y1 .*not a width and a height",
    ),
    "true x, y, w, h": (
        {},
        {"boxes": torch.tensor([[50.0, 60, 20, 30], [0, 0, 9, 9]])},
        "a.jpg#0: target boxes: must be x0, y0, x1, y1",
    ),
    "areas for shares": (
        {"face_share": torch.tensor([[1.0, 0, 0, 0, 0, 0], [1] * 6])},
        {},
        "a.jpg#1: prediction face_share: must be parts of the visible area",
    ),
    "a third flank": (
        {"flank": torch.tensor([1, 5])},
        {},
        "a.jpg#1: prediction flank: must be 0 undecided, 1 left or 2 right",
    ),
    "flags for classes": (
        {"labels": torch.tensor([True, False])},
        {},
        "prediction labels: must be the classes' numbers, got flags",
    ),
    "a camera of a lens": ({"K": torch.zeros(1, 3, 3)}, {}, r"camera K: must have shape \(3, 3\)"),
    "a target without boxes": ({}, {"rotation": None}, "a.jpg: target rotation: is missing"),
}


@pytest.mark.parametrize("kind", WRONG)
def test_what_is_wrong_is_named_by_image_animal_and_field_and_adds_nothing(kind: str) -> None:
    in_prediction, in_target, message = WRONG[kind]
    target = {**animals(HERE, ASIDE), "image_id": "a.jpg"}
    prediction = {**detected(target, 0.9, 0.8), **in_prediction}
    good = (detected(animals(HERE), 0.9), animals(HERE))
    bad = (
        {name: value for name, value in prediction.items() if value is not None},
        {name: value for name, value in {**target, **in_target}.items() if value is not None},
    )
    metrics = BoxMetrics()
    with pytest.raises(SampleError, match=message):
        metrics.update([good[0], bad[0]], [good[1], bad[1]])
    assert metrics.compute()["images"] == 0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"pair_by": "iou"}, "pair_by must be iou_3d or boxes"),
        ({"pair_iou": 0.0}, r"pair_iou must lie in \(0, 1\]"),
        ({"classes": "cat"}, "classes must be a list of names"),
        ({"classes": ["cat", "cat"]}, "classes must be names that differ"),
        ({"resamples": -1}, "resamples and seed not negative"),
        ({"max_detections": 0}, "max_detections must be at least 1"),
        ({"metrics": True}, "options of BoxMetrics are classes, .*metrics"),
    ],
    ids=str,
)
def test_an_option_that_cannot_be_is_refused(options: dict[str, Any], message: str) -> None:
    for kind in (BoxMetrics, TorchBoxMetrics):
        with pytest.raises(ConfigError, match=message):
            kind(**options)


def test_batches_that_are_no_batches_are_refused() -> None:
    target = animals(HERE)
    with pytest.raises(ConfigError, match="1 predictions for 2 targets"):
        BoxMetrics().update([detected(target, 0.9)], [target, target])
    with pytest.raises(ConfigError, match="targets must be a list of dicts"):
        BoxMetrics().update([detected(target, 0.9)], target)  # type: ignore[arg-type]


def torch_fed(images: Pairs, **options: Any) -> TorchBoxMetrics:
    metric = TorchBoxMetrics(**{"relative": False, **options})
    for prediction, target in images:
        metric.update([prediction], [target])
    return metric


def test_torchmetrics_form_gives_the_same_dict_and_forgets_on_reset() -> None:
    images = noisy_images(5)
    metric = torch_fed(images, classes=["cat", "dog"])
    expected = fed(images, classes=["cat", "dog"]).compute()
    assert metric.compute() == expected
    assert pickle.loads(pickle.dumps(metric)).compute() == expected
    metric.reset()
    metric.update([images[0][0]], [images[0][1]])
    assert metric.compute()["images"] == 1


def test_without_torchmetrics_the_error_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "torchmetrics", None)
    monkeypatch.delitem(sys.modules, TorchBoxMetrics.__module__)
    with pytest.raises(ConfigError, match=r"pip install 'animal3dbox\[metrics\]'"):
        importlib.import_module(TorchBoxMetrics.__module__)


def test_torchmetrics_form_is_synchronised_over_processes() -> None:
    images = noisy_images(7)
    ranks = [torch_fed(images[:3]), torch_fed(images[3:])]
    gathered = {
        name: [torch.cat(getattr(rank, name)) for rank in ranks]
        for name in ("image_counts", "prediction_rows", "truth_rows")
    }
    order = iter(gathered.values())
    ranks[0].sync(dist_sync_fn=lambda *_, **__: next(order), distributed_available=lambda: True)
    ranks[0]._should_unsync = False
    ranks[0]._to_sync = False
    assert ranks[0].compute() == fed(images).compute()


def test_every_key_is_in_the_docs_and_every_key_of_the_docs_is_computed() -> None:
    page = (Path(__file__).parents[3] / "docs" / "metrics.md").read_text()
    rows = re.findall(r"^\| ((?:`\w+`(?:, )?)+) \|", page.split("## Average precision")[1], re.M)
    documented = {name for row in rows for name in re.findall(r"`(\w+)`", row)}
    for pattern, names in (("FACE", FACE_NAMES), ("NAME", ("0", "1"))):
        for name in [name for name in documented if name.endswith(pattern)]:
            documented |= {name.replace(pattern, one) for one in names}
            documented.remove(name)
    result = fed(noisy_images(6), relative=True).compute()
    assert documented == {name for name in result if not name.endswith(("_low", "_high"))}
    counts = {"images", "truths", "predictions", "degenerate_predictions", "pairs", "rel_scale"}
    counts |= {"heading_count", "flank_count"}
    assert {name for name in result if f"{name}_low" in result} == documented - counts


def test_every_option_is_in_the_docs_with_its_default() -> None:
    page = (Path(__file__).parents[3] / "docs" / "metrics.md").read_text()
    rows = re.findall(r"^\| `(\w+)` \| ([^|]+) \| ", page, re.M)
    told = {name: ast.literal_eval(default) for name, default in rows}
    assert told == asdict(MetricOptions())
