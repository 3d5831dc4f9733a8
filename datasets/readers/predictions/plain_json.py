"""JSON as Python programs write it: with NaN and Infinity, which JSON does not have."""

import json
from pathlib import Path
from typing import Any

from animal3dbox.datasets.storage.json_files import decode_json, read_json_bytes
from animal3dbox.errors import DatasetFormatError


def plain_json(path: Path) -> Any:
    """The content of a JSON file as plain values; NaN, Infinity and 1e999 become floats.

    A network that diverged writes NaN into a few of its boxes: these are faults later, each by
    itself, so the file is not refused for them.

    Raises:
        DatasetNotFoundError: no such file.
        DatasetFormatError: not JSON, even so.

    """
    try:
        return decode_json(path, Any)
    except DatasetFormatError:
        try:
            return json.loads(read_json_bytes(path))
        except (ValueError, RecursionError):
            pass
        raise
