"""What can be wrong with picture, mask and mesh files: each kind in every reader and format.

A cell makes a small dataset, spoils one file, loads all of it, and looks for the sample and the
field in what the Dataset reports, and for other samples, which must not be touched.
"""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from animals import toy_mesh
from deeplabcut_files import table, write_csv, write_images
from mesh_folder_dataset import write_mesh_folder
from photo_dataset import View, png_that_claims, toy_scene, view_of
from PIL import Image
from turned_pictures import turn_file
from written_otherwise import json_set

from animal3dbox.datasets import AnnotatedDataset
from animal3dbox.datasets.labelling.load_report import Case
from animal3dbox.labels.config import LabelConfig

QUICK = LabelConfig(surface_share=False, mask_iou=False)
Spoil = Callable[[Path], object]
JSON = ("coco", "stanfordextra", "animal3d")
READERS = (*JSON, "deeplabcut", "mesh_folder")


@pytest.fixture(scope="module")
def view() -> View:
    return view_of(toy_scene(), 60)


def made(root: Path, reader: str, view: View) -> tuple[Path, Path, str]:
    """A dataset, its first picture, and the words by which reports name that."""
    if reader == "mesh_folder":
        write_mesh_folder(root)
        return root, root / "images" / "a.jpg", "a.jpg"
    if reader == "deeplabcut":
        write_images(root / "images", 2)
        path = write_csv(root / "CollectedData_Me.csv", table([[60], [250]]))
        return path, root / "images" / "img000.png", "img000.png"
    dataset = json_set(reader, root, view)
    for image, key in dataset.images:
        with Image.open(root / "images" / image[key]) as picture:
            keys = ("img_width", "img_height") if reader == "stanfordextra" else ("width", "height")
            image |= dict(zip(keys, picture.size, strict=True))
    return dataset.write(), root / "images" / "a.jpg", "a.jpg"


def faults_of(path: Path, reader: str, **options: Any) -> list[Case]:
    """What a Dataset that leaves out what is wrong says when all of it has been loaded."""
    home = path if path.is_dir() else path.parent
    dataset = AnnotatedDataset(
        path,
        format=reader,
        images=home / "images",
        body=None if reader == "mesh_folder" else "preset",
        on_bad="skip",
        config=QUICK,
        **options,
    )
    for index in range(len(dataset)):
        dataset[index]
    return [case for case in dataset.report().cases if case.kind == "fault"]


def written(data: Callable[[bytes], bytes]) -> Spoil:
    return lambda file: file.write_bytes(data(file.read_bytes()))


def as_folder(file: Path) -> None:
    file.unlink()
    file.mkdir()


def linked_out(file: Path) -> None:
    outside = file.parent.parent.parent / f"outside-{file.name}"
    file.rename(outside)
    file.symlink_to(outside)


def saved_as(change: Callable[[Image.Image], Image.Image], format: str) -> Spoil:
    """Store the picture changed, in another format under its old name."""

    def spoil(file: Path) -> None:
        with Image.open(file) as image:
            changed = change(image.convert("RGB"))
        changed.save(file, format)

    return spoil


def held_as(orientation: int) -> Spoil:
    return lambda file: turn_file(file, orientation)


