"""Files as detectors' programs write them, of the boxes of a set, beside the truth they are for."""

import json
import pickle
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from cuboid_sets import random_set
from scipy.spatial.transform import Rotation

from animal3dbox.datasets.exchange.omni3d_writer import write_omni3d
from animal3dbox.datasets.records import CuboidSet

Elements = list[dict[str, Any]]
SCORE = 0.75
STEP_NS = 33_333_333
"""Time between two frames of Boxer's."""


def detected_set(seed: int = 0) -> CuboidSet:
    """Ten boxes in five images, all seen whole, in metres and with known headings."""
    boxes = random_set(seed, in_view=True)
    return replace(boxes, records=tuple(replace(one, heading_known=True) for one in boxes.records))


def written_truth(folder: Path, boxes: CuboidSet, first_category_id: int = 0) -> Path:
    """The Omni3D file of a set."""
    path = folder / "truth.json"
    write_omni3d(boxes, path, first_category_id=first_category_id)
    return path


def flat_elements(truth: Path, pose: str = "R_cam") -> Elements:
    """The list of 3D-MOOD (R_cam) or DetAny3D (pose), of the boxes of a truth."""
    elements = []
    for one in json.loads(truth.read_text())["annotations"]:
        x1, y1, x2, y2 = one["bbox2D_trunc"]
        elements.append(
            {
                "image_id": one["image_id"], "category_id": one["category_id"], "score": SCORE,
                "bbox": [x1, y1, x2 - x1, y2 - y1], "center_cam": one["center_cam"],
                "dimensions": one["dimensions"], pose: one["R_cam"], "bbox3D": one["bbox3D_cam"],
                "depth": one["center_cam"][2],
            }
        )  # fmt: skip
    return elements


def nested_elements(truth: Path) -> Elements:
    """The list an image of Cube R-CNN: contiguous categories, and NumPy's scalars and arrays."""
    content = json.loads(truth.read_text())
    place = {one["id"]: number for number, one in enumerate(content["categories"])}
    instances = flat_elements(truth, "pose")
    for one in instances:
        one["category_id"] = np.int64(place[one["category_id"]])
        one["score"], one["depth"] = np.float32(SCORE), np.float64(one["depth"])
        one["bbox3D"] = np.array(one["bbox3D"])
    return [
        {
            "image_id": image["id"], "K": image["K"], "width": image["width"],
            "height": image["height"],
            "instances": [one for one in instances if one["image_id"] == image["id"]],
        }
        for image in content["images"]
    ]  # fmt: skip


def written_json(path: Path, content: Any) -> Path:
    """A file of JSON; NaN is written as Python writes it."""
    path.write_text(json.dumps(content))
    return path


PTH_WRITERS: dict[str, Callable[[Any, Path], object]] = {
    "archive": torch.save,
    "torch before 1.6": lambda value, path: torch.save(
        value, path, _use_new_zipfile_serialization=False
    ),
    "plain pickle": lambda value, path: path.write_bytes(pickle.dumps(value)),
}
"""The three forms of a .pth."""


def written_pth(folder: Path, truth: Path, form: str = "archive") -> Path:
    """Cube R-CNN's instances_predictions.pth."""
    path = folder / "instances_predictions.pth"
    PTH_WRITERS[form](nested_elements(truth), path)
    return path


def written_flat(folder: Path, truth: Path) -> Path:
    """3D-MOOD's and WildDet3D's detect_3D_results.json."""
    return written_json(folder / "detect_3D_results.json", flat_elements(truth))


def written_detany3d(folder: Path, truth: Path) -> Path:
    """DetAny3D's list."""
    elements = [{**one, "yaw": 0.0, "area": 1.0} for one in flat_elements(truth, "pose")]
    return written_json(folder / "detany3d.json", elements)


def camera_pose(number: int) -> tuple[np.ndarray, np.ndarray]:
    """R_world_cam (3, 3) and the position (3,) of the camera of an image."""
    R = Rotation.from_rotvec([0.2 * number, 0.4 - number, 0.3]).as_matrix()
    return R, np.array([number, -2.0, 0.5 * number])


def written_boxer(folder: Path, boxes: CuboidSet) -> Path:
    """Boxer's csv in a world, with camera_poses.csv beside it."""
    rows, poses = [], []
    for number, image in enumerate(boxes.images):
        R, position = camera_pose(number)
        x, y, z, w = Rotation.from_matrix(R).as_quat()
        cells = [number * STEP_NS, image.image_id, *position, w, x, y, z]
        poses.append(",".join(map(str, cells)))
        for one in (one for one in boxes.records if one.image_id == image.image_id):
            x, y, z, w = Rotation.from_matrix(R @ one.rotation).as_quat()
            place = R @ one.center + position
            cells = [number * STEP_NS, *place, w, x, y, z, *one.size, one.category, 0, 4, SCORE]
            rows.append(",".join(map(str, cells)))
    ends = ("tx", "ty", "tz", "qw", "qx", "qy", "qz")
    head = ",".join(
        ("time_ns", *(f"{end}_world_object" for end in ends), "scale_x,scale_y,scale_z")
    )
    path = folder / "boxer_3dbbs.csv"
    path.write_text("\n".join((f"{head},name,instance,sem_id,prob", *rows)) + "\n")
    head = ",".join(("time_ns,image", *(f"{end}_world_camera" for end in ends)))
    (folder / "camera_poses.csv").write_text("\n".join((head, *poses)) + "\n")
    return path


def tracked_content(boxes: CuboidSet) -> dict[str, Any]:
    """WildDet3D's tracks: the first, second, ... boxes of images are one animal's each."""
    frames: dict[str, list[Any]] = {}
    counts = {image.image_id: 0 for image in boxes.images}
    place = {image.image_id: number for number, image in enumerate(boxes.images)}
    for one in boxes.records:
        forward, left, up = one.rotation.T
        x, y, z, w = Rotation.from_matrix(np.stack((forward, -up, left), axis=1)).as_quat()
        length, width, height = one.size.tolist()
        name = f"{one.category} {counts[one.image_id]}"
        counts[one.image_id] += 1
        row = frames.setdefault(name, [None] * len(boxes.images))
        row[place[one.image_id]] = [*one.center.tolist(), width, length, height, w, x, y, z]
    tracks = {
        str(number): {"category": name[:-2], "boxes_3d": rows}
        for number, (name, rows) in enumerate(frames.items())
    }
    return {"video_name": "v", "n_frames": len(boxes.images), "tracks": tracks}


def written_tracks(folder: Path, boxes: CuboidSet) -> Path:
    """WildDet3D's tracking_results.json."""
    return written_json(folder / "tracking_results.json", tracked_content(boxes))


def written_frames(folder: Path, boxes: CuboidSet) -> Path:
    """WildLIFT's folder of frames in a world, with camera_params/ beside it."""
    home, poses = folder / "bounding_boxes", folder / "camera_params"
    home.mkdir()
    poses.mkdir()
    for number, image in enumerate(boxes.images):
        R, position = camera_pose(number)
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = R, position
        np.savez(poses / f"frame_{number:04d}.npz", cam_c2w=pose, intrinsic=image.K)
        content = [
            {
                "center": (R @ one.center + position).tolist(), "dimensions": one.size.tolist(),
                "rotation_matrix": (R @ one.rotation).tolist(), "class_name": one.category,
                "confidence": SCORE, "instance_id": 1, "track_id": -1,
            }
            for one in boxes.records
            if one.image_id == image.image_id
        ]  # fmt: skip
        written_json(home / f"frame_{number:04d}.json", content)
    return home
