"""The gallery's search, filters and the page of each animal, as far as HTML tells."""

import re
from dataclasses import replace
from html.parser import HTMLParser
from importlib import resources
from pathlib import Path

import numpy as np
import pytest
from animals import IMAGE_HW
from command_pages import options_of
from hypothesis import given
from hypothesis import strategies as st

from animal3dbox import LabelConfig, label_animal
from animal3dbox.labels.types import FLAGS as LABEL_FLAGS
from animal3dbox.labels.types import REASONS, CuboidLabel, Rejection
from animal3dbox.report.advice import (
    FLAG_REMEDIES,
    FLAG_SENTENCES,
    REASON_REMEDIES,
    Finding,
    explanations,
    flag_findings,
    rejection_finding,
)
from animal3dbox.report.gallery import Card, write_gallery
from animal3dbox.report.html_page import render
from animal3dbox.report.run import write_run
from animal3dbox.report.run_rows import Labelled
from animal3dbox.report.summary import FLAGS, summarize

GREY = np.full((*IMAGE_HW, 3), 128, dtype=np.uint8)
NUMBERS = {
    "confidence": 0.314,
    "truncation": 0.42,
    "n_inliers": 3,
    "n_keypoints": 9,
    "mask_iou": 0.55,
}


class Elements(HTMLParser):
    """The elements of a page in their order: tag, attributes, text."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.all: list[tuple[str, dict[str, str | None], str]] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.all.append((tag, dict(attrs), ""))

    def handle_data(self, data: str) -> None:
        if self.all:
            tag, attributes, text = self.all[-1]
            self.all[-1] = (tag, attributes, text + data)

    def of(self, tag: str) -> list[tuple[dict[str, str | None], str]]:
        return [(attributes, text) for name, attributes, text in self.all if name == tag]


def page_of(path: Path, *cards: Card) -> str:
    nothing = summarize(
        source="s", body="dog", method="default", animals=(), flags=(), rejected=(), faults=()
    )
    write_gallery(path / "gallery.html", cards, nothing)
    return (path / "gallery.html").read_text()


def label() -> CuboidLabel:
    outcome = label_animal(
        IMAGE_HW,
        vertices=[[x, y, z] for x in (-1, 1) for y in (-0.5, 0.5) for z in (-0.4, 0.4)],
        K=[[100, 0, 79.5], [0, 100, 59.5], [0, 0, 1]],
        pose=([[1, 0, 0], [0, 0, -1], [0, 1, 0]], [0, 0, 5]),
        config=LabelConfig(axes="pca"),
        sample_id="a.jpg",
    )
    assert isinstance(outcome, CuboidLabel)
    return outcome


def test_every_flag_and_reason_has_its_sentence_and_its_remedy() -> None:
    assert set(FLAG_SENTENCES) == set(FLAG_REMEDIES) == set(FLAGS)
    assert set(REASON_REMEDIES) == set(REASONS)
    sentences = [*(one.sentence for one in flag_findings([*FLAGS], NUMBERS, [*LABEL_FLAGS]))]
    for one in explanations():
        sentences += [one.meaning, one.remedy]
    for reason in REASONS:
        sentences += [rejection_finding(reason, detail).sentence for detail in ("", "x", "x.")]
    for sentence in sentences:
        assert re.fullmatch(r"[A-Z0-9].*[^.]\.", sentence), sentence


def test_a_finding_has_the_animals_own_numbers_and_the_cause_of_its_probability() -> None:
    sentences = {one.key: one.sentence for one in flag_findings([*FLAGS], NUMBERS, ["rolled"])}
    assert sentences["low_confidence"].startswith("The box is right with a probability of 31%.")
    assert sentences["low_confidence"].endswith(f"{LABEL_FLAGS['rolled'][1:]}.")
    assert sentences["truncated"] == "42% of the box lies outside the image."
    assert sentences["few_inliers"].startswith("3 of 9 ")
    assert "0.55" in sentences["low_overlap"]
    assert flag_findings(["of a later version"], {})[0].sentence == "It raises of a later version."
    (own,) = flag_findings(["rolled"], {})  # of a label without a probability
    assert own.sentence == f"The camera{LABEL_FLAGS['rolled'].removeprefix('the camera')}."


def test_the_table_and_the_glossary_say_what_every_flag_and_reason_means(tmp_path: Path) -> None:
    every = dict.fromkeys({*FLAGS, *LABEL_FLAGS}, 1)
    nothing = summarize(
        source="s", body="dog", method="default", animals=(), flags=(), rejected=(), faults=()
    )
    nothing.flags, nothing.reasons = every, dict.fromkeys(REASONS, 1)
    write_gallery(tmp_path / "gallery.html", [], nothing)
    page = (tmp_path / "gallery.html").read_text()
    rows = dict(re.findall(r"<tr><th>· (\w+)</th>.*?<td>([^<]*)</td></tr>", page))
    assert set(rows) == {*every, *REASONS}
    assert all(rows.values())
    assert {one.key for one in explanations()} == set(rows)


def test_options_that_a_remedy_names_are_those_of_label() -> None:
    remedies = " ".join([*FLAG_REMEDIES.values(), *REASON_REMEDIES.values()])
    options = set(re.findall(r"--[a-z-]+", remedies))
    assert len(options) > 5
    assert options <= options_of(("label",))


def test_a_run_tells_why_each_animal_was_flagged_or_rejected(tmp_path: Path) -> None:
    cut = replace(label().with_fields(truncation=0.42), sample_id="a.jpg")
    refused = Rejection("b.jpg", "too_few_keypoints", "3 visible, 6 needed")
    results = [
        Labelled(cut, "a.jpg", "zebra", GREY),
        Labelled(refused, "b.jpg", "leopard", GREY),
        Labelled(replace(label(), sample_id="c.jpg"), "c.jpg", "zebra", GREY),
    ]
    write_run(tmp_path, results, source="set", body="toy", config=LabelConfig())
    elements = Elements((tmp_path / "gallery.html").read_text())
    causes = {(a["data-key"], text) for a, text in elements.of("li") if "data-key" in a}
    assert causes == {
        ("truncated", "42% of the box lies outside the image."),
        ("too_few_keypoints", rejection_finding("too_few_keypoints", refused.detail).sentence),
    }
    articles = [attributes for attributes, _ in elements.of("article")]
    assert [a["class"] for a in articles] == ["rejected", "flagged", "kept"]
    assert [a["data-category"] for a in articles] == ["leopard", "zebra", "zebra"]
    assert ["data-flank" in a for a in articles] == [False, True, True]
    remedies = {a["data-remedy"]: text.strip() for a, text in elements.of("span")}
    causes_of_doubt = dict.fromkeys({*LABEL_FLAGS} - {*FLAGS}, FLAG_REMEDIES["low_confidence"])
    assert remedies == {**FLAG_REMEDIES, **REASON_REMEDIES, **causes_of_doubt}


@given(st.text(st.sampled_from("\"'<>&=`/ a\n{}%$;"), min_size=1, max_size=30))
def test_hostile_words_come_back_as_they_were(evil: str) -> None:
    evil = f"{evil}\"><script>'"
    finding = Finding(evil, evil)
    card = Card("t", None, "flagged", 0.5, None, None, (), None, evil, evil, evil, (finding,))
    text = render("animal3dbox.report", "gallery_card.html", card=card, jpeg=None)
    elements = Elements(text)
    assert [tag for tag, _, _ in elements.all] == ["article", "h2", "ul", "ol", "li", "button"]
    attributes = elements.of("article")[0][0]
    names = ("data-category", "data-flank", "data-image")
    assert [attributes[name] for name in names] == [evil] * 3
    assert elements.of("li")[0] == ({"data-key": evil}, evil)


def test_what_the_script_asks_for_is_in_the_page(tmp_path: Path) -> None:
    finding = Finding("truncated", "It is cut.")
    card = Card("a", b"x", "flagged", 0.5, 1.0, 0.5, ("f",), "overlays/a.png", "b", "c", "left")
    text = page_of(tmp_path, replace(card, findings=(finding,)))
    script = text[text.index("<script>") :]
    ids = {str(a["id"]) for _, a, _ in Elements(text).all if "id" in a}
    assert ids >= set(re.findall(r'by\("([a-z-]+)"\)', script)) > {"search", "count", "animal"}
    filters = re.findall(r'"([a-z]+)"', script[script.index("filters = [") :].split("]")[0])
    assert filters == ["status", "category", "flank", "key"]
    assert ids >= set(filters)
    article = dict(Elements(text).of("article")[0][0])
    assert {"data-category", "data-flank", "data-image"} <= set(article)


def test_the_page_stays_small_and_draws_cards_when_they_come_into_view(tmp_path: Path) -> None:
    finding = flag_findings(["truncated"], NUMBERS)
    cards = [
        Card(name, None, "flagged", 0.5, 1.0, None, ("side left",), None, name, "zebra", "left")
        for name in (f"herd/{i}.jpg" for i in range(500))
    ]
    cards = [replace(card, findings=finding) for card in cards]
    empty = len(page_of(tmp_path))
    assert empty < 16_000
    assert (len(page_of(tmp_path, *cards)) - empty) / 500 < 450
    assert "content-visibility: auto" in page_of(tmp_path)


def test_script_and_style_put_nothing_into_the_page_as_html() -> None:
    template = resources.files("animal3dbox.report").joinpath("gallery.html").read_text("utf-8")
    assert not re.search(r"innerHTML|outerHTML|insertAdjacentHTML|document\.write|eval\(", template)
    assert not re.search(r"https?:|url\(|@import|fetch\(", template)


@pytest.mark.parametrize("status", ["kept", "flagged", "rejected", "of a later version"])
def test_every_card_has_a_button_to_its_page(tmp_path: Path, status: str) -> None:
    page = page_of(tmp_path, Card("a", None, status, 0.5, None, None, (), None))
    buttons = [attributes for attributes, _ in Elements(page).of("button")]
    assert buttons.count({"class": "why"}) == 1
