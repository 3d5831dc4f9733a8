"""Label files, overlays, gallery, counts: what a run leaves on disk."""

import io
import json
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import msgspec
import numpy as np
import pytest
import torch
from animals import IMAGE_HW, K, camera_round, keypoints_seen, toy_landmarks, toy_mesh
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from PIL import Image
from strategies import cuboids_anywhere

from animal3dbox.errors import (
    Animal3DBoxError,
    ConfigError,
    DatasetFormatError,
    DatasetNotFoundError,
    SampleError,
)
from animal3dbox.files import write_whole
from animal3dbox.geometry.cuboid import Cuboid
from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.label import label_animal
from animal3dbox.labels.types import REASONS, CuboidLabel, Quality, Rejection
from animal3dbox.report.cuboid_pen import BACK, FRONT
from animal3dbox.report.gallery import Card, card_picture, small_picture, write_gallery
from animal3dbox.report.label_files import (
    LabelFile,
    RejectedRow,
    animal_row,
    write_labels_json,
)
from animal3dbox.report.label_reading import read_labels_json
from animal3dbox.report.label_words import words_of_label
from animal3dbox.report.overlay import draw_cuboid, draw_label, enlarged, with_words
from animal3dbox.report.run import RunWriter, overlay_name, write_run
from animal3dbox.report.run_rows import Labelled, drawn_animal
from animal3dbox.report.summary import FLAGS, Summary, flags_of, summarize

Picture = NDArray[np.uint8]
GREY = np.full((*IMAGE_HW, 3), 128, dtype=np.uint8)


def labelled(azimuth_deg: float = 60, sample_id: str = "a.jpg") -> CuboidLabel:
    """The toy animal under its true camera."""
    R, t = camera_round(azimuth_deg, 15)
    vertices, faces = toy_mesh()
    outcome = label_animal(
        IMAGE_HW,
        keypoints_seen(R, t),
        toy_landmarks(),
        vertices,
        faces=faces,
        K=K,
        pose=(R, t),
        sample_id=sample_id,
    )
    assert isinstance(outcome, CuboidLabel)
    return outcome


@pytest.fixture(scope="module")
def label() -> CuboidLabel:
    return labelled()


def with_quality(label: CuboidLabel, **changes: float | int | str | None) -> CuboidLabel:
    quality: Quality = replace(label.quality, **changes)  # type: ignore[arg-type]
    return replace(label, quality=quality)


# Files
# --------------------------------------------------------------------------------------------------


def test_a_file_is_written_whole_with_ordinary_rights(tmp_path: Path) -> None:
    path = tmp_path / "deep" / "down" / "file.txt"
    write_whole(path, b"old")
    write_whole(path, b"new")
    (tmp_path / "plain").touch()
    assert path.read_bytes() == b"new"
    assert path.stat().st_mode == (tmp_path / "plain").stat().st_mode
    assert [p.name for p in path.parent.iterdir()] == ["file.txt"]


@pytest.mark.parametrize("step", ["replace", "chmod"])
@pytest.mark.parametrize("error", [OSError("disk full"), KeyboardInterrupt()])
def test_a_failed_write_leaves_the_old_file_and_no_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, step: str, error: BaseException
) -> None:
    def fail(*arguments: object) -> None:
        raise error

    (tmp_path / "file.txt").write_bytes(b"old")
    monkeypatch.setattr(Path, step, fail)
    with pytest.raises(type(error)):
        write_whole(tmp_path / "file.txt", b"new")
    assert (tmp_path / "file.txt").read_bytes() == b"old"
    assert [p.name for p in tmp_path.iterdir()] == ["file.txt"]


@pytest.mark.parametrize("name", ["plain/a.json", f"{'a' * 300}.json"])
def test_a_failed_write_names_the_file_that_was_to_be_written(tmp_path: Path, name: str) -> None:
    (tmp_path / "plain").touch()
    with pytest.raises(OSError, match="cannot be written") as caught:
        write_whole(tmp_path / name, b"new")
    assert caught.value.filename == str(tmp_path / name)
    assert [p.name for p in tmp_path.iterdir()] == ["plain"]


# labels.json
# -------------------------------------------------------------------------------------------


