"""A small mesh folder: the toy animal under known cameras, and every fault a folder can have."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from animals import camera_round, toy_landmarks, toy_mesh
from photo_dataset import HW, K
from PIL import Image
from torch import Tensor

from animal3dbox.geometry.camera import project
from animal3dbox.geometry.rasterizer import silhouette
from animal3dbox.smal.keypoints.vocabularies import ANIMAL3D_26

LANDMARK_IDS = {name: list(range(6 * row, 6 * row + 6)) for row, name in enumerate(ANIMAL3D_26)}
"""The octahedron round each landmark, whose mean it is."""


def obj_text(vertices: Tensor, faces: Tensor) -> str:
    """A mesh as an OBJ."""
    lines = ["v " + " ".join(f"{value:.17g}" for value in vertex) for vertex in vertices.tolist()]
    lines += ["f " + " ".join(str(i + 1) for i in face) for face in faces.tolist()]
    return "\n".join(lines) + "\n"


def write_json(path: Path, content: object) -> Path:
    """A JSON file and its folders."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content))
    return path


def camera_json(azimuth_deg: float, distance: float = 2.4) -> dict[str, Any]:
    """The camera that sees the toy animal from an azimuth."""
    R, t = camera_round(azimuth_deg, 12.0, distance)
    return {"K": K.tolist(), "R": R.tolist(), "t": t.tolist(), "image_hw": list(HW)}


def keypoints_json(azimuth_deg: float) -> dict[str, list[float]]:
    """The 26 keypoints by name as that camera sees them."""
    R, t = camera_round(azimuth_deg, 12.0, 2.4)
    px, _ = project(K, toy_landmarks() @ R.mT + t)
    return {name: [x, y, 1.0] for name, (x, y) in zip(ANIMAL3D_26, px.tolist(), strict=True)}


def write_picture(path: Path, level: int = 120) -> None:
    """A grey picture of the common size."""
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.new("RGB", (HW[1], HW[0]), (level, level, level)).save(path)


def write_mask(path: Path, azimuth_deg: float) -> None:
    """The toy animal's mask."""
    R, t = camera_round(azimuth_deg, 12.0, 2.4)
    vertices, faces = toy_mesh()
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(
        np.asarray(silhouette(vertices @ R.mT + t, faces, K, HW).numpy(), dtype=np.uint8)
        * np.uint8(255)
    ).save(path)


def write_mesh_folder(root: Path) -> Path:
    """a.jpg with a known camera and a mask, b.jpg with keypoints."""
    vertices, faces = toy_mesh()
    for name in ("a", "b"):
        write_picture(root / "images" / f"{name}.jpg")
        (root / "meshes").mkdir(parents=True, exist_ok=True)
        (root / "meshes" / f"{name}.obj").write_text(obj_text(vertices, faces))
    write_json(root / "cameras" / "a.json", camera_json(60))
    write_json(root / "keypoints" / "b.json", keypoints_json(250))
    write_json(root / "cameras" / "b.json", {"K": K.tolist()})
    write_json(root / "landmarks.json", LANDMARK_IDS)
    write_mask(root / "masks" / "a.png", 60)
    return root


@dataclass(frozen=True)
class FolderFault:
    """One way for a folder to be wrong.

    Attributes:
        field: that the error names.
        reason: words of the error.
        spoil: gets the folder.
        sample: that the error names.
        when_read: found when the folder is read, not when the animal is labelled.
    """

    field: str
    reason: str
    spoil: Callable[[Path], object]
    sample: str = "a.jpg"
    when_read: bool = True


def camera_with(**changes: Any) -> Callable[[Path], object]:
    """Replace keys of a.jpg's camera; None leaves one out."""

    def spoil(root: Path) -> None:
        content = {**camera_json(60), **changes}
        write_json(
            root / "cameras" / "a.json",
            {key: value for key, value in content.items() if value is not None},
        )

    return spoil


