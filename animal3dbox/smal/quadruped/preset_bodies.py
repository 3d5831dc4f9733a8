"""The embedded quadruped and its presets, one a species.

A licence-free body of SMAL's structure, made by `animal3dbox.smal.quadruped.modelling`.

The template frame is x forward, y to the animal's left, z up; the soles stand on z = 0. It is about
one unit long from nose to rump, and so are all presets: the column `size` (or a camera further
away) makes a cow larger than a cat.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib import resources

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from animal3dbox.errors import ConfigError
from animal3dbox.smal.model import SmalModel
from animal3dbox.smal.model_origin import ModelOrigin, remember

_ASSET = "quadruped.npz"
_KEYPOINTS = 26
"""How many of the asset's landmarks, from the first, are the keypoints of Animal3D."""

Arrays = Mapping[str, NDArray[np.generic]]


@dataclass(frozen=True)
class QuadrupedNames:
    """The names of the quadruped's shape columns.

    Attributes:
        columns: a name for each of the S shape columns.
        measures: those that change one named measure.
        presets: those that turn the template into a species at beta 1.

    Example:
        >>> quadruped_names().measures[:3]
        ('size', 'leg_length', 'leg_thickness')
    """

    columns: tuple[str, ...]
    measures: tuple[str, ...]
    presets: tuple[str, ...]


@cache
def load_quadruped() -> SmalModel:
    """The embedded quadruped, float64 on the CPU; the same object every time.

    Example:
        >>> model = load_quadruped()
        >>> model.vertex_count, model.joint_count, model.beta_count
        (5852, 35, 41)
    """
    arrays = _asset()
    half, seam = (
        _float64(arrays, "vertices") * _float64(arrays, "vertices_scale"),
        int(arrays["seam"]),
    )
    symmetry = _symmetry(len(half), seam)
    weights = _whole_weights(arrays, symmetry)
    regressor = np.zeros((len(_words(arrays, "joint_names")), len(symmetry)))
    regressor[arrays["regressor_rows"], arrays["regressor_cols"]] = arrays["regressor_values"]
    columns = _float64(arrays, "columns").transpose(2, 1, 0) * _float64(arrays, "columns_scale")
    v_template = torch.from_numpy(_whole(half, seam))
    joints = torch.from_numpy(regressor / regressor.sum(axis=1, keepdims=True))
    # Not a BLAS product, whose last digits depend on the threads: caches are named by these numbers
    places = torch.from_numpy(np.einsum("jv,vc->jc", joints.numpy(), v_template.numpy()))
    parents = tuple(int(p) for p in arrays["parents"])
    model = SmalModel(
        v_template=v_template,
        faces=torch.from_numpy(_whole_faces(arrays["faces"].astype(np.int64), symmetry)),
        shapedirs=torch.from_numpy(_whole(columns, seam)),
        posedirs=_volume_keeping(v_template, places, torch.from_numpy(weights), parents),
        J_regressor=joints,
        weights=torch.from_numpy(weights),
        parents=parents,
        joint_names=_words(arrays, "joint_names"),
        landmarks=dict(list(_landmarks(arrays).items())[:_KEYPOINTS]),
        symmetry=torch.from_numpy(symmetry),
        extra_landmarks=dict(list(_landmarks(arrays).items())[_KEYPOINTS:]),
    )
    return remember(model, ModelOrigin(load_quadruped))


@cache
def quadruped_names() -> QuadrupedNames:
    """The names of the quadruped's shape columns, and which of them are measures and presets.

    Example:
        >>> quadruped_names().presets[:4]
        ('dog', 'cat', 'horse', 'cow')
    """
    arrays = _asset()
    return QuadrupedNames(
        columns=_words(arrays, "column_names"),
        measures=_words(arrays, "measure_names"),
        presets=_words(arrays, "preset_names"),
    )


def preset_betas(name: str) -> Tensor:
    """The betas (S,) of a species, float64.

    Raises:
        ConfigError: naming the presets there are.

    Example:
        >>> int(preset_betas("dog").argmax()) == quadruped_names().columns.index("dog")
        True
    """
    names = quadruped_names()
    if name not in names.presets:
        raise ConfigError(f"preset must be one of {', '.join(names.presets)}, got {name!r}")
    return measure_betas({name: 1.0})


