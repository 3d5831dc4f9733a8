"""What can be wrong with a file of cuboids, by kind and reader: each cell names sample and field.

A cell spoils one thing of a file that is read whole without it: the second box of the first image,
or what that box is made of. The fault's message begins with the sample and the field, says what is
wrong, and the other boxes are read; where a thing is only implausible, a note says so.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cuboid_sets import standing_set
from PIL import Image

from animal3dbox.datasets.exchange.kitti_writer import write_kitti
from animal3dbox.datasets.exchange.omni3d_writer import write_omni3d
from animal3dbox.datasets.readers.kitti.reader import read_kitti
from animal3dbox.datasets.readers.omni3d.reader import read_omni3d
from animal3dbox.datasets.records import CuboidSet

OMNI3D, KITTI = "omni3d", "kitti"
BOXES = 4
FIRST = {OMNI3D: "0.jpg", KITTI: "image_2/000000.png"}
BOX_COLUMNS = ("x1", "y1", "x2", "y2", "h", "w", "l", "x", "y", "z", "rotation_y")
COLUMNS = ("kind", "truncated", "occluded", "alpha", *BOX_COLUMNS)


class Omni3DFile:
    """A file of another program, with pictures beside it, and what cells spoil of it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        write_omni3d(standing_set(), folder / "file.json")
        self.content: dict[str, Any] = json.loads((folder / "file.json").read_text())
        self.content["info"] = {"name": "made", "units": "m"}
        for annotation in self.content["annotations"]:
            del annotation["metric"], annotation["heading_known"]
        for image in self.content["images"]:
            Image.new("L", (image["width"], image["height"])).save(folder / image["file_path"])

    @property
    def box(self) -> dict[str, Any]:
        """The second box of the first image."""
        box: dict[str, Any] = self.content["annotations"][1]
        return box

    @property
    def image(self) -> dict[str, Any]:
        """The first image."""
        image: dict[str, Any] = self.content["images"][0]
        return image

    def read(self) -> CuboidSet:
        text = json.dumps(self.content).replace('"INFINITE"', "1e999")
        (self.folder / "file.json").write_text(text)
        return read_omni3d(self.folder / "file.json")


class KittiFolder:
    """A folder of another program, and what cells spoil of it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        write_kitti(standing_set(), folder)
        (folder / "images.txt").unlink()
        (folder / "image_2").mkdir(exist_ok=True)
        for number in range(2):
            Image.new("L", (160, 120)).save(folder / "image_2" / f"{number:06d}.png")
        self.lines = [
            dict(zip(COLUMNS, line.split(), strict=True))
            for number in range(2)
            for line in self.label(number).read_text().splitlines()
        ]

    def label(self, number: int) -> Path:
        return self.folder / "label_2" / f"{number:06d}.txt"

    @property
    def box(self) -> dict[str, str]:
        """The second box of the first image."""
        return self.lines[1]

    @property
    def calibration(self) -> Path:
        """That of the first image."""
        return self.folder / "calib" / "000000.txt"

    def P2(self, values: str) -> None:
        rows = self.calibration.read_text().splitlines()
        rows = [f"P2: {values}" if row.startswith("P2") else row for row in rows]
        self.calibration.write_text("\n".join(rows))

    def read(self) -> CuboidSet:
        texts = [" ".join(line.values()) + "\n" for line in self.lines]
        self.label(0).write_text("".join(texts[:3] + texts[4:]))
        self.label(1).write_text(texts[3])
        return read_kitti(self.folder)


MAKE: dict[str, Callable[[Path], Any]] = {OMNI3D: Omni3DFile, KITTI: KittiFolder}


@dataclass(frozen=True)
class Cell:
    """One kind of fault in one format.

    Attributes:
        spoil: what is done to a good file.
        field: that the message names.
        words: that it holds.
        read: how many boxes are read all the same.
        sample: what follows the first image's name in the sample's.
    """

    spoil: Callable[[Any], object]
    field: str
    words: str
    read: int = BOXES - 1
    sample: str = "#1"


def of(value: object, *keys: str) -> Callable[[Any], object]:
    """Sets keys of the box to a value."""
    return lambda file: file.box.update(dict.fromkeys(keys, value))


def image_of(key: str, value: object) -> Callable[[Any], object]:
    """Sets a key of an Omni3D file's first image."""
    return lambda file: file.image.update({key: value})


