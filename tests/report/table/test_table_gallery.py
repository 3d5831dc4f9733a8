"""The gallery of a sample of a table."""

import json
import re
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import fsspec
import pytest
from commands import ran
from small_animals import model_of, small_dataset

from animal3dbox.report import label_table, write_part
from animal3dbox.report.table.keys import table_length
from animal3dbox.report.table.source_file import read_source, write_source


@pytest.fixture(scope="module")
def table(animals: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A table in several parts, with confidences of its own: the first rows are the worst."""
    folder = tmp_path_factory.mktemp("out") / "table"
    dataset = small_dataset(animals)
    rows = 0
    for index in range(table_length(dataset)):
        part = label_table(dataset, [index])
        part["confidence"] = [(rows + k + 1) / 100 for k in range(len(part["key"]))]
        rows += len(part["key"])
        write_part(folder, part)
    write_source(folder, dataset, animals)
    return folder


def confidences(page: Path) -> list[float]:
    return [float(one) for one in re.findall(r'data-confidence="([0-9.]+)"', page.read_text())]


def test_the_worst_labels_and_some_others_are_drawn(table: Path, tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    code, output = ran("gallery", table, "--worst", "3", "--random", "2", "--out", page)
    assert (code, output.split(":")[0]) == (0, "5 labels")
    drawn = confidences(page)
    assert drawn[:3] == [0.01, 0.02, 0.03]
    assert len({*drawn}) == 5
    assert page.read_text().count('<img src="data:image/jpeg;base64,') == 5
    assert "3 of least confidence and 2 drawn at random" in page.read_text()
    pages = set()
    for seed in ("0", "1", "2"):
        ran("gallery", table, "--worst", "3", "--random", "2", "--out", page, "--seed", seed)
        pages.add(tuple(confidences(page)))
    assert tuple(drawn) in pages
    assert len(pages) > 1


def test_the_page_lies_beside_the_table_which_is_read_as_a_folder_of_parts(table: Path) -> None:
    assert ran("gallery", table, "--worst", "1", "--random", "0")[0] == 0
    assert (table.parent / "table-gallery.html").exists()
    others = {path.name for path in table.iterdir() if not path.name.startswith("shard-")}
    assert all(name.startswith(("_", ".")) for name in others)


@pytest.mark.parametrize(("inside", "path"), [(".", "."), (".below", "..")])
def test_a_table_that_is_the_working_folder_has_its_page_beside_it(
    table: Path, monkeypatch: pytest.MonkeyPatch, inside: str, path: str
) -> None:
    page = table.parent / "table-gallery.html"
    page.unlink(missing_ok=True)
    (table / inside).mkdir(exist_ok=True)
    monkeypatch.chdir(table / inside)
    code, output = ran("gallery", path, "--worst", "1", "--random", "0")
    assert (code, output.strip()) == (0, f"1 label: look at {page}")
    assert page.exists()


def test_a_picture_that_is_gone_costs_its_picture_alone(table: Path, tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    more = ("--worst", "2", "--random", "0", "--images", tmp_path, "--out", page)
    assert ran("gallery", table, *more)[0] == 0
    assert page.read_text().count("no picture: ") == 2


STORE = "memory://gallery"


@pytest.fixture
def remote_table(animals: Path, tmp_path: Path) -> Iterator[Path]:
    """A table whose pictures lie in a store in memory, but for one."""
    memory, folder, dataset = (
        fsspec.filesystem("memory"),
        tmp_path / "table",
        small_dataset(animals),
    )
    part = label_table(dataset, range(4))
    part["confidence"] = [(place + 1) / 100 for place in range(len(part["key"]))]
    for name in {*part["image"]} - {part["image"][0]}:
        memory.pipe(f"{STORE}/{name}", (animals / name).read_bytes())
    write_part(folder, {**part, "image": [f"{STORE}/{name}" for name in part["image"]]})
    write_source(folder, dataset, animals)
    source = folder / "_source.json"
    content = json.loads(source.read_text())
    source.write_text(json.dumps({**content, "images": None}))
    yield folder
    memory.store.clear()


def test_pictures_at_urls_are_fetched_of_the_rows_that_are_drawn(
    remote_table: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    memory = fsspec.filesystem("memory")
    urls, cat_file = list[str](), type(memory).cat_file

    def noted(store: Any, path: str, **more: Any) -> bytes:
        urls.append(path)
        content: bytes = cat_file(store, path, **more)
        return content

    monkeypatch.setattr(type(memory), "cat_file", noted)
    page = tmp_path / "page.html"
    assert ran("gallery", remote_table, "--worst", "3", "--random", "0", "--out", page)[0] == 0
    drawn, without = page.read_text().count("<img "), page.read_text().count("no picture: ")
    assert drawn + without == len(urls) == 3
    assert without == page.read_text().count("cannot be read (FileNotFoundError") > 0 < drawn


def test_without_the_extra_pictures_at_urls_are_refused_in_a_line(
    remote_table: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "fsspec", None)
    code, output = ran("gallery", remote_table, "--out", tmp_path / "page.html")
    assert code == 2
    assert "pip install 'animal3dbox[remote]'" in output
    assert len(output.strip().splitlines()) == 1


def test_a_table_that_does_not_say_where_its_images_are_asks_for_the_folder(
    table: Path, tmp_path: Path
) -> None:
    shutil.copytree(table, tmp_path / "copy")
    source = tmp_path / "copy" / "_source.json"
    source.write_text(json.dumps({**json.loads(source.read_text()), "images": None}))
    code, output = ran("gallery", tmp_path / "copy")
    assert (code, "does not say where its images are: give --images" in output) == (2, True)


def test_the_images_folder_is_told_without_an_absolute_path(table: Path, animals: Path) -> None:
    source = read_source(table)
    assert source.images is not None
    assert not Path(source.images).is_absolute()
    assert (table / source.images).resolve() == animals.resolve()
    assert source.source == animals.name


@pytest.mark.parametrize(
    ("options", "says", "code"),
    [(("--worst", "-1"), "must not be negative", 2), ((), "holds no parts of a table", 3)],
)
def test_what_cannot_be_drawn_is_told(
    tmp_path: Path, options: tuple[str, ...], says: str, code: int
) -> None:
    assert ran("gallery", tmp_path, *options)[0] == code
    assert says in ran("gallery", tmp_path, *options)[1]


def test_the_command_draws_what_label_wrote(animals: Path, tmp_path: Path) -> None:
    common = ("label", animals, "--model", model_of(animals), "--stored-camera", "exact")
    assert ran(*common, "--table", tmp_path / "t")[0] == 0
    code, output = ran("gallery", tmp_path / "t", "--worst", "2", "--random", "1")
    assert (code, output.split(":")[0]) == (0, "3 labels")
