"""Small inputs that were once misread, read again: one line a folder, "right" or what came instead.

Run: python benchmarks/cases.py ../shared/cases
"""

import argparse
import contextlib
import io
import json
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from PIL import Image

from animal3dbox.cli.main import main as animal3dbox
from animal3dbox.datasets import CuboidSet, read_omni3d, read_predictions
from animal3dbox.evaluate.comparison import cuboids_of
from animal3dbox.geometry import pairwise_box_iou
from animal3dbox.plurals import counted

Said = Callable[[str, int], bool]


@dataclass(frozen=True)
class Case:
    """One folder.

    Attributes:
        name: of the folder, and of the file in it that is read.
        is_right: whether what the command printed, and its exit code, are as they should be.
        options: of `label`, which without a model or meshes has the rigid preset, too, or of
            another command.
        command: that reads it.
        with_pictures: whether blank pictures are made for the file's images and given (--images).
    """

    name: str
    is_right: Said
    options: tuple[str, ...] = ()
    command: str = "label"
    with_pictures: bool = False


def checked(count: int, *words: str, faults: int = 0) -> Said:
    """So many boxes checked, with so many faults, and some words in what is printed."""
    return lambda text, code: (
        f"{counted(count, 'box', 'boxes')} in" in text
        and f": {counted(faults, 'fault')}" in text
        and all(word in text for word in words)
    )


def labelled(count: int, *words: str) -> Said:
    """So many animals read, none faulty, and some words in what is printed."""
    return lambda text, code: (
        counted(count, "animal") in text
        and " 0 faulty" in text
        and all(word in text for word in words)
    )


def refused(*words: str) -> Said:
    """Animals that are faulty, for a reason with some words."""
    return lambda text, code: code != 0 and all(word in text for word in words)


MODEL = "MODEL"
"""Stands in a case's options for the model of `synth`."""
CSV = "labeled-data/vid/CollectedData_Me.csv"
CASES = (
    Case("coco-normalised-no-box", refused("look normalised")),
    Case(f"dlc-normalised/{CSV}", refused("look normalised")),
    Case("coco-minus1-marked", labelled(3, "(-1, -1)")),
    Case(f"dlc-minus1/{CSV}", labelled(2, "(-1, -1)")),
    Case("animal3d-negative", labelled(1, "(-1, -1)")),
    Case("coco-mask-elsewhere", refused("the mask")),
    Case("dlc-two-videos/CollectedData_Me.csv", labelled(2)),
    Case("dlc-two-videos/labeled-data/vid1/CollectedData_Me.csv", labelled(2)),
    Case("dlc-project", labelled(2, "1 rejected")),
    Case("animal3d-not-unzipped", refused("there is no file")),
    Case("animal3d-pose-nested", labelled(1)),
    Case("animal3d-two-splits", refused("once more")),
    Case("photo-as-mask", labelled(1)),
    Case("zero-params", labelled(1, "all zero")),
    Case("coco-windows-path", labelled(3)),
    Case("coco-float-ids", labelled(3)),
    Case("coco-iscrowd-null", labelled(3)),
    Case("coco-v-minus-1", labelled(3)),
    Case("coco-scores", refused("--visibility scores")),
    Case("coco-scores", labelled(3), ("--visibility", "scores")),
    Case("coco-box-empty", labelled(3, "left out")),
    Case("coco-polygon-two-points", labelled(1, "left out")),
    Case("coco-person-too", labelled(2, "'person'")),
    Case("coco-names-spaces", labelled(3)),
    Case("coco-names-camel", labelled(3)),
    Case("kitti-degrees", checked(1, "degrees", "rotation_y", faults=1), command="check"),
    Case("kitti-alpha", checked(1, "alpha", faults=1), command="check"),
    Case("kitti-lwh", checked(1, "length, width, height", faults=1), command="check"),
    Case("kitti-centre", checked(1, "centre", faults=1), command="check"),
    Case("omni3d-opengl/omni.json", checked(4, "OpenGL", faults=4), command="check"),
    Case("omni3d-mm/omni.json", checked(4, "millimetres"), command="check"),
    Case("omni3d-flat-K/omni.json", checked(4), command="check"),
    Case("wildbox-abs/WildBox_train.json", checked(21), command="check", with_pictures=True),
    Case("wildlift-flatK/RHINO_train.json", checked(21, "[L, H, W]"), command="check"),
    Case(
        "animal3d-multi-animal/train_multi_animal.json",
        labelled(6, "nobody's", "all zero"),
        ("--model", MODEL),
    ),
    Case("mesh-stl-ids", refused("a.png: landmarks:", "STL")),
    Case("mesh-loose-vertex", labelled(1, "longest sides: [1.3]")),
    Case("exif-upright", refused("3 x not_turned", "orientation 6; turn it so by --orientation")),
    Case("exif-upright", labelled(8, "7 pictures were turned"), ("--orientation", "apply")),
    Case("tiff-mask-and-photo", labelled(2, "1 x not_turned")),
    Case(
        "tiff-mask-and-photo",
        refused("its pixels as stored: leave out --orientation apply"),
        ("--orientation", "apply"),
    ),
)


@dataclass(frozen=True)
class PredictionCase:
    """One detector's file of the folder predictions/, whose boxes are the truth's.

    Attributes:
        name: of the file.
        boxes: how many it holds.
        in_own_image: how many of them are in the image of the truth's box: a track goes through
            images that do not show its animal.
        cameras: as read_predictions takes them; "identity": a csv beside it says so.
        note: a word of the notes.
    """

    name: str
    boxes: int
    in_own_image: int
    cameras: Literal["camera", "identity"] | None = None
    note: str = ""