def matrix(key: str, change: Callable[[Any], Any]) -> Callable[[Any], object]:
    """Changes the numbers of a key of an Omni3D file's box."""
    return lambda file: file.box.update({key: np.array(change(np.array(file.box[key]))).tolist()})


def number(key: str, change: Callable[[float], float]) -> Callable[[Any], object]:
    """Changes a number of a KITTI line."""
    return lambda file: file.box.update({key: f"{change(float(file.box[key])):.6f}"})


def in_order(*keys: str) -> Callable[[Any], object]:
    """Writes a KITTI line's h, w, l in another order."""
    return lambda file: file.box.update(
        dict(zip("hwl", [file.box[key] for key in keys], strict=True))
    )


def at_center(file: Any) -> None:
    """Writes the centre of a KITTI line's box for the middle of its bottom."""
    height = float(file.box["h"])
    number("y", lambda y: y - height / 2)(file)


def opengl(file: Any) -> None:
    """Turns an Omni3D file's box into OpenGL's axes."""
    turn = np.array([1.0, -1, -1])
    matrix("center_cam", lambda c: turn * c)(file)
    matrix("bbox3D_cam", lambda X: turn * X)(file)
    matrix("R_cam", lambda R: turn[:, None] * R)(file)


def again(file: Any) -> None:
    """Lists an Omni3D file's box once more, under an id of its own."""
    file.content["annotations"].append(file.box | {"id": 99})


def again_turned(file: Any) -> None:
    """Lists an Omni3D file's box once more, with its tail for its nose."""
    again(file)
    turned = file.content["annotations"][-1]
    turned["R_cam"] = (np.array(turned["R_cam"]) * [-1, 1, -1]).tolist()
    turned["bbox3D_cam"] = None


def again_turned_line(file: Any) -> None:
    """Lists a KITTI line once more, with its tail for its nose."""
    file.lines.append(dict(file.box))
    turned = {
        key: f"{float(file.box[key]) - np.pi * np.sign(float(file.box[key])):.6f}"
        for key in ("alpha", "rotation_y")
    }
    file.lines[-1].update(turned)


def of_image(spoil: Callable[[Any], object], field: str, words: str) -> Cell:
    """A cell that costs the first image, with its three boxes."""
    return Cell(spoil, field, words, read=1, sample="")


