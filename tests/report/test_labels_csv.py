"""labels.csv."""

import csv
import re
from pathlib import Path

import pytest
from animals import IMAGE_HW, K, camera_round, keypoints_seen, toy_landmarks, toy_mesh

from animal3dbox import CuboidLabel, LabelConfig, label_animal
from animal3dbox.datasets.labelling.scale import in_metres
from animal3dbox.datasets.sightings import Sighting
from animal3dbox.geometry.cuboid import FACE_NAMES
from animal3dbox.report.label_files import animal_row
from animal3dbox.report.labels_csv import CSV_COLUMNS, write_labels_csv

DOCS = Path(__file__).parents[2] / "docs" / "formats.md"
NAME = 'dogs, "wet"/ö\n\r.jpg'


def labelled(*, surface: bool = True, guessed: bool = False) -> CuboidLabel:
    view = camera_round(60, 15)
    vertices, faces = toy_mesh()
    outcome = label_animal(
        IMAGE_HW,
        keypoints_seen(*view),
        toy_landmarks(),
        vertices,
        faces=faces,
        K=None if guessed else K,
        pose=view,
        config=LabelConfig(surface_share=surface),
    )
    assert isinstance(outcome, CuboidLabel)
    return outcome


def written(
    folder: Path, label: CuboidLabel, flags: tuple[str, ...] | None = None
) -> dict[str, str]:
    """The cells of a label's row."""
    row = animal_row(label, image=NAME, animal=3, category="dog")
    write_labels_csv(folder / "labels.csv", [row], None if flags is None else [flags])
    with (folder / "labels.csv").open(newline="", encoding="utf-8") as file:
        (cells,) = csv.DictReader(file)
    return cells


def test_the_columns_are_those_of_the_docs_in_their_order() -> None:
    section = DOCS.read_text().split("### labels.csv")[1].split("## ")[0]
    first_cells = re.findall(r"^\| (`.*?`) \|", section, re.MULTILINE)
    documented = [name for cell in first_cells for name in re.findall(r"`(\w+)`", cell)]
    assert documented == list(CSV_COLUMNS)


def test_a_row_tells_what_an_ecologist_wants(tmp_path: Path) -> None:
    label = labelled()
    cells = written(tmp_path, label)
    words = ("image", "animal", "side", "viewpoint", "category", "flank")
    assert [cells[name] for name in words] == [NAME, "3", "left", "front-left", "dog", "left"]
    assert cells["sample_id"] == f"{NAME}#3"
    assert label.surface_share is not None
    for kind, shares in (("share", label.face_share), ("surface", label.surface_share)):
        of_faces = [float(cells[f"{kind}_{name}"]) for name in FACE_NAMES]
        assert of_faces == pytest.approx(shares.tolist(), abs=5e-5)
    for name, value in zip(("x0", "y0", "x1", "y1"), label.box.tolist(), strict=True):
        assert float(cells[name]) == pytest.approx(value, abs=0.05)
    assert float(cells["azimuth_deg"]) == pytest.approx(label.azimuth_deg, abs=0.05)
    assert float(cells["flank_confidence"]) == pytest.approx(label.flank_confidence, abs=5e-4)


def test_a_distance_is_given_in_metres_or_not_at_all(tmp_path: Path) -> None:
    label = labelled()
    cells = written(tmp_path, label)
    assert (cells["distance_m"], cells["distance_source"]) == ("", "unknown")
    cells = written(tmp_path, in_metres(label, 0.5, "species:dog"))
    assert float(cells["distance_m"]) == pytest.approx(label.distance / 2, abs=5e-4)
    assert cells["distance_source"] == "species:dog"


def test_a_distance_by_a_guessed_focal_length_says_so(tmp_path: Path) -> None:
    cells = written(tmp_path, in_metres(labelled(guessed=True), 0.5, "user"))
    assert cells["distance_source"] == "user, focal guessed"


def test_a_surface_that_was_not_measured_leaves_its_cells_empty(tmp_path: Path) -> None:
    cells = written(tmp_path, labelled(surface=False))
    assert {cells[f"surface_{name}"] for name in FACE_NAMES} == {""}


def test_the_flags_of_report_and_quality_are_told_once_each(tmp_path: Path) -> None:
    label = labelled()
    assert written(tmp_path, label)["flags"] == ""
    assert written(tmp_path, label, ("few_inliers", "unseen"))["flags"] == "few_inliers;unseen"
    row = animal_row(label, image=NAME, animal=3, category="dog")
    row.quality["flags"] = ["below_ground", "unseen"]
    write_labels_csv(tmp_path / "labels.csv", [row], [("unseen",)])
    assert "unseen;below_ground" in (tmp_path / "labels.csv").read_text()


def test_a_rows_side_may_be_unknown(tmp_path: Path) -> None:
    row = animal_row(labelled(), image="a.jpg", animal=0, category="dog")
    row.side, row.flank, row.flank_confidence = None, None, None
    write_labels_csv(tmp_path / "labels.csv", [row])
    with (tmp_path / "labels.csv").open(newline="", encoding="utf-8") as file:
        (cells,) = csv.DictReader(file)
    assert (cells["side"], cells["flank"], cells["flank_confidence"]) == ("", "", "")


def test_labels_csv_without_animals_is_its_header(tmp_path: Path) -> None:
    write_labels_csv(tmp_path / "labels.csv", [])
    assert (tmp_path / "labels.csv").read_text().splitlines() == [",".join(CSV_COLUMNS)]


@pytest.mark.parametrize("text", ["=1+1", "+1", "-2.jpg", "@me", "\t=1"])
def test_no_text_is_a_formula_for_a_spreadsheet(tmp_path: Path, text: str) -> None:
    row = animal_row(
        labelled(), image=text, animal=0, category=text, sighting=Sighting(individual=text)
    )
    write_labels_csv(tmp_path / "labels.csv", [row])
    with (tmp_path / "labels.csv").open(newline="", encoding="utf-8") as file:
        (cells,) = csv.DictReader(file)
    assert cells["image"] == cells["category"] == cells["individual"] == f"'{text}"
