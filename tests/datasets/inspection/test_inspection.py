"""Inspecting copies of datasets: what was altered is said, and what was not is not."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from animal3d_copies import Content, copy_with, in_pytorch3d_frame
from coco_dataset import coco_content, write_coco
from mesh_folder_dataset import write_json, write_mesh_folder
from PIL import Image

from animal3dbox.cli.main import main
from animal3dbox.datasets.inspection.inspect import inspect_dataset
from animal3dbox.datasets.inspection.result import Animal3DFacts, Inspection
from animal3dbox.datasets.inspection.text import as_text
from animal3dbox.datasets.read_options import ReadOptions
from animal3dbox.datasets.synthetic.animal3d_writer import write_animal3d
from animal3dbox.datasets.synthetic.faults import FaultConfig
from animal3dbox.datasets.synthetic.synthetic_set import SyntheticSet, animal3d_world
from animal3dbox.datasets.synthetic.world.config import WorldConfig
from animal3dbox.smal.files.safetensors_file import save_safetensors
from animal3dbox.smal.keypoints.vocabularies import VOCABULARIES
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped

FLIP = list(VOCABULARIES["animal3d26"].flip)
OPENCV, PYTORCH3D = "x right, y down, z forward", "x left, y up, z forward"


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the dataset "animals" and its model beside it."""
    home = tmp_path_factory.mktemp("animal3d")
    config = animal3d_world(
        WorldConfig(image_hw=(120, 160), fill=(0.5, 0.9), occluded=0.0, truncated=0.0)
    )
    write_animal3d(
        SyntheticSet(6, 8, config, FaultConfig(noise_px=0.3)), home / "animals", home / "body.pkl"
    )
    return home


def inspected(home: Path, folder: Path, model: bool = True) -> tuple[Inspection, Animal3DFacts]:
    """A copy's inspection, and what is Animal3D's in it."""
    found = inspect_dataset(folder, options=ReadOptions(model=home / "body.pkl" if model else None))
    assert found.animal3d is not None
    return found, found.animal3d


def altered(
    home: Path, tmp_path: Path, change: Callable[[Content], object], model: bool = True
) -> tuple[Inspection, Animal3DFacts]:
    """The inspection of an altered copy."""
    return inspected(home, copy_with(home, tmp_path / "copy", change), model)


def each(change: Callable[[dict[str, Any]], object]) -> Callable[[Content], None]:
    """A change of every entry."""

    def changed(content: Content) -> None:
        for entry in content["data"]:
            change(entry)

    return changed


def answer(found: Inspection, start: str) -> str:
    """The one sentence that starts so."""
    (sentence,) = [sentence for sentence in found.answers if sentence.startswith(start)]
    return sentence


# As it is
# --------------------------------------------------------------------------------------------------


def test_a_copy_as_written_is_counted_and_its_camera_found(home: Path) -> None:
    found, facts = inspected(home, home / "animals")
    assert (found.format, found.images, found.faults.count, found.image_files.looked_at) == (
        "animal3d",
        8,
        0,
        8,
    )
    assert (
        found.animals
        == sum(facts.entries.values())
        == facts.keys["pose"]
        == sum(found.categories.values())
    )
    assert set(facts.entries) == {"train.json", "test.json"}
    assert facts.forms["keypoint_2d"] == {"26x3": found.animals}
    assert facts.forms["pose"] == {"105": found.animals}
    assert set(facts.visibility) == {"0", "1"}
    assert facts.with_tail == {"1": found.animals}
    assert found.masks.levels == {"0 and 255": found.animals}
    assert facts.stored_points is not None
    assert facts.stored_points.relations == {"less trans": found.animals}
    best = facts.cameras[0]
    assert (best.target, best.frame) == ("keypoint_2d", OPENCV)
    assert best.points in ("posed body", "keypoint_3d + trans")  # the same points, but for rounding
    assert best.stored is not None
    assert best.stored.median_px < 0.6
    assert best.focal_px == pytest.approx(1000, rel=0.01)
    assert "which is the stored camera's" in answer(found, "the focal length that fits keypoint_2d")
    assert [(fit.key, fit.relation) for fit in facts.pictures] == [("reproj_kp_2d", "as stored")]
    assert facts.sides is not None
    assert (facts.sides.left_is_left, facts.sides.left_is_right, facts.sides.swapped_in_image) == (
        found.animals,
        0,
        0,
    )
    assert facts.sides.template_wrong == []


