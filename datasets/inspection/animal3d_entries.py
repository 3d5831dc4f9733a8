"""The entries of Animal3D's files as they stand, and what their keys hold."""

from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from animal3dbox.datasets.readers.animal3d.entries import SplitFile, find_splits, numbered_id
from animal3dbox.datasets.storage.json_files import decode_json
from animal3dbox.errors import SampleError


@dataclass(frozen=True)
class RawFiles:
    """What the files hold.

    Attributes:
        top_keys: file -> its keys.
        counts: file -> entries.
        entries: sample id -> the entry; those without an image's name are under their place.
        flength: of the first file that has one.
        supercategories: number -> name, as far as a file says.
    """

    top_keys: dict[str, list[str]]
    counts: dict[str, int]
    entries: dict[str, dict[str, Any]]
    flength: float | None
    supercategories: dict[str, str]


def read_raw(path: Path) -> RawFiles:
    """The files of a dataset that Animal3D's reader has read."""
    top, counts, entries, flength, names = (
        {},
        {},
        dict[str, dict[str, Any]](),
        None,
        dict[str, str](),
    )
    seen = Counter[str]()
    for file in find_splits(path):
        content: dict[str, msgspec.Raw] = decode_json(file, dict[str, msgspec.Raw])
        split: SplitFile = decode_json(file, SplitFile)
        top[file.name] = sorted(content)
        counts[file.name] = len(split.data)
        flength = split.flength if flength is None else flength
        names |= _names(content.get("supercategories"))
        for i, raw in enumerate(split.data):
            place = f"{file.name} entry {i}"
            with suppress(SampleError):  # it is among the reader's faults
                place = numbered_id(raw, place, seen)
            entry = msgspec.json.decode(raw)
            if isinstance(entry, dict):
                entries[place] = entry
    return RawFiles(top, counts, entries, flength, names)


def _names(raw: msgspec.Raw | None) -> dict[str, str]:
    """Number -> name of a list of names or of {id, name}."""
    listed = [] if raw is None else msgspec.json.decode(raw)
    if isinstance(listed, dict):
        return {str(key): str(value) for key, value in listed.items()}
    known = [
        (item.get("id", i), item.get("name")) if isinstance(item, dict) else (i, item)
        for i, item in enumerate(listed)
    ]
    return {str(key): str(value) for key, value in known}


def points_of(entry: Mapping[str, Any], key: str) -> NDArray[np.float64] | None:
    """A key's points (N, 2 or 3); None if it does not hold finite rows of that form."""
    try:
        points = np.array(entry.get(key), dtype=np.float64)
    except (TypeError, ValueError):  # null, ragged rows, words
        return None
    return (
        points
        if points.ndim == 2
        and points.shape[1] in (2, 3)
        and len(points)
        and np.isfinite(points).all()
        else None
    )


def key_counts(entries: Sequence[Mapping[str, Any]]) -> dict[str, int]:
    """Key -> entries that have it, not null."""
    return dict(
        Counter(
            key for entry in entries for key, value in entry.items() if value is not None
        ).most_common()
    )


def key_forms(entries: Sequence[Mapping[str, Any]]) -> dict[str, dict[str, int]]:
    """Key of lists -> their form (105, 26x3) -> entries."""
    forms: dict[str, Counter[str]] = {}
    for entry in entries:
        for key, value in entry.items():
            if isinstance(value, list):
                forms.setdefault(key, Counter())[_form(value)] += 1
    return {key: dict(found.most_common()) for key, found in sorted(forms.items())}


def _form(value: list[Any]) -> str:
    widths = {len(row) if isinstance(row, list) else 0 for row in value}
    if widths == {0}:
        return str(len(value))
    return f"{len(value)}x{'|'.join(str(width) for width in sorted(widths))}"


def visibility_values(entries: Sequence[Mapping[str, Any]]) -> dict[str, int]:
    """The third column of keypoint_2d as it stands."""
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
    """A key's value, by name if it has one -> entries; "absent" where there is none."""
    told = ("absent" if entry.get(key) is None else str(entry[key]) for entry in entries)
    return dict(
        Counter(
            f"{value} ({names[value]})" if value in names else value for value in told
        ).most_common()
    )
