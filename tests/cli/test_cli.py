"""The command line, end to end.

A dataset with every fault in it, wrong usage, and what is left on disk.
"""

import contextlib
import csv
import io
import json
import re
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
import tyro
from photo_dataset import (
    FAULTS,
    HW,
    WORDS,
    Entry,
    Scene,
    Spoilt,
    View,
    add_fault,
    add_photo,
    toy_scene,
    view_of,
    write_annotations,
)

from animal3dbox.cli.jobs import COMMANDS
from animal3dbox.cli.main import main
from animal3dbox.cli.options import FaultOptions, Format, Metric, StoredCamera, Swap
from animal3dbox.datasets.bodies.sources import preset_body
from animal3dbox.datasets.cuboid_formats import CUBOID_READERS
from animal3dbox.datasets.formats import FORMATS
from animal3dbox.datasets.labelling.label_records import CameraPolicy
from animal3dbox.datasets.readers.cuboid_checks import Metric as ReaderMetric
from animal3dbox.datasets.records import AnimalRecord
from animal3dbox.datasets.synthetic import faults
from animal3dbox.report.label_files import AnimalRow
from animal3dbox.report.label_reading import read_labels_json
from animal3dbox.report.run import overlay_name

SIDES = {"left.jpg": (95, "left"), "right.jpg": (-80, "right"), "back.jpg": (185, "back")}


@dataclass(frozen=True)
class CommandResult:
    """The exit code and the output of a command."""

    code: int
    stdout: str
    stderr: str


def ran(*arguments: str | Path) -> CommandResult:
    """Run a command in this process."""
    out, err = io.StringIO(), io.StringIO()
    with (
        pytest.raises(SystemExit) as left,
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
    ):
        main([str(a) for a in arguments])
    code = left.value.code
    return CommandResult(
        code if isinstance(code, int) else 0 if code is None else 1, out.getvalue(), err.getvalue()
    )


def dog_scene() -> Scene:
    """The embedded dog, which the command labels with unless told otherwise."""
    body = preset_body("dog").body(
        AnimalRecord("", "", Path(), HW, WORDS, np.zeros((24, 3)), None, "dog")
    )
    return Scene(body.vertices, body.faces, body.landmarks)


@pytest.fixture(scope="module")
def views() -> dict[str, View]:
    scene = dog_scene()
    return {name: view_of(scene, azimuth) for name, (azimuth, _) in SIDES.items()}


@dataclass(frozen=True)
class Faulty:
    """A run over a dataset that has three good animals and everything else."""

    root: Path
    out: Path
    ran: CommandResult
    report: dict[str, Any]
    spoilt: dict[str, Spoilt]


def few(entry: Entry, visible: int) -> Entry:
    """Only the first so many joints are seen."""
    return {
        **entry,
        "joints": [[x, y, v if i < visible else 0] for i, (x, y, v) in enumerate(entry["joints"])],
    }


def at_zero(entry: Entry) -> Entry:
    """Every joint at (0, 0), and said to be seen."""
    return {**entry, "joints": [[0, 0, 1]] * 24}