def measure_betas(amounts: Mapping[str, float]) -> Tensor:
    """The betas (S,), float64, of amounts of named shape columns.

    They add, so `{"dog": 1, "leg_length": -2}` is a dachshund's way.

    Raises:
        ConfigError: naming the columns there are.

    Example:
        >>> measure_betas({"dog": 1, "leg_length": -2}).unique().tolist()
        [-2.0, 0.0, 1.0]
    """
    columns = quadruped_names().columns
    betas = torch.zeros(len(columns), dtype=torch.float64)
    for name, amount in amounts.items():
        if name not in columns:
            raise ConfigError(f"a shape column must be one of {', '.join(columns)}, got {name!r}")
        betas[columns.index(name)] = amount
    return betas


@cache
def _asset() -> Arrays:
    """The packed arrays, see modelling/asset.py."""
    with (
        resources.files("animal3dbox.smal").joinpath("assets", _ASSET).open("rb") as file,
        np.load(file, allow_pickle=False) as packed,
    ):
        return dict(packed.items())


def _float64(arrays: Arrays, key: str) -> NDArray[np.float64]:
    return arrays[key].astype(np.float64)


def _words(arrays: Arrays, key: str) -> tuple[str, ...]:
    return tuple(str(arrays[key]).split())


def _landmarks(arrays: Arrays) -> dict[str, tuple[int, ...]]:
    """Landmark -> vertex ids."""
    groups = np.split(arrays["landmark_vertices"], np.cumsum(arrays["landmark_counts"])[:-1])
    return {
        name: tuple(int(i) for i in group)
        for name, group in zip(_words(arrays, "landmark_names"), groups, strict=True)
    }


def _symmetry(half_count: int, seam: int) -> NDArray[np.int64]:
    """The mirror image (V,) of each vertex.

    The asset stores the left half, the vertices on the seam first; the right half follows it.
    """
    right = np.arange(half_count, 2 * half_count - seam)
    return np.concatenate([np.arange(seam), right, np.arange(seam, half_count)])


def _whole(half: NDArray[np.float64], seam: int) -> NDArray[np.float64]:
    """Both halves (V, 3, ...) of values (H, 3, ...) that mirror by their y."""
    sign = np.array([1.0, -1.0, 1.0]).reshape((1, 3) + (1,) * (half.ndim - 2))
    return np.concatenate([half, half[seam:] * sign])


def _whole_faces(faces: NDArray[np.int64], symmetry: NDArray[np.int64]) -> NDArray[np.int64]:
    """The faces of both halves; those of the right one run the other way round."""
    return np.concatenate([faces, symmetry[faces][:, ::-1]])


def _whole_weights(arrays: Arrays, symmetry: NDArray[np.int64]) -> NDArray[np.float64]:
    """The dense weights (V, J), with rows that sum to 1.

    A right vertex takes its mirror image's with left and right joints swapped.
    """
    names, joints = _words(arrays, "joint_names"), arrays["weight_joints"].astype(np.int64)
    values = _float64(arrays, "weight_values")
    half = np.zeros((len(joints), len(names)))
    np.put_along_axis(half, joints, values / values.sum(axis=1, keepdims=True), axis=1)
    swap = {"L": "R", "R": "L"}
    mirror = [names.index(swap[name[0]] + name[1:] if name[0] in swap else name) for name in names]
    return np.concatenate([half, half[symmetry[len(half) :]][:, mirror]])


def _volume_keeping(
    v_template: Tensor, joints: Tensor, weights: Tensor, parents: tuple[int, ...]
) -> Tensor:
    """Pose correctives (V, 3, 9 (J - 1)) for the volume that blending takes at a bent joint.

    A vertex at r from a joint, moved by it with share w, is drawn towards the joint's axis by
    w (1 - w) (1 - cos a) r⊥. As the symmetric part of R - I is -(1 - cos a) times the projection
    across the axis, this is linear in R - I for every axis.
    """
    V, J = weights.shape
    shares = weights.clone()  # w of a joint and all beyond it
    for j in range(J - 1, 0, -1):
        shares[:, parents[j]] += shares[:, j]
    loss = (shares * (1 - shares))[:, 1:]
    offset = v_template[:, None] - joints[None, 1:]
    pull = -0.5 * loss[..., None] * offset  # (V, J - 1, 3)
    correctives = torch.zeros(V, 3, J - 1, 3, 3, dtype=v_template.dtype)
    for c in range(3):
        correctives[:, c, :, c, :] += pull
        correctives[:, c, :, :, c] += pull
    return correctives.flatten(2)
