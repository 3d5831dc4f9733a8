"""The datasets that a golden record is made of: small, synthetic, the same for old and new code.

They are written once, by the code of one commit: as ``animal3dbox synth`` writes them, or from its
synthetic world in the files of other formats.
"""

import csv
import itertools
import json
import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from golden_commands import command
from golden_names import named
from golden_things import write_bare_cuboids, write_things
from PIL import Image

HW = (240, 320)
KNOWN_LENS = [0.02, -0.01, 0.001, 0.0005]
"""Coefficients of the lens that one camera of the mesh folder has."""


def write_inputs(folder: Path) -> None:
    """Write every dataset of the record into a new folder."""
    folder.mkdir(parents=True)
    size = ("--width", str(HW[1]), "--height", str(HW[0]), "--noise-px", "1", "--missing", "0.05")
    command("synth", "--out", folder / "animals", "--n", "6", "--seed", "3", *size)
    dogs = ("--format", "stanfordextra", "--outliers", "0.05")
    command("synth", "--out", folder / "dogs", "--n", "6", "--seed", "4", *dogs, *size)
    _tell_focal_length(folder / "dogs")
    write_coco(folder / "coco", world_samples(5, 6, "ap10k17"))
    write_deeplabcut(folder / "deeplabcut", world_samples(6, 6, "superanimal39"))
    write_meshes(folder / "meshes_cameras", world_samples(7, 3, "animal3d26"), known=True)
    write_meshes(folder / "meshes_keypoints", world_samples(8, 3, "animal3d26"), known=False)
    write_arrays(folder / "arrays", world_samples(9, 4, "animal3d26", clear=True))
    write_things(folder / "things")
    write_bare_cuboids(folder / "bare.npz")
    _write_labels(folder)
    _spoil_dogs(folder / "dogs", folder / "faulty_dogs")
    _spoil_coco(folder / "coco", folder / "faulty_coco")
    _spoil_animals(folder / "animals", folder / "faulty_animals")


def world_samples(seed: int, images: int, vocabulary: str, *, clear: bool = False) -> list[Any]:
    """Animals of the synthetic world with their annotations, which are a little off."""
    config = "CLEAR" if clear else "WorldConfig"
    start = named(f"animal3dbox.datasets.world.config.{config}")
    words = named("animal3dbox.smal.vocabularies.VOCABULARIES")[vocabulary]
    focal = (350.0, 900.0)
    world = replace(start if clear else start(), image_hw=HW, vocabulary=words, focal_px=focal)
    faults = named("animal3dbox.datasets.faults.FaultConfig")(noise_px=1.0, missing=0.05)
    made = named("animal3dbox.datasets.SyntheticSet")(seed, images, world, faults)
    return list(made.samples())


def _by_picture(samples: Sequence[Any]) -> dict[str, list[Any]]:
    """The samples of each picture."""
    groups = itertools.groupby(samples, key=lambda sample: sample.scene.image_id)
    return {name: list(group) for name, group in groups}


def _save_picture(path: Path, sample: Any) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(sample.scene.image.numpy()).save(path)


