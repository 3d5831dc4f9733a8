"""Checks that every body model from a file must pass, whatever the file's format."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from torch import Tensor

from animal3dbox.errors import ModelFileError, ShapeError
from animal3dbox.geometry.checks import check_finite
from animal3dbox.smal.model import SmalModel

REMEDY = (
    "the file is no SMAL-family model, or a program changed it: get the model from its authors'"
    " site"
)
_WEIGHT_SLACK = 1e-3  # real weights are rounded

Groups = Mapping[str, tuple[int, ...]]


@dataclass(frozen=True)
class ModelNames:
    """The parts of a model that are not arrays, as in SmalModel."""

    parents: tuple[int, ...]
    joint_names: tuple[str, ...]
    landmarks: Groups
    extra_landmarks: Groups = field(default_factory=dict)


def checked_model(path: Path, tensors: Mapping[str, Tensor], names: ModelNames) -> SmalModel:
    """The model of a file's parts, after all checks.

    Args:
        path: the file, for errors.
        tensors: v_template, faces, shapedirs, posedirs, J_regressor, weights and, if there is one,
            symmetry.
        names: the rest.

    Raises:
        ModelFileError: parts do not fit together, are not finite, or point to vertices that there
            are not.

    """
    if not names.parents:
        raise ModelFileError(f"{path}: parents must name at least the root; {REMEDY}")
    try:
        model = SmalModel(
            v_template=tensors["v_template"],
            faces=tensors["faces"],
            shapedirs=tensors["shapedirs"],
            posedirs=tensors["posedirs"],
            J_regressor=tensors["J_regressor"],
            weights=tensors["weights"],
            parents=names.parents,
            joint_names=names.joint_names,
            landmarks=names.landmarks,
            symmetry=tensors.get("symmetry"),
            extra_landmarks=names.extra_landmarks,
        )
        for name, tensor in tensors.items():
            if tensor.is_floating_point():
                check_finite(name, tensor)
    except ShapeError as error:
        raise ModelFileError(f"{path}: {error}; {REMEDY}") from error
    check_faces(path, "faces", model.faces, model.vertex_count)
    check_weights(path, model.weights)
    if model.symmetry is not None:
        check_involution(path, "symmetry", model.symmetry)
    return model


def check_faces(path: Path, key: str, faces: Tensor, vertex_count: int) -> None:
    """Raise unless all entries of faces (F, 3) are indices of vertices."""
    if not faces.numel() or not 0 <= int(faces.min()) <= int(faces.max()) < vertex_count:
        got = f"{int(faces.min())} to {int(faces.max())}" if faces.numel() else "no faces"
        raise ModelFileError(
            f"{path}: {key} must hold vertex numbers from 0 to {vertex_count - 1}, got {got};"
            f" {REMEDY}"
        )


def check_weights(path: Path, weights: Tensor) -> None:
    """Raise unless the rows of weights (V, J) are shares of 1."""
    sums = weights.sum(dim=1)
    if float((sums - 1).abs().max()) > _WEIGHT_SLACK or float(weights.min()) < -_WEIGHT_SLACK:
        raise ModelFileError(
            f"{path}: weights must be shares whose rows sum to 1, got sums from"
            f" {float(sums.min()):.4g} to {float(sums.max()):.4g} and a least weight of"
            f" {float(weights.min()):.4g}; {REMEDY}"
        )


def check_involution(path: Path, key: str, symmetry: Tensor) -> None:
    """Raise unless symmetry (V,) maps each vertex to a mirror image that it is the image of."""
    count = symmetry.shape[0]
    if not count or not 0 <= int(symmetry.min()) <= int(symmetry.max()) < count:
        raise ModelFileError(
            f"{path}: {key} must hold {count} vertex numbers from 0 to {count - 1}; take the file"
            " that belongs to the model"
        )
    wrong = (symmetry[symmetry] != symmetry.new_tensor(range(count))).nonzero()[:, 0]
    if len(wrong):
        first = int(wrong[0])
        raise ModelFileError(
            f"{path}: {key} must be its own inverse, but {len(wrong)} of {count} vertices do not"
            f" come back: {first} -> {int(symmetry[first])} -> {int(symmetry[symmetry[first]])};"
            " take the file that belongs to the model"
        )