def written(file: str, data: bytes) -> Callable[[Path], object]:
    """Replace a file of the folder."""

    def spoil(root: Path) -> None:
        path = root / file
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(data)

    return spoil


def obj_with(
    vertices: Callable[[Tensor], Tensor] = lambda v: v,
    faces: Callable[[Tensor], Tensor] = lambda f: f,
) -> Callable[[Path], object]:
    """Replace a.obj by a changed one."""
    return lambda root: (root / "meshes" / "a.obj").write_text(
        obj_text(vertices(toy_mesh()[0]), faces(toy_mesh()[1]))
    )


def npz_with(**arrays: Any) -> Callable[[Path], object]:
    """Replace a.obj by an npz."""

    def spoil(root: Path) -> None:
        vertices, faces = toy_mesh()
        (root / "meshes" / "a.obj").unlink()
        content = {"vertices": vertices.numpy(), "faces": faces.numpy(), **arrays}
        np.savez(
            root / "meshes" / "a.npz",
            **{key: value for key, value in content.items() if value is not None},
        )

    return spoil


def linked_out(file: str) -> Callable[[Path], object]:
    """Move a file out of the folder and leave a link."""

    def spoil(root: Path) -> None:
        outside = root.parent / f"outside-{Path(file).name}"
        (root / file).rename(outside)
        (root / file).symlink_to(outside)

    return spoil


def keypoints_with(**changes: Any) -> Callable[[Path], object]:
    """Replace keypoints of b.jpg."""
    return lambda root: write_json(
        root / "keypoints" / "b.json", {**keypoints_json(250), **changes}
    )


def half_size(root: Path) -> None:
    """A mask of another size."""
    Image.new("L", (80, 60), 255).save(root / "masks" / "a.png")


def twin_mesh(root: Path) -> None:
    """The same mesh in two formats."""
    (root / "meshes" / "a.ply").write_text("ply")


