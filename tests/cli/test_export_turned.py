"""``animal3dbox export`` of labels for pictures that were turned as their headers say."""

from pathlib import Path

import numpy as np
import pytest
from commands import ran
from numpy.typing import NDArray
from photo_dataset import toy_scene, view_of
from PIL import Image
from turned_pictures import turn_file
from written_otherwise import json_set

from animal3dbox.datasets.cuboid_datasets import Omni3DDataset
from animal3dbox.datasets.labelling.skipped import Skipped
from animal3dbox.report.label_reading import read_labels_json


@pytest.fixture(params=[3, 6])
def labelled(request: pytest.FixtureRequest, tmp_path: Path) -> tuple[Path, Path]:
    """The folders of pictures and of labels of a set that was labelled with them turned."""
    made = json_set("coco", tmp_path / "set", view_of(toy_scene(), 60))
    animals = {animal["image_id"]: animal for animal in made.animals}  # one an image
    made.content["annotations"] = list(animals.values())
    dataset = made.write()
    images = tmp_path / "set" / "images"
    for number, path in enumerate(sorted(images.rglob("*.*"))):
        turn_file(path, request.param if number else 1)  # the first lies as it is
    out = tmp_path / "labels"
    code, output = ran(
        *("label", dataset, "--images", images, "--body", "preset", "--orientation", "apply"),
        *("--out", out),
    )
    assert code == 0, output
    return images, out


def shown(path: Path) -> NDArray[np.uint8]:
    """The pixels of a picture as its header says to turn them."""
    with Image.open(path) as image:
        orientation = image.getexif().get(274, 1)
        pixels = np.array(image.convert("RGB"))
    return {1: pixels, 3: pixels[::-1, ::-1], 6: np.rot90(pixels, -1)}[orientation]


def assert_pictures_lie_as_their_labels(folder: Path, labels: Path, images: Path) -> None:
    index = (folder / "images.txt").read_text().splitlines()
    names = [line.split(" ", 3)[3] for line in index if line[0] != "#"]
    rows = {row.image: row for row in read_labels_json(labels / "labels.json").animals}
    assert [rows[name].upright for name in sorted(rows)] == [False] + [True] * (len(rows) - 1)
    assert len(rows) > 1
    for number, name in enumerate(names):
        written = np.array(Image.open(folder / "image_2" / f"{number:06d}.png"))
        assert written.shape[:2] == rows[name].image_hw
        assert np.array_equal(written, shown(images / name))


def test_kitti_gets_the_pictures_as_the_labels_have_them(
    labelled: tuple[Path, Path], tmp_path: Path
) -> None:
    images, labels = labelled
    kitti = tmp_path / "kitti"
    code, output = ran(
        "export", labels, "--to", "kitti", "--out", kitti, "--images", images, "--scale-free"
    )
    assert code == 0, output
    assert_pictures_lie_as_their_labels(kitti, labels, images)


def test_omni3d_says_which_pictures_are_turned_and_is_read_so(
    labelled: tuple[Path, Path], tmp_path: Path
) -> None:
    images, labels = labelled
    omni3d, kitti = tmp_path / "omni3d" / "animals.json", tmp_path / "kitti"
    code, output = ran("export", labels, "--to", "omni3d", "--out", omni3d, "--scale-free")
    assert (code, "pixels turned as the EXIF headers say" in output) == (0, True), output
    code, output = ran(
        "export", omni3d, "--to", "kitti", "--out", kitti, "--images", images, "--scale-free"
    )
    assert code == 0, output
    assert_pictures_lie_as_their_labels(kitti, labels, images)
    dataset = Omni3DDataset(omni3d, images=images, on_bad="skip")
    for number in range(len(dataset)):
        sample = dataset[number]
        assert not isinstance(sample, Skipped)
        picture, target = sample
        pixels = (255 * picture).round().byte() if picture.is_floating_point() else picture
        name = target["image_id"]
        assert np.array_equal(pixels.permute(1, 2, 0).numpy(), shown(images / name))


def test_coco_says_that_pictures_must_be_read_turned(
    labelled: tuple[Path, Path], tmp_path: Path
) -> None:
    code, output = ran("export", labelled[1], "--to", "coco", "--out", tmp_path / "coco.json")
    assert (code, "pixels turned as the EXIF headers say" in output) == (0, True), output
