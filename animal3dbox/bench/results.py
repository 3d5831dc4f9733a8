"""A detector's results as a folder, and what of it is refused.

The folder holds about.json, which says what was detected on, and for each split SPLIT.json (or
SPLIT.pth) in Cube R-CNN's layout, an element an image. Only that layout tells an image in which
nothing was found from an image that was left out.
"""

import json
from collections import Counter
from collections.abc import Container, Sequence
from pathlib import Path
from typing import Any

import msgspec

from animal3dbox.bench.editions import Track
from animal3dbox.bench.made_files import NAMED
from animal3dbox.bench.manifest import Manifest
from animal3dbox.datasets.readers.omni3d.schema import Key
from animal3dbox.datasets.readers.predictions.layouts import PICKLES
from animal3dbox.datasets.readers.predictions.pickled import read_pickled
from animal3dbox.datasets.readers.predictions.plain_json import plain_json
from animal3dbox.datasets.readers.predictions.reader import read_predictions
from animal3dbox.datasets.readers.predictions.truth import read_truth
from animal3dbox.datasets.records import CuboidSet
from animal3dbox.datasets.storage.json_files import decode_json
from animal3dbox.errors import ConfigError, DatasetFormatError, DatasetNotFoundError
from animal3dbox.files import write_whole

ABOUT = "about.json"
SUFFIXES = (".json", ".pth")
"""Suffixes of a split's file."""


class ResultHead(msgspec.Struct, kw_only=True, frozen=True, forbid_unknown_fields=True):
    """The content of about.json: what a result is of.

    Attributes:
        version: of the benchmark, from its MANIFEST.json.
        edition: likewise.
        track: what the method looked at; see docs/bench.md.
        method: the method's name.
        splits: split -> the digest that MANIFEST.json gives the images that were looked at.
        note: anything that a reader should know of the method.
        notes: split -> what a reader should know of that split's boxes.

    Example:
        >>> ResultHead(
        ...     version="bench-v1", edition="small", track="K", method="ours", splits={}).note
        ''
    """

    version: str
    edition: str
    track: Track
    method: str
    splits: dict[str, str]
    note: str = ""
    notes: dict[str, str] = {}


def write_head(folder: Path, head: ResultHead) -> None:
    """Write about.json of a result's folder.

    Example:
        >>> import tempfile
        >>> head = ResultHead(
        ...     version="bench-v1", edition="small", track="K", method="ours", splits={})
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     write_head(Path(folder), head)
        ...     read_head(Path(folder)) == head
        True
    """
    write_whole(folder / ABOUT, msgspec.json.format(msgspec.json.encode(head)))


def read_head(folder: Path) -> ResultHead:
    """The content of a result's about.json.

    Raises:
        DatasetNotFoundError: there is none.
        DatasetFormatError: a key is missing, unknown or of another kind.

    """
    if not (folder / ABOUT).is_file():
        raise DatasetNotFoundError(
            f"{folder} holds no {ABOUT}, which says what the result is of: a JSON object with"
            " version and edition as in the benchmark's MANIFEST.json, track (image, K, box or"
            " keypoints: what the method looked at), method, and splits (of each split's name the"
            " digest that MANIFEST.json gives its images). `animal3dbox bench baseline` writes one"
            " for an example"
        )
    head: ResultHead = decode_json(folder / ABOUT, ResultHead)
    return head


def extended_head(folder: Path, head: ResultHead) -> ResultHead:
    """The head of a result that is written into a folder, with the splits that are there already.

    Args:
        folder: of the result; it may be new.
        head: of the splits that are written now.

    Returns:
        All splits whose files are there or are written now, and the notes on them.

    Raises:
        ConfigError: the folder holds the result of another method, track, version or edition.
        DatasetFormatError: its about.json is damaged.

    """
    if not (folder / ABOUT).is_file():
        return head
    old = read_head(folder)
    for field in ("method", "track", "version", "edition"):
        if (theirs := getattr(old, field)) != (ours := getattr(head, field)):
            raise ConfigError(
                f"{folder} holds a result whose {field} is {theirs!r}, and this one's is {ours!r}:"
                " give another folder (--out)"
            )
    other_splits = {
        name: digest
        for name, digest in old.splits.items()
        if name not in head.splits
        and any((folder / f"{name}{suffix}").is_file() for suffix in SUFFIXES)
    }
    notes = {name: note for name, note in old.notes.items() if name in other_splits}
    return msgspec.structs.replace(
        head,
        splits={**other_splits, **head.splits},
        note=head.note or old.note,
        notes={**notes, **head.notes},
    )


