"""Cameras in JSON files: intrinsics, lens, and the camera's pose relative to a mesh."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np
import torch
from numpy.typing import NDArray

from animal3dbox.datasets.readers.elements import Matrix, read_matrix
from animal3dbox.datasets.storage.json_files import decode_json
from animal3dbox.errors import DatasetFormatError, ShapeError
from animal3dbox.geometry.camera import WEAK_FOCAL, intrinsics
from animal3dbox.geometry.checks import check_intrinsics, check_rotation
from animal3dbox.geometry.distortion import check_distortion

Array = NDArray[np.float64]


class CameraFile(msgspec.Struct, forbid_unknown_fields=True):
    """The keys of a camera's file, all of which may be left out; see docs/formats.md."""

    K: Matrix | None = None
    focal_px: float | None = None
    focal_over_side: float | None = None
    R: Matrix | None = None
    t: list[float] | None = None
    exact: bool = True
    distortion: list[float] | None = None
    image_hw: tuple[int, int] | None = None
    unit_m: float | None = None
    weak_perspective: list[float] | None = None


@dataclass(frozen=True)
class Camera:
    """The camera of one image, checked.

    Attributes:
        K: (3, 3) intrinsics in px; None if they are not known.
        pose: (R, t), X_cam = R X + t with X a vertex of the mesh; None if it is not known.
        exact: whether the pose is known, not a guess.
        distortion: coefficients of OpenCV's lens; None of a pinhole.
        metres_per_unit: metres in a unit of the mesh; None if it is not known.
    """

    K: NDArray[np.float64] | None = None
    pose: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None
    exact: bool = True
    distortion: NDArray[np.float64] | None = None
    metres_per_unit: float | None = None


def load_camera(path: Path, image_hw: tuple[int, int]) -> Camera:
    """The camera of a file, for an image of a size.

    Args:
        path: JSON, see CameraFile and docs/formats.md.
        image_hw: height and width of the image that the camera took.

    Raises:
        DatasetFormatError: no such file, or not a camera; names the file and the key.

    """
    camera: CameraFile = decode_json(path, CameraFile)
    if camera.image_hw is not None and camera.image_hw != image_hw:
        is_turned = camera.image_hw == image_hw[::-1]
        remedy = (
            ": is it for the pixels turned as the picture's EXIF header says, or as stored? See"
            " --orientation (apply_orientation)"
        )
        raise DatasetFormatError(
            f"{path}: image_hw is {list(camera.image_hw)}, but the image is {list(image_hw)}"
            f" (height, width){remedy if is_turned else ''}"
        )
    try:
        if camera.weak_perspective is None:
            K, pose = _intrinsics(camera, image_hw), _pose(camera)
        else:
            K, pose = _weak_perspective(camera, image_hw)
        lens = None if camera.distortion is None else np.array(camera.distortion, dtype=np.float64)
        if lens is not None:
            check_distortion("distortion", lens)
    except (ShapeError, ValueError) as error:  # ValueError: rows of different lengths
        raise DatasetFormatError(f"{path}: {error}") from error
    if camera.unit_m is not None and not (np.isfinite(camera.unit_m) and camera.unit_m > 0):
        raise DatasetFormatError(
            f"{path}: unit_m must be the metres of a unit, above 0, got {camera.unit_m}"
        )
    if K is None and (pose is not None or lens is not None):
        raise DatasetFormatError(
            f"{path}: R, t and distortion mean nothing without K (or focal_px, or focal_over_side)"
        )
    return Camera(
        K=K, pose=pose, exact=camera.exact, distortion=lens, metres_per_unit=camera.unit_m
    )


def weak_perspective_camera(
    weak: Sequence[float], image_hw: tuple[int, int], R: Array | None = None
) -> tuple[Array, tuple[Array, Array]]:
    """K and pose of a camera so far away that its picture is a weak perspective's.

    u = s X + tx and v = s Y + ty, with X, Y, Z = R times a vertex. With a focal length f, t =
    ((tx - cx) / s, (ty - cy) / s, f / s) gives the same to some thousandths of a pixel.

    Args:
        weak: s in px a unit, tx and ty in px.
        image_hw: height and width of the image, in whose middle the principal point is.
        R: (3, 3); None: the mesh's x is to the right and its y down.

    Raises:
        ShapeError: not three finite numbers, or a scale that is not positive.

    Example:
        >>> K, (R, t) = weak_perspective_camera([200.0, 60.0, 50.0], (101, 121))
        >>> float(K[0, 0]) == WEAK_FOCAL, t.tolist()
        (True, [0.0, 0.0, 50000.0])
    """
    if len(weak) != 3 or not np.isfinite(weak).all() or not weak[0] > 0:
        raise ShapeError(
            f"weak_perspective must be s, tx, ty in px with s above 0, got {list(weak)}"
        )
    K = np.asarray(intrinsics(WEAK_FOCAL, image_hw).numpy(), dtype=np.float64)
    scale, x, y = weak
    t = np.array([x - K[0, 2], y - K[1, 2], WEAK_FOCAL]) / scale
    return K, (np.eye(3) if R is None else R, t)


def _weak_perspective(
    camera: CameraFile, image_hw: tuple[int, int]
) -> tuple[Array, tuple[Array, Array]]:
    """K and pose of a file's weak perspective; raises ShapeError."""
    others = [
        name
        for name in ("K", "focal_px", "focal_over_side", "t", "distortion")
        if getattr(camera, name) is not None
    ]
    if others:
        raise ShapeError(f"weak_perspective says it all but R: leave out {' and '.join(others)}")
    R = None if camera.R is None else read_matrix(camera.R)
    if R is not None:
        check_rotation("R", torch.from_numpy(R))
    return weak_perspective_camera(camera.weak_perspective or (), image_hw, R)


def _intrinsics(camera: CameraFile, image_hw: tuple[int, int]) -> NDArray[np.float64] | None:
    """K (3, 3) as it stands, or of a focal length with a centred principal point.

    None if the file has neither. Raises ShapeError.
    """
    keys = [
        name for name in ("K", "focal_px", "focal_over_side") if getattr(camera, name) is not None
    ]
    if len(keys) > 1:
        raise ShapeError(f"give one of {' and '.join(keys)}")
    if camera.K is not None:
        K = read_matrix(camera.K)
        check_intrinsics("K", K)
        return K
    focal = (
        camera.focal_px
        if camera.focal_over_side is None
        else camera.focal_over_side * max(image_hw)
    )
    if focal is not None and not (np.isfinite(focal) and focal > 0):
        raise ShapeError(f"{keys[0]} must be above 0")
    if focal is None:
        return None
    return np.asarray(intrinsics(focal, image_hw).numpy(), dtype=np.float64)


def _pose(camera: CameraFile) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """R (3, 3) and t (3,) of a file, None if it has neither; raises ShapeError."""
    if camera.R is None and camera.t is None:
        return None
    if camera.R is None or camera.t is None:
        raise ShapeError("give both R and t, or neither: X_cam = R X + t")
    R, t = read_matrix(camera.R), np.array(camera.t, dtype=np.float64)
    check_rotation("R", torch.from_numpy(R))
    if t.shape != (3,) or not np.isfinite(t).all():
        raise ShapeError(f"t must be 3 finite numbers, got {camera.t}")
    return R, t
