"""The entries of Animal3D's files as they stand, and counts of their keys and values."""

from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from animal3dbox.datasets.readers.animal3d.collected_animals import elements_of
from animal3dbox.datasets.readers.animal3d.entries import SplitFile, find_splits, numbered_id
from animal3dbox.datasets.readers.elements import plain_value
from animal3dbox.datasets.storage.json_files import decode_json
from animal3dbox.errors import SampleError


@dataclass(frozen=True)
class RawFiles:
    """The content of a dataset's files, as it stands.

    Attributes:
        top_keys: file -> its keys.
        counts: file -> number of entries.
        entries: sample id -> the entry; those without an image's name are under their place.
        flength: the focal length of the first file that has one; None without.
        supercategories: number -> name, as far as a file says.
    """

    top_keys: dict[str, list[str]]
    counts: dict[str, int]
    entries: dict[str, dict[str, Any]]
    flength: float | None
    supercategories: dict[str, str]


def read_raw(path: Path) -> RawFiles:
    """The content of the files of a dataset that Animal3D's reader has read."""
    top_keys, counts, names = dict[str, list[str]](), dict[str, int](), dict[str, str]()
    entries = dict[str, dict[str, Any]]()
    flength: float | None = None
    image_counts = Counter[str]()
    for file in find_splits(path):
        content: dict[str, msgspec.Raw] = decode_json(file, dict[str, msgspec.Raw])
        split: SplitFile = decode_json(file, SplitFile)
        top_keys[file.name] = sorted(content)
        counts[file.name] = len(split.data)
        flength = split.flength if flength is None else flength
        names |= _names(content.get("supercategories"))
        for i, raw in enumerate(split.data):
            place, elements = f"{file.name} entry {i}", [raw]
            with suppress(SampleError):  # it is among the reader's faults
                elements = elements_of(raw, place, file.parent).animals
            for element in elements:
                name = place
                with suppress(SampleError):
                    name = numbered_id(element, place, image_counts, file.parent)
                with suppress(SampleError):
                    entry = plain_value(element, name)
                    if isinstance(entry, dict):
                        entries[name] = entry
    return RawFiles(
        top_keys=top_keys,
        counts=counts,
        entries=entries,
        flength=flength,
        supercategories=names,
    )


def _names(raw: msgspec.Raw | None) -> dict[str, str]:
    """Number -> name, of a list of names or of {id, name}, or of a dictionary."""
    items = [] if raw is None else msgspec.json.decode(raw)
    if isinstance(items, dict):
        return {str(key): str(value) for key, value in items.items()}
    pairs = [
        (item.get("id", i), item.get("name")) if isinstance(item, dict) else (i, item)
        for i, item in enumerate(items)
    ]
    return {str(key): str(value) for key, value in pairs}


def points_of(entry: Mapping[str, Any], key: str) -> NDArray[np.float64] | None:
    """The points (N, 2 or 3) of a key; None if it does not hold finite rows of that form."""
    try:
        points = np.array(entry.get(key), dtype=np.float64)
    except (TypeError, ValueError):  # null, ragged rows, words
        return None
    if points.ndim != 2 or points.shape[1] not in (2, 3) or not len(points):
        return None
    return points if np.isfinite(points).all() else None


def key_counts(entries: Sequence[Mapping[str, Any]]) -> dict[str, int]:
    """Key -> number of entries that have it, not null."""
    return dict(
        Counter(
            key for entry in entries for key, value in entry.items() if value is not None
        ).most_common()
    )


def key_forms(entries: Sequence[Mapping[str, Any]]) -> dict[str, dict[str, int]]:
    """Key of lists -> their form (105, 26x3) -> number of entries."""
    forms: dict[str, Counter[str]] = {}
    for entry in entries:
        for key, value in entry.items():
            if isinstance(value, list):
                forms.setdefault(key, Counter())[_form(value)] += 1
    return {key: dict(counts.most_common()) for key, counts in sorted(forms.items())}


def _form(value: list[Any]) -> str:
    """The form of a list: its length, and that of its rows if it has any."""
    widths = {len(row) if isinstance(row, list) else 0 for row in value}
    if widths == {0}:
        return str(len(value))
    return f"{len(value)}x{'|'.join(str(width) for width in sorted(widths))}"


def visibility_values(entries: Sequence[Mapping[str, Any]]) -> dict[str, int]:
    """Third column of keypoint_2d as it stands -> number of keypoints."""
    values: Counter[str] = Counter()
    for entry in entries:
        rows = entry.get("keypoint_2d")
        for row in rows if isinstance(rows, list) else []:
            values[
                f"{row[2]:g}"
                if isinstance(row, list) and len(row) == 3 and isinstance(row[2], (int, float))
                else "none"
            ] += 1
    return dict(sorted(values.items()))


def value_counts(
    entries: Sequence[Mapping[str, Any]], key: str, names: Mapping[str, str]
) -> dict[str, int]:
    """A key's value, with its name if it has one -> number of entries; "absent" without one."""
    values = ("absent" if entry.get(key) is None else str(entry[key]) for entry in entries)
    labels = (f"{value} ({names[value]})" if value in names else value for value in values)
    return dict(Counter(labels).most_common())