TABLE: dict[str, dict[str, Cell]] = {
    "z is negative": {
        OMNI3D: Cell(opengl, "center_cam", "behind_camera is false"),
        KITTI: Cell(number("z", lambda z: -z), "location", "not in front of the camera"),
    },
    "the centre for the bottom, or the bottom for the centre": {
        OMNI3D: Cell(
            matrix("center_cam", lambda c: c + np.array([0, 0.5, 0])),
            "center_cam",
            "not its bottom",
        ),
        KITTI: Cell(at_center, "location", "looks like the box's centre"),
    },
    "dimensions in another order": {
        OMNI3D: Cell(matrix("dimensions", lambda d: d[[2, 1, 0]]), "dimensions", "in the order of"),
        KITTI: Cell(in_order("l", "w", "h"), "dimensions", "look like length, width, height"),
    },
    "a dimension of zero": {
        OMNI3D: Cell(matrix("dimensions", lambda d: d * [0, 1, 1]), "dimensions", "be positive"),
        KITTI: Cell(of("0", "w"), "dimensions", "be positive"),
    },
    "a negative dimension": {
        OMNI3D: Cell(matrix("dimensions", lambda d: -d), "dimensions", "be positive"),
        KITTI: Cell(of("-0.5", "w"), "dimensions", "be positive"),
    },
    "a 2D box elsewhere": {
        OMNI3D: Cell(of([1, 1, 9, 9], "bbox2D_tight"), "bbox2D_tight", "lies beside the projected"),
        KITTI: Cell(
            lambda file: file.box.update(x1="1", y1="1", x2="9", y2="9"),
            "bbox",
            "lies beside the projected",
        ),
    },
    "a projected box of another camera": {
        OMNI3D: Cell(of([1, 1, 9, 9], "bbox2D_proj"), "bbox2D_proj", "is not where K projects"),
    },
    "a projected box in the frame of another camera": {
        OMNI3D: Cell(of([1, 1, 9, 9], "bbox2D_trunc"), "bbox2D_trunc", "is not where K projects"),
    },
    "a 2D box of a larger picture": {
        OMNI3D: Cell(
            matrix("bbox2D_tight", lambda b: 4 * b), "bbox2D_tight", "lies beside the projected"
        ),
        KITTI: Cell(
            lambda file: [number(key, lambda px: 4 * px)(file) for key in ("x1", "y1", "x2", "y2")],
            "bbox",
            "a picture of another size",
        ),
    },
    "a 2D box whose corners are exchanged": {
        OMNI3D: Cell(matrix("bbox2D_tight", lambda b: b[[2, 1, 0, 3]]), "bbox2D_tight", "x2 > x1"),
        KITTI: Cell(
            lambda file: file.box.update(x1=file.box["x2"], x2=file.box["x1"]),
            "bbox",
            "right > left",
        ),
    },
    "a 2D box of x, y, w, h": {
        OMNI3D: Cell(
            matrix("bbox2D_tight", lambda b: [*b[:2], *(b[2:] - b[:2])]), "bbox2D_tight", "x2 > x1"
        ),
        KITTI: Cell(
            lambda file: file.box.update(
                x2=str(float(file.box["x2"]) - float(file.box["x1"])),
                y2=str(float(file.box["y2"]) - float(file.box["y1"])),
            ),
            "bbox",
            "right > left",
        ),
    },
    "the same box twice": {
        OMNI3D: Cell(again, "box", "once more", BOXES, "#3"),
        KITTI: Cell(lambda file: file.lines.append(file.box), "box", "once more", BOXES, "#3"),
    },
    "the same box twice, the other way round": {
        OMNI3D: Cell(again_turned, "box", "once more", BOXES, "#3"),
        KITTI: Cell(again_turned_line, "box", "once more", BOXES, "#3"),
    },
    "an id twice": {
        OMNI3D: Cell(of(1, "id"), "id", "is that of 0.jpg too"),
    },
    "a number that is infinite": {
        OMNI3D: Cell(of(["INFINITE", 0, 8], "center_cam"), "center_cam", "out of range"),
        KITTI: Cell(of("inf", "x"), "line", "not finite"),
    },
    "a word for a number": {
        OMNI3D: Cell(of("here", "center_cam"), "center_cam", "Expected `array"),
        KITTI: Cell(of("here", "x"), "line", "no number"),
    },
    "a number too few": {
        OMNI3D: Cell(matrix("center_cam", lambda c: c[:2]), "center_cam", "must be 3 numbers"),
        KITTI: Cell(lambda file: file.box.pop("z"), "line", "must have 15 fields"),
    },
    "no centre": {
        OMNI3D: Cell(of(None, "center_cam"), "center_cam", "is missing"),
    },
    "no dimensions": {
        OMNI3D: Cell(of([-1, -1, -1], "dimensions"), "dimensions", "is missing"),
    },
    "neither rotation nor corners": {
        OMNI3D: Cell(of(None, "R_cam", "bbox3D_cam"), "R_cam", "is missing, and so are"),
    },
    "truncation beyond 1": {
        OMNI3D: Cell(of(1.5, "truncation"), "truncation", "must lie in 0 to 1"),
        KITTI: Cell(of("1.5", "truncated"), "truncated", "must lie in 0 to 1"),
    },
    "visibility, or occlusion, that is none": {
        OMNI3D: Cell(of(3, "visibility"), "visibility", "must lie in 0 to 1"),
        KITTI: Cell(of("5", "occluded"), "occluded", "must be 0, 1, 2 or 3"),
    },
    "an angle in degrees": {
        KITTI: Cell(number("rotation_y", np.rad2deg), "rotation_y", "looks like degrees"),
    },
    "an alpha of another yaw": {
        KITTI: Cell(number("alpha", lambda a: a + np.pi), "alpha", "by half a turn"),
    },
    "an alpha in degrees": {
        KITTI: Cell(number("alpha", lambda a: 400 + a), "alpha", "looks like degrees"),
    },
    "a rotation of another box": {
        OMNI3D: Cell(matrix("R_cam", lambda R: R[[1, 2, 0]]), "R_cam", "does not turn the box"),
    },
    "a rotation transposed": {
        OMNI3D: Cell(matrix("R_cam", lambda R: R.T), "R_cam", "its transpose does"),
    },
    "a mirrored rotation": {
        OMNI3D: Cell(matrix("R_cam", lambda R: R * [1, 1, -1]), "R_cam", "determinant -1"),
    },
    "a rotation that is scaled": {
        OMNI3D: Cell(matrix("R_cam", lambda R: 1.1 * R), "R_cam", "must be a rotation matrix"),
    },
    "corners that are no box": {
        OMNI3D: Cell(
            matrix("bbox3D_cam", lambda X: X + np.eye(8, 3)), "bbox3D_cam", "is not a box"
        ),
    },
    "sides locked left-handed": {
        OMNI3D: Cell(
            of({"front": 3, "top": 0, "left": 5}, "face_locks"), "face_locks", "right-handed"
        ),
    },
    "an unknown category": {
        OMNI3D: Cell(of(77, "category_id"), "category_id", "is not among the file's categories"),
    },
    "the name of another category": {
        OMNI3D: Cell(of("cow", "category_name"), "category_name", "is 'cow'"),
    },
    "no intrinsics": {
        OMNI3D: of_image(image_of("K", -np.ones((3, 3))), "K", "is missing"),
        KITTI: of_image(lambda file: file.calibration.write_text("P0: 1"), "P2", "missing"),
    },
    "intrinsics without a focal length": {
        OMNI3D: of_image(image_of("K", np.diag([0.0, 1, 1])), "K", "positive focal"),
        KITTI: of_image(lambda file: file.P2("0 " * 10 + "1 0"), "P2", "positive focal"),
    },
    "intrinsics that are normalised": {
        OMNI3D: of_image(
            image_of("K", np.array([[0.6, 0, 0.5], [0, 0.8, 0.5], [0, 0, 1]])),
            "K",
            "looks normalised",
        ),
        KITTI: of_image(
            lambda file: file.P2("0.6 0 0.5 0 0 0.8 0.5 0 0 0 1 0"), "P2", "looks normalised"
        ),
    },
    "intrinsics transposed": {
        OMNI3D: of_image(
            image_of("K", np.array([[100.0, 0, 0], [0, 100, 0], [79.5, 59.5, 1]])),
            "K",
            "upper triangular",
        ),
        KITTI: of_image(
            lambda file: file.P2("100 0 0 0 0 100 0 0 79.5 59.5 1 0"), "P2", "upper triangular"
        ),
    },
    "intrinsics of other numbers": {
        OMNI3D: of_image(image_of("K", [100.0, 100.0, 80.0]), "K", "3 x 3 numbers"),
        KITTI: of_image(lambda file: file.P2("100 100 80 60"), "P2", "12 finite numbers"),
    },
    "an image that is missing": {
        OMNI3D: of_image(lambda file: (file.folder / "0.jpg").unlink(), "file_path", "there is no"),
        KITTI: of_image(
            lambda file: (file.folder / "image_2" / "000000.png").unlink(),
            "image",
            "cannot be decoded",
        ),
    },
    "a file that is no image": {
        KITTI: of_image(
            lambda file: (file.folder / "image_2" / "000000.png").write_text("text"),
            "image",
            "cannot be decoded",
        ),
    },
    "calibration that is missing": {
        KITTI: of_image(lambda file: file.calibration.unlink(), "calib", "cannot be read"),
    },
    "an image of no size": {
        OMNI3D: of_image(image_of("width", 0), "height, width", "must be positive"),
    },
}
CELLS = [(kind, reader) for kind, cells in TABLE.items() for reader in cells]


