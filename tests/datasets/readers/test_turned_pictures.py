"""Pictures that EXIF says to turn: what every reader, Dataset and command does with them."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from deeplabcut_files import table, write_csv, write_images
from mesh_folder_dataset import write_json, write_mesh_folder
from PIL import Image
from torch import Tensor
from turned_pictures import turn_file
from written_otherwise import json_set

from animal3dbox.cli.main import main as animal3dbox
from animal3dbox.datasets.bodies.sources import preset_body
from animal3dbox.datasets.cuboid_datasets import KittiDataset, Omni3DDataset
from animal3dbox.datasets.format_datasets import AnnotatedDataset
from animal3dbox.datasets.formats import read_dataset
from animal3dbox.datasets.inspection.inspect import inspect_dataset
from animal3dbox.datasets.label_dataset import LabelDataset
from animal3dbox.datasets.labelling.label_records import label_records
from animal3dbox.datasets.labelling.label_requests import request_of_record
from animal3dbox.datasets.labelling.skipped import Skipped
from animal3dbox.datasets.read_options import ReadOptions
from animal3dbox.datasets.records import CuboidRecord, CuboidSet
from animal3dbox.errors import SampleError
from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.types import CuboidLabel

QUICK = LabelConfig(surface_share=False, mask_iou=False)
PICTURES = (".jpg", ".png", ".tif")


def sizes_left_out(root: Path, format: str, view: Any) -> Path:
    """A dataset whose sizes are read from its pictures, if its format knows any."""
    made = json_set(format, root, view)
    for element in [*made.animals, *(image for image, _ in made.images)]:
        for key in ("width", "height"):
            element.pop(key, None)
    for animal in made.animals:
        animal.pop("segmentation", None)
    return made.write()


def written(root: Path, format: str, view: Any) -> Path:
    """A dataset of upright pictures in any format."""
    if format == "mesh_folder":
        return write_mesh_folder(root)
    if format == "deeplabcut":
        write_images(root / "images", 2)
        return write_csv(root / "CollectedData_Me.csv", table([[60], [250]]))
    return sizes_left_out(root, format, view)


def first(dataset: LabelDataset) -> tuple[Tensor, dict[str, Any]]:
    """The first image and target of a Dataset, which must have one."""
    sample = dataset[0]
    assert not isinstance(sample, Skipped)
    return sample


def pictures_of(root: Path) -> list[Path]:
    return sorted(path for path in root.rglob("*") if path.suffix in PICTURES)


@pytest.fixture(scope="module")
def view() -> Any:
    from photo_dataset import toy_scene, view_of

    return view_of(toy_scene(), 60)


FORMATS = ("coco", "stanfordextra", "animal3d", "deeplabcut", "mesh_folder")


@pytest.fixture(params=FORMATS)
def dataset(request: pytest.FixtureRequest, tmp_path: Path, view: Any) -> tuple[str, Path]:
    return request.param, written(tmp_path / "set", request.param, view)


def options(path: Path, **more: Any) -> ReadOptions:
    folder = path if path.is_dir() else path.parent
    return ReadOptions(images=folder / "images", **more)


@pytest.mark.parametrize("orientation", [2, 3, 6, 8])
def test_upright_annotations_of_turned_pictures_are_read_as_of_upright_ones(
    dataset: tuple[str, Path], orientation: int
) -> None:
    format, path = dataset
    plain = read_dataset(path, format, options(path)).records
    pictures = [np.asarray(Image.open(record.image_path or "")) for record in plain.records]
    masks = [record.mask for record in plain.records]
    for file in pictures_of(path.parent):
        turn_file(file, orientation)
    found = read_dataset(path, format, options(path, apply_orientation=True)).records
    assert found.faults == ()
    assert any("turned upright as their EXIF headers say" in note for note in found.notes)
    assert not any("turned upright" in note for note in plain.notes)
    dataset_of = AnnotatedDataset(
        path,
        format=format,
        images=options(path).images,
        apply_orientation=True,
        on_bad="skip",
        body=None if format == "mesh_folder" else "preset",
        config=QUICK,
    )
    for one, other, picture, mask in zip(
        found.records, plain.records, pictures, masks, strict=True
    ):
        assert (one.image_hw, one.upright) == (other.image_hw, True)
        found_mask = one.mask
        assert (found_mask is None) == (mask is None)
        if mask is not None:
            assert found_mask is not None
            assert np.array_equal(found_mask, mask)
        sample = dataset_of.source.sample(
            next(i for i in range(len(dataset_of)) if dataset_of.image_id(i) == one.image_id)
        )
        photo = dataset_of.source.photo(sample)
        assert photo.pixels.shape == picture.shape
        assert np.abs(photo.pixels.astype(int) - picture).mean() < 3  # JPEG, once more
        assert dataset_of.source.facts(sample) == photo.facts
        assert photo.facts.upright


@pytest.mark.parametrize("orientation", [2, 3, 4])
def test_pictures_that_are_kept_as_stored_are_flagged(
    dataset: tuple[str, Path], orientation: int
) -> None:
    format, path = dataset
    for file in pictures_of(path.parent / "set" / "images") or pictures_of(path.parent):
        turn_file(file, orientation)
    found = read_dataset(path, format, options(path))
    bodies = found.bodies or preset_body("dog")
    requests = [request_of_record(record, bodies) for record in found.records.records]
    labels = [
        label
        for label in label_records(requests, QUICK, misplaced="flag")
        if isinstance(label, CuboidLabel)
    ]
    assert labels
    for label in labels:
        assert "not_turned" in label.quality.flags
        assert any(f"EXIF orientation {orientation} was not" in w for w in label.quality.warnings)


@pytest.fixture
def coco(tmp_path: Path, view: Any) -> Path:
    """A file that says the sizes of its upright pictures."""
    made = json_set("coco", tmp_path / "coco", view)
    for image, key in made.images:
        with Image.open(made.root / "images" / image[key]) as picture:
            image["width"], image["height"] = picture.size
    return made.write()


def test_the_command_says_what_it_does(coco: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name, orientation in (("a.jpg", 3), ("sub/b.jpg", 6)):
        turn_file(coco.parent / "images" / name, orientation)
    command = ["label", str(coco), "--images", str(coco.parent / "images"), "--body", "preset"]
    command += ["--out", str(coco.parent / "out")]
    with pytest.raises(SystemExit):
        animal3dbox(command)
    said = capsys.readouterr().out
    assert "1 x not_turned" in said
    assert "EXIF orientation 6; turn it so by --orientation apply" in said
    with pytest.raises(SystemExit) as end:
        animal3dbox([*command, "--orientation", "apply"])
    assert end.value.code == 0
    out, err = capsys.readouterr()
    assert "not_turned" not in out
    assert "2 pictures were turned by their EXIF orientation" in err
    labels = json.loads((coco.parent / "out" / "labels.json").read_text())["animals"]
    turned = [one["quality"]["warnings"] for one in labels]
    assert sum(any("turned upright by its EXIF" in w for w in each) for each in turned) == 3


def test_targets_and_their_cache_know_the_choice(coco: Path, tmp_path: Path) -> None:
    for file in pictures_of(coco.parent):
        turn_file(file, 2)
    kept, turned = (
        AnnotatedDataset(
            coco,
            images=coco.parent / "images",
            body="preset",
            config=QUICK,
            misplaced="flag",
            cache=tmp_path / "cache",
            apply_orientation=apply,
        )
        for apply in (False, True)
    )
    image, target = first(kept)
    other_image, other = first(turned)
    assert (target["meta"]["exif_orientation"], target["meta"]["turned_upright"]) == (2, False)
    assert (other["meta"]["exif_orientation"], other["meta"]["turned_upright"]) == (2, True)
    assert (image.flip(2).int() - other_image.int()).abs().float().mean() < 1
    assert "not_turned" in target["meta"]["quality"][0]["flags"]
    assert other["meta"]["quality"][0]["flags"].count("not_turned") == 0
    again = first(kept)[1]["meta"]["quality"][0]["flags"]
    assert "not_turned" in again  # the other's label is not in the way
    keys = [
        data._store.request(data.source.sample(0), 0, data.source.facts(data.source.sample(0))).key
        for data in (kept, turned)
    ]
    assert keys[0] != keys[1]


def test_a_mask_of_its_own_orientation_changes_the_key_too(tmp_path: Path, view: Any) -> None:
    """The photograph is upright and the mask is not, so that the headers' facts are the same."""
    root = write_mesh_folder(tmp_path / "set")
    turn_file(root / "masks" / "a.png", 3)
    kept, turned = (
        AnnotatedDataset(root, config=QUICK, cache=tmp_path / "cache", apply_orientation=apply)
        for apply in (False, True)
    )
    keys = [
        data._store.request(data.source.sample(0), 0, data.source.facts(data.source.sample(0))).key
        for data in (kept, turned)
    ]
    assert keys[0] != keys[1]
    assert np.array_equal(
        first(kept)[1]["masks"][0].numpy()[::-1, ::-1], first(turned)[1]["masks"][0].numpy()
    )


