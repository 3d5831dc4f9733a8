"""The code of docs/metrics.md and docs/detector_targets.md runs as it stands there."""

import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import torch
from scenes import scene

from animal3dbox.datasets import SyntheticDataset
from animal3dbox.training.metrics import BoxMetrics

DOCS = Path(__file__).parents[2] / "docs"


def blocks(page: str) -> list[str]:
    """The blocks of Python of a page, in their order."""
    return re.findall(r"```python\n(.*?)```", (DOCS / page).read_text(), re.DOTALL)


def a_loader() -> list[tuple[torch.Tensor, list[dict[str, Any]]]]:
    return [(torch.zeros(2, 3, 120, 160), [scene(2, seed=n), scene(2, seed=n + 1)]) for n in (0, 2)]


def test_the_loop_of_the_metrics_page_measures_a_detector() -> None:
    loader = a_loader()
    answers = iter([[{**t, "scores": torch.ones(2)} for t in targets] for _, targets in loader])
    names: dict[str, Any] = {"loader": loader, "detector": lambda images: next(answers)}
    first, _ = blocks("metrics.md")
    exec(first, names)  # noqa: S102
    assert names["result"]["ap_3d"] == names["result"]["ap_3d_h30"] == 1.0
    assert names["result"]["ap_3d_class_dog"] == 1.0


def test_the_metrics_of_all_processes_are_merged_as_the_page_says(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    ranks = []
    for images, targets in a_loader():
        own: dict[str, Any] = {"loader": [(images, targets)]}
        own["detector"] = lambda _, t=targets: [{**one, "scores": torch.ones(2)} for one in t]
        exec(blocks("metrics.md")[0], own)  # noqa: S102
        ranks.append(own["metrics"])

    def gather(everybody: list[Any], _: Any) -> None:
        everybody[:] = ranks

    monkeypatch.setattr(torch.distributed, "get_world_size", lambda: len(ranks))
    monkeypatch.setattr(torch.distributed, "all_gather_object", gather)
    names: dict[str, Any] = {"torch": torch, "metrics": ranks[0]}
    exec(blocks("metrics.md")[1], names)  # noqa: S102
    assert names["everybody"][0].compute()["images"] == 4


def test_the_code_of_the_page_of_targets_encodes_decodes_and_fits_a_baseline(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    drawn = SyntheticDataset(2, seed=0, image_hw=(120, 160))
    targets = [scene(2, seed=n) for n in range(4)]
    names: dict[str, Any] = {
        "train_targets": targets,
        "targets": targets,
        "target": targets[0],
        "dataset": SimpleNamespace(classes=("cat", "dog")),
        "metrics": BoxMetrics(resamples=0),
        "rows": torch.arange(2),
        "generator": torch.Generator().manual_seed(0),
        "network": lambda pixels: len(pixels),
        "loss_of": lambda out, target: (out, len(target["rotation_6d"])),
    }
    losses = []
    for block in blocks("detector_targets.md"):
        own = {**names, "dataset": drawn} if "StoredCrops" in block else names
        exec(block, own)  # noqa: S102
        losses.append(own.get("loss"))
    assert (2, 2) in losses  # two views, and two targets of them
    assert torch.allclose(names["decoded"]["center"], targets[0]["center"])
    assert names["metrics"].compute()["ap_3d"] == 1.0  # each animal is its own neighbour