def checked_splits(head: ResultHead, manifest: Manifest, splits: Sequence[str]) -> list[str]:
    """The splits of a result that can be scored against a benchmark.

    Args:
        head: of the result.
        manifest: of the benchmark.
        splits: those that are asked for; none: all of the result.

    Raises:
        DatasetFormatError: the result is of another version, edition or pixels, or lacks a split.

    """
    theirs, ours = (head.version, head.edition), (manifest.version, manifest.edition)
    if theirs != ours:
        raise DatasetFormatError(
            f"{ABOUT}: the result is of {' '.join(theirs)} and the benchmark is {' '.join(ours)}:"
            " score it against what was detected on"
        )
    names = list(dict.fromkeys(splits)) or list(head.splits)
    for name in names:
        if name not in head.splits:
            raise DatasetFormatError(f"{ABOUT}: splits has no {name!r}, which is asked for")
        if name not in manifest.splits:
            raise DatasetFormatError(
                f"{ABOUT}: the benchmark's folder has no whole split {name!r}: make it"
            )
        if head.splits[name] != (digest := manifest.splits[name].digest):
            raise DatasetFormatError(
                f"{ABOUT}: {name} was detected on other pixels: the result says"
                f" {head.splits[name]}, and MANIFEST.json {digest}; verify both copies"
                " (animal3dbox bench verify), and detect again"
            )
    if not names:
        raise DatasetFormatError(f"{ABOUT}: splits is empty: there is nothing to score")
    return names


def read_split(folder: Path, split: str, truth: Path) -> CuboidSet:
    """The boxes of a result in one split, none of which is unusable.

    Args:
        folder: of the result.
        split: its name.
        truth: the split's Omni3D JSON.

    Raises:
        DatasetNotFoundError: there is no file of the split.
        DatasetFormatError: in another layout; an image is missing, unknown or there twice; or a box
            cannot be used.

    """
    path = _file_of(folder, split)
    _check_images(path, truth)
    boxes = read_predictions(path, truth, layout="cubercnn", look_for_images=False)
    if boxes.faults:
        raise DatasetFormatError(
            f"{path}: {len(boxes.faults)} boxes cannot be used, so the result is not scored; the"
            f" first: {boxes.faults[0]}"
        )
    return boxes


def _file_of(folder: Path, split: str) -> Path:
    """The file of a split's boxes in a result: SPLIT.json or SPLIT.pth, one of which is there."""
    files = [path for suffix in SUFFIXES if (path := folder / f"{split}{suffix}").is_file()]
    if len(files) != 1:
        names = " or ".join(f"{split}{suffix}" for suffix in SUFFIXES)
        number = "both" if files else "neither"
        raise DatasetNotFoundError(f"{folder} must hold {names}, and holds {number}")
    return files[0]


def _check_images(path: Path, truth: Path) -> None:
    """Raise unless every image of the truth has exactly one element in the file."""
    content = read_pickled(path) if path.suffix in PICKLES else plain_json(path)
    if not isinstance(content, list) or not all(_is_image(element) for element in content):
        raise DatasetFormatError(
            f"{path} must be a list of images, each with image_id and a list of instances"
            " (Cube R-CNN's layout): an image without a box has an empty list"
        )
    times = Counter(element["image_id"] for element in content)
    known = read_truth(truth, look_for_images=False).images
    missing = [key for key in known if key not in times]
    unknown = [key for key in times if key not in known]
    twice = [key for key, count in times.items() if count > 1]
    problems = [
        f"{len(keys)} images (ids {_named(keys)}) {problem}"
        for problem, keys in (
            (f"are not of this split{_number_remedy(unknown, known)}", unknown),
            ("are missing: give each its element, with no instances if nothing was found", missing),
            ("are there more than once", twice),
        )
        if keys
    ]
    if problems:
        raise DatasetFormatError(f"{path}: {'; '.join(problems)}")


def _named(keys: Sequence[Key]) -> str:
    """The first ids of many as JSON has them, so that the text "1" differs from the number 1."""
    return ", ".join(json.dumps(key) for key in keys[:NAMED]) + (
        ", ..." if len(keys) > NAMED else ""
    )


def _number_remedy(unknown: Sequence[Key], known: Container[Key]) -> str:
    """What to do about ids that are text where the truth's are numbers, if some are."""
    texts = [key for key in unknown if isinstance(key, str)]
    if any(key.isdecimal() and int(key) in known for key in texts):
        return ": text stands where the truth has a number; write ids without quotation marks"
    return ""


def _is_image(element: Any) -> bool:
    """Whether an element is an image with a list of detections."""
    return (
        isinstance(element, dict)
        and isinstance(element.get("image_id"), int | str)
        and isinstance(element.get("instances"), list)
    )
