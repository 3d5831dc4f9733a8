"""The evaluation's page as a report: questions, answers from the tables, plots, tables."""

import re
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from animal3dbox.evaluate.answers import (
    PLOT_DESCRIPTIONS,
    QUESTIONS,
    answers_of,
    records_of,
)
from animal3dbox.evaluate.dataset_study import DatasetRow, dataset_table
from animal3dbox.evaluate.files import Evaluation
from animal3dbox.evaluate.fit_study import fit_table
from animal3dbox.evaluate.page import write_page
from animal3dbox.evaluate.plots import plots_of
from animal3dbox.evaluate.reliability import Judged, curve_table
from animal3dbox.evaluate.run import StudyRows, world_tables
from animal3dbox.evaluate.tables import Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

EMPTY = {t.name: t for t in (*world_tables(StudyRows((), (), (), (), ())), fit_table(()))}
NAMES: dict[str, list[dict[str, str]]] = {
    "pose": [
        {"setting": setting, "method": method}
        for setting in ("2 px", "2 px, 10 % outliers")
        for method in ("basic", "default")
    ],
    "foreign": [{"setting": "K known"}, {"setting": "preset"}],
    "curve": [{"labels": "with mask"}, {"labels": "without mask"}],
    "reliability": [{"labels": "all, with mask"}, {"labels": "all, without mask"}],
    "fits": [
        {"world": "foreign", "class": "all", "body": body}
        for body in ("rigid dog", "fit", "true body")
    ],
}
"""Rows of tables that have none without animals, by their words."""


def filled(name: str) -> Table:
    """A table whose numbers are all different: 11.5, 12.5, ..."""
    table = dataset_table([]) if name == "dataset" else EMPTY[name]
    words = NAMES.get(name) or [
        {column: cell for column, cell in record.items() if isinstance(cell, str)}
        for record in records_of(table)
    ]
    numbers = iter(range(11, 10_000))
    rows = [
        tuple(row.get(column) or next(numbers) + 0.5 for column in table.columns) for row in words
    ]
    return replace(table, rows=tuple(rows))


def value(table: Table, column: str, **wanted: str) -> str:
    """A cell as it is shown: up to 100 with two digits."""
    (row,) = [r for r in table.records() if all(r[key] == word for key, word in wanted.items())]
    return f"{row[column]:.1f}" if row[column] >= 100 else f"{row[column]:.2f}"


def test_every_table_has_its_question_and_an_answer_and_each_plot_its_description() -> None:
    assert set(QUESTIONS) == {*EMPTY, "dataset"}
    assert set(PLOT_DESCRIPTIONS) == set(QUESTIONS) - {"reliability"}
    for name in QUESTIONS:
        answers = answers_of(filled(name))
        assert 1 <= len(answers) <= 5
        assert all(re.fullmatch(r"[A-Z].*\.", answer) for answer in answers)
        assert "None" not in " ".join(answers)


@pytest.mark.parametrize(
    ("name", "column", "wanted"),
    [
        ("stability", "theta_R deg", {"protocol": "pixel-equivalent", "rule": "ours, mesh"}),
        ("stability", "theta_R deg", {"protocol": "camera", "rule": "ours, mesh"}),
        ("accuracy", "median deg", {"rule": "ours, mesh"}),
        ("accuracy", "median deg", {"rule": "landmarks (paper)"}),
        ("pose", "rotation median deg", {"setting": "2 px", "method": "default"}),
        ("pose", "rotation median deg", {"setting": "2 px", "method": "basic"}),
        ("reproduction", "mean px", {"keypoints": "30% at (0, 0)", "method": "basic"}),
        ("faces", "booleans right %", {"view": "in frame"}),
        ("foreign", "rotation median deg", {"setting": "preset"}),
        ("reliability", "AUC", {"labels": "all, with mask"}),
        ("fits", "trunk median deg", {"body": "fit"}),
        ("dataset", "annotated median px", {"method": "default"}),
        ("dataset", "rotation median deg", {"method": "default"}),
    ],
)
def test_an_answer_has_the_tables_own_number(
    name: str, column: str, wanted: dict[str, str]
) -> None:
    table = filled(name)
    assert value(table, column, **wanted) in " ".join(answers_of(table))