def write_json(path: Path, content: object) -> None:
    """Write a JSON file and its folders."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content))


def _tell_focal_length(dogs: Path) -> None:
    """Give one photograph a header that tells its focal length."""
    path = sorted((dogs / "images").rglob("*.jpg"))[1]
    exif = Image.Exif()
    exif.get_ifd(0x8769)[0xA405] = 40  # FocalLengthIn35mmFilm
    with Image.open(path) as photo:
        photo.load()
        photo.save(path, "JPEG", quality=92, exif=exif)


def write_coco(root: Path, samples: Sequence[Any]) -> None:
    """Write COCO keypoints: masks in turn as run lengths, as polygons and not at all."""
    images: list[dict[str, Any]] = []
    annotations: list[dict[str, Any]] = []
    names = list(samples[0].annotation.vocabulary.keypoints)
    for image_id, (name, group) in enumerate(_by_picture(samples).items()):
        _save_picture(root / "images" / f"{name}.png", group[0])
        picture = {"file_name": f"{name}.png", "height": HW[0], "width": HW[1]}
        images.append({"id": image_id, **picture})
        for sample in group:
            annotations.append(_coco_annotation(sample, len(annotations), image_id))
    kinds = [{"id": 1, "name": "dog", "supercategory": "Canidae", "keypoints": names}]
    kinds.append({"id": 2, "name": "king cheetah", "supercategory": "Felidae", "keypoints": names})
    content = {"images": images, "annotations": annotations, "categories": kinds}
    write_json(root / "annotations.json", content)


def _coco_annotation(sample: Any, number: int, image_id: int) -> dict[str, Any]:
    mask = sample.annotation.mask.numpy()
    rows, columns = np.nonzero(mask)
    box = [columns.min(), rows.min(), np.ptp(columns) + 1, np.ptp(rows) + 1]
    points = sample.annotation.keypoints_2d.tolist()
    keypoints = [[x, y, 2 if seen else 0] if seen else [0, 0, 0] for x, y, seen in points]
    if number % 3 == 0:
        keypoints = [[x, y, min(v, 1 + k % 2)] for k, (x, y, v) in enumerate(keypoints)]
    marked: dict[str, Any] = {"keypoints": [value for row in keypoints for value in row]}
    marked["num_keypoints"] = sum(row[2] > 0 for row in keypoints)
    shown: dict[str, Any] = {}
    if number % 3 == 0:
        shown = {"segmentation": {"size": list(HW), "counts": _run_lengths(mask)}}
    elif number % 3 == 1:
        shown = {"segmentation": _polygons(mask)}
    said = {"id": number, "image_id": image_id, "category_id": 1 + number % 2, "iscrowd": 0}
    return {**said, **marked, "bbox": [int(side) for side in box], "area": int(mask.sum()), **shown}


def _run_lengths(mask: np.ndarray) -> list[int]:
    """The lengths of runs down the columns, zeros first."""
    flat = np.concatenate(([False], mask.T.ravel(), [not mask.T.ravel()[-1]]))
    ends = np.flatnonzero(flat[1:] != flat[:-1])
    return [int(length) for length in np.diff(np.concatenate(([0], ends)))]


def _polygons(mask: np.ndarray) -> list[list[float]]:
    """Outlines of a mask; those of fewer than four points are left out."""
    found, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    return [(line.reshape(-1) + 0.5).tolist() for line in found if len(line) > 3]


def write_deeplabcut(root: Path, samples: Sequence[Any]) -> None:
    """Write a table of two individuals with likelihoods, and its pictures."""
    parts = list(samples[0].annotation.vocabulary.keypoints)
    columns = list(itertools.product(("first", "second"), parts, ("x", "y", "likelihood")))
    levels = {"scorer": ["golden"] * len(columns)}
    for number, level in enumerate(("individuals", "bodyparts", "coords")):
        levels[level] = [column[number] for column in columns]
    lines = [[level, *words] for level, words in levels.items()]
    for name, group in _by_picture(samples).items():
        _save_picture(root / f"{name}.png", group[0])
        cells: list[str] = []
        for k in range(2):
            points = group[k].annotation.keypoints_2d.tolist() if k < len(group) else []
            rows = [[x, y, 0.95 - 0.1 * (n % 5)] for n, (x, y, _) in enumerate(points)]
            seen = [bool(point[2]) for point in points]
            for n in range(len(parts)):
                cells += [repr(v) for v in rows[n]] if k < len(group) and seen[n] else ["", "", ""]
        lines.append([f"{name}.png", *cells])
    with (root / "CollectedData_golden.csv").open("w", newline="") as file:
        csv.writer(file).writerows(lines)


def write_meshes(root: Path, samples: Sequence[Any], *, known: bool) -> None:
    """Write a mesh for each animal, with its camera and mask if known, else with keypoints."""
    for number, (name, group) in enumerate(_by_picture(samples).items()):
        _save_picture(root / "images" / f"{name}.png", group[0])
        camera = {"K": group[0].animal.K.tolist()}
        if known:
            camera |= {"R": group[0].animal.R.tolist(), "t": group[0].animal.t.tolist()}
            camera |= {"distortion": KNOWN_LENS} if number == 1 else {"image_hw": list(HW)}
            camera |= {"unit_m": 1.3} if number == 2 else {}
        if known or number != 1:
            write_json(root / "cameras" / f"{name}.json", camera)
        for k, sample in enumerate(group):
            _write_mesh(root, f"{name}_{k}", sample, known=known)
    vertices, landmarks = samples[-1].animal.vertices, samples[-1].animal.landmarks
    nearest = (landmarks[:, None] - vertices).norm(dim=-1).argmin(dim=-1).tolist()
    names = samples[0].annotation.vocabulary.keypoints
    write_json(root / "landmarks.json", {n: [i] for n, i in zip(names, nearest, strict=True)})


def _write_mesh(root: Path, name: str, sample: Any, *, known: bool) -> None:
    """Write one animal's mesh, as an npz if its camera is known, else as an obj with keypoints."""
    words, faces = sample.annotation.vocabulary.keypoints, sample.animal.model.faces
    (root / "meshes").mkdir(exist_ok=True)
    if known:
        (root / "masks").mkdir(exist_ok=True)
        Image.fromarray(sample.annotation.mask.numpy()).save(root / "masks" / f"{name}.png")
        arrays = {"vertices": sample.animal.vertices.numpy(), "faces": faces.numpy()}
        told = {"landmarks": sample.animal.landmarks.numpy(), "landmark_names": np.array(words)}
        np.savez(root / "meshes" / f"{name}.npz", **arrays, **told)
        return
    lines = ["v {:.17g} {:.17g} {:.17g}".format(*row) for row in sample.animal.vertices.tolist()]
    lines += ["f {} {} {}".format(*(i + 1 for i in row)) for row in faces.tolist()]
    (root / "meshes" / f"{name}.obj").write_text("\n".join(lines) + "\n")
    points = zip(words, sample.annotation.keypoints_2d.tolist(), strict=True)
    write_json(root / "keypoints" / f"{name}.json", {n: row for n, row in points if row[2] > 0})


