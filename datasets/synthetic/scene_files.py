"""Writing a synthetic dataset scene by scene: by several processes, and again after a crash.

A scene's pictures are written first, then its rows, as a part of its own in the folder PARTS; the
annotation files are made of the parts, again and again while the parts grow. So a dataset whose
writing was killed can be read, and be completed. When all scenes are there, PARTS goes, and nothing
tells how many processes there were, or how often they began.
"""

import shutil
from collections.abc import Generator
from contextlib import closing
from dataclasses import asdict
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Protocol

import cv2
import msgspec
import torch

from animal3dbox.datasets.storage.fingerprint import code_digest
from animal3dbox.datasets.synthetic.synthetic_set import SyntheticSet
from animal3dbox.errors import ConfigError
from animal3dbox.files import write_whole
from animal3dbox.progress import watched

PARTS = ".synth"
"""The folder of parts inside a dataset that is being written."""
GROWTH = 1.25
"""The annotation files are written anew when there are so many times more scenes in them."""


class SceneRows(msgspec.Struct, frozen=True):
    """The rows of one scene, as JSON.

    Attributes:
        index: of the scene.
        split: "train" or "test".
        entries: of the annotation file, an animal each.
        truths: of truth.json, likewise.
    """

    index: int
    split: str
    entries: list[msgspec.Raw]
    truths: list[msgspec.Raw]


class SceneFiles(Protocol):
    """A format's files of a synthetic dataset; it is sent to worker processes."""

    @property
    def root(self) -> Path:
        """The dataset's folder."""
        ...

    @property
    def synthetic_set(self) -> SyntheticSet:
        """The dataset."""
        ...

    def write_scene(self, index: int) -> SceneRows:
        """Write the pictures of a scene, and give its rows."""
        ...

    def write_index(self, scenes: list[SceneRows]) -> None:
        """Write the annotation files and truth.json of some scenes, in order."""
        ...


def raw(value: Any) -> msgspec.Raw:
    """A value as JSON, to be written into a file as it is."""
    return msgspec.Raw(msgspec.json.encode(value))


def write_scenes(files: SceneFiles, *, workers: int, resume: bool) -> int:
    """Write all scenes of a dataset, and give its number of animals.

    Args:
        files: of its format.
        workers: processes; 1: this one alone. The files are the same for any number.
        resume: whether scenes that an earlier run finished stay as they are.

    Raises:
        ConfigError: workers is below 1; or the parts that are there are of another dataset or of
            other code.

    """
    if workers < 1:
        raise ConfigError(f"workers must be at least 1, got {workers}")
    scenes = _begun(files, resume=resume)
    missing = [index for index in range(len(files.synthetic_set)) if index not in scenes]
    written = 0
    with closing(_each(files, missing, workers)) as rows:
        total = len(files.synthetic_set)
        for row in watched(rows, "drawing", unit="image", total=total, initial=len(scenes)):
            scenes[row.index] = row
            if len(scenes) >= GROWTH * written:
                written = len(scenes)
                files.write_index([scenes[index] for index in sorted(scenes)])
    files.write_index([scenes[index] for index in sorted(scenes)])
    shutil.rmtree(files.root / PARTS)
    return sum(len(row.entries) for row in scenes.values())


def can_resume(root: Path) -> bool:
    """Whether a folder holds parts of a dataset whose writing was broken off."""
    return (root / PARTS / "dataset.json").is_file()


def _begun(files: SceneFiles, *, resume: bool) -> dict[int, SceneRows]:
    """The scenes that are there already; the folder of parts is made where it is not."""
    parts = files.root / PARTS
    name = msgspec.json.encode({"format": type(files).__name__, **content_of(files.synthetic_set)})
    if not resume or not can_resume(files.root):
        write_whole(parts / "dataset.json", name)
        return {}
    if (parts / "dataset.json").read_bytes() != name:
        raise ConfigError(
            f"{files.root} was begun with other options, or by another version of animal3dbox:"
            " repeat the command with those, or write into another folder"
        )
    for left_behind in files.root.rglob(".*.*"):
        if left_behind.is_file():  # a file that write_whole had not renamed when it was killed
            left_behind.unlink()
    scenes = (
        msgspec.json.decode(part.read_bytes(), type=SceneRows) for part in parts.glob("[0-9]*.json")
    )
    return {scene.index: scene for scene in scenes}


def content_of(made: SyntheticSet) -> dict[str, Any]:
    """What all of a synthetic dataset depends on, as plain values: its dials and the code."""
    return {
        "seed": made.seed,
        "images": made.images,
        "hidden": made.hidden,
        "world": {**asdict(made.config), "vocabulary": made.config.vocabulary.name},
        "faults": asdict(made.faults),
        "code": code_digest().hex(),
    }


def _each(files: SceneFiles, indices: list[int], workers: int) -> Generator[SceneRows, None, None]:
    """The rows of scenes, as they are finished."""
    if workers == 1 or len(indices) < 2:
        yield from map(partial(_write_part, files), indices)
        return
    with get_context("spawn").Pool(workers, initializer=_one_thread) as pool:
        yield from pool.imap_unordered(partial(_write_part, files), indices)


def _one_thread() -> None:
    """Keep a worker to one thread: the problems are small, and others work beside it."""
    torch.set_num_threads(1)
    cv2.setNumThreads(1)


def _write_part(files: SceneFiles, index: int) -> SceneRows:
    """Write a scene's pictures, and then its rows as a part."""
    rows = files.write_scene(index)
    write_whole(files.root / PARTS / f"{index:09d}.json", msgspec.json.encode(rows))
    return rows
