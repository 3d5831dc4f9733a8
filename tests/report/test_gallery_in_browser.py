"""The gallery's search, filters, order and pages of animals, as they work in a browser."""

from collections.abc import Iterator

import numpy as np
import pytest
from browser import BrowserPage, browser_page

from animal3dbox.report.advice import flag_findings, rejection_finding
from animal3dbox.report.gallery import Card, card_picture, write_gallery
from animal3dbox.report.summary import summarize

PICTURE = card_picture(np.full((30, 40, 3), 128, dtype=np.uint8))
SPECIES = ("dog", "zebra", "Grevy's <zebra>")
N_ANIMALS = 30


def card(number: int) -> Card:
    """Every third animal is flagged for one or two causes, every tenth is rejected."""
    flags = ["truncated", "low_confidence"][: 1 + number % 2] if number % 3 == 0 else []
    is_rejected = number % 10 == 9
    findings = (
        [rejection_finding("no_pose", "none fits")]
        if is_rejected
        else flag_findings(flags, {"truncation": 0.4, "confidence": 0.3})
    )
    return Card(
        title=f"herd{number // 10}/{number:03d}.jpg",
        picture=PICTURE,
        confidence=-1 if is_rejected else (number * 7 % N_ANIMALS) / N_ANIMALS,
        error_px=None if is_rejected else float(number),
        mask_iou=None if is_rejected else 1 - number / 100,
        status="rejected" if is_rejected else "flagged" if flags else "kept",
        facts=("keypoints 3.0 px off",),
        overlay=None,
        category=SPECIES[number % 3],
        flank="" if is_rejected else ("left", "right")[number % 2],
        findings=tuple(findings),
    )


CARDS = [card(number) for number in range(N_ANIMALS)]


@pytest.fixture(scope="module")
def opened(tmp_path_factory: pytest.TempPathFactory) -> Iterator[BrowserPage]:
    folder = tmp_path_factory.mktemp("gallery")
    nothing = summarize(
        source="s", body="dog", method="default", animals=(), flags=(), rejected=(), faults=()
    )
    write_gallery(folder / "gallery.html", CARDS, nothing)
    address = (folder / "gallery.html").as_uri()
    with browser_page(address, folder / "profile") as page:
        yield page


@pytest.fixture
def page(opened: BrowserPage) -> BrowserPage:
    """The gallery with everything shown, worst first, no animal's page open."""
    opened.evaluate("dialog.close(); by('reset').click()")
    opened.evaluate("document.querySelector('[data-sort]').click()")
    opened.settle()
    return opened


def shown(page: BrowserPage) -> list[str]:
    """The titles of the cards that one sees, in their order."""
    return list(
        page.evaluate(
            "[...main.children].filter(card => card.getClientRects().length)"
            ".map(card => card.querySelector('h2').textContent)"
        )
    )


def search(page: BrowserPage, words: str) -> None:
    page.evaluate(f"by('search').value = {words!r}; by('search').dispatchEvent(new Event('input'))")
    page.evaluate("new Promise(done => setTimeout(done, 200))")


def choose(page: BrowserPage, filter_name: str, value: str) -> None:
    page.evaluate(
        f"by({filter_name!r}).value = {value!r};"
        f" by({filter_name!r}).dispatchEvent(new Event('change'))"
    )


def titles(*wanted: Card) -> set[str]:
    return {one.title for one in wanted}


def address_of(page: BrowserPage) -> str:
    return str(page.evaluate("location.hash"))


def is_open(page: BrowserPage) -> bool:
    return bool(page.evaluate("dialog.open"))


@pytest.mark.parametrize(
    ("words", "numbers"),
    [
        ("012", [12]),
        ("HERD1", range(10, 20)),
        ("zebra herd0", [n for n in range(10) if n % 3]),
        ("<zebra>", [n for n in range(N_ANIMALS) if n % 3 == 2]),
        (" ", range(N_ANIMALS)),
        ("giraffe", []),
    ],
)
def test_every_word_of_a_search_is_looked_for(
    page: BrowserPage, words: str, numbers: list[int]
) -> None:
    search(page, words)
    assert set(shown(page)) == titles(*(CARDS[n] for n in numbers))
    count = page.evaluate("by('count').textContent")
    ending = "" if numbers else ": none fits all of this"
    assert count == f"{len(numbers)} of {N_ANIMALS}{ending}"