@pytest.fixture(scope="module")
def faulty(tmp_path_factory: pytest.TempPathFactory, views: dict[str, View]) -> Faulty:
    root = tmp_path_factory.mktemp("faulty") / "set"
    spoilt = {name: add_fault(root, views["left.jpg"], name) for name in FAULTS}
    good = [add_photo(root, view, name) for name, view in views.items()]
    refused = [
        few(add_photo(root, views["left.jpg"], "few.jpg"), 5),
        at_zero(add_photo(root, views["left.jpg"], "zero.jpg")),
    ]
    bad = [s.entry for s in spoilt.values()]
    write_annotations(
        root,
        [
            good[0],
            *bad[: len(bad) // 2],
            good[1],
            *bad[len(bad) // 2 :],
            *refused,
            good[1],
            good[2],
        ],
    )
    result = ran("label", root, "--out", root / "out", "--optional", "fault", "--json")
    return Faulty(
        root, root / "out", result, json.loads((root / "out" / "report.json").read_text()), spoilt
    )


# A dataset with every fault in it
# -------------------------------------------------------------------------------------


def test_faults_end_with_their_own_exit_code(faulty: Faulty) -> None:
    assert faulty.ran.code == 4


@pytest.mark.parametrize("name", list(FAULTS))
def test_the_report_names_each_faulty_sample_with_field_and_reason(
    faulty: Faulty, name: str
) -> None:
    fault = FAULTS[name]
    expected = (
        f"entry {list(FAULTS).index(name) + 1 + (list(FAULTS).index(name) >= len(FAULTS) // 2)}"
        if fault.sample == "entry "
        else None
    )
    rows = [
        row
        for row in faulty.report["faults"]
        if row["sample_id"] == (expected or faulty.spoilt[name].sample_id)
    ]
    assert len(rows) == 1
    assert fault.field in rows[0]["field"]
    assert fault.reason in rows[0]["problem"]


def test_the_run_goes_on_past_every_fault_and_labels_the_others(faulty: Faulty) -> None:
    assert {
        row.image: row.side for row in read_labels_json(faulty.out / "labels.json").animals
    } == {name: side for name, (_, side) in SIDES.items()}


def test_every_animal_of_the_input_is_counted_once(faulty: Faulty) -> None:
    counts = {key: faulty.report[key] for key in ("animals", "rejected", "faulty")}
    assert counts == {
        "animals": 3 + 2 + len(FAULTS) + 1,
        "rejected": 2,
        "faulty": len(FAULTS) + 1,
    }  # and one that comes twice
    assert faulty.report["kept"] + faulty.report["flagged"] == 3
    assert len(faulty.report["faults"]) == faulty.report["faulty"]


def test_an_entry_that_comes_twice_is_labelled_once_and_reported(faulty: Faulty) -> None:
    (row,) = [row for row in faulty.report["faults"] if row["sample_id"] == "right.jpg#1"]
    assert "once more; remove one" in row["problem"]


@pytest.mark.parametrize(
    ("name", "detail"),
    [
        ("few.jpg", "5 visible keypoints, but min_keypoints is 6"),
        ("zero.jpg", "0 visible keypoints"),
    ],
)
def test_too_few_keypoints_are_a_rejection_and_no_fault(
    faulty: Faulty, name: str, detail: str
) -> None:
    assert faulty.report["reasons"] == {"too_few_keypoints": 2}
    (row,) = [
        row for row in read_labels_json(faulty.out / "labels.json").rejected if row.image == name
    ]
    assert (row.sample_id, row.animal, row.reason) == (name, 0, "too_few_keypoints")
    assert detail in row.detail


def test_json_prints_the_report_and_nothing_else(faulty: Faulty) -> None:
    assert faulty.ran.stdout.count("\n") == 1
    assert json.loads(faulty.ran.stdout) == faulty.report
    assert faulty.ran.stderr == ""


# A good dataset
# -------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory, views: dict[str, View]) -> Path:
    """A dataset without a fault; one dog's path would be markup."""
    root = tmp_path_factory.mktemp("good") / "set"
    entries = [add_photo(root, view, name) for name, view in views.items()]
    entries.append(add_photo(root, views["left.jpg"], "<script>alert(1)<&.jpg"))
    entries.append({**add_photo(root, views["back.jpg"], "two.jpg"), "seg": None})
    other = {**entries[-1], "is_multiple_dogs": True}
    other["joints"] = [[x + 4 * bool(v), y, v] for x, y, v in other["joints"]]
    entries.append(other)
    write_annotations(root, entries)
    assert ran("label", root, "--out", root / "out").code == 0
    return root


def rows_of(root: Path) -> list[AnimalRow]:
    return read_labels_json(root / "out" / "labels.json").animals


def no_constants(name: str) -> None:
    raise AssertionError(f"{name} in a JSON file")


def test_labels_json_reads_back_in_its_schema_without_nan(good: Path) -> None:
    assert len(rows_of(good)) == 6
    for name in ("labels.json", "report.json"):
        json.loads((good / "out" / name).read_text(), parse_constant=no_constants)


def test_known_bodies_are_labelled_with_the_side_the_camera_sees(good: Path) -> None:
    for row in rows_of(good)[:3]:
        azimuth, side = SIDES[row.image]
        assert row.side == side
        assert abs((row.azimuth_deg - azimuth + 180) % 360 - 180) < 3
        # Exact keypoints, and a mask of whole pixels that is trusted to about one.
        assert float(str(row.quality["reprojection_error_px"])) < 0.7
        assert float(str(row.quality["mask_iou"])) > 0.95


def test_two_animals_of_one_image_have_numbers_and_overlays_of_their_own(good: Path) -> None:
    assert [(row.sample_id, row.animal) for row in rows_of(good)[4:]] == [
        ("two.jpg", 0),
        ("two.jpg#1", 1),
    ]
    assert {"two.png", "two-1.png"} <= {path.name for path in (good / "out" / "overlays").iterdir()}


def test_there_is_an_overlay_for_each_label(good: Path) -> None:
    names_so_far: set[str] = set()
    names = sorted(overlay_name(row.image, row.animal, names_so_far) for row in rows_of(good))
    assert sorted(path.name for path in (good / "out" / "overlays").iterdir()) == names
    assert all((good / "out" / "overlays" / name).stat().st_size > 1000 for name in names)


def test_labels_csv_has_a_row_an_animal_with_the_same_numbers(good: Path) -> None:
    with (good / "out" / "labels.csv").open(newline="", encoding="utf-8") as file:
        table = list(csv.DictReader(file))
    assert [(row["image"], row["animal"], row["side"], row["viewpoint"]) for row in table] == [
        (row.image, str(row.animal), row.side, row.viewpoint) for row in rows_of(good)
    ]
    assert all(
        float(written["share_left"]) == pytest.approx(row.face_share[2], abs=1e-4)
        and (written["flank"], written["category"]) == (row.flank, row.category)
        for written, row in zip(table, rows_of(good), strict=True)
    )


def test_the_gallery_escapes_names_and_loads_nothing(good: Path) -> None:
    text = (good / "out" / "gallery.html").read_text()
    assert "<script>alert" not in text
    assert "&lt;script&gt;alert(1)&lt;&amp;.jpg" in text
    assert "http" not in text
    assert text.count("<img ") == text.count('<img src="data:image/jpeg;base64,') == 6


def test_a_second_run_into_the_same_folder_changes_no_byte(good: Path) -> None:
    def contents() -> dict[Path, bytes]:
        return {
            path: path.read_bytes() for path in sorted((good / "out").rglob("*")) if path.is_file()
        }

    before = contents()
    assert ran("label", good, "--out", good / "out", "--format", "stanfordextra").code == 0
    after = contents()
    assert before.keys() == after.keys()
    assert [path for path in before if before[path] != after[path]] == []


def test_words_tell_the_counts_and_where_to_look(tmp_path: Path, views: dict[str, View]) -> None:
    view = views["left.jpg"]
    spoilt = {**add_photo(tmp_path, view, "b.jpg"), "img_width": 0}
    write_annotations(tmp_path, [few(add_photo(tmp_path, view, "a.jpg"), 5), spoilt])
    result = ran("label", tmp_path, "--out", tmp_path / "out")
    assert "2 animals: 0 kept, 0 flagged, 1 rejected, 1 faulty" in result.stdout
    assert "1 x too_few_keypoints" in result.stdout
    assert "faulty: b.jpg: img_width, img_height: must be positive" in result.stdout
    assert str(tmp_path / "out" / "gallery.html") in result.stdout


def test_min_keypoints_decides_what_is_rejected(tmp_path: Path, views: dict[str, View]) -> None:
    write_annotations(
        tmp_path, [{**few(add_photo(tmp_path, views["left.jpg"], "a.jpg"), 8), "seg": None}]
    )
    for least, rejected in ((8, 0), (9, 1)):
        report = json.loads(
            ran(
                "label",
                tmp_path,
                "--out",
                tmp_path / "out",
                "--min-keypoints",
                str(least),
                "--json",
            ).stdout
        )
        assert report["rejected"] == rejected


def test_a_mesh_of_another_topology_labels_a_dataset(tmp_path: Path) -> None:
    scene = toy_scene()
    here, marks = (
        scene.vertices[:, [0, 2, 1]],
        scene.landmarks[:, [0, 2, 1]],
    )  # y up, as modelling programs write it:
    here[:, 2], marks[:, 2] = -here[:, 2], -marks[:, 2]  # (x, z, -y)
    obj = ["mtllib toy.mtl", *(f"v {x!r} {y!r} {z!r}" for x, y, z in here.tolist()), "usemtl coat"]
    (tmp_path / "toy.obj").write_text(
        "\n".join([*obj, *(f"f {a} {b} {c}" for a, b, c in (scene.faces + 1).tolist())])
    )
    places = {
        name: {"point": mark}
        for name, mark in zip(WORDS.keypoints, marks.tolist(), strict=True)
        if np.isfinite(mark).all()
    }
    (tmp_path / "toy.json").write_text(json.dumps(places))
    write_annotations(
        tmp_path,
        [
            add_photo(tmp_path, view_of(scene, azimuth), name)
            for name, (azimuth, _) in SIDES.items()
        ],
    )
    result = ran(
        "label",
        tmp_path,
        "--out",
        tmp_path / "out",
        "--body",
        tmp_path / "toy.obj",
        "--landmarks",
        tmp_path / "toy.json",
        "--json",
    )
    assert result.code == 0
    assert json.loads(result.stdout)["body"] == "mesh:toy.obj"
    assert {row.image: row.side for row in rows_of(tmp_path)} == {
        name: side for name, (_, side) in SIDES.items()
    }


# Wrong usage
# -------------------------------------------------------------------------------------


@pytest.fixture
def small(tmp_path: Path, views: dict[str, View]) -> Path:
    """A dataset of one dog that is quickly rejected."""
    write_annotations(tmp_path, [few(add_photo(tmp_path, views["left.jpg"], "a.jpg"), 0)])
    (tmp_path / "file").touch()
    (tmp_path / "body.obj").write_text("no mesh")
    (tmp_path / "marks.json").write_text("{}")
    return tmp_path


@pytest.mark.parametrize(
    ("options", "code", "words"),
    [
        (["--body", "poodle"], 2, ["dog", "horse", "'poodle'"]),
        (["--body", "{}/body.obj"], 2, ["body.obj", "--landmarks"]),
        (["--body", "{}/body.glb", "--landmarks", "{}/marks.json"], 2, [".obj, .ply, .stl, .off"]),
        (["--body", "dog", "--landmarks", "{}/marks.json"], 2, [".obj", "horse"]),
        (
            ["--body", "{}/none.obj", "--landmarks", "{}/marks.json"],
            3,
            ["there is no file", "none.obj"],
        ),
        (
            ["--body", "{}/body.obj", "--landmarks", "{}/marks.json"],
            3,
            ["body.obj", "must have four vertices"],
        ),
        (["--min-keypoints", "3"], 2, ["min_keypoints must be at least 4", "got 3"]),
        (["--out", "{}/file"], 2, ["file is a file: give a folder"]),
        (["--out", "{}/file/below"], 2, ["file/below cannot be made"]),
        (["--images", "{}/nowhere"], 3, ["there is no folder of images", "nowhere"]),
    ],
)
def test_wrong_options_end_with_a_code_and_a_remedy(
    small: Path, options: list[str], code: int, words: list[str]
) -> None:
    arguments = [option.format(small) for option in options]
    result = ran(
        "label", small, *([] if "--out" in arguments else ["--out", str(small / "out")]), *arguments
    )
    assert result.code == code
    assert result.stderr.startswith("animal3dbox: ")
    assert all(word in result.stderr for word in words)
    assert result.stdout == ""
    assert not (small / "out").exists()


@pytest.mark.parametrize(
    "arguments",
    [
        ["label", "{}"],
        ["label", "--out", "x"],
        ["label", "{}", "--out", "x", "--format", "cocoa"],
        ["label", "{}", "--out", "x", "--method", "best"],
        ["lable"],
        [],
    ],
)
def test_arguments_that_make_no_command_end_with_the_code_for_usage(
    small: Path, arguments: list[str]
) -> None:
    assert ran(*(a.format(small) for a in arguments)).code == 2


def nothing(root: Path) -> None:
    (root / "annotations.json").unlink()


def removed(root: Path) -> None:
    nothing(root)
    root.rename(root.with_name("elsewhere"))


def holding(data: bytes) -> Callable[[Path], None]:
    def write(root: Path) -> None:
        (root / "annotations.json").write_bytes(data)

    return write


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (removed, "there is no file or folder"),
        (nothing, "is in no format that is known"),
        (holding(b""), "is empty"),
        (holding(b"path;width"), "is not valid JSON"),
        (holding(b'{"a": 1}'), "Expected `array`"),
        (holding(b"[[NaN]]"), "NaN, which JSON does not have"),
        (holding(b"[" * 50_000), "nested too deeply"),
    ],
    ids=["missing", "no_json", "empty", "csv", "no_list", "nan", "deep"],
)
@pytest.mark.parametrize("flags", [(), ("--json",)])
def test_an_input_that_cannot_be_read_ends_with_code_3_and_its_name(
    small: Path, spoil: Callable[[Path], None], words: str, flags: Sequence[str]
) -> None:
    root = small / "set"
    root.mkdir()
    write_annotations(root, [])
    spoil(root)
    result = ran("label", root, "--out", small / "out", *flags)
    assert result.code == 3
    assert str(root) in result.stderr
    assert words in result.stderr
    assert result.stdout == ""
    assert not (small / "out").exists()