def write_arrays(root: Path, samples: Sequence[Any]) -> None:
    """Write what label_animal takes, an npz an animal."""
    root.mkdir()
    for number, sample in enumerate(samples):
        said, animal = sample.annotation, sample.animal
        arrays = {
            "keypoints_2d": said.keypoints_2d, "keypoints_3d": animal.landmarks, "K": said.K,
            "vertices": animal.vertices, "faces": animal.model.faces, "mask": said.mask,
            "R": animal.R, "t": animal.t,
        }  # fmt: skip
        np.savez(root / f"{number}.npz", **{name: array.numpy() for name, array in arrays.items()})


def _write_labels(folder: Path) -> None:
    """Write labels of the animals to export and to check, and a copy that does not hold."""
    words = ("label", folder / "animals", "--model", folder / "animals-model.pkl")
    command(*words, "--out", folder / "labels", "--json")
    content = json.loads((folder / "labels" / "labels.json").read_text())
    content["animals"][0]["size"][0] *= 1.5
    content["animals"][1]["rotation"][0] = [2.0, 0.0, 0.0]
    content["animals"][2]["K"][0][0] *= 1.1
    content["animals"][3]["face_share"] = content["animals"][3]["face_share"][::-1]
    write_json(folder / "spoilt_labels" / "labels.json", content)


def _spoil_dogs(source: Path, root: Path) -> None:
    """Plant faults into a copy of the dogs; the first three stay as they are."""
    shutil.copytree(source, root)
    entries = json.loads((root / "annotations.json").read_text())
    faults: list[dict[str, Any]] = [
        {"img_path": "gone.jpg"}, {"joints": entries[1]["joints"][:20]}, {"img_width": 300},
        {"img_bbox": [5, 5, -20, 20]}, {"seg": entries[0]["seg"][:-2]}, {"img_path": "../x.jpg"},
        {"joints": [[x, y, 2] for x, y, _ in entries[0]["joints"]]},
    ]  # fmt: skip
    spoilt = [{**entries[k % 3], "seg": None, **fault} for k, fault in enumerate(faults)]
    few = [[x, y, v if k < 3 else 0] for k, (x, y, v) in enumerate(entries[4]["joints"])]
    spoilt.append({**entries[4], "joints": few, "seg": None})
    shutil.copy(root / "images" / entries[5]["img_path"], root / "images" / "cut.jpg")
    (root / "images" / "cut.jpg").write_bytes((root / "images" / "cut.jpg").read_bytes()[:900])
    spoilt.append({**entries[5], "img_path": "cut.jpg"})
    write_json(root / "annotations.json", [*entries[:3], entries[2], *spoilt])


def _spoil_coco(source: Path, root: Path) -> None:
    """Plant faults into a copy of the COCO keypoints."""
    shutil.copytree(source, root)
    content = json.loads((root / "annotations.json").read_text())
    annotations = content["annotations"]
    annotations[0]["keypoints"][2] = 7
    annotations[1]["bbox"] = [0, 0, 0, 5]
    annotations[2]["category_id"] = 99
    annotations[3]["image_id"] = 777
    content["images"][-1]["height"] += 1
    content["images"][-2]["file_name"] = "/etc/hostname"
    write_json(root / "annotations.json", content)


def _spoil_animals(source: Path, root: Path) -> None:
    """Plant faults into a copy of the Animal3D folder."""
    shutil.copytree(source, root)
    content = json.loads((root / "train.json").read_text())
    entries = content["data"]
    entries[0]["pose"] = entries[0]["pose"][:7]
    entries[1]["keypoint_2d"] = entries[1]["keypoint_2d"][:5]
    entries[2]["shape"] = None
    entries[3]["height"] += 1
    entries[4]["trans"][2] = -50.0
    (root / entries[5]["mask_path"]).write_bytes(b"words")
    write_json(root / "train.json", content)
