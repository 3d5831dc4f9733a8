"""Body models as safetensors files: plain tensors, and one JSON text for what is not an array."""

from pathlib import Path
from typing import Literal

import msgspec
import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor

from animal3dbox.errors import ModelFileError
from animal3dbox.files import write_whole
from animal3dbox.smal.files.model_checks import ModelNames, checked_model
from animal3dbox.smal.model import SmalModel

_METADATA = "smal_model"
_FLOATS = ("v_template", "shapedirs", "posedirs", "J_regressor", "weights")
_REQUIRED = (*_FLOATS, "faces")
_OPTIONAL = "symmetry"
_REMEDY = "convert the SMAL file again with `animal3dbox convert-model`"


class _Names(msgspec.Struct, forbid_unknown_fields=True):
    """The JSON text in the file's metadata: all of a model that is not an array."""

    schema: Literal["animal3dbox.smal_model"]
    version: Literal[1]
    parents: tuple[int, ...]
    joint_names: tuple[str, ...]
    landmarks: dict[str, tuple[int, ...]]
    extra_landmarks: dict[str, tuple[int, ...]]


def save_safetensors(model: SmalModel, path: Path) -> None:
    """Write a model, whole or not at all: a neighbour of path is written and renamed.

    Raises:
        OSError: path cannot be written.

    Example:
        >>> from tempfile import TemporaryDirectory
        >>> from animal3dbox.smal import load_quadruped
        >>> with TemporaryDirectory() as folder:
        ...     save_safetensors(load_quadruped(), Path(folder, "quadruped.safetensors"))
        ...     [path.name for path in Path(folder).iterdir()]
        ['quadruped.safetensors']
    """
    names = _Names(
        schema="animal3dbox.smal_model",
        version=1,
        parents=model.parents,
        joint_names=model.joint_names,
        landmarks=dict(model.landmarks),
        extra_landmarks=dict(model.extra_landmarks),
    )
    tensors: dict[str, Tensor] = {
        name: getattr(model, name).detach().cpu().contiguous() for name in _REQUIRED
    }
    if model.symmetry is not None:
        tensors[_OPTIONAL] = model.symmetry.detach().cpu().contiguous()
    write_whole(path, save(tensors, metadata={_METADATA: msgspec.json.encode(names).decode()}))


def load_safetensors(path: Path) -> SmalModel:
    """Read the model that save_safetensors wrote, on the CPU.

    Raises:
        ModelFileError: the file is not there, damaged, or breaks the schema.

    Example:
        >>> from tempfile import TemporaryDirectory
        >>> from animal3dbox.smal import load_quadruped
        >>> with TemporaryDirectory() as folder:
        ...     save_safetensors(load_quadruped(), Path(folder, "quadruped.safetensors"))
        ...     load_safetensors(Path(folder, "quadruped.safetensors")).joint_names[0]
        'pelvis'
    """
    try:
        with safe_open(path, framework="pt") as file:
            metadata, keys = file.metadata() or {}, set(file.keys())
            names = _read_names(path, metadata)
            _check_keys(path, keys)
            tensors = {key: file.get_tensor(key) for key in (*_REQUIRED, _OPTIONAL) if key in keys}
    except (SafetensorError, OSError) as error:
        raise ModelFileError(
            f"{path} cannot be read: {error}; check the path, or {_REMEDY}"
        ) from error
    _check_types(path, tensors)
    return checked_model(
        path,
        tensors,
        ModelNames(names.parents, names.joint_names, names.landmarks, names.extra_landmarks),
    )


def _read_names(path: Path, metadata: dict[str, str]) -> _Names:
    if _METADATA not in metadata:
        raise ModelFileError(
            f"{path} is a safetensors file, but no body model: its metadata has no {_METADATA!r};"
            f" {_REMEDY}"
        )
    try:
        return msgspec.json.decode(metadata[_METADATA], type=_Names)
    except (msgspec.DecodeError, RecursionError) as error:
        raise ModelFileError(
            f"{path}: its metadata {_METADATA!r} breaks the schema: {error}; {_REMEDY}"
        ) from error


def _check_keys(path: Path, keys: set[str]) -> None:
    missing, unknown = sorted(set(_REQUIRED) - keys), sorted(keys - set(_REQUIRED) - {_OPTIONAL})
    if missing or unknown:
        raise ModelFileError(
            f"{path} must hold {', '.join(_REQUIRED)}: missing {missing}, unknown {unknown};"
            f" {_REMEDY}"
        )


def _check_types(path: Path, tensors: dict[str, Tensor]) -> None:
    floats = {tensors[key].dtype for key in _FLOATS}
    if len(floats) != 1 or not floats <= {torch.float32, torch.float64}:
        raise ModelFileError(
            f"{path}: {', '.join(_FLOATS)} must all be float64 or all float32, got"
            f" {sorted(map(str, floats))}; {_REMEDY}"
        )
    for key in ("faces", _OPTIONAL):
        if key in tensors and tensors[key].dtype != torch.int64:
            raise ModelFileError(
                f"{path}: {key} must be int64, got {tensors[key].dtype}; {_REMEDY}"
            )