FOLDER_FAULTS = {
    "neither_camera_nor_keypoints": FolderFault(
        "camera, keypoints",
        "there is no camera, and there are no keypoints",
        lambda root: (root / "cameras" / "a.json").unlink(),
    ),
    "camera_without_pose": FolderFault(
        "camera, keypoints", "cameras/a.json has no R and t", camera_with(R=None, t=None)
    ),
    "camera_with_R_only": FolderFault("camera", "give both R and t", camera_with(t=None)),
    "camera_without_K": FolderFault("camera", "mean nothing without K", camera_with(K=None)),
    "camera_with_two_focals": FolderFault(
        "camera", "give one of K and focal_px", camera_with(focal_px=700)
    ),
    "mirrored_R": FolderFault(
        "camera", "determinant of -1", camera_with(R=[[1, 0, 0], [0, 1, 0], [0, 0, -1]])
    ),
    "R_that_is_no_rotation": FolderFault(
        "camera", "must hold rotation matrices", camera_with(R=[[2, 0, 0], [0, 1, 0], [0, 0, 1]])
    ),
    "R_of_2_rows": FolderFault(
        "camera", "R must have shape", camera_with(R=[[1, 0, 0], [0, 1, 0]])
    ),
    "ragged_R": FolderFault(
        "camera", "cameras/a.json", camera_with(R=[[1, 0, 0], [0, 1], [0, 0, 1]])
    ),
    "t_of_2_numbers": FolderFault("camera", "t must be 3", camera_with(t=[0, 0])),
    "transposed_K": FolderFault(
        "camera", "K must be upper triangular", camera_with(K=K.mT.tolist())
    ),
    "negative_focal": FolderFault(
        "camera", "focal_px must be above 0", camera_with(K=None, focal_px=-5)
    ),
    "three_coefficients": FolderFault(
        "camera", "distortion must have shape (4,)", camera_with(distortion=[0.1, 0, 0])
    ),
    "another_size": FolderFault(
        "camera",
        "image_hw is [480, 640], but the image is [120, 160]",
        camera_with(image_hw=[480, 640]),
    ),
    "unit_of_nothing": FolderFault("camera", "unit_m must be", camera_with(unit_m=0)),
    "unknown_key": FolderFault(
        "camera", "unknown field `rotation`", camera_with(rotation=[1, 0, 0])
    ),
    "camera_is_no_json": FolderFault(
        "camera", "is not valid JSON", written("cameras/a.json", b"K = 3")
    ),
    "image_is_no_image": FolderFault(
        "image", "cannot be decoded", written("images/a.jpg", b"<html>")
    ),
    "image_linked_out": FolderFault("image", "leads out of", linked_out("images/a.jpg")),
    "mesh_linked_out": FolderFault("mesh", "leads out of", linked_out("meshes/a.obj")),
    "mesh_without_image": FolderFault(
        "image", "there is no image c.*", written("meshes/c.obj", b"v"), sample="meshes/c.obj"
    ),
    "mesh_in_two_formats": FolderFault("mesh", "has the name of a.obj", twin_mesh, sample="a.ply"),
    "unknown_keypoint": FolderFault(
        "keypoints", "'snout' (nearest: ", keypoints_with(snout=[1, 2]), sample="b.jpg"
    ),
    "confidence_of_2": FolderFault(
        "keypoints", "nose must be [x, y]", keypoints_with(nose=[1, 2, 2]), sample="b.jpg"
    ),
    "keypoint_of_one_number": FolderFault(
        "keypoints", "nose must be [x, y]", keypoints_with(nose=[1]), sample="b.jpg"
    ),
    "keypoints_in_a_list": FolderFault(
        "keypoints",
        "Expected `object`",
        written("keypoints/b.json", b"[[1, 2, 1]]"),
        sample="b.jpg",
    ),
    "keypoints_that_mark_nothing": FolderFault(
        "camera, keypoints",
        "b.json marks nothing",
        written("keypoints/b.json", b'{"nose": null}'),
        sample="b.jpg",
    ),
    "empty_mesh": FolderFault("mesh", "it is empty", written("meshes/a.obj", b""), when_read=False),
    "mesh_of_words": FolderFault(
        "mesh",
        "cannot be read as a mesh",
        written("meshes/a.obj", b"v one two three"),
        when_read=False,
    ),
    "mesh_with_nan": FolderFault(
        "mesh",
        "3 of their coordinates not finite",
        obj_with(lambda v: v.index_fill(0, v.new_tensor([5]).long(), float("nan"))),
        when_read=False,
    ),
    "mesh_without_faces": FolderFault(
        "mesh", "must have faces", obj_with(faces=lambda f: f[:0]), when_read=False
    ),
    "face_of_a_vertex_that_is_not_there": FolderFault(
        "mesh", "all of its own 162 vertices", obj_with(faces=lambda f: f + 1), when_read=False
    ),
    "mesh_with_fewer_vertices_than_landmarks": FolderFault(
        "landmarks",
        "tail_middle must be vertex ids from 0 to 149",
        obj_with(lambda v: v[:150], lambda f: f[:200]),
        when_read=False,
    ),
    "npz_without_faces": FolderFault("mesh", "faces", npz_with(faces=None), when_read=False),
    "npz_with_faces_of_floats": FolderFault(
        "mesh", "whole numbers", npz_with(faces=np.zeros((3, 3))), when_read=False
    ),
    "npz_of_objects": FolderFault(
        "mesh",
        "cannot be read as a mesh",
        npz_with(vertices=np.array([{}, {}, {}, {}], dtype=object)),
        when_read=False,
    ),
    "npz_landmarks_without_names": FolderFault(
        "mesh",
        "as many different landmark_names",
        npz_with(landmarks=np.zeros((2, 3))),
        when_read=False,
    ),
    "mask_of_another_size": FolderFault("mask", "80 x 60", half_size, when_read=False),
    "no_landmarks": FolderFault(
        "landmarks",
        "nothing tells where a.obj has its nose",
        lambda root: (root / "landmarks.json").unlink(),
        when_read=False,
    ),
}