@pytest.mark.parametrize("apply", [False, True])
def test_a_camera_for_the_other_pixels_is_a_fault(tmp_path: Path, *, apply: bool) -> None:
    root = write_mesh_folder(tmp_path / "set")
    file = root / "images" / "a.jpg"
    (root / "masks" / "a.png").unlink()
    with Image.open(file) as image:
        width, height = image.size
    turn_file(file, 6)
    other = (height, width) if apply else (width, height)
    camera = json.loads((root / "cameras" / "a.json").read_text())
    del camera["image_hw"]
    camera["K"][0][2], camera["K"][1][2] = (other[0] - 1) / 2, (other[1] - 1) / 2
    write_json(root / "cameras" / "a.json", camera)
    found = read_dataset(root, options=ReadOptions(apply_orientation=apply))
    request = request_of_record(found.records.records[0], found.bodies)
    (fault,) = label_records([request], QUICK)
    assert isinstance(fault, SampleError)
    assert (fault.sample_id, fault.field) == ("a.jpg", "K")
    used = "turned upright" if apply else "stored"
    assert f"it is used as {used}" in fault.problem
    right = replace(found.records.records[0], K=np.array(camera["K"])[[1, 0, 2]][:, [1, 0, 2]])
    (label,) = label_records([request_of_record(right, found.bodies)], QUICK)
    assert not isinstance(label, SampleError)


