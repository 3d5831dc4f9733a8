"""The code of the how-to pages runs as it stands there, and does what the page says."""

import csv
import re
from pathlib import Path
from typing import Any

import pytest
import torch
from commands import ran
from PIL import Image

from animal3dbox.datasets.synthetic import synthetic_animal
from animal3dbox.errors import SampleError
from animal3dbox.geometry import FACE_NAMES, FACES, Cuboid
from animal3dbox.report.table.parts import parts_of, read_part

DOCS = Path(__file__).parent.parent / "docs"


def run_code_of(page: str, known: dict[str, Any]) -> dict[str, Any]:
    """The names that the Python of a page leaves, run as one program."""
    blocks = re.findall(r"```python\n(.*?)```", (DOCS / page).read_text(), re.DOTALL)
    names = dict(known)
    exec(compile("".join(blocks), page, "exec"), names)  # noqa: S102
    return names


@pytest.fixture(scope="module")
def read(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What the page's reader makes of a table with a dog and a row that cannot be read."""
    folder = tmp_path_factory.mktemp("table")
    animal = synthetic_animal(seed=0, index=0, preset="dog", pose="stand")
    Image.fromarray(animal.image.numpy()).save(folder / "dog.png")
    numbers = " ".join(str(float(value)) for value in animal.keypoints_2d.flatten())
    table = folder / "animals.csv"
    with table.open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(["image", "category", "keypoints"])
        rows.writerows([["dog.png", "dog", numbers], ["dog.png", "dog", "1 2 three"]])
    return run_code_of("your-reader.md", {"table": table, "images": folder})


def test_the_reader_of_the_page_reads_a_table_and_names_its_bad_row(read: dict[str, Any]) -> None:
    assert len(read["dataset"]) == 1
    assert [fault.sample_id for fault in read["records"].faults] == ["dog.png#1"]
    assert FACE_NAMES[int(read["target"]["face_share"][0].argmax())] == "left"
    assert "dog.png#1" in str(read["dataset"].report())


def test_the_bodies_of_the_page_are_scaled_and_an_animal_without_a_row_is_refused(
    read: dict[str, Any],
) -> None:
    (record,) = read["records"].records
    scales = {record.sample_id: 2.0}
    names = run_code_of("your-body.md", {"records": read["records"], "scales": scales})
    assert names["target"]["center"].shape == (1, 3)
    for length in ("size", "center"):
        torch.testing.assert_close(
            names["target"][length], 2 * read["target"][length], rtol=1e-3, atol=1e-3
        )
    with pytest.raises(SampleError, match="other: scale: is not in the table"):
        names["ScaledBodies"]({}).content("other")


def test_the_transform_of_the_page_moves_pixels_and_corners_alike() -> None:
    box = Cuboid(torch.tensor([[0.0, 0, 5]]), torch.eye(3)[None], torch.tensor([[2.0, 1, 1]]))
    target = {
        "center": box.center,
        "rotation": box.rotation,
        "size": box.size,
        "K": torch.tensor([[100.0, 0, 79.5], [0, 100, 59.5], [0, 0, 1]]),
    }
    image = torch.zeros(3, 120, 160, dtype=torch.uint8)
    names = run_code_of("your-transform.md", {"image": image, "target": target})
    _, moved = names["RandomShift"]()(image, target)
    assert 1 <= float(moved["K"][0, 2] - target["K"][0, 2]) <= 8
    torch.testing.assert_close(moved["center"], target["center"])


def test_the_box_of_objectron_on_the_page_has_its_front_where_objectron_has_it() -> None:
    """Objectron's vertices 2, 4, 8 and 6 are +z, which its box.py calls the front, +y the top."""
    scale = torch.tensor([1.0, 2.0, 3.0])
    half = scale / 2
    front = torch.stack(
        [torch.tensor([x, y, 1.0]) * half for x, y in ((-1, -1), (-1, 1), (1, 1), (1, -1))]
    )
    names = run_code_of(
        "front.md", {"translation": [0.0, 0.0, 0.0], "rotation": torch.eye(3), "scale": scale}
    )
    corners = names["cuboid"].corners()
    ours = corners[list(FACES["front"])]
    torch.testing.assert_close(ours.mean(dim=0), front.mean(dim=0))
    torch.testing.assert_close(ours.amax(dim=0), front.amax(dim=0))
    torch.testing.assert_close(
        corners[list(FACES["top"])].mean(dim=0), torch.tensor([0.0, half[1], 0.0])
    )


def test_the_left_flanks_of_the_camera_traps_page_are_those_of_the_table(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("labels").mkdir()
    with Path("labels/labels.csv").open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(["flank", "flank_confidence", "flags"])
        rows.writerows(
            [["left", "0.99", ""], ["left", "0.6", ""], ["right", "0.99", ""], ["left", "1", "x"]]
        )
    run_code_of("camera-traps.md", {})
    assert capsys.readouterr().out == "1 of 4 animals show their left flank\n"


def test_a_whole_image_box_of_torchvision_s_pixels_stays_the_whole_image() -> None:
    known = {
        "image": torch.zeros(3, 100, 200, dtype=torch.uint8),
        "boxes": torch.tensor([[0.0, 0, 200, 100]]),
        "labels": torch.tensor([1]),
    }
    names = run_code_of("coming-from.md", known)
    assert names["image"].shape == (3, 480, 640)
    torch.testing.assert_close(names["target"]["boxes"], torch.tensor([[0.0, 0, 640, 480]]))


def test_the_rows_of_the_cluster_s_page_are_of_the_animals_of_the_command(
    animals: Path, tmp_path: Path
) -> None:
    page = (DOCS / "your-cluster.md").read_text()
    (block,) = (b for b in re.findall(r"```python\n(.*?)```", page, re.DOTALL) if "table_plan" in b)
    names: dict[str, Any] = {"PATH": animals, "INDEX": tmp_path / "index", "OUT": tmp_path / "out"}
    exec(compile(block, "your-cluster.md", "exec"), names)  # noqa: S102
    assert len(names["chunks"]) == 1
    written = [Path(names["make_part"](chunk)) for chunk in names["chunks"]]
    assert ran("label", animals, "--table", tmp_path / "by-command")[0] in (0, 4)
    (part,), (other,) = parts_of(tmp_path / "out"), parts_of(tmp_path / "by-command")
    assert [part.path] == written
    columns = ["image", "animal", "sample_id", "category"]
    assert read_part(part, columns) == read_part(other, columns)
    exec(compile(block, "your-cluster.md", "exec"), names)  # noqa: S102
    assert names["chunks"] == []