def label_file(label: CuboidLabel) -> LabelFile:
    rejected = RejectedRow(
        sample_id="b.jpg", image="b.jpg", animal=0, reason="no_axes", detail="none"
    )
    return LabelFile(
        body="toy",
        config={"method": "default", "margin": None},
        animals=[animal_row(label, image="a.jpg", animal=0, category="dog")],
        rejected=[rejected],
    )


def test_labels_json_reads_back_as_written(tmp_path: Path, label: CuboidLabel) -> None:
    file = label_file(label)
    write_labels_json(tmp_path / "labels.json", file)
    read = read_labels_json(tmp_path / "labels.json")
    assert read == file
    assert (read.schema, read.version, read.face_names[2], read.corner_signs[1]) == (
        "animal3dbox.labels",
        1,
        "left",
        (1, -1, -1),
    )
    row = read.animals[0]
    assert row.corners_3d == label.corners_3d.tolist()  # to the last bit
    assert (row.image_hw, row.side, row.viewpoint) == (IMAGE_HW, "left", "front-left")


def test_corners_behind_the_camera_are_null(label: CuboidLabel) -> None:
    in_front = torch.tensor([True, False] * 4)
    row = animal_row(
        label.with_fields(corner_in_front=in_front), image="a.jpg", animal=0, category="dog"
    )
    assert [corner is None for corner in row.corners_2d] == [False, True] * 4


@pytest.mark.parametrize(
    "field",
    ["corners_3d", "center", "rotation", "size", "corners_2d", "face_area", "K", "R", "t", "box"],
)
@pytest.mark.parametrize("value", [torch.nan, torch.inf, -torch.inf])
def test_a_label_with_nan_is_never_written(
    tmp_path: Path, label: CuboidLabel, field: str, value: float
) -> None:
    file = label_file(label)
    spoilt = getattr(label, field).clone()
    spoilt.view(-1)[1] = value
    setattr(file.animals[0], field, spoilt.tolist())
    with pytest.raises(DatasetFormatError, match="NaN, infinite"):
        write_labels_json(tmp_path / "labels.json", file)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda text: text.replace("animal3dbox.labels", "coco"), "schema"),
        (lambda text: text.replace('"version": 1', '"version": 2'), "version"),
        (lambda text: text.replace('"side"', '"slide"'), "side"),
        (lambda text: text[:-5], "not valid JSON"),
        (lambda text: "", "is empty"),
    ],
    ids=["schema", "version", "missing_key", "cut_off", "empty"],
)
def test_labels_json_of_another_form_is_refused(
    tmp_path: Path, label: CuboidLabel, change: Callable[[str], str], reason: str
) -> None:
    path = tmp_path / "labels.json"
    write_labels_json(path, label_file(label))
    path.write_text(change(path.read_text()))
    with pytest.raises(DatasetFormatError) as caught:
        read_labels_json(path)
    assert str(path) in str(caught.value)
    assert reason in str(caught.value)


def test_missing_labels_json_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DatasetNotFoundError):
        read_labels_json(tmp_path / "labels.json")


# Overlays
# --------------------------------------------------------------------------------------------------


def differs(a: Picture, b: Picture) -> NDArray[np.bool_]:
    return np.asarray((a != b).any(-1))


def test_drawing_leaves_the_picture_as_it_was(label: CuboidLabel) -> None:
    picture = GREY.copy()
    drawn = draw_label(picture, label)
    assert np.array_equal(picture, GREY)
    assert drawn.shape[0] > GREY.shape[0]  # words below
    assert drawn.shape[1] == GREY.shape[1]
    assert differs(drawn[: IMAGE_HW[0]], GREY).any()


def test_the_drawn_cuboid_covers_its_corners_and_no_far_pixels(label: CuboidLabel) -> None:
    canvas = GREY.copy()
    draw_cuboid(canvas, label.cuboid, label.K)
    rows, columns = np.nonzero(differs(canvas, GREY))
    least, most = label.corners_2d.amin(0), label.corners_2d.amax(0)
    assert columns.min() == pytest.approx(float(least[0]), abs=3)
    assert columns.max() == pytest.approx(float(most[0]), abs=3)
    assert rows.min() == pytest.approx(float(least[1]), abs=3)
    assert rows.max() == pytest.approx(float(most[1]), abs=3)


