"""SyntheticDataset(store=...): scenes that are drawn once, and read afterwards."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from loading import in_bytes
from torch.utils.data import DataLoader

from animal3dbox.datasets import SyntheticDataset, SyntheticSet, collate
from animal3dbox.datasets.labelling import synthetic_source
from animal3dbox.datasets.synthetic import scenes
from animal3dbox.datasets.synthetic.faults import FaultConfig
from animal3dbox.datasets.synthetic.world.config import WorldConfig

SMALL = WorldConfig(image_hw=(60, 80))


def everything(dataset: SyntheticDataset) -> list[Any]:
    return [in_bytes(dataset[index]) for index in range(len(dataset))]


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """The scenes that have been drawn."""
    draw, indices = scenes.synthetic_scene, list[int]()

    def watched(seed: int, index: int, config: WorldConfig) -> Any:
        indices.append(index)
        return draw(seed, index, config)

    monkeypatch.setattr(synthetic_source, "synthetic_scene", watched)
    synthetic_source._scene.cache_clear()
    return indices


def test_a_stored_scene_is_the_drawn_one_and_is_drawn_once(
    tmp_path: Path, drawn: list[int]
) -> None:
    made = SyntheticSet(4, 3, SMALL, FaultConfig(noise_px=1.0))
    right = everything(SyntheticDataset(made))
    drawn.clear()
    synthetic_source._scene.cache_clear()
    assert everything(SyntheticDataset(made, store=tmp_path)) == right
    assert drawn == [0, 1, 2]
    synthetic_source._scene.cache_clear()
    again = SyntheticDataset(made, store=tmp_path)
    assert everything(again) == right
    assert [again.source.animals(index) for index in range(3)] == [
        len(target[1]["meta"]["sample_ids"]) for target in right
    ]
    loader = DataLoader(again, batch_size=3, collate_fn=collate)
    assert [in_bytes(sample) for sample in zip(*next(iter(loader)), strict=True)] == right
    assert drawn == [0, 1, 2]


def test_a_dataset_draws_nothing_until_it_is_asked(drawn: list[int]) -> None:
    SyntheticDataset(SyntheticSet(4, 3, SMALL))
    assert drawn == []


def test_a_batch_draws_each_of_its_scenes_once(drawn: list[int]) -> None:
    SyntheticDataset(SyntheticSet(4, 5, SMALL)).__getitems__([0, 1, 2, 3, 4])
    assert drawn == [0, 1, 2, 3, 4]


@pytest.mark.parametrize(
    "other",
    [
        SyntheticSet(5, 1, SMALL),
        SyntheticSet(4, 1, replace(SMALL, image_hw=(60, 90))),
        SyntheticSet(4, 1, SMALL, FaultConfig(noise_px=1.0)),
        SyntheticSet(4, 1, SMALL, hidden="marked"),
    ],
    ids=["seed", "world", "faults", "hidden"],
)
def test_another_set_in_the_same_folder_gets_its_own_scenes(
    tmp_path: Path, other: SyntheticSet
) -> None:
    everything(SyntheticDataset(SyntheticSet(4, 1, SMALL), store=tmp_path))
    assert everything(SyntheticDataset(other, store=tmp_path)) == everything(
        SyntheticDataset(other)
    )


def test_a_damaged_scene_is_drawn_anew(tmp_path: Path, drawn: list[int]) -> None:
    made = SyntheticSet(4, 1, SMALL)
    right = everything(SyntheticDataset(made, store=tmp_path))
    (file,) = tmp_path.rglob("*.scene")
    whole = file.read_bytes()
    for damaged in (whole[: len(whole) // 2], whole[:-9] + b"x" + whole[-8:], b""):
        file.write_bytes(damaged)
        synthetic_source._scene.cache_clear()
        drawn.clear()
        assert everything(SyntheticDataset(made, store=tmp_path)) == right
        assert drawn == [0]
        assert file.read_bytes() == whole


def test_a_folder_that_takes_no_file_costs_a_warning_and_no_sample(tmp_path: Path) -> None:
    made = SyntheticSet(4, 1, SMALL)
    (tmp_path / "store").write_text("not a folder")
    stored = SyntheticDataset(made, store=tmp_path / "store")
    with pytest.warns(UserWarning, match="cannot be stored and are drawn anew"):
        assert everything(stored) == everything(SyntheticDataset(made))