PREDICTIONS = (
    PredictionCase("ovmono3d_instances_predictions.pth", 6, 6, note="1 dummy boxes"),
    PredictionCase("3dmood_wilddet3d_detect_3D_results.json", 6, 6),
    PredictionCase("detany3d_output.json", 6, 6),
    PredictionCase("boxer_3dbbs.csv", 3, 3, "identity"),
    PredictionCase("wilddet3d_tracking_results.json", 4, 1),
    PredictionCase("wildlift_frame_0000.json", 1, 1, "camera"),
)
POSES = "time_ns,image,tx_world_camera,ty_world_camera,tz_world_camera,qw_world_camera,"
"""The first columns of camera_poses.csv."""


def predictions_are_right(case: PredictionCase, folder: Path, made: Path) -> tuple[bool, str]:
    """Whether a detector's boxes are the truth's, and what came out, in words."""
    path = folder / "truth_omni3d.json"
    truth = read_omni3d(path)
    cameras = made / "camera_poses.csv" if case.cameras == "identity" else case.cameras
    if isinstance(cameras, Path):
        rows = (folder / case.name).read_text().splitlines()[1:]
        poses = [
            f"{row.split(',')[0]},{image.image_id},0,0,0,1,0,0,0"
            for row, image in zip(rows, truth.images, strict=False)
        ]
        head = f"{POSES}qx_world_camera,qy_world_camera,qz_world_camera"
        cameras.write_text("\n".join((head, *poses)))
    found = read_predictions(folder / case.name, path, cameras=cameras)
    least, in_own_image = least_iou(found, truth)
    words = (
        f"{len(found.records)} boxes, least IoU {least:.6f}, {in_own_image} in the truth's image,"
        f" {len(found.faults)} faults, {'; '.join(found.notes)}"
    )
    is_right = (len(found.records), in_own_image) == (case.boxes, case.in_own_image)
    is_right &= least > 1 - 1e-6 and not found.faults
    return is_right and case.note in words, words


def least_iou(found: CuboidSet, truth: CuboidSet) -> tuple[float, int]:
    """The least of all boxes' IoU with the truth's box that fits best, and how many share images.

    All images of the case have one K, so boxes of different images can be compared.
    """
    iou = pairwise_box_iou(cuboids_of(found.records), cuboids_of(truth.records)).numpy()
    best = [truth.records[number] for number in iou.argmax(1).tolist()]
    pairs = list(zip(found.records, best, strict=True))
    if any(one.category != other.category for one, other in pairs):
        return 0.0, 0
    return float(np.min(iou.max(1))), sum(one.image_id == two.image_id for one, two in pairs)


def blank_pictures(file: Path, folder: Path) -> Path:
    """A folder with a blank picture for each image of an Omni3D file, under its last name."""
    for image in json.loads(file.read_text())["images"]:
        size = (image["width"], image["height"])
        Image.new("L", size).save(folder / Path(image["file_path"]).name)
    return folder


def with_model(options: tuple[str, ...], folder: Path) -> tuple[str, ...]:
    """The options with MODEL as the file that `synth` writes, made in a folder when needed."""
    if MODEL not in options:
        return options
    world, model = folder / "world", folder / "model.pkl"
    if not model.is_file():
        with contextlib.suppress(SystemExit), contextlib.redirect_stdout(io.StringIO()):
            animal3dbox(["synth", "--out", str(world), "--n", "1", "--model", str(model)])
    return tuple(str(model) if one == MODEL else one for one in options)


def run(case: Case, path: Path, options: tuple[str, ...]) -> tuple[str, int]:
    """What a case's command prints of a path and how long its boxes are, and its exit code."""
    printed = io.StringIO()
    with (
        tempfile.TemporaryDirectory() as out,
        contextlib.redirect_stdout(printed),
        contextlib.redirect_stderr(printed),
    ):
        code = 0
        body = () if "--model" in options or (path / "meshes").is_dir() else ("--body", "preset")
        try:
            own = ["--out", out, *body] if case.command == "label" else []
            own += ["--images", str(blank_pictures(path, Path(out)))] if case.with_pictures else []
            animal3dbox([case.command, str(path), *own, *options])
        except SystemExit as end:
            code = end.code if isinstance(end.code, int) else 1
        labels = Path(out, "labels.json")
        animals = json.loads(labels.read_text())["animals"] if labels.is_file() else []
        sides = [round(max(animal["size"]), 1) for animal in animals]
    return f"{printed.getvalue()}longest sides: {sides}\n", code


def main() -> None:
    """Read every folder and say how."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args().folder
    names = {"predictions", *(case.name.split("/")[0] for case in CASES)}
    with tempfile.TemporaryDirectory() as made:
        for case in CASES:
            text, code = run(case, folder / case.name, with_model(case.options, Path(made)))
            first = " / ".join(text.strip().splitlines()[:3])
            print(f"{case.name}: {'right' if case.is_right(text, code) else f'WRONG, {first}'}")
        for one in PREDICTIONS:
            is_right, words = predictions_are_right(one, folder / "predictions", Path(made))
            print(f"predictions/{one.name}: {'right' if is_right else 'WRONG'}, {words}")
    others = [p.name for p in sorted(folder.iterdir()) if p.name not in names and p.is_dir()]
    print(f"not tried here: {', '.join(others)}")


if __name__ == "__main__":
    main()