@pytest.mark.parametrize(("azimuth_deg", "strong", "weak"), [(20, FRONT, BACK), (160, BACK, FRONT)])
def test_the_face_that_is_seen_is_the_strongly_coloured_one(
    azimuth_deg: float, strong: tuple[int, ...], weak: tuple[int, ...]
) -> None:
    canvas = GREY.copy()
    draw_cuboid(canvas, labelled(azimuth_deg).cuboid, K)
    counts = [
        int((np.abs(canvas.astype(int) - np.array(color)).max(-1) <= 2).sum())
        for color in (strong, weak)
    ]
    assert counts[0] > 100  # its outline, in the plain colour
    assert counts[1] == 0


def test_a_small_picture_is_enlarged_and_its_drawing_with_it() -> None:
    small = np.full((60, 80, 3), 128, dtype=np.uint8)
    box = Cuboid(
        torch.tensor([0.0, 0, 4], dtype=torch.float64),
        torch.eye(3, dtype=torch.float64),
        torch.ones(3, dtype=torch.float64),
    )
    K_small = torch.tensor([[80.0, 0, 39.5], [0, 80, 29.5], [0, 0, 1]], dtype=torch.float64)
    canvas, factor = enlarged(small)
    assert (canvas.shape, factor) == ((360, 480, 3), 6.0)
    plain = canvas.copy()
    draw_cuboid(canvas, box, K_small, factor)
    rows, columns = np.nonzero(differs(canvas, plain))
    near = 80 * 0.5 / 3.5 * 6  # half the near face, in pixels of the enlarged picture
    assert columns.min() == pytest.approx(239.5 - near, abs=3)
    assert columns.max() == pytest.approx(239.5 + near, abs=3)
    assert rows.max() == pytest.approx(179.5 + near, abs=3)


@given(cuboids_anywhere())
def test_a_box_before_behind_or_around_the_camera_can_be_drawn(box: Cuboid) -> None:
    canvas = np.full((48, 64, 3), 128, dtype=np.uint8)
    draw_cuboid(
        canvas, box, torch.tensor([[60.0, 0, 31.5], [0, 60, 23.5], [0, 0, 1]], dtype=torch.float64)
    )
    assert canvas.shape == (48, 64, 3)


@pytest.mark.parametrize("size", [(1, 3000), (3000, 1), (70_000, 40), (40, 70_000)])
def test_strips_stay_small_enough_to_show(size: tuple[int, int]) -> None:
    strip = np.zeros((*size, 3), dtype=np.uint8)
    assert max(enlarged(strip)[0].shape) <= max(2000, *size)
    shown = small_picture(strip, 420)
    assert 1 <= shown.shape[1] <= 420
    assert 1 <= shown.shape[0] <= 1260


def test_words_that_are_too_long_for_the_picture_go_on_in_the_next_line() -> None:
    canvas = np.zeros((50, 480, 3), dtype=np.uint8)
    words = "12 labelled, 12 detected (dashed, score 0.3+), 12 of them no boxes and some more words"
    once, long = (with_words(canvas, [line]) for line in (words[:30], words))
    assert long.shape[0] == once.shape[0] + 20
    right = long[50:, -8:]
    assert (right == right[0, 0]).all()  # nothing is cut off at the border
    first = with_words(canvas, [words[:30], ""])
    assert np.array_equal(first[50:70, :200], long[50:70, :200])


def test_a_picture_that_is_small_already_is_not_touched() -> None:
    assert small_picture(GREY, 640) is GREY


def test_the_words_tell_side_view_and_shares(label: CuboidLabel) -> None:
    side, shares, fit = words_of_label(label).lines
    assert side == "side: left   view: front-left"
    assert shares.startswith("left ")
    assert sum(int(part) for part in re.findall(r"(\d+)%", shares)) == pytest.approx(100, abs=2)
    assert fit == "keypoints 0.0 px"


def test_a_share_that_would_be_0_percent_is_not_told(label: CuboidLabel) -> None:
    words = replace(words_of_label(label), shares=(0.004, 0.0, 0.8, 0.0, 0.19, 0.006))
    assert words.lines[1] == "left 80%  top 19%  bottom 1%"


