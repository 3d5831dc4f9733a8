"""The table of labels made by Ray Data on a local cluster of two actors."""

import sys
from pathlib import Path

import pytest
from commands import ran
from small_animals import model_of


def table_of(animals: Path, folder: Path, *options: str) -> dict[str, bytes]:
    """Label a dataset into a table; the names and bytes of its parts."""
    code, words = ran(
        "label", animals, "--model", model_of(animals), "--table", folder, "--json", *options
    )
    assert code in (0, 4), words
    return {path.name: path.read_bytes() for path in folder.glob("shard-*")}


@pytest.mark.filterwarnings("ignore")
def test_ray_makes_the_same_bytes_and_goes_on_where_another_engine_was_stopped(
    animals: Path, tmp_path: Path
) -> None:
    pytest.importorskip("ray.data", reason="the extra ray is not installed: make test-extras")
    plain = table_of(animals, tmp_path / "plain")
    ray = ("--engine", "ray", "--workers", "2")
    assert table_of(animals, tmp_path / "ray", *ray) == plain
    first = table_of(animals, tmp_path / "half", "--shard", "1/2")
    both = table_of(animals, tmp_path / "half", *ray, "--resume")
    assert len(both) == 2
    assert first.items() < both.items()
    assert table_of(animals, tmp_path / "half", *ray, "--resume") == both


def test_what_is_missing_is_said_with_how_to_have_it(
    animals: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)
    code, words = ran(
        *("label", animals, "--model", model_of(animals)),
        *("--table", tmp_path / "t", "--engine", "ray"),
    )
    assert code == 2
    assert "pip install 'animal3dbox[ray]'" in words


def test_an_address_is_for_ray_alone(animals: Path, tmp_path: Path) -> None:
    code, words = ran("label", animals, "--table", tmp_path / "t", "--address", "auto")
    assert code == 2
    assert "--engine ray" in words
