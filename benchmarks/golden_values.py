"""The values of a golden record: a digest and a short summary for every name, for whoever compares.

An array is told by its type, shape and bytes, a plain value by its canonical JSON. Dictionaries and
lists of them are taken apart, so that an added key changes no old name.
"""

import csv
import dataclasses
import hashlib
import json
import traceback
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from golden_names import in_old_words, without_meta

SHOWN = 90
"""So many characters of a plain value are kept to be read."""


class GoldenValues:
    """Names and digests of one record.

    Args:
        places: text that differs from run to run, such as a folder, -> the word that stands for it.

    """

    def __init__(self, places: Mapping[str, str]) -> None:
        self.places = dict(sorted(places.items(), key=lambda item: -len(item[0])))
        self.digests: dict[str, str] = {}
        self.summaries: dict[str, str] = {}
        self.errors: dict[str, str] = {}

    @contextmanager
    def section(self, name: str) -> Iterator[None]:
        """A part whose failure is written down and does not end the record."""
        try:
            yield
        except Exception:  # noqa: BLE001
            self.errors[name] = traceback.format_exc()

    def add(self, name: str, value: Any) -> None:
        """Record a value and its parts; raises TypeError for a kind that has no digest."""
        value = self._plain(value)
        if isinstance(value, torch.Tensor):
            value = value.detach().numpy()
        if isinstance(value, np.ndarray):
            self._array(name, value)
        elif isinstance(value, dict) and value:
            for key, part in value.items():
                self.add(f"{name}/{self.told(str(key))}", part)
        elif isinstance(value, list) and any(_is_taken_apart(part) for part in value):
            self._leaf(f"{name}/count", len(value))
            for number, part in enumerate(value):
                self.add(f"{name}/{number}", part)
        else:
            self._leaf(name, value)

    def add_target(self, name: str, target: Mapping[str, Any]) -> None:
        """Record a target; words that have moved into its "meta" keep their names."""
        self.add(name, without_meta(dict(target)))

    def add_json(self, name: str, path: Path) -> None:
        """Record a JSON file, leaf by leaf."""
        self.add(name, json.loads(path.read_text()))

    def add_csv(self, name: str, path: Path) -> None:
        """Record a table, column by column."""
        with path.open(newline="") as file:
            header, *rows = csv.reader(file)
        for number, column in enumerate(header):
            self.add(f"{name}/{column}", [row[number] for row in rows])

    def add_picture(self, name: str, path: Path) -> None:
        """Record the pixels of a picture."""
        pixels = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        if pixels is None:
            raise ValueError(f"{path} is no picture")
        self.add(name, np.asarray(pixels))

    def add_bytes(self, name: str, path: Path) -> None:
        """Record a file to the byte."""
        self.add(name, np.frombuffer(path.read_bytes(), dtype=np.uint8))

    def told(self, text: str) -> str:
        """A text in old names, with words for the folders of this run."""
        for place, word in self.places.items():
            text = text.replace(place, word)
        return in_old_words(text)

    def _plain(self, value: Any) -> Any:
        """Numbers of NumPy as Python's, any mapping as a dict, any row of things as a list."""
        if isinstance(value, np.generic):
            return value.item()
        if isinstance(value, Path):
            return str(value)
        if isinstance(value, Mapping):
            return dict(value)
        if _fields(value):
            return {field: getattr(value, field) for field in _fields(value)}
        if isinstance(value, Sequence) and not isinstance(value, str | bytes):
            return [self._plain(part) for part in value]
        return value

    def _array(self, name: str, array: np.ndarray) -> None:
        head = f"{array.dtype.str}{array.shape}"
        total = np.asarray(array, dtype=np.float64).sum()
        self._put(name, head.encode() + array.tobytes(), f"{head} sum {total:.12g}")

    def _leaf(self, name: str, value: Any) -> None:
        text = json.dumps(_told_all(value, self.told), sort_keys=True, ensure_ascii=True)
        numbers = _numbers(value)
        shown = text if len(text) <= SHOWN else f"{text[:SHOWN]}..."
        if isinstance(value, list) and numbers:
            shown = f"{len(numbers)} numbers sum {sum(numbers):.12g} {shown}"
        self._put(name, text.encode(), shown)

    def _put(self, name: str, content: bytes, summary: str) -> None:
        if name in self.digests:
            raise ValueError(f"{name} is recorded twice")
        self.digests[name] = hashlib.sha256(content).hexdigest()
        self.summaries[name] = summary

    def written(self, path: Path, package: Path) -> None:
        """Write the record as JSON, with the folder of the code that it is of."""
        values = {name: [self.digests[name], self.summaries[name]] for name in self.digests}
        told = {"package": str(package), "errors": self.errors, "values": values}
        path.write_text(json.dumps(told, indent=0))


LABEL_PARTS = (
    "sample_id", "image_hw", "corners_3d", "center", "rotation", "size", "corners_2d",
    "corner_in_front", "face_visible", "face_area", "face_share", "face_share_in_image", "K", "R",
    "t", "box", "surface_share", "truncation", "behind_camera", "keypoints", "cuboid_mesh",
    "quality", "distortion", "scale_m_per_unit", "scale_source",
)  # fmt: skip
"""The parts of a CuboidLabel: fields of the old class, properties of the new one."""


def _is_taken_apart(value: Any) -> bool:
    """Whether something is no plain value: a list that holds it gets a name for each element."""
    if isinstance(value, list):
        return any(_is_taken_apart(part) for part in value)
    return isinstance(value, Mapping | torch.Tensor | np.ndarray) or bool(_fields(value))


def _fields(value: Any) -> tuple[str, ...]:
    """The names of a value's parts: those of LABEL_PARTS for a label, whatever holds them now."""
    if isinstance(value, type):
        return ()
    if type(value).__name__ == "CuboidLabel":
        return LABEL_PARTS
    if dataclasses.is_dataclass(value):
        return tuple(field.name for field in dataclasses.fields(value))
    return tuple(getattr(type(value), "__struct_fields__", ()))


def _told_all(value: Any, told: Any) -> Any:
    """A plain value with every text in it told."""
    if isinstance(value, list):
        return [_told_all(part, told) for part in value]
    return told(value) if isinstance(value, str) else value


def _numbers(value: Any) -> list[float]:
    """All numbers in nested lists."""
    if isinstance(value, list):
        return [number for part in value for number in _numbers(part)]
    return [value] if isinstance(value, int | float) and not isinstance(value, bool) else []