# Counts
# --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "flags"),
    [
        ({}, ()),
        ({"n_keypoints": 10, "n_inliers": 5}, ()),
        ({"n_keypoints": 10, "n_inliers": 4}, ("few_inliers",)),
        ({"n_keypoints": 0, "n_inliers": 0}, ()),
        ({"mask_iou": 0.6}, ()),
        ({"mask_iou": 0.59}, ("low_overlap",)),
        ({"mask_iou": None}, ()),
        ({"mask_iou": 0.0, "n_inliers": 0}, ("few_inliers", "low_overlap")),
    ],
)
def test_a_poor_fit_is_flagged(
    label: CuboidLabel, changes: dict[str, float | int | None], flags: tuple[str, ...]
) -> None:
    published = with_quality(label, **{"confidence": None, **changes})
    assert flags_of(published) == flags
    assert flags_of(with_quality(label, **{"confidence": 0.9, **changes})) == ()


@pytest.mark.parametrize(
    ("changes", "flags"),
    [
        ({"confidence": 0.51}, ()),
        ({"confidence": 0.49}, ("low_confidence",)),
        ({"confidence": 0.9, "labeling": "legs"}, ("exchanged",)),
    ],
)
def test_a_label_is_flagged_by_its_probability(
    label: CuboidLabel, changes: dict[str, float | int | str | None], flags: tuple[str, ...]
) -> None:
    assert flags_of(with_quality(label, **changes)) == flags


def test_a_cut_or_too_near_box_is_flagged(label: CuboidLabel) -> None:
    assert flags_of(label.with_fields(truncation=0.3)) == ()
    assert flags_of(label.with_fields(truncation=0.31, behind_camera=True)) == (
        "truncated",
        "near_camera",
    )


OUTCOMES = st.lists(
    st.one_of(
        st.lists(st.sampled_from(list(FLAGS)), unique=True).map(tuple),
        st.sampled_from(list(REASONS)),
        st.just(None),
    ),
    max_size=30,
)


@given(OUTCOMES)
def test_every_animal_is_counted_exactly_once(outcomes: list[tuple[str, ...] | str | None]) -> None:
    row = animal_row(LABEL, image="a.jpg", animal=0, category="dog")
    flags = [o for o in outcomes if isinstance(o, tuple)]
    rejected = [
        RejectedRow(sample_id="r", image="r", animal=0, reason=o, detail="")
        for o in outcomes
        if isinstance(o, str)
    ]
    faults = [SampleError("f", "seg", "bad") for o in outcomes if o is None]
    summary = summarize(
        source="set",
        body="dog",
        method="default",
        animals=[row] * len(flags),
        flags=flags,
        rejected=rejected,
        faults=faults,
    )
    assert (
        summary.animals
        == len(outcomes)
        == summary.kept + summary.flagged + summary.rejected + summary.faulty
    )
    assert summary.kept == outcomes.count(())
    assert summary.faulty == len(summary.faults) == outcomes.count(None)
    assert sum(summary.reasons.values()) == summary.rejected
    assert sum(summary.sides.values()) == summary.kept + summary.flagged
    assert sum(summary.flags.values()) == sum(len(raised) for raised in flags)
    assert all(summary.flags[flag] <= summary.flagged for flag in summary.flags)


LABEL = labelled()


@pytest.mark.parametrize(
    ("values", "median"),
    [
        ([], None),
        ([3.0], 3.0),
        ([5.0, 1.0, 2.0], 2.0),
        ([4.0, 1.0, 2.0, 9.0], 3.0),
        ([None, 7.0], 7.0),
    ],
)
def test_medians_leave_out_what_is_unknown(
    label: CuboidLabel, values: list[float | None], median: float | None
) -> None:
    rows = [
        animal_row(
            with_quality(label, reprojection_error_px=v, mask_iou=v),
            image="a.jpg",
            animal=i,
            category="dog",
        )
        for i, v in enumerate(values)
    ]
    summary = summarize(
        source="set",
        body="dog",
        method="default",
        animals=rows,
        flags=[()] * len(rows),
        rejected=[],
        faults=[],
    )
    assert (summary.median_reprojection_error_px, summary.median_mask_iou) == (median, median)