# In a process of its own
# -------------------------------------------------------------------------------------


def alone(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, *map(str, arguments)], capture_output=True, text=True, check=False
    )


def test_help_answers_without_loading_torch() -> None:
    code = """
import linecache, sys
from animal3dbox.cli.jobs import COMMANDS
from animal3dbox.cli.main import main
from animal3dbox.cli.options import FaultOptions, Format, Metric, StoredCamera, Swap
try:
    main(sys.argv[1:])
except SystemExit as left:
    slow = ("torch", "cv2", "scipy", "trimesh", "kornia", "tqdm")
    heavy = [name for name in slow if name in sys.modules]
    heavy += [name for name in linecache.cache if name.endswith("typing.py")]  # its source was read
    sys.exit(f"loaded {heavy}" if heavy else left.code)
"""
    for arguments in (["--help"], ["label", "--help"]):
        result = alone("-c", code, *arguments)
        assert (result.returncode, result.stderr) == (0, "")
        assert "label" in result.stdout
    assert all(
        option in result.stdout
        for option in ("--body", "--landmarks", "--min-keypoints", "--images", "PATH")
    )


def test_the_module_can_be_run_and_leaves_no_traceback(small: Path) -> None:
    result = alone(
        "-W", "error", "-m", "animal3dbox", "label", small / "nowhere", "--out", small / "out"
    )
    assert result.returncode == 3
    assert result.stderr.splitlines() == [
        f"animal3dbox: there is no file or folder {small / 'nowhere'}"
    ]