def test_what_is_not_known_is_not_answered() -> None:
    for table in EMPTY.values():
        assert answers_of(table) == []
    assert answers_of(Table("t", "Another", (), ("px",), ((1.0,),))) == []
    ours, theirs, truth = answers_of(dataset_table([DatasetRow("a.jpg", "default", "no_pose")]))
    assert ours == "The default labelled 0 of 1 animal."
    assert theirs == "The paper's baseline (basic) labelled 0 of 0 animals."
    assert truth.startswith("There are no true boxes")


def figures_of(table: Table, monkeypatch: pytest.MonkeyPatch) -> "list[Figure]":
    """The figures of a table."""
    pytest.importorskip("matplotlib")
    figures: list[Figure] = []

    def keep(figure: "Figure") -> bytes:
        figures.append(figure)
        return b"png"

    monkeypatch.setattr("animal3dbox.evaluate.plots.png_of", keep)
    plots_of((table,))
    return figures


def test_the_plot_of_a_dataset_has_no_empty_panel(monkeypatch: pytest.MonkeyPatch) -> None:
    """Keypoints alone, without masks, truth or rejections: two of three charts were empty."""
    row = DatasetRow("a.jpg", "default", None, annotated_px=3.5)
    (figure,) = figures_of(dataset_table([row]), monkeypatch)
    assert [len(panel.patches) for panel in figure.axes] == [1]
    (figure,) = figures_of(
        dataset_table([replace(row, mask_iou=0.9), DatasetRow("b.jpg", "default", "no_pose")]),
        monkeypatch,
    )
    assert len(figure.axes) == 3
    assert all(panel.patches for panel in figure.axes)
    assert figures_of(dataset_table([]), monkeypatch) == []


def test_a_panel_that_would_be_empty_is_left_out_and_named(monkeypatch: pytest.MonkeyPatch) -> None:
    table = filled("reproduction")
    place = table.columns.index("degenerate %")

    def with_cell(cell: float | None) -> Table:
        rows = [(*row[:place], cell, *row[place + 1 :]) for row in table.rows]
        return replace(table, rows=tuple(rows))

    for cell, words, n_panels in (
        (0.0, "degenerate %: 0 for all", 1),
        (None, "degenerate %: not known", 1),
        (1.0, "", 2),
    ):
        (figure,) = figures_of(with_cell(cell), monkeypatch)
        assert figure.get_supxlabel() == words
        assert len(figure.axes) == n_panels


