"""JSON as Python programs write it: with NaN and Infinity, which JSON does not have."""

import json
from pathlib import Path
from typing import Any

from animal3dbox.datasets.storage.json_files import decode_json, read_json_bytes
from animal3dbox.errors import DatasetFormatError


def plain_json(path: Path) -> Any:
    """The content of a JSON file as plain values; NaN and Infinity become floats.

    A network that diverged writes NaN into a few of its boxes: these are faults later, each by
    itself, so the file is not refused for them.

    Raises:
        DatasetNotFoundError: no such file.
        DatasetFormatError: not JSON, even so.

    """
    try:
        return decode_json(path, Any)
    except DatasetFormatError:
        data = read_json_bytes(path)
        if b"NaN" not in data and b"Infinity" not in data:
            raise
        try:
            return json.loads(data)
        except (ValueError, RecursionError) as error:
            raise DatasetFormatError(f"{path} is not valid JSON: {error}") from error
