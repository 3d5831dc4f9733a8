"""A camera in a JSON file: intrinsics, lens, and where it stands to a mesh."""

from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np
import torch
from numpy.typing import NDArray

from animal3dbox.datasets.storage.json_files import decode_json
from animal3dbox.errors import DatasetFormatError, ShapeError
from animal3dbox.geometry.camera import intrinsics
from animal3dbox.geometry.checks import check_intrinsics, check_rotation
from animal3dbox.geometry.distortion import check_distortion


class CameraFile(msgspec.Struct, forbid_unknown_fields=True):
    """The file's keys; all may be left out."""

    K: list[list[float]] | None = None
    focal_px: float | None = None
    focal_over_side: float | None = None
    R: list[list[float]] | None = None
    t: list[float] | None = None
    exact: bool = True
    distortion: list[float] | None = None
    image_hw: tuple[int, int] | None = None
    unit_m: float | None = None


@dataclass(frozen=True)
class Camera:
    """A camera for an image of a size, checked.

    Attributes:
        K: (3, 3) in px; None if it is not known.
        pose: (R, t), X_cam = R X + t with X a vertex of the mesh; None if it is not known.
        exact: whether the pose is known, not a guess.
        distortion: coefficients of OpenCV's lens; None of a pinhole.
        metres_per_unit: of the mesh's unit; None if it is not known.
    """

    K: NDArray[np.float64] | None = None
    pose: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None
    exact: bool = True
    distortion: NDArray[np.float64] | None = None
    metres_per_unit: float | None = None


def load_camera(path: Path, image_hw: tuple[int, int]) -> Camera:
    """The camera of a file.

    Args:
        path: JSON, see CameraFile and docs/formats.md.
        image_hw: of the image that it took.

    Raises:
        DatasetFormatError: no such file, or not a camera; names the file and the key.

    """
    said: CameraFile = decode_json(path, CameraFile)
    if said.image_hw is not None and said.image_hw != image_hw:
        raise DatasetFormatError(
            f"{path}: image_hw is {list(said.image_hw)}, but the image is {list(image_hw)} (height,"
            " width)"
        )
    try:
        K, pose = _intrinsics(said, image_hw), _pose(said)
        lens = None if said.distortion is None else np.array(said.distortion, dtype=np.float64)
        if lens is not None:
            check_distortion("distortion", lens)
    except (ShapeError, ValueError) as error:  # ValueError: rows of different lengths
        raise DatasetFormatError(f"{path}: {error}") from error
    if said.unit_m is not None and not (np.isfinite(said.unit_m) and said.unit_m > 0):
        raise DatasetFormatError(
            f"{path}: unit_m must be the metres of a unit, above 0, got {said.unit_m}"
        )
    if K is None and (pose is not None or lens is not None):
        raise DatasetFormatError(
            f"{path}: R, t and distortion mean nothing without K (or focal_px, or focal_over_side)"
        )
    return Camera(K, pose, said.exact, lens, said.unit_m)


def _intrinsics(said: CameraFile, image_hw: tuple[int, int]) -> NDArray[np.float64] | None:
    """K as it stands, or of a focal length with a centred principal point."""
    told = [
        name for name in ("K", "focal_px", "focal_over_side") if getattr(said, name) is not None
    ]
    if len(told) > 1:
        raise ShapeError(f"give one of {' and '.join(told)}")
    if said.K is not None:
        K = np.array(said.K, dtype=np.float64)
        check_intrinsics("K", K)
        return K
    focal = said.focal_px if said.focal_over_side is None else said.focal_over_side * max(image_hw)
    if focal is not None and not (np.isfinite(focal) and focal > 0):
        raise ShapeError(f"{told[0]} must be above 0")
    return (
        None if focal is None else np.asarray(intrinsics(focal, image_hw).numpy(), dtype=np.float64)
    )


def _pose(said: CameraFile) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    if said.R is None and said.t is None:
        return None
    if said.R is None or said.t is None:
        raise ShapeError("give both R and t, or neither: X_cam = R X + t")
    R, t = np.array(said.R, dtype=np.float64), np.array(said.t, dtype=np.float64)
    check_rotation("R", torch.from_numpy(R))
    if t.shape != (3,) or not np.isfinite(t).all():
        raise ShapeError(f"t must be 3 finite numbers, got {said.t}")
    return R, t