@pytest.mark.parametrize("name", sorted(set(PLOT_DESCRIPTIONS) - {"curve"}))
def test_a_table_in_which_all_is_zero_or_unknown_has_no_plot(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    table = filled(name)
    for value in (0.0, None):
        rows = [tuple(c if isinstance(c, str) else value for c in row) for row in table.rows]
        assert len(figures_of(replace(table, rows=tuple(rows)), monkeypatch)) == 0


@pytest.mark.parametrize("name", sorted(set(PLOT_DESCRIPTIONS) - {"curve"}))
def test_a_table_without_animals_and_one_with_them_can_be_drawn(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert len(figures_of(filled(name), monkeypatch)) == 1
    figures_of(dataset_table([]) if name == "dataset" else EMPTY[name], monkeypatch)


def test_the_curve_lies_beside_what_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    rows: list[tuple[Any, ...]] = [("with mask", 1, 5, 0.2, 0.3), ("with mask", 2, 5, 0.8, 0.7)]
    table = replace(EMPTY["curve"], rows=tuple(rows))
    (figure,) = figures_of(table, monkeypatch)
    (line,) = [one for one in figure.axes[0].lines if one.get_marker() == "o"]
    assert np.asarray(line.get_xydata()).tolist() == [[0.2, 0.3], [0.8, 0.7]]
    assert figure.axes[0].get_title() == "labels with mask: 10, 5 a point"
    assert answers_of(table)[0].replace("\N{NO-BREAK SPACE}", " ") == (
        "Of labels with mask, the most confident (which state 80 % on average) are right in 4 of 5,"
        " the least confident (20 %) in 2 of 5."
    )


def test_the_curve_of_few_labels_has_few_points() -> None:
    """A point of one label is either 0 or 1, and says nothing."""

    def counts(n_labels: int) -> list[int]:
        judged = [Judged("fit", True, i / n_labels, True, 0.1, 0.1) for i in range(n_labels)]
        return [record["n"] for record in curve_table(judged).records()]

    assert counts(4) == []
    assert counts(5) == [5]
    assert counts(11) == [6, 5]
    assert counts(200) == [20] * 10
    (answer,) = answers_of(curve_table([Judged("fit", True, 0.5, True, 0.1, 0.1)] * 5))
    assert answer.endswith(
        "all (which state 50\N{NO-BREAK SPACE}% on average) are right in 5 of 5."
    )


def test_the_plot_of_fits_has_a_bar_for_each_body_and_class(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    (figure,) = figures_of(filled("fits"), monkeypatch)
    table = filled("fits").records()
    trunk, overlap = figure.axes
    for panel, measure in ((trunk, "trunk median deg"), (overlap, "IoU median")):
        widths = [bar.get_extents().width for bar in panel.patches]
        scale = [row[measure] / width for row, width in zip(table, widths, strict=True)]
        assert scale == pytest.approx([scale[0]] * len(table))
    ends = [np.asarray(line.get_xydata())[:, 0].tolist() for line in trunk.lines]
    assert ends == [[row["trunk median deg"], row["trunk p95 deg"]] for row in table]
    assert len(overlap.lines) == 0


def test_settings_are_written_as_people_write_them(tmp_path: Path) -> None:
    about = {"faults": [], "truth": True, "image_hw": [480, 640], "seed": 0}
    write_page(tmp_path / "e.html", Evaluation("Title", about, ()), {})
    words = "faults: none; truth: yes; image_hw: 480, 640; seed: 0"
    assert f'<p class="note">{words}</p>' in (tmp_path / "e.html").read_text()


def test_a_long_name_of_a_column_can_be_broken(tmp_path: Path) -> None:
    table = Table("t", "Another", (), ("iou_3d_<b>", "px"), ((1.0, 2.0),))
    write_page(tmp_path / "e.html", Evaluation("Title", {}, (table,)), {})
    headings = "<th>iou_<wbr>3d_<wbr>&lt;b&gt;</th><th>px</th>"
    assert headings in (tmp_path / "e.html").read_text()


def test_the_page_asks_answers_shows_and_then_counts(tmp_path: Path) -> None:
    table = filled("dataset")
    write_page(tmp_path / "e.html", Evaluation("Title", {}, (table,)), {"dataset": b"png"})
    page = (tmp_path / "e.html").read_text()
    question, answer = QUESTIONS["dataset"], answers_of(table)[0]
    description = f'alt="{table.title}. {PLOT_DESCRIPTIONS["dataset"]}"'
    parts = (question, answer, "<figure", "<img", description, "<figcaption", "<table>")
    order = [page.index(part) for part in parts]
    assert order == sorted(order)
    links, ids = (set(re.findall(rf'{name}="#?([\w-]+)"', page)) for name in ("href", " id"))
    assert links == ids == {"dataset", "table-dataset"}
    without = Table("t", "Another", (), ("px",), ((1.0,),))
    write_page(tmp_path / "e.html", Evaluation("Title", {}, (without,)), None)
    assert "What was asked" not in (tmp_path / "e.html").read_text()