def test_stdout_of_a_process_is_one_json(small: Path) -> None:
    result = alone(
        "-W", "error", "-m", "animal3dbox", "label", small, "--out", small / "out", "--json"
    )
    assert (result.returncode, result.stderr) == (4, "")  # no animal has a label
    assert json.loads(result.stdout)["reasons"] == {"too_few_keypoints": 1}


def test_the_options_name_exactly_the_formats_that_can_be_read() -> None:
    assert get_args(Format) == ("auto", *FORMATS, *CUBOID_READERS)


def test_the_options_name_exactly_the_choices_of_the_code_that_takes_them() -> None:
    assert get_args(StoredCamera) == get_args(CameraPolicy)
    assert get_args(Metric) == get_args(ReaderMetric)
    assert get_args(Swap) == get_args(faults.Swap)


BENCH_COMMANDS = ("make", "verify", "score", "baseline")


@pytest.mark.parametrize(
    "called", [*((name,) for name in COMMANDS), *(("bench", name) for name in BENCH_COMMANDS)]
)
def test_the_help_of_a_command_shows_an_example_that_it_parses(called: tuple[str, ...]) -> None:
    shown = ran(*called, "--help").stdout
    (example,) = re.findall(r"^Example: animal3dbox (.*(?:\n\S.*)*)$", shown, re.M)
    words, command = example.split(), called[0]
    assert tuple(words[: len(called)]) == called
    job = tyro.cli(COMMANDS[command], args=words[1:], config=(tyro.conf.OmitArgPrefixes,))
    assert isinstance(job, COMMANDS[command])  # type: ignore[arg-type]


def test_the_fault_options_are_the_faults_of_the_synthetic_world() -> None:
    assert FaultOptions().config() == faults.FaultConfig()
