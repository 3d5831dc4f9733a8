"""Recordings for Rerun: against a stand-in for the module, and the real one where it is there."""

import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch

from animal3dbox.datasets import Skipped, SyntheticDataset
from animal3dbox.errors import ConfigError, SampleError
from animal3dbox.geometry import project
from animal3dbox.report import write_rerun
from animal3dbox.report.cuboid_pen import BACK, FRONT

HW = (96, 128)


class Recording:
    """What was logged, instead of Rerun's stream."""

    def __init__(self, _: str) -> None:
        self.time = -1
        self.entries: list[tuple[int, str, Any]] = []

    def set_time(self, _: str, *, sequence: int) -> None:
        self.time = sequence

    def log(self, entity: str, value: Any, *, static: bool = False) -> None:
        self.entries.append((-1 if static else self.time, entity, value))

    def flush(self) -> None:
        """All is logged at once."""

    def memory_recording(self) -> Any:
        return SimpleNamespace(drain_as_bytes=lambda: str(len(self.entries)).encode())


@pytest.fixture
def recordings(monkeypatch: pytest.MonkeyPatch) -> list[Recording]:
    """The recordings made while Rerun's module is a stand-in whose objects keep their arguments."""
    made: list[Recording] = []
    module = ModuleType("rerun")

    def stream(name: str) -> Recording:
        made.append(Recording(name))
        return made[-1]

    def keeper(*values: Any, **named: Any) -> SimpleNamespace:
        return SimpleNamespace(values=values, **named)

    for name in ("Pinhole", "Image", "TextDocument", "LineStrips3D", "Arrows3D"):
        setattr(module, name, keeper)
    module.RecordingStream = stream  # type: ignore[attr-defined]
    module.ViewCoordinates = SimpleNamespace(RDF="RDF")  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "rerun", module)
    return made


def sample_of(seed: int) -> tuple[torch.Tensor, dict[str, Any]]:
    """An image of the world of a seed, and its target."""
    sample = SyntheticDataset(1, seed=seed, image_hw=HW)[0]
    assert not isinstance(sample, Skipped)
    return sample


def logged(recording: Recording, time: int, entity: str) -> Any:
    (value,) = [v for t, name, v in recording.entries if (t, name) == (time, entity)]
    return value


def test_every_image_hangs_before_its_camera_with_its_boxes(
    recordings: list[Recording], tmp_path: Path
) -> None:
    samples = [sample_of(seed) for seed in range(3)]
    with_skipped: list[Any] = [Skipped(7, "b.jpg", ()), *samples]
    assert write_rerun(tmp_path / "world.rrd", with_skipped) == 3
    (recording,) = recordings
    assert (tmp_path / "world.rrd").read_bytes() == str(len(recording.entries)).encode()
    for number, (image, target) in enumerate(samples):
        camera = logged(recording, number, "world/camera")
        np.testing.assert_allclose(camera.image_from_camera, target["K"].numpy())
        assert (camera.height, camera.width) == HW
        (picture,) = logged(recording, number, "world/camera/image").values
        np.testing.assert_array_equal(picture, image.permute(1, 2, 0).numpy())
        boxes = logged(recording, number, "world/boxes")
        strips = torch.tensor(np.array(boxes.values[0])).reshape(-1, 3)
        assert len(strips) == 24 * len(target["boxes"])
        pixels, _ = project(target["K"].double(), strips)
        corners = target["corners_2d"].double().reshape(-1, 2)
        assert torch.cdist(pixels, corners).amin(-1).max() < 1e-2
        assert boxes.colors.count(FRONT) == boxes.colors.count(BACK) == 4 * len(target["boxes"])


def test_green_edges_and_the_arrow_are_of_the_front(
    recordings: list[Recording], tmp_path: Path
) -> None:
    sample = sample_of(3)
    write_rerun(tmp_path / "one.rrd", [sample])
    target = sample[1]
    boxes = logged(recordings[0], 0, "world/boxes")
    green = [
        strip for strip, color in zip(boxes.values[0], boxes.colors, strict=True) if color == FRONT
    ]
    center, rotation = target["center"][0].numpy(), target["rotation"][0].numpy()
    forward = (np.array(green[:4]).reshape(-1, 3) - center) @ rotation[:, 0]
    np.testing.assert_allclose(forward, float(target["size"][0, 0]) / 2, rtol=1e-4)
    arrow = logged(recordings[0], 0, "world/fronts")
    np.testing.assert_allclose(
        arrow.vectors[0], rotation[:, 0] * float(target["size"][0, 0]) * 0.75, rtol=1e-4
    )


def test_a_target_without_a_camera_or_with_no_box_is_named(
    recordings: list[Recording], tmp_path: Path
) -> None:
    image, target = sample_of(3)
    without = {name: value for name, value in target.items() if name != "K"}
    with pytest.raises(SampleError, match=r"K.*is missing"):
        write_rerun(tmp_path / "a.rrd", [(image, without)])
    with pytest.raises(SampleError, match=r"\[0\] are no boxes"):
        write_rerun(tmp_path / "a.rrd", [(image, {**target, "size": -target["size"]})])
    assert len(recordings) == 2
    assert not list(tmp_path.iterdir())


def test_what_is_missing_is_said_with_how_to_have_it(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(ConfigError, match=r"animal3dbox\[rerun\]"):
        write_rerun(tmp_path / "a.rrd", [])


def test_the_real_viewer_reads_the_file(tmp_path: Path) -> None:
    pytest.importorskip("rerun", reason="the extra rerun is not installed: make test-extras")
    file = tmp_path / "world.rrd"
    image, target = sample_of(0)
    empty = {name: target[name][:0] for name in ("center", "rotation", "size")}
    assert write_rerun(file, [(image, target), (image, {**target, **empty})]) == 2
    assert file.read_bytes()[:4] == b"RRF2"