def test_without_the_model_the_stored_points_tell_the_camera(home: Path) -> None:
    found, facts = inspected(home, home / "animals", model=False)
    best = facts.cameras[0]
    assert (best.points, best.frame) == ("keypoint_3d + trans", OPENCV)
    assert facts.stored_points is None
    assert found.cameras.residual is None


# Altered
# --------------------------------------------------------------------------------------------------


def test_masks_of_another_range_are_told(home: Path, tmp_path: Path) -> None:
    folder = copy_with(home, tmp_path / "copy", lambda content: None)
    files = sorted((folder / "masks" / "train").rglob("*.png"))
    for file in files[1:]:
        Image.fromarray(np.asarray(np.asarray(Image.open(file)) // 255)).save(file)
    Image.fromarray(np.zeros((120, 160), dtype=np.uint8)).save(files[0])
    found, _ = inspected(home, folder)
    assert found.masks.levels == {"0 and 1": found.animals - 1, "only 0": 1}


def test_other_marks_and_tails_are_told(home: Path, tmp_path: Path) -> None:
    def change(entry: dict[str, Any]) -> None:
        entry["keypoint_2d"] = [[x, y, 2 * v] for x, y, v in entry["keypoint_2d"]]
        entry["with_tail"] = 0

    found, facts = altered(home, tmp_path, each(change))
    assert set(facts.visibility) == {"0", "2"}
    assert set(found.confidences) == {"0", "1"}
    assert answer(found, "keypoint_2d marks with 2; all above 0")
    assert facts.with_tail == {"0": found.animals}
    assert "--tail drop" in answer(found, f"{found.animals} bodies were fitted without their tail")


def test_bodies_in_another_camera_frame_are_told(home: Path, tmp_path: Path) -> None:
    found, facts = altered(home, tmp_path, in_pytorch3d_frame)
    assert (facts.cameras[0].points, facts.cameras[0].frame) == ("posed body", PYTORCH3D)
    assert answer(found, f"keypoint_2d is posed body in the camera frame {PYTORCH3D}")
    assert facts.stored_points is not None
    assert facts.stored_points.relations == {"other frame": found.animals}


def test_another_focal_length_is_not_the_stored_one(home: Path, tmp_path: Path) -> None:
    found, facts = altered(home, tmp_path, lambda content: content.update(flength=500.0))
    assert facts.cameras[0].focal_px == pytest.approx(1000, rel=0.01)
    assert "which is not the stored camera's (flength 500, centred)" in answer(
        found, "the focal length that fits keypoint_2d"
    )


def test_reprojections_in_a_resized_and_padded_picture_are_told(home: Path, tmp_path: Path) -> None:
    def change(entry: dict[str, Any]) -> None:
        entry["reproj_kp_2d"] = [
            [1.6 * (x + 0.5) - 0.5, 1.6 * (y + 0.5) + 32 - 0.5, v]
            for x, y, v in entry["reproj_kp_2d"]
        ]

    found, facts = altered(home, tmp_path, each(change))
    (fit,) = facts.pictures
    assert fit.relation == "scaled and shifted"
    assert fit.scale == pytest.approx(1.6, rel=0.02)
    assert fit.shift_px == pytest.approx([0, 32], abs=3)
    assert "the image scaled by 1.6 and shifted by (" in answer(
        found, "reproj_kp_2d lives in another picture"
    )
    best = next(fit for fit in facts.cameras if fit.target == "reproj_kp_2d")
    assert best.focal_px == pytest.approx(1600, rel=1e-3)


def test_reprojections_that_are_only_scaled_or_of_nothing_are_told(
    home: Path, tmp_path: Path
) -> None:
    def halved(entry: dict[str, Any]) -> None:
        entry["reproj_kp_2d"] = [
            [0.5 * (x + 0.5) - 0.5, 0.5 * (y + 0.5) - 0.5, v] for x, y, v in entry["reproj_kp_2d"]
        ]

    _, facts = altered(home, tmp_path, each(halved))
    assert facts.pictures[0].relation == "scaled"
    assert facts.pictures[0].scale == pytest.approx(0.5, rel=0.01)
    generator = np.random.default_rng(0)
    wild = each(
        lambda entry: entry.update(reproj_kp_2d=generator.uniform(0, 100, (26, 3)).tolist())
    )
    found, facts = inspected(home, copy_with(home, tmp_path / "wild", wild))
    assert facts.pictures[0].relation == "none"
    assert answer(found, "reproj_kp_2d is in no simple relation to keypoint_2d")
    assert answer(found, "no points and frame project onto reproj_kp_2d")


@pytest.mark.parametrize(
    ("relation", "change"),
    [
        ("same", lambda points, trans: points + trans),
        ("shifted", lambda points, trans: points + 3.0),
        ("sides exchanged", lambda points, trans: points[FLIP]),
        (
            "turned or scaled",
            lambda points, trans: 2 * points @ np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1.0]]),
        ),
        ("other", lambda points, trans: points[::-1]),
        ("other", lambda points, trans: points * (-1, 1, 1)),
    ],
)
def test_what_maps_stored_keypoints_onto_the_bodies_is_told(
    home: Path, tmp_path: Path, relation: str, change: Callable[..., Any]
) -> None:
    wrong = each(
        lambda entry: entry.update(
            keypoint_3d=change(np.array(entry["keypoint_3d"]), np.array(entry["trans"])).tolist()
        )
    )
    found, facts = altered(
        home,
        tmp_path,
        lambda content: (
            content.update(data=content["data"][:4]),
            wrong({"data": content["data"][:3]}),
        ),
    )
    assert facts.stored_points is not None
    assert facts.stored_points.relations == {relation: 3, "less trans": 1}
    assert f"{relation} in 3" in answer(found, "keypoint_3d against the posed bodies")


