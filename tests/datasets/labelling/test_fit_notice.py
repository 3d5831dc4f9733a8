"""What a worker says of bodies that it fits."""

from pathlib import Path

import pytest
from commands import ran
from torch.utils.data import DataLoader

from animal3dbox.datasets import StanfordExtraDataset, SyntheticSet, collate
from animal3dbox.datasets.synthetic.stanfordextra_writer import write_stanfordextra
from animal3dbox.datasets.synthetic.world.config import WorldConfig
from animal3dbox.smal.keypoints.vocabularies import VOCABULARIES

WORLD = WorldConfig(
    image_hw=(120, 160), vocabulary=VOCABULARIES["stanfordextra24"], truncated=0.0, occluded=0.0
)


@pytest.fixture(scope="module")
def photos(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("photos")
    write_stanfordextra(SyntheticSet(3, 3, WORLD), folder)
    return folder


def loaded(photos: Path, body: str, workers: int, cache: Path | None = None) -> None:
    dataset = StanfordExtraDataset(photos, body=body, on_bad="skip", cache=cache)
    for _ in DataLoader(dataset, batch_size=1, collate_fn=collate, num_workers=workers):
        pass


def test_the_first_fit_in_a_worker_tells_its_cost_once_and_a_filled_cache_is_silent(
    photos: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    loaded(photos, "fit", workers=1, cache=tmp_path)
    told = capfd.readouterr().err
    assert told.count("bodies are being fitted") == 1
    assert "animal3dbox label PATH --cache FOLDER" in told
    assert "about 1 min an epoch, if its 3 images show an animal each" in told
    loaded(photos, "fit", workers=1, cache=tmp_path)
    assert "fitted" not in capfd.readouterr().err


def test_rigid_bodies_and_loads_without_workers_are_silent(
    photos: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    loaded(photos, "dog", workers=1)
    loaded(photos, "fit", workers=0)
    assert "fitted" not in capfd.readouterr().err


def test_the_command_that_is_named_fills_the_cache(
    photos: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    code, printed = ran("label", photos, "--body", "fit", "--cache", tmp_path / "cache")
    assert code == 0, printed
    capfd.readouterr()
    loaded(photos, "fit", workers=1, cache=tmp_path / "cache")
    assert "fitted" not in capfd.readouterr().err
