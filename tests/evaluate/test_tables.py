"""Tables: what is shown, what is unknown."""

import json
import sys
from pathlib import Path

import pytest

from animal3dbox.evaluate.files import Evaluation, as_text, write_json
from animal3dbox.evaluate.page import write_page
from animal3dbox.evaluate.pictures import pictures_of
from animal3dbox.evaluate.plots import plots_of
from animal3dbox.evaluate.tables import PAPER, Table, mean, percent, quantile, shown, wilson_bounds

TABLE = Table(
    "t",
    "A table",
    ("A note.",),
    ("method", "px", "n"),
    (("ours", 1.25, 3), ("theirs", None, 0), (f"({PAPER})", 75.28, 1)),
)


def test_bounds_of_a_rate_hold_it_and_narrow_with_the_count() -> None:
    """None of 100: at most 3.7 %, z^2 / (n + z^2)."""
    assert wilson_bounds(0, 0) == (0.0, 1.0)
    low, high = wilson_bounds(0, 100)
    assert abs(low) < 1e-12
    assert high == pytest.approx(0.0370, abs=1e-4)
    assert wilson_bounds(500, 1000)[1] - 0.5 < wilson_bounds(5, 10)[1] - 0.5


def test_numbers_are_shown_with_about_four_digits_and_the_unknown_as_a_dash() -> None:
    numbers = {1.234567: "1.23", 0.01234567: "0.0123", 123.456: "123.5", 1e-7: "1.0e-07"}
    assert {number: shown(number) for number in numbers} == numbers
    assert [shown(cell) for cell in (0.0, 12, "word")] == ["0", "12", "word"]
    assert [shown(cell) for cell in (None, float("nan"))] == ["-", "-"]


def test_statistics_leave_out_what_is_unknown() -> None:
    assert mean([1.0, None, 3.0]) == 2.0
    assert quantile([None, 1.0, 2.0, 9.0], 0.5) == 2.0
    assert percent([True, False, False, False]) == 25.0
    assert mean([None]) is None
    assert quantile([], 0.5) is None
    assert percent([]) is None


def test_the_text_is_aligned_under_its_title() -> None:
    assert as_text(Evaluation("Title", {}, (TABLE,))).splitlines() == [
        "Title",
        "",
        "A table",
        "=======",
        "method      px  n",
        "ours      1.25  3",
        "theirs       -  0",
        "(PAPER)  75.28  1",
        "  A note.",
    ]


def test_the_json_has_a_row_by_its_columns_and_null_for_the_unknown(tmp_path: Path) -> None:
    write_json(tmp_path / "e.json", Evaluation("Title", {"seed": 0}, (TABLE,)))
    content = json.loads((tmp_path / "e.json").read_text())
    assert content["schema"] == "animal3dbox.evaluation"
    assert content["tables"]["t"]["rows"][1] == {"method": "theirs", "px": None, "n": 0}


def test_the_page_without_matplotlib_says_how_to_get_the_plots(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    assert plots_of((TABLE,)) is None
    assert pictures_of(0) is None
    write_page(tmp_path / "e.html", Evaluation("Title", {}, (TABLE,)), plots_of((TABLE,)))
    page = (tmp_path / "e.html").read_text()
    assert "animal3dbox[plots]" in page
    assert "75.28" in page
    assert '<tr class="paper">' in page


def test_names_cannot_put_tags_into_the_page(tmp_path: Path) -> None:
    evil = '"><script>alert(1)</script><img src=x onerror=alert(1)>{{ tables }}'
    table = Table("t", evil, (evil,), (evil, "px"), ((evil, 1.0),))
    evaluation = Evaluation(evil, {evil: evil}, (table,))
    write_page(tmp_path / "e.html", evaluation, {"t": b"png"}, {evil: b"png"})
    page = (tmp_path / "e.html").read_text()
    assert "<script" not in page
    assert page.count("<img") == 2  # a picture and a plot
    assert page.count("&lt;script&gt;alert(1)&lt;/script&gt;") == 11


def test_with_plots_the_page_does_not_ask_for_matplotlib(tmp_path: Path) -> None:
    write_page(tmp_path / "e.html", Evaluation("Title", {}, (TABLE,)), {"t": b"png"})
    page = (tmp_path / "e.html").read_text()
    assert "animal3dbox[plots]" not in page
    assert "data:image/png;base64,cG5n" in page