def test_animals_whose_left_and_right_a_label_would_exchange_are_named(
    home: Path, tmp_path: Path
) -> None:
    plain, _ = inspected(home, home / "animals")
    assert 0.8 * plain.animals <= plain.labelings.labelled <= plain.animals  # rest: rejected
    assert sum(map(len, plain.labelings.exchanged.values())) <= 1
    found, _ = altered(
        home,
        tmp_path,
        each(lambda entry: entry.update(keypoint_2d=[entry["keypoint_2d"][i] for i in FLIP])),
    )
    samples = found.labelings.exchanged["all"]
    assert len(samples) >= 0.75 * found.labelings.labelled
    assert f"all: {samples[0]}" in as_text(found)
    assert answer(found, "left and right keypoints are exchanged in")


def test_sides_exchanged_in_the_image_or_in_space_are_told(home: Path, tmp_path: Path) -> None:
    _, facts = altered(
        home,
        tmp_path,
        each(lambda entry: entry.update(keypoint_2d=[entry["keypoint_2d"][i] for i in FLIP])),
    )
    assert facts.sides is not None
    assert facts.sides.compared_in_image > 4
    assert facts.sides.swapped_in_image >= 0.6 * facts.sides.compared_in_image
    mirrored = each(lambda entry: entry.update(keypoint_3d=[entry["keypoint_3d"][i] for i in FLIP]))
    found, facts = inspected(home, copy_with(home, tmp_path / "mirrored", mirrored), model=False)
    assert facts.sides is not None
    assert (facts.sides.left_is_left, facts.sides.left_is_right) == (0, found.animals)
    assert answer(
        found,
        "keypoint_3d: the named left is the animal's left in 0 animals, its right in"
        f" {found.animals}",
    )


def test_a_model_in_another_vertex_order_is_told(home: Path, tmp_path: Path) -> None:
    model = load_quadruped()
    swapped = {
        name: list(model.landmarks.values())[FLIP[i]] for i, name in enumerate(model.landmarks)
    }
    save_safetensors(replace(model, landmarks=swapped), tmp_path / "swapped.safetensors")
    found = inspect_dataset(
        home / "animals", options=ReadOptions(model=tmp_path / "swapped.safetensors")
    )
    assert found.animal3d is not None
    assert found.animal3d.sides is not None
    assert "left_eye" in found.animal3d.sides.template_wrong
    assert any("lie on the wrong side of its template" in sentence for sentence in found.answers)


def test_files_that_do_not_fit_their_annotations_are_told(home: Path, tmp_path: Path) -> None:
    folder = copy_with(home, tmp_path / "copy", each(lambda entry: entry.update(bbox=None)))
    first, second, third = sorted((folder / "images" / "train").rglob("*.jpg"))[:3]
    Image.new("RGB", (20, 30)).save(first)
    second.write_bytes(b"<html>")
    third.unlink()
    found, facts = inspected(home, folder)
    assert (found.image_files.other_size, found.image_files.unreadable) == (1, 1)
    assert any(
        "is 20 x 30, annotated 160 x 120" in example for example in found.image_files.examples
    )
    assert set(found.faults.by_field) == {"img_path"}
    assert "bbox" not in facts.keys
    assert answer(
        found,
        f"{found.faults.count} samples cannot be used, by field: img_path {found.faults.count}",
    )
    assert found.faults.first[0].problem in as_text(found)