def test_a_camera_of_the_other_size_names_the_option(tmp_path: Path) -> None:
    root = write_mesh_folder(tmp_path / "set")
    turn_file(root / "images" / "a.jpg", 6)
    (fault,) = read_dataset(root).records.faults
    assert (fault.sample_id, fault.field) == ("a.jpg", "camera")
    assert "See --orientation" in fault.problem
    assert read_dataset(root, options=ReadOptions(apply_orientation=True)).records.faults == ()


def test_inspect_says_which_pictures_may_lie_otherwise(coco: Path) -> None:
    plain = inspect_dataset(coco, options=ReadOptions(images=coco.parent / "images"))
    assert not any("--orientation apply" in answer for answer in plain.answers)
    turn_file(coco.parent / "images" / "a.jpg", 3)
    turned = inspect_dataset(coco, options=ReadOptions(images=coco.parent / "images"))
    assert turned.image_files.turned_by_exif == 1
    assert any("1 say by EXIF" in answer for answer in turned.answers)


def test_a_focal_length_of_exif_has_its_middle_in_the_turned_picture(
    coco: Path, tmp_path: Path
) -> None:
    for file in pictures_of(coco.parent):
        with Image.open(file) as image:
            stored = image.transpose(Image.Transpose.ROTATE_90)  # what 6 turns back
        exif = Image.Exif()
        exif[274] = 6
        exif[34665] = {41989: 50}
        stored.save(file, exif=exif)
    dataset = AnnotatedDataset(
        coco,
        images=coco.parent / "images",
        body="preset",
        config=QUICK,
        apply_orientation=True,
    )
    picture, target = first(dataset)
    height, width = picture.shape[1:]
    assert width > height
    assert target["meta"]["K_source"] == "exif"
    assert target["K"][:2, 2].tolist() == [(width - 1) / 2, (height - 1) / 2]


def test_boxes_of_kitti_may_be_for_turned_pictures(tmp_path: Path) -> None:
    picture = np.zeros((48, 64, 3), dtype=np.uint8)
    picture[:, :20] = 255
    for folder in ("image_2", "label_2", "calib"):
        (tmp_path / folder).mkdir()
    Image.fromarray(picture).save(tmp_path / "image_2" / "000000.png")
    turn_file(tmp_path / "image_2" / "000000.png", 3)
    line = "Dog 0.00 0 0.00 20.00 15.00 40.00 35.00 0.60 0.30 0.90 0.00 0.30 4.00 0.00\n"
    (tmp_path / "label_2" / "000000.txt").write_text(line)
    P2 = "60 0 31.5 0 0 60 23.5 0 0 0 1 0"
    (tmp_path / "calib" / "000000.txt").write_text(f"P2: {P2}\n")
    for apply in (False, True):
        dataset = KittiDataset(tmp_path, on_bad="skip", apply_orientation=apply)
        photo = dataset.source.photo(dataset.source.sample(0))
        expected = picture if apply else picture[::-1, ::-1]
        assert np.array_equal(photo.pixels, expected)
        assert any("turned upright" in note for note in dataset.notes) == apply


@pytest.mark.parametrize("has_box", [False, True])
def test_boxes_of_turned_pictures_come_as_they_are(tmp_path: Path, *, has_box: bool) -> None:
    from animal3dbox.datasets.exchange.omni3d_writer import write_omni3d
    from animal3dbox.datasets.records import CuboidImage

    picture = np.zeros((48, 64, 3), dtype=np.uint8)
    picture[:, :20] = 255
    Image.fromarray(picture).save(tmp_path / "a.png")
    turn_file(tmp_path / "a.png", 6)
    K = np.array([[60.0, 0, 31.5], [0, 60, 23.5], [0, 0, 1]])
    box = CuboidRecord(
        sample_id="a.png",
        image_id="a.png",
        image_path=tmp_path / "a.png",
        image_hw=(48, 64),
        category="dog",
        K=K,
        center=np.array([0.0, 0.0, 4.0]),
        rotation=np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]),
        size=np.array([0.9, 0.3, 0.6]),
    )
    listed = CuboidImage("a.png", tmp_path / "a.png", (48, 64), K)
    boxes = CuboidSet("boxes", (box,) if has_box else (), (), images=(listed,), categories=("dog",))
    write_omni3d(boxes, tmp_path / "boxes.json")
    turned = Omni3DDataset(tmp_path / "boxes.json", images=tmp_path, apply_orientation=True)
    image, target = first(turned)
    assert np.array_equal(image.permute(1, 2, 0).numpy(), picture)
    assert target["meta"]["turned_upright"]
    with pytest.raises(SampleError, match="--orientation apply"):
        Omni3DDataset(tmp_path / "boxes.json", images=tmp_path)[0]
