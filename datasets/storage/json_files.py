"""Reading JSON files whole, with errors that name the file and say where it breaks."""

import codecs
from pathlib import Path
from typing import Any

import msgspec

from animal3dbox.errors import DatasetFormatError, DatasetNotFoundError


def read_json_bytes(path: Path) -> bytes:
    """The bytes of a file, without the mark of UTF-8 (BOM) that some editors put before them.

    Raises:
        DatasetNotFoundError: no such file.
        DatasetFormatError: it cannot be read, or is empty.

    """
    try:
        data = path.read_bytes()
    except FileNotFoundError as error:
        raise DatasetNotFoundError(f"there is no file {path}") from error
    except OSError as error:
        raise DatasetFormatError(f"{path} cannot be read: {error}") from error
    if not data.strip():
        raise DatasetFormatError(f"{path} is empty")
    return data.removeprefix(codecs.BOM_UTF8)


def decode_json(path: Path, kind: Any) -> Any:
    """The content of a JSON file as a value of a type.

    Args:
        path: the file.
        kind: any type that msgspec decodes.

    Raises:
        DatasetNotFoundError: no such file.
        DatasetFormatError: not JSON (NaN and Infinity are not), or of another form.

    """
    return decode_json_bytes(read_json_bytes(path), kind, path)


def decode_json_bytes(data: bytes, kind: Any, path: Path) -> Any:
    """The content of a JSON file that has been read, with the errors of decode_json.

    Args:
        data: the file's bytes, without a byte order mark.
        kind: any type that msgspec decodes.
        path: the file, named in errors.

    """
    try:
        return msgspec.json.decode(data, type=kind)
    except msgspec.ValidationError as error:
        raise DatasetFormatError(f"{path}: {error}") from error
    except msgspec.DecodeError as error:
        literal = next((name for name in ("NaN", "Infinity") if name.encode() in data), None)
        hint = f"; it holds {literal}, which JSON does not have: write null" if literal else ""
        raise DatasetFormatError(f"{path} is not valid JSON: {error}{hint}") from error
    except UnicodeDecodeError as error:
        raise DatasetFormatError(f"{path} is not UTF-8: {error}") from error
    except RecursionError as error:
        raise DatasetFormatError(f"{path} is nested too deeply to be annotations") from error


def read_json_list(path: Path) -> list[msgspec.Raw]:
    """The elements of a JSON file that is one list.

    Each is still undecoded, so that one bad element spoils no other.
    """
    elements: list[msgspec.Raw] = decode_json(path, list[msgspec.Raw])
    return elements