@pytest.mark.parametrize("reader", MAKE)
def test_without_a_fault_all_is_read(tmp_path: Path, reader: str) -> None:
    back = MAKE[reader](tmp_path).read()
    assert (len(back.records), back.faults) == (BOXES, ())
    assert FIRST[reader] == back.records[0].sample_id


@pytest.mark.parametrize(("kind", "reader"), CELLS)
def test_a_fault_names_its_sample_and_field_and_spoils_no_other(
    tmp_path: Path, kind: str, reader: str
) -> None:
    cell, file = TABLE[kind][reader], MAKE[reader](tmp_path)
    cell.spoil(file)
    for element in getattr(file, "content", {}).get("images", ()):
        element["K"] = np.array(element["K"]).tolist()
    back = file.read()
    (fault,) = back.faults
    assert str(fault).startswith(f"{FIRST[reader]}{cell.sample}: {cell.field}"), fault
    assert cell.words in fault.problem
    assert len(back.records) == cell.read
    lost = f"{FIRST[reader]}{cell.sample}"
    assert lost not in {record.sample_id for record in back.records}


NOTED: dict[str, dict[str, tuple[Callable[[Any], object], str]]] = {
    "millimetres": {
        OMNI3D: (
            lambda file: [
                element.update({key: (1000 * np.array(element[key])).tolist()})
                for element in file.content["annotations"]
                for key in ("center_cam", "dimensions", "bbox3D_cam")
            ],
            "looks like millimetres",
        ),
        KITTI: (
            lambda file: [
                line.update({key: str(1000 * float(line[key])) for key in "hwlxyz"})
                for line in file.lines
            ],
            "looks like millimetres",
        ),
    },
    "a unit that is not said": {
        OMNI3D: (lambda file: file.content["info"].pop("units"), "--metric yes"),
    },
    "orientation that nothing confirms": {
        OMNI3D: (of(None, "bbox3D_cam"), "bbox3D_cam is missing in 1 of 4"),
    },
    "regions that are no boxes": {
        KITTI: (of("DontCare", "kind"), "1 DontCare regions were left out"),
    },
    "boxes without a third dimension": {
        OMNI3D: (of(False, "valid3D"), "1 annotations say that they have no 3D box"),
        KITTI: (of("-1000", "x", "y", "z"), "1 boxes without a 3D location were left out"),
    },
}


@pytest.mark.parametrize(
    ("kind", "reader"), [(kind, reader) for kind, cells in NOTED.items() for reader in cells]
)
def test_what_is_only_implausible_or_left_out_is_noted(
    tmp_path: Path, kind: str, reader: str
) -> None:
    for name in ("good", "noted"):
        (tmp_path / name).mkdir()
    (spoil, words), file = NOTED[kind][reader], MAKE[reader](tmp_path / "noted")
    assert not any(words in note for note in MAKE[reader](tmp_path / "good").read().notes)
    spoil(file)
    back = file.read()
    assert back.faults == ()
    assert any(words in note for note in back.notes), back.notes