# Gallery
# --------------------------------------------------------------------------------------------------


def summary_of(**changes: str | int | dict[str, int]) -> Summary:
    return msgspec.structs.replace(
        summarize(
            source="set",
            body="dog",
            method="default",
            animals=[],
            flags=[],
            rejected=[],
            faults=[],
        ),
        **changes,
    )


def card(
    title: str,
    confidence: float,
    picture: Picture | None = None,
    status: str = "kept",
    overlay: str | None = None,
) -> Card:
    return Card(
        title,
        None if picture is None else card_picture(picture),
        status,
        confidence,
        1.5,
        None,
        ("side left",),
        overlay,
    )


class Page(HTMLParser):
    """The tags of a page and what it would load."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.loads: list[str] = []
        self.titles: list[str] = []
        self.links: list[str] = []
        self._in_h2 = False
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        values = dict(attrs)
        self.loads += [
            values[key] or "" for key in ("src", "srcset", "data", "poster") if key in values
        ]
        self.loads += [values["href"] or ""] if tag == "link" else []
        self.links += [values["href"] or ""] if tag == "a" else []
        self._in_h2 = tag == "h2"

    def handle_data(self, data: str) -> None:
        if self._in_h2:
            self.titles.append(data)
            self._in_h2 = False


def noise_pictures(n: int) -> Iterator[Picture]:
    rng = np.random.default_rng(0)
    for _ in range(n):
        yield rng.integers(0, 256, (90, 420, 3), dtype=np.uint8)


def test_400_cards_stay_below_5_megabytes_and_load_nothing(tmp_path: Path) -> None:
    cards = [
        card(f"{i}.jpg", (i * 37 % 400) / 400, picture, overlay=f"overlays/{i}.png")
        for i, picture in enumerate(noise_pictures(400))
    ]
    shown = write_gallery(tmp_path / "gallery.html", cards, summary_of(animals=400, kept=400))
    text = (tmp_path / "gallery.html").read_text()
    page = Page(text)
    assert len(text.encode()) < 5_000_000
    assert shown == len(page.titles) == 400
    assert len(page.loads) == 400
    assert all(load.startswith("data:image/jpeg;base64,") for load in page.loads)
    assert "http" not in text
    assert "@import" not in text
    assert "url(" not in text


def test_a_card_holds_its_picture_small_enough_for_a_long_run() -> None:
    photo = np.asarray(Image.fromarray(next(noise_pictures(1))).resize((4000, 3000)))
    held = card_picture(photo)
    assert len(held) < photo.nbytes / 500  # 12 000 of them in half a gigabyte
    with Image.open(io.BytesIO(held)) as image:
        assert (image.format, image.size) == ("JPEG", (420, 315))


def test_cards_that_do_not_fit_are_the_best_ones_and_the_page_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("animal3dbox.report.gallery.MAX_BYTES", 30_000)
    cards = [card(f"{i}.jpg", i / 40, picture) for i, picture in enumerate(noise_pictures(40))]
    shown = write_gallery(tmp_path / "gallery.html", cards[::-1], summary_of())
    text = (tmp_path / "gallery.html").read_text()
    assert 0 < shown < 40
    assert Page(text).titles == [f"{i}.jpg" for i in range(shown)]
    assert f"The {shown} worst of 40 animals are shown" in text


def test_the_worst_come_first_and_rejected_ones_before_all(tmp_path: Path) -> None:
    cards = [
        card("good", 0.9),
        card("poor", 0.1),
        card("refused", -1, status="rejected"),
        card("middling", 0.5, status="flagged"),
    ]
    write_gallery(tmp_path / "gallery.html", cards, summary_of())
    assert Page((tmp_path / "gallery.html").read_text()).titles == [
        "refused",
        "poor",
        "middling",
        "good",
    ]


def test_names_cannot_put_tags_or_placeholders_into_the_page(tmp_path: Path) -> None:
    evil = '"><script>alert(1)</script><img src=x onerror=alert(1)>$source ${cards}'
    picture = card_picture(np.zeros((4, 4, 3), dtype=np.uint8))
    spoilt = Card(evil, picture, "kept", 0.5, None, None, (evil,), f"overlays/{evil}.png")
    write_gallery(
        tmp_path / "gallery.html",
        [spoilt],
        summary_of(source=evil, body=evil, reasons={evil: 1}, flags={evil: 2}),
    )
    text = (tmp_path / "gallery.html").read_text()
    page = Page(text)
    assert page.tags.count("script") == 1  # the page's own
    assert page.tags.count("img") == 1
    assert page.titles == [evil]
    assert "<script>alert" not in text


def test_the_funnel_shows_every_count(tmp_path: Path) -> None:
    summary = summary_of(
        animals=9,
        kept=4,
        flagged=2,
        rejected=2,
        faulty=1,
        flags={"truncated": 2},
        reasons={"no_axes": 2},
    )
    write_gallery(tmp_path / "gallery.html", [], summary)
    text = (tmp_path / "gallery.html").read_text()
    rows = re.findall(r"<tr><th>(.*?)</th><td>(\d+)</td>", text)
    assert rows == [
        ("animals", "9"),
        ("kept", "4"),
        ("flagged", "2"),
        ("· truncated", "2"),
        ("rejected", "2"),
        ("· no_axes", "2"),
        ("faulty", "1"),
    ]


# A whole run
# --------------------------------------------------------------------------------------------------


def run(out: Path, results: Sequence[Labelled | SampleError]) -> Summary:
    return write_run(out, results, source="set", body="toy", config=LabelConfig())


def kept(label: CuboidLabel, image: str, sample_id: str | None = None) -> Labelled:
    return Labelled(replace(label, sample_id=sample_id or image), image, "dog", GREY)


def test_a_run_leaves_all_its_files_and_the_counts(tmp_path: Path, label: CuboidLabel) -> None:
    refused = Labelled(Rejection("b.jpg", "no_axes", "no landmarks"), "b.jpg", "dog", GREY)
    summary = run(
        tmp_path / "out",
        [kept(label, "a.jpg"), SampleError("c.jpg", "seg", "is an empty mask"), refused],
    )
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == [
        ".label-pictures",
        "gallery.html",
        "labels.csv",
        "labels.json",
        "overlays",
        "report.json",
    ]
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert report == msgspec.to_builtins(summary)
    assert [report[key] for key in ("animals", "kept", "flagged", "rejected", "faulty")] == [
        3,
        1,
        0,
        1,
        1,
    ]
    assert report["faults"] == [
        {"sample_id": "c.jpg", "field": "seg", "problem": "is an empty mask"}
    ]
    read = read_labels_json(tmp_path / "out" / "labels.json")
    assert [(row.image, row.reason, row.detail) for row in read.rejected] == [
        ("b.jpg", "no_axes", "no landmarks")
    ]
    assert read.config == msgspec.to_builtins(LabelConfig())
    assert Page((tmp_path / "out" / "gallery.html").read_text()).titles == ["b.jpg", "a.jpg"]


def test_every_label_has_an_overlay_of_its_own_that_its_card_leads_to(
    tmp_path: Path, label: CuboidLabel
) -> None:
    images = [
        "dog/a.jpg",
        "dog_a.jpg",
        "dog/a.png",
        "DOG/a.jpg",
        "собака.jpg",
        "犬.jpg",
        "<script>.jpg",
        "x" * 300 + ".jpg",
        "a.b/c",
        "...",
    ]
    results = [*(kept(label, image) for image in images), kept(label, "dog/a.jpg", "dog/a.jpg#1")]
    run(tmp_path, results)
    links = [link for link in Page((tmp_path / "gallery.html").read_text()).links if link]
    files = {f"overlays/{path.name}" for path in (tmp_path / "overlays").iterdir()}
    assert len({link.lower() for link in links}) == len(results)
    assert set(links) == files
    assert np.array_equal(np.asarray(Image.open(tmp_path / links[0])), draw_label(GREY, label))


@pytest.mark.parametrize(
    ("image_id", "number", "name"),
    [
        ("dog/a.jpg", 0, "dog_a.png"),
        ("dog/a.jpg", 2, "dog_a-2.png"),
        ("a.b/c", 0, "a.b_c.png"),
        ("../../etc/x", 0, "etc_x.png"),
        ("犬.jpg", 0, "image.png"),
    ],
)
def test_an_overlays_name_is_plain(image_id: str, number: int, name: str) -> None:
    assert overlay_name(image_id, number, set()) == name


def test_a_name_that_is_taken_is_not_given_again() -> None:
    taken: set[str] = set()
    assert [overlay_name(image, 0, taken) for image in ("a/b.jpg", "a_b.jpg", "A/b.png")] == [
        "a_b.png",
        "a_b_2.png",
        "A_b_3.png",
    ]


def test_an_animal_keeps_its_number_when_its_neighbour_is_faulty(
    tmp_path: Path, label: CuboidLabel
) -> None:
    run(
        tmp_path,
        [
            SampleError("a.jpg", "joints", "bad"),
            kept(label, "a.jpg", "a.jpg#1"),
            kept(label, "a.jpg", "a.jpg#2"),
        ],
    )
    rows = read_labels_json(tmp_path / "labels.json").animals
    assert [(row.sample_id, row.animal) for row in rows] == [("a.jpg#1", 1), ("a.jpg#2", 2)]


def test_animals_without_a_name_are_counted_by_image(tmp_path: Path, label: CuboidLabel) -> None:
    nameless = Labelled(replace(label, sample_id=None), "a.jpg", "dog", GREY)
    run(tmp_path, [nameless, nameless])
    assert [row.sample_id for row in read_labels_json(tmp_path / "labels.json").animals] == [
        "a.jpg#0",
        "a.jpg#1",
    ]


def test_a_second_run_writes_the_same_bytes(tmp_path: Path, label: CuboidLabel) -> None:
    contents = []
    for _ in range(2):
        run(tmp_path, [kept(label, "a.jpg"), kept(label, "b.jpg")])
        contents.append(
            {
                p.relative_to(tmp_path): p.read_bytes()
                for p in sorted(tmp_path.rglob("*"))
                if p.is_file()
            }
        )
    assert contents[0] == contents[1]
    assert len(contents[0]) == 7


@pytest.mark.parametrize("resume", [False, True])
def test_overlays_of_a_killed_run_stay_with_their_rows_alone(
    tmp_path: Path, label: CuboidLabel, resume: bool
) -> None:
    def writer(*, resume: bool) -> RunWriter:
        return RunWriter(tmp_path, source="set", body="toy", config=LabelConfig(), resume=resume)

    run(tmp_path, [kept(label, "old.jpg"), kept(label, "a.jpg")])
    with writer(resume=False) as killed:
        killed.add([drawn_animal(kept(label, name), 0, key=name) for name in ("a.jpg", "b.jpg")])
    (tmp_path / "overlays" / "mine.png").write_bytes(b"a user's")
    with writer(resume=resume) as last:
        assert last.known_keys == ({"a.jpg", "b.jpg"} if resume else set())
        last.add([drawn_animal(kept(label, "c.jpg"), 0, key="c", pictures="none")])
    last.finish()
    stay = {"a.png", "b.png"} if resume else set()
    assert {path.name for path in (tmp_path / "overlays").iterdir()} == {"mine.png", *stay}


def test_a_run_without_animals_says_so(tmp_path: Path) -> None:
    summary = run(tmp_path, [])
    assert (summary.animals, summary.median_mask_iou) == (0, None)
    assert read_labels_json(tmp_path / "labels.json").animals == []


def test_a_folder_that_cannot_be_made_is_a_usage_error(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    for out in (tmp_path / "file", tmp_path / "file" / "below"):
        with pytest.raises(ConfigError, match="cannot be made") as caught:
            run(out, [])
        assert str(out) in str(caught.value)
    assert issubclass(ConfigError, Animal3DBoxError)


def test_a_very_high_or_flat_picture_of_a_rejected_animal_stops_nothing(tmp_path: Path) -> None:
    strips = [np.zeros(size, dtype=np.uint8) for size in ((70_000, 40, 3), (1, 5000, 3))]
    results: list[Labelled | SampleError] = [
        Labelled(Rejection(f"{i}", "no_axes", ""), f"{i}", "dog", strip)
        for i, strip in enumerate(strips)
    ]
    assert run(tmp_path, results).rejected == 2
    assert len(Page((tmp_path / "gallery.html").read_text()).loads) == 2