def test_filters_offer_what_there_is_with_counts_and_show_it(page: BrowserPage) -> None:
    values = {
        "status": [[one.status] for one in CARDS],
        "category": [[one.category] for one in CARDS],
        "flank": [[one.flank] for one in CARDS],
        "key": [[finding.key for finding in one.findings] for one in CARDS],
    }
    for name, of_cards in values.items():
        options = page.evaluate(f"[...by({name!r}).options].map(o => [o.value, o.textContent])")
        every = {value for of_card in of_cards for value in of_card if value}
        assert {value for value, _ in options} == {"", *every}
        for value, words in options[1:]:
            fitting = [c for c, of_card in zip(CARDS, of_cards, strict=True) if value in of_card]
            assert words == f"{value} ({len(fitting)})"
            choose(page, name, value)
            assert set(shown(page)) == titles(*fitting)
        choose(page, name, "")


def test_filters_and_search_act_together_and_one_button_ends_them(page: BrowserPage) -> None:
    choose(page, "status", "flagged")
    choose(page, "flank", "left")
    search(page, "herd2 dog")
    wanted = [
        one
        for one in CARDS[20:]
        if (one.status, one.flank, one.category) == ("flagged", "left", "dog")
    ]
    assert wanted
    assert set(shown(page)) == titles(*wanted)
    page.evaluate("by('reset').click()")
    assert len(shown(page)) == N_ANIMALS


def test_buttons_sort_and_rejected_animals_come_where_they_belong(page: BrowserPage) -> None:
    rejected = titles(*(one for one in CARDS if one.status == "rejected"))
    labelled = [one for one in CARDS if one.status != "rejected"]
    orders = [
        (sorted(labelled, key=lambda one: one.confidence), True),
        (sorted(labelled, key=lambda one: -one.confidence), False),
        (sorted(labelled, key=lambda one: -(one.error_px or 0)), False),
        (sorted(labelled, key=lambda one: one.mask_iou or 0), False),
    ]
    for number, (order, rejected_first) in enumerate(orders):
        page.evaluate(f"document.querySelectorAll('[data-sort]')[{number}].click()")
        visible = shown(page)
        assert [title for title in visible if title not in rejected] == [c.title for c in order]
        assert set(visible[:3] if rejected_first else visible[-3:]) == rejected


def test_an_animals_page_opens_steps_through_what_is_shown_and_closes(page: BrowserPage) -> None:
    choose(page, "status", "flagged")
    first, second = shown(page)[:2]
    page.evaluate("[...main.children].find(card => !card.hidden).querySelector('.why').click()")
    page.settle()
    assert is_open(page)
    assert page.evaluate("by('animal-title').textContent") == first
    text = page.evaluate("dialog.innerText")
    (of_first,) = [one for one in CARDS if one.title == first]
    for finding in of_first.findings:
        assert finding.sentence in text
    assert text.count("What to do: ") == len(of_first.findings)
    assert page.evaluate("[by('before').disabled, by('after').disabled]") == [True, False]
    page.press("ArrowRight")
    assert page.evaluate("by('animal-title').textContent") == second
    page.press("ArrowLeft")
    page.press("ArrowLeft")  # there is none before
    assert page.evaluate("by('animal-title').textContent") == first
    page.press("Escape")
    assert not is_open(page)
    assert address_of(page) == ""


def test_the_back_button_goes_back_and_an_address_opens_its_animal(page: BrowserPage) -> None:
    page.evaluate("location.hash = 'animal-4'; location.hash = 'animal-5'")
    page.settle()
    page.go(-1)
    assert (address_of(page), is_open(page)) == ("#animal-4", True)
    page.go(-1)
    assert (address_of(page), is_open(page)) == ("", False)
    page.go(1)
    assert (address_of(page), is_open(page)) == ("#animal-4", True)
    page.evaluate("by('close').click()")
    page.settle()
    assert (address_of(page), is_open(page)) == ("", False)
    page.evaluate("location.hash = 'animal-99'")
    page.settle()
    assert not is_open(page)
