"""Reading of body models: SMAL's pickles, their companions (families, symmetry), safetensors."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from animal3dbox.errors import ConfigError, ModelFileError
from animal3dbox.smal.files.model_checks import (
    REMEDY,
    ModelNames,
    check_faces,
    check_involution,
    checked_model,
)
from animal3dbox.smal.files.safetensors_file import load_safetensors
from animal3dbox.smal.keypoints.smal_topology import (
    SMAL_EXTRA_LANDMARKS,
    SMAL_LANDMARKS,
    SMAL_VERTICES,
    joint_names,
)
from animal3dbox.smal.model import SmalModel
from animal3dbox.smal.model_origin import ModelOrigin, model_content, remember
from animal3dbox.smal.safe_pickle.arrays import Array, Place, read_array, read_array_list
from animal3dbox.smal.safe_pickle.reader import DEFAULT_LIMITS, read_pickle
from animal3dbox.smal.safe_pickle.stream import PickleLimits, describe

PICKLE_SUFFIXES = (".pkl", ".pickle")
SAFETENSORS_SUFFIX = ".safetensors"
_NO_PARENT = (-1, 2**32 - 1, 2**64 - 1)  # -1 in the types in which files hold it

LandmarkIds = Mapping[str, Sequence[int]]


@dataclass(frozen=True)
class ShapeFamily:
    """The clusters of shapes, one a species family, that SMAL's authors give beside the model.

    Attributes:
        means: (C, S) betas.
        covariances: (C, S, S) of the betas.

    Example:
        >>> family = ShapeFamily(torch.zeros(5, 41), torch.eye(41).expand(5, 41, 41))
        >>> len(family.means)
        5
    """

    means: Tensor
    covariances: Tensor


@dataclass(frozen=True)
class _Content:
    """A pickled dictionary whose values become arrays on demand."""

    path: Path
    values: dict[object, object]
    limits: PickleLimits

    def array(self, key: str, shape: tuple[int | str, ...], kinds: str = "fiu") -> Array:
        """The array of a key, checked.

        Args:
            key: of the dictionary.
            shape: a number is that size, a word any but 0.
            kinds: NumPy's letters of the types allowed: f, i, u.

        """
        array = read_array(self.values[key], Place(str(self.path), key, self.limits))
        fits = len(array.shape) == len(shape) and all(
            size == want if isinstance(want, int) else size > 0
            for size, want in zip(array.shape, shape, strict=True)
        )
        if not fits:
            wanted = ", ".join(str(size) for size in shape)
            raise ModelFileError(
                f"{self.path}: {key} must have shape ({wanted}), got {array.shape}; {REMEDY}"
            )
        if array.dtype.kind not in kinds:
            raise ModelFileError(
                f"{self.path}: {key} must hold {'numbers' if 'f' in kinds else 'whole numbers'},"
                f" got {array.dtype}; {REMEDY}"
            )
        return array

    def floats(self, key: str, shape: tuple[int | str, ...]) -> Tensor:
        """The numbers of a key as a float64 tensor; see array."""
        return torch.from_numpy(self.array(key, shape).astype(np.float64, copy=False))


def load_model(path: Path, landmarks: LandmarkIds | None = None) -> SmalModel:
    """Read a body model, by its file's suffix: .safetensors, or .pkl and .pickle as load_smal does.

    It is sent to other processes as the file's path and digest, and loaded there once.

    Args:
        path: the file.
        landmarks: as load_smal's, for pickles.

    Raises:
        ConfigError: another suffix, or landmarks for a safetensors file, which has its own.
        ModelFileError: the file is refused.

    Example:
        >>> from tempfile import TemporaryDirectory
        >>> from animal3dbox.smal import load_quadruped, save_safetensors
        >>> with TemporaryDirectory() as folder:
        ...     save_safetensors(load_quadruped(), Path(folder, "quadruped.safetensors"))
        ...     load_model(Path(folder, "quadruped.safetensors")).vertex_count
        5852
    """
    suffix = path.suffix.lower()
    if suffix not in (SAFETENSORS_SUFFIX, *PICKLE_SUFFIXES):
        raise ConfigError(
            f"a body model's file must end in {', '.join((SAFETENSORS_SUFFIX, *PICKLE_SUFFIXES))},"
            f" got {path}"
        )
    if suffix == SAFETENSORS_SUFFIX and landmarks is not None:
        raise ConfigError(f"landmarks are for pickles; {path} holds its own")
    model = load_safetensors(path) if suffix == SAFETENSORS_SUFFIX else load_smal(path, landmarks)
    places = None if landmarks is None else tuple((k, tuple(v)) for k, v in landmarks.items())
    home = path.absolute()
    return remember(model, ModelOrigin(_load_again, (home, places), home, model_content(home)))


def _load_again(path: Path, landmarks: tuple[tuple[str, tuple[int, ...]], ...] | None) -> SmalModel:
    """The model that load_model gave of the same arguments."""
    return load_model(path, None if landmarks is None else dict(landmarks))


def load_smal(
    path: Path,
    landmarks: LandmarkIds | None = None,
    *,
    symmetry: Tensor | None = None,
    limits: PickleLimits = DEFAULT_LIMITS,
) -> SmalModel:
    """Read a model from a SMAL-family pickle, float64 on the CPU.

    Nothing that the file names is imported or called.

    Args:
        path: the file.
        landmarks: keypoint name -> vertex ids. None: SMAL's own if the model has SMAL's 3889
            vertices, else none.
        symmetry: (V,) as load_symmetry gives it.
        limits: how much the file may ask for.

    Raises:
        ModelFileError: the file is damaged, hostile, or no such model; says which key, what was
            expected, what came.

    Example:
        >>> from tempfile import TemporaryDirectory
        >>> from animal3dbox.smal import load_quadruped, write_smal_pickle
        >>> with TemporaryDirectory() as folder:
        ...     write_smal_pickle(load_quadruped(), Path(folder, "smal.pkl"))
        ...     load_smal(Path(folder, "smal.pkl"), {"nose": (7,)}).landmarks
        {'nose': (7,)}
    """
    content = _read_dictionary(
        path,
        ("v_template", "f", "shapedirs", "posedirs", "J_regressor", "kintree_table", "weights"),
        limits,
    )
    parents = _read_parents(content)
    J = len(parents)
    v_template = content.floats("v_template", ("V", 3))
    V = v_template.shape[0]
    faces = torch.from_numpy(content.array("f", ("F", 3), kinds="iu").astype(np.int64))
    check_faces(path, "f", faces, V)
    tensors = {
        "v_template": v_template,
        "faces": faces,
        "shapedirs": content.floats("shapedirs", (V, 3, "S")),
        "posedirs": content.floats("posedirs", (V, 3, 9 * (J - 1))),
        "weights": content.floats("weights", (V, J)),
        "J_regressor": content.floats("J_regressor", (J, V)),
    }
    if symmetry is not None:
        tensors["symmetry"] = symmetry
    return checked_model(path, tensors, _names(parents, V, landmarks))


def load_family(path: Path, limits: PickleLimits = DEFAULT_LIMITS) -> ShapeFamily:
    """Read the clusters of shapes of `my_smpl_data_*.pkl`, float64.

    Raises:
        ModelFileError: as load_smal.

    Example:
        >>> import pickle
        >>> from tempfile import TemporaryDirectory
        >>> clusters = {"cluster_means": np.zeros((2, 3)), "cluster_cov": [np.eye(3)] * 2}
        >>> with TemporaryDirectory() as folder:
        ...     _ = Path(folder, "family.pkl").write_bytes(pickle.dumps(clusters))
        ...     load_family(Path(folder, "family.pkl")).covariances.shape
        torch.Size([2, 3, 3])
    """
    content = _read_dictionary(path, ("cluster_means", "cluster_cov"), limits)
    means = content.floats("cluster_means", ("C", "S"))
    C, S = means.shape
    members = read_array_list(
        content.values["cluster_cov"], Place(str(path), "cluster_cov", limits), (C, S, S)
    )
    if members.dtype.kind not in "fiu":
        raise ModelFileError(
            f"{path}: cluster_cov must hold numbers, got {members.dtype}; {REMEDY}"
        )
    covariances = torch.from_numpy(members.astype(np.float64))
    if not bool(torch.isfinite(means).all() and torch.isfinite(covariances).all()):
        raise ModelFileError(f"{path}: cluster_means and cluster_cov must be finite; {REMEDY}")
    return ShapeFamily(means, covariances)


def load_symmetry(
    path: Path, vertex_count: int | None = None, limits: PickleLimits = DEFAULT_LIMITS
) -> Tensor:
    """Read each vertex's mirror image, (V,) int64, from SMAL's `symIdx.pkl`.

    Args:
        path: the file.
        vertex_count: V, if it is known.
        limits: how much the file may ask for.

    Raises:
        ModelFileError: as load_smal, and if the mirror image's mirror image is another vertex.

    Example:
        >>> import pickle
        >>> from tempfile import TemporaryDirectory
        >>> with TemporaryDirectory() as folder:
        ...     _ = Path(folder, "symIdx.pkl").write_bytes(pickle.dumps(np.array([1, 0, 2])))
        ...     load_symmetry(Path(folder, "symIdx.pkl")).tolist()
        [1, 0, 2]
    """
    value = read_pickle(path, limits)
    if isinstance(value, dict):
        value = _read_key(path, value, "symIdx")
    content = _Content(path, {"symIdx": value}, limits)
    numbers = content.array("symIdx", ("V" if vertex_count is None else vertex_count,))
    with np.errstate(invalid="ignore"):  # NaN and the like become numbers that differ from them
        whole = numbers.astype(np.int64)
    if not np.array_equal(whole, numbers):
        raise ModelFileError(
            f"{path}: symIdx must hold whole numbers; take the file that belongs to the model"
        )
    symmetry = torch.from_numpy(whole)
    check_involution(path, "symIdx", symmetry)
    return symmetry


def _read_dictionary(path: Path, keys: tuple[str, ...], limits: PickleLimits) -> _Content:
    """The dictionary of a pickle, which must have all of the keys."""
    value = read_pickle(path, limits)
    if not isinstance(value, dict):
        raise ModelFileError(
            f"{path}: expected a dictionary with {', '.join(keys)}, got {describe(value)}; {REMEDY}"
        )
    for key in keys:
        _read_key(path, value, key)
    return _Content(path, value, limits)


def _read_key(path: Path, values: dict[object, object], key: str) -> object:
    if key not in values:
        names = sorted(ascii(name[:40])[1:-1] for name in values if isinstance(name, str))[:20]
        raise ModelFileError(
            f"{path}: the key {key} is missing; there are {', '.join(names) or 'no names'};"
            f" {REMEDY}"
        )
    return values[key]


def _read_parents(content: _Content) -> tuple[int, ...]:
    """The parent of each joint from kintree_table, whose row 1 names joints and row 0 parents."""
    table = content.array("kintree_table", (2, "J"), kinds="iu")
    parent_ids, ids = table.tolist()
    column = {joint: c for c, joint in enumerate(ids)}
    if len(column) != len(ids):
        raise ModelFileError(
            f"{content.path}: kintree_table must name each joint once in row 1; {REMEDY}"
        )
    parents = tuple(
        -1 if parent in _NO_PARENT else column.get(parent, len(ids)) for parent in parent_ids
    )
    for c, parent in enumerate(parents):
        if (c == 0) != (parent == -1) or parent >= max(c, 1):
            raise ModelFileError(
                f"{content.path}: kintree_table must start with the root, and give each other joint"
                f" an earlier one for its parent, but column {c} (joint {ids[c]}) has parent"
                f" {parent_ids[c]}; {REMEDY}"
            )
    return parents


def _names(
    parents: tuple[int, ...], vertex_count: int, landmarks: LandmarkIds | None
) -> ModelNames:
    if landmarks is not None:
        return ModelNames(
            parents, joint_names(parents), {name: tuple(ids) for name, ids in landmarks.items()}
        )
    if vertex_count == SMAL_VERTICES:
        return ModelNames(parents, joint_names(parents), SMAL_LANDMARKS, SMAL_EXTRA_LANDMARKS)
    return ModelNames(parents, joint_names(parents), {})