def test_a_set_without_bodies_is_inspected(home: Path, tmp_path: Path) -> None:
    def flat(entry: dict[str, Any]) -> None:
        for key in (
            "pose",
            "shape",
            "shape_extra",
            "trans",
            "keypoint_3d",
            "joints_3d",
            "joints_2d",
            "reproj_kp_2d",
            "supercategory",
        ):
            del entry[key]

    found, facts = altered(home, tmp_path, each(flat), model=False)
    assert (facts.cameras, facts.pictures, facts.stored_points) == ([], [], None)
    assert facts.supercategories == {"absent": found.animals}


def test_odd_values_are_counted_not_stumbled_over(home: Path, tmp_path: Path) -> None:
    def odd(content: Content) -> None:
        first, second, third, *_ = content["data"]
        first.update(
            reproj_kp_2d="none", keypoint_3d=[[1, 2], [3]], joints_2d=[[None, 1]], trans=[1, 2]
        )
        second.update(keypoint_2d=[[1, 2]], pose=None)
        third.clear()
        content["data"].append(7)

    found, facts = altered(home, tmp_path, odd)
    assert found.faults.count == 4
    assert facts.forms["keypoint_3d"]["2x1|2"] == 1
    assert facts.visibility["none"] == 1


# Other formats, and from the command line
# -----------------------------------------------------------------------------


def test_keypoints_beside_their_animal_are_counted_and_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    content = coco_content(tmp_path / "coco")
    points = content["annotations"][1]["keypoints"]
    content["annotations"][1]["keypoints"] = [
        value / 640 if place % 3 < 2 else value for place, value in enumerate(points)
    ]
    file = write_coco(tmp_path / "coco", content)
    found = inspect_dataset(file)
    assert (found.keypoint_places.looked_at, found.keypoint_places.misplaced) == (3, 1)
    assert "look normalised" in answer(found, "the keypoints of 1 of 3 animals lie beside")
    with pytest.raises(SystemExit) as caught:
        main(["inspect", str(file)])
    assert caught.value.code == 4
    assert "keypoints beside their animal: 1 of 3 animals" in capsys.readouterr().out


def test_other_formats_are_inspected_too(tmp_path: Path) -> None:
    found = inspect_dataset(write_coco(tmp_path / "coco", coco_content(tmp_path / "coco")))
    assert (found.format, found.animals, found.images, found.largest_group, found.animal3d) == (
        "coco",
        3,
        2,
        2,
        None,
    )
    assert found.masks.levels == {"run lengths": 3}
    assert found.cameras.intrinsics == {"unknown": 3}
    assert found.keypoint_places.misplaced == 0
    assert answer(found, "3 of 3 animals have a mask")
    root = write_mesh_folder(tmp_path / "meshes")
    write_json(
        root / "keypoints" / "a.json", json.loads((root / "keypoints" / "b.json").read_text())
    )
    found = inspect_dataset(root)
    assert found.cameras.exact_poses == 1
    assert found.cameras.residual is not None
    assert found.cameras.residual.median_percent > 15  # the keypoints are another view's
    assert (found.bodies.looked_at, found.bodies.unusable) == (2, 0)
    (root / "meshes" / "b.obj").write_text("")
    found = inspect_dataset(root)
    assert (found.bodies.looked_at, found.bodies.unusable) == (2, 1)
    assert "b.jpg: mesh: " in answer(found, "1 of 2 bodies looked at cannot be used")
    assert found.bodies.examples[0] in as_text(found)


def test_the_command_prints_words_or_json(
    home: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = str(
        copy_with(
            home,
            tmp_path / "copy",
            lambda content: content["data"].append({"img_path": "none.jpg"}),
        )
    )
    codes = []
    for more in ([], ["--json"]):
        with pytest.raises(SystemExit) as caught:
            main(["inspect", folder, "--model", str(home / "body.pkl"), *more])
        codes.append(caught.value.code)
    text, _, printed = capsys.readouterr().out.rpartition("\n{")
    assert codes == [4, 4]
    assert "so:\n" in text
    found = msgspec.json.decode("{" + printed, type=Inspection)
    assert (found.schema, found.version, found.faults.count) == ("animal3dbox.inspection", 3, 1)
    assert as_text(found) == text + "\n"