ANY = READERS
PICTURES: dict[str, tuple[Spoil, tuple[str, ...]]] = {
    "missing": (lambda file: file.unlink(), (*JSON, "deeplabcut")),
    "a_folder": (as_folder, (*JSON, "deeplabcut")),
    "linked_out_of_the_root": (linked_out, ANY),
    "empty": (written(lambda data: b""), ANY),
    "words": (written(lambda data: b"<html>404</html>"), ANY),
    "cut_in_its_header": (written(lambda data: data[:16]), ANY),
    "cut_in_its_pixels": (written(lambda data: data[: len(data) * 2 // 3]), ANY),
    "larger_than_any_decoder_takes": (written(lambda data: png_that_claims(60_000, 60_000)), ANY),
    "of_more_pixels_than_are_read": (written(lambda data: png_that_claims(12_000, 10_000)), ANY),
    "of_floats": (saved_as(lambda image: image.convert("F"), "TIFF"), ANY),
    "resized": (saved_as(lambda image: image.resize((80, 60)), "PNG"), JSON),
    "cropped": (saved_as(lambda image: image.crop((0, 0, 100, 100)), "PNG"), JSON),
    **{f"held_as_exif_{number}_says": (held_as(number), JSON) for number in (5, 6, 7, 8)},
}
"""Kinds of pictures, and the readers whose datasets can have them."""
PICTURE_CELLS = [(name, reader) for name, (_, readers) in PICTURES.items() for reader in readers]


@pytest.mark.parametrize("reader", READERS)
def test_a_set_without_a_mistake_has_none(reader: str, tmp_path: Path, view: View) -> None:
    path, _, _ = made(tmp_path / "set", reader, view)
    assert faults_of(path, reader) == []


@pytest.mark.parametrize(("name", "reader"), PICTURE_CELLS)
def test_what_is_wrong_with_a_picture_is_told_by_sample_and_field(
    name: str, reader: str, tmp_path: Path, view: View
) -> None:
    path, file, image = made(tmp_path / "set", reader, view)
    PICTURES[name][0](file)
    cases = faults_of(path, reader)
    assert cases
    for case in cases:
        assert case.sample_id.partition("#")[0].endswith(image), case
        assert case.field in ("image", "img_path", "file_name"), case
        assert len(case.problem) > 20, case


@pytest.mark.parametrize("reader", JSON)
def test_a_picture_is_right_once_it_is_held_as_it_was_annotated(
    reader: str, tmp_path: Path, view: View
) -> None:
    path, _, _ = made(tmp_path / "set", reader, view)
    for file in sorted((tmp_path / "set" / "images").rglob("*.jpg")):
        turn_file(file, 6)
    assert faults_of(path, reader)
    assert faults_of(path, reader, apply_orientation=True) == []


# Masks that are pictures
# --------------------------------------------------------------------------------------------------


def mask_of(values: Callable[[Any], Any], format: str = "PNG") -> Spoil:
    """Store a mask of other values."""

    def spoil(file: Path) -> None:
        with Image.open(file) as image:
            changed = values(np.array(image.convert("L")))
        Image.fromarray(changed).save(file, format)

    return spoil


def two_ids(mask: Any) -> Any:
    """A second animal of another id, above those that are read as ids."""
    other = mask.copy()
    other[:40, :60] = 90
    return other


MASKS: dict[str, Spoil] = {
    "words": written(lambda data: b"no picture"),
    "empty": written(lambda data: b""),
    "cut": written(lambda data: data[: len(data) // 2]),
    "of_another_size": mask_of(lambda mask: mask[::2, ::2].copy()),
    "of_width_and_height_exchanged": mask_of(lambda mask: np.ascontiguousarray(mask.T)),
    "of_zeros": mask_of(lambda mask: mask * 0),
    "of_ids": mask_of(two_ids),
    "of_floats": mask_of(lambda mask: mask.astype(np.float32), "TIFF"),
    "held_on_its_side": lambda file: turn_file(file, 6),
    "too_large": written(lambda data: png_that_claims(60_000, 60_000)),
}


@pytest.mark.parametrize("optional", ["fault", "drop"])
@pytest.mark.parametrize("name", MASKS)
@pytest.mark.parametrize("reader", ["animal3d", "mesh_folder"])
def test_what_is_wrong_with_a_mask_is_told_or_the_mask_left_out(
    name: str, reader: str, optional: str, tmp_path: Path, view: View
) -> None:
    path, file, image = made(tmp_path / "set", reader, view)
    mask = tmp_path / "set" / "masks" / "a.png"
    if reader == "animal3d":
        content = json.loads(path.read_text())
        content["data"][0]["mask_path"] = "masks/a.png"
        path.write_text(json.dumps(content))
        mask.parent.mkdir()
        (file.parent / "masks").mkdir()
        mask = file.parent / "masks" / "a.png"
        Image.fromarray((view.mask * 255).astype(np.uint8)).save(mask)
    MASKS[name](mask)
    cases = faults_of(path, reader, optional=optional)
    if optional == "drop":
        assert cases == []
        return
    (case,) = cases
    assert (case.sample_id, case.field) == (image, "mask")
    assert len(case.problem) > 20


# Meshes
# --------------------------------------------------------------------------------------------------


Arrays = tuple[Any, Any]
MESH_FORMATS = (".obj", ".ply", ".off", ".stl", ".npz")


def write_mesh(folder: Path, suffix: str, mesh: Arrays) -> Path:
    """The mesh a in a format, instead of the OBJ."""
    (folder / "a.obj").unlink()
    vertices, faces = mesh
    path = folder / f"a{suffix}"
    if suffix == ".npz":
        np.savez(path, vertices=vertices, faces=faces)
    elif suffix == ".obj":
        lines = ["v " + " ".join(map(str, vertex)) for vertex in vertices.tolist()]
        lines += ["f " + " ".join(str(i + 1) for i in face) for face in faces.tolist()]
        path.write_text("\n".join(lines))
    else:
        options = {"encoding": "ascii"} if suffix == ".ply" else {}
        mesh_file = trimesh.Trimesh(vertices, faces, process=False)
        data: Any = mesh_file.export(file_type=suffix[1:], **options)
        path.write_bytes(data.encode() if isinstance(data, str) else data)
    return path


def toy_arrays() -> Arrays:
    vertices, faces = toy_mesh()
    return vertices.numpy().copy(), faces.numpy().copy()


def not_finite(mesh: Arrays) -> Arrays:
    mesh[0][5, 1] = np.nan
    return mesh


CONTENTS: dict[str, tuple[Callable[[Arrays], Arrays], tuple[str, ...]]] = {
    "a_vertex_that_is_not_finite": (not_finite, MESH_FORMATS),
    "no_faces": (lambda mesh: (mesh[0], mesh[1][:0]), (".obj", ".off", ".npz")),
    "faces_of_other_vertices": (lambda mesh: (mesh[0], mesh[1] + 9), (".obj", ".npz")),
    "three_vertices": (lambda mesh: (mesh[0][:3], mesh[1][:1] * 0 + [0, 1, 2]), MESH_FORMATS),
    "numbers_of_another_unit": (lambda mesh: (mesh[0] / 1000, mesh[1]), MESH_FORMATS),
}
FILES: dict[str, Spoil] = {
    "empty": written(lambda data: b""),
    "words": written(lambda data: b"v one two three\nsolid\nply\n"),
    "cut": written(lambda data: data[: len(data) * 3 // 5]),
}


def mesh_faults(root: Path) -> list[Case]:
    return faults_of(root, "mesh_folder")


@pytest.mark.parametrize("suffix", [*MESH_FORMATS[:-2], ".npz"])
def test_a_whole_mesh_of_every_format_is_read(suffix: str, tmp_path: Path) -> None:
    root = write_mesh_folder(tmp_path)
    write_mesh(root / "meshes", suffix, toy_arrays())
    assert mesh_faults(root) == []


@pytest.mark.parametrize(
    ("name", "suffix"),
    [(name, suffix) for name, (_, suffixes) in CONTENTS.items() for suffix in suffixes],
)
def test_what_is_wrong_in_a_mesh_is_told_by_sample_and_file(
    name: str, suffix: str, tmp_path: Path
) -> None:
    root = write_mesh_folder(tmp_path)
    write_mesh(root / "meshes", suffix, CONTENTS[name][0](toy_arrays()))
    (case,) = mesh_faults(root)
    assert case.sample_id == "a.jpg"
    assert "mesh" in case.field
    assert f"a{suffix}" in case.problem


@pytest.mark.parametrize("suffix", MESH_FORMATS)
@pytest.mark.parametrize("name", FILES)
def test_a_damaged_mesh_file_is_told_by_sample_and_file(
    name: str, suffix: str, tmp_path: Path
) -> None:
    root = write_mesh_folder(tmp_path)
    FILES[name](write_mesh(root / "meshes", suffix, toy_arrays()))
    (case,) = mesh_faults(root)
    assert case.sample_id == "a.jpg"
    assert "mesh" in case.field or (suffix == ".stl" and case.field == "landmarks")
    assert f"a{suffix}" in case.problem


def test_the_tables_are_large() -> None:
    cells = len(PICTURE_CELLS) + 2 * len(MASKS) + len(FILES) * len(MESH_FORMATS)
    assert cells + sum(len(suffixes) for _, suffixes in CONTENTS.values()) >= 100
