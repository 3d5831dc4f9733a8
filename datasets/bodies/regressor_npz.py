"""Bodies in the npz files of mesh regressors, under the keys that their own code writes.

GenZoo's have vertices_3d and no faces, which are the model's, beside its parameters: pose as
rotation matrices, and beta. FMPose3D's have the 26 landmarks of Animal3D alone.
"""

import zipfile
import zlib
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from animal3dbox.datasets.bodies.mesh_formats import check_mesh
from animal3dbox.errors import DatasetFormatError, ShapeError
from animal3dbox.geometry.arrays import as_numpy
from animal3dbox.geometry.checks import check_rotation
from animal3dbox.geometry.rigid_transforms import axis_angle_from_rotation
from animal3dbox.smal.keypoints.vocabularies import ANIMAL3D_26
from animal3dbox.smal.model import SmalModel
from animal3dbox.smal.parameters import SmalParameters, posed_body

Array = NDArray[np.float64]
Arrays = dict[str, NDArray[np.generic]]
LANDMARKS = ("pose3d", "pose_3d")
"""Keys of the landmarks (26, 3) of a skeleton without a body."""
WEAK_PERSPECTIVE = ("scale", "tx", "ty")
"""Keys of GenZoo's camera, in parts of its picture's side."""


def npz_names(path: Path) -> tuple[str, ...]:
    """The names of the arrays of an npz file, none of which is decoded.

    Raises:
        DatasetFormatError: no such file.

    """
    try:
        # Opened here, since NumPy leaves the file of a damaged archive open.
        with path.open("rb") as file, np.load(file, allow_pickle=False) as arrays:
            return tuple(arrays.files)
    except (ValueError, TypeError, AttributeError, OSError, EOFError, zipfile.BadZipFile) as error:
        raise DatasetFormatError(f"{path} cannot be read as a mesh: {error}") from error


def npz_arrays(path: Path, names: tuple[str, ...]) -> Arrays:
    """Those arrays of an npz file that it has of these names; nothing is unpickled.

    Raises:
        DatasetFormatError: no such file, or an array that holds objects.

    """
    try:
        # Opened here, since NumPy leaves the file of a damaged archive open.
        with path.open("rb") as file, np.load(file, allow_pickle=False) as arrays:
            return {name: np.asarray(arrays[name]) for name in names if name in arrays}
    except (ValueError, TypeError, OSError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        raise DatasetFormatError(f"{path} cannot be read as an npz: {error}") from error


def skeleton_of(path: Path) -> dict[str, Array]:
    """Keypoint name -> place (3,) of an npz that holds a skeleton alone.

    Raises:
        DatasetFormatError: other than 26 finite points.

    """
    points = next(iter(npz_arrays(path, LANDMARKS).values()))
    places = points.astype(np.float64)
    if places.shape != (len(ANIMAL3D_26), 3) or not np.isfinite(places).all():
        raise DatasetFormatError(
            f"{path} must have the 26 finite points of Animal3D in {' or '.join(LANDMARKS)}, got"
            f" {places.shape}"
        )
    return dict(zip(ANIMAL3D_26, places, strict=True))


def posed_mesh(path: Path, model: SmalModel | None) -> tuple[Array, NDArray[np.int64]]:
    """The vertices (V, 3) and the model's faces (F, 3) of an npz of a regressor.

    Args:
        path: a file with vertices_3d, or with pose and beta.
        model: whose faces they are, or which is posed; None if it is not known.

    Raises:
        DatasetFormatError: neither, or nothing that the model can have.

    """
    arrays = npz_arrays(path, ("vertices_3d", "pose", "beta", "betas"))
    if "vertices_3d" not in arrays and "pose" not in arrays:
        raise DatasetFormatError(
            f"{path} must have vertices and faces, or vertices_3d, or pose and beta, or pose3d: is"
            " it a mesh?"
        )
    if model is None:
        raise DatasetFormatError(
            f"{path} has no faces: give --model, the SMAL file that it was made with"
        )
    faces = as_numpy(model.faces).astype(np.int64)
    if "vertices_3d" not in arrays:
        return _posed(path, arrays, model), faces
    vertices = arrays["vertices_3d"].astype(np.float64)
    if len(vertices) != model.vertex_count:
        raise DatasetFormatError(
            f"{path} has {len(vertices)} vertices, but --model {model.vertex_count}: give the model"
            " that it was made with"
        )
    check_mesh(vertices, faces, path)
    return vertices, faces


def _posed(path: Path, arrays: Arrays, model: SmalModel) -> Array:
    """The vertices (V, 3) of a model in a file's pose and shape."""
    betas = arrays.get("beta", arrays.get("betas", np.zeros(0))).reshape(-1)
    pose = torch.from_numpy(arrays["pose"].astype(np.float64))
    try:
        if pose.ndim == 3:
            check_rotation("pose", pose)
            pose = axis_angle_from_rotation(pose)
        shape = torch.from_numpy(betas.astype(np.float64))
        body = posed_body(model, SmalParameters(pose, shape, torch.zeros(3, dtype=torch.float64)))
    except (ShapeError, ValueError) as error:
        raise DatasetFormatError(f"{path} does not fit --model: {error}") from error
    return np.asarray(as_numpy(body.vertices)[0], dtype=np.float64)


def weak_perspective_of(path: Path, image_hw: tuple[int, int]) -> tuple[float, float, float] | None:
    """Scale and shifts in px of a GenZoo npz for its picture; None of a file without them.

    u = s X + tx and v = s Y + ty, X to the right and Y down. The file has them in parts of the
    picture's side, the middle being 0, and its own code takes the width for both sides.

    Raises:
        DatasetFormatError: the picture is not square, so that nobody knows what the parts are of.

    """
    arrays = npz_arrays(path, WEAK_PERSPECTIVE)
    if len(arrays) < len(WEAK_PERSPECTIVE):
        return None
    if any(one.size != 1 for one in arrays.values()):
        raise DatasetFormatError(f"{path} must have one number in each of scale, tx, ty")
    height, width = image_hw
    if height != width:
        raise DatasetFormatError(
            f"{path} has scale, tx and ty in parts of a square picture, and the image is {width} x"
            f" {height}: give weak_perspective in px in a file of cameras/"
        )
    scale, x, y = (float(arrays[name].reshape(-1)[0]) for name in WEAK_PERSPECTIVE)
    return scale * width, (x + 0.5) * width, (y + 0.5) * width
