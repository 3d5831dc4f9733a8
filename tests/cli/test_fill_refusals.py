"""What filling a cache refuses, and what it says of labels that it could not keep."""

import json
from pathlib import Path

import pytest
from commands import ran
from small_animals import model_of

from animal3dbox.datasets.storage.segments import SegmentWriter


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (("--body", "dog"), "give one of them"),
        (("--workers", "-1"), "--workers must not be negative"),
    ],
)
def test_options_that_contradict_are_refused(
    animals: Path, tmp_path: Path, options: tuple[str, str], says: str
) -> None:
    code, output = ran(
        "label", animals, "--model", model_of(animals), "--cache", tmp_path, *options
    )
    assert code == 2
    assert says in output


def test_a_negative_number_of_workers_is_no_traceback(animals: Path) -> None:
    code, output = ran("check", animals, "--model", model_of(animals), "--workers", "-1")
    assert code == 2
    assert "--workers must not be negative" in output


def test_labels_that_found_no_room_are_not_said_to_be_in_the_cache(
    animals: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(writer: SegmentWriter, key: bytes, payload: bytes) -> int:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(SegmentWriter, "append", full)
    code, output = ran(
        "label", animals, "--model", model_of(animals), "--cache", tmp_path, "--json"
    )
    assert code == 4
    assert json.loads(output)["stored"] == 0
