"""The commands of ``animal3dbox`` and the files that they write, for the golden record."""

import contextlib
import io
import json
import runpy
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from unittest.mock import patch

from golden_names import OPTIONS
from golden_values import GoldenValues

USAGE = 2
"""The exit code of a command that does not know an option."""


@dataclass(frozen=True)
class CommandAnswer:
    """What a command gave back.

    Attributes:
        code: its exit code.
        said: what it printed.
        noted: what it said beside that, without bars of progress.
    """

    code: int
    said: str
    noted: list[str]


def command(*words: str | Path, expected: Sequence[int] = (0,)) -> CommandAnswer:
    """Run a command in this process, under the new names of its options or else the old ones.

    Raises:
        RuntimeError: it ended with another code than expected.

    """
    old = [str(word) for word in words]
    new = [OPTIONS.get(word, word) for word in old]
    answer = _run(new)
    if answer.code == USAGE and new != old:
        answer = _run(old)
    if answer.code not in expected:
        said = f"{answer.said} {answer.noted}"
        raise RuntimeError(f"{' '.join(new)} ended with {answer.code}: {said}")
    return answer


def _run(words: list[str]) -> CommandAnswer:
    out, err = io.StringIO(), io.StringIO()
    code: object = 0
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            with patch.object(sys, "argv", ["animal3dbox", *words]):
                runpy.run_module("animal3dbox", run_name="__main__")
        except SystemExit as left:
            code = left.code
    lines = err.getvalue().replace("\r", "\n").splitlines()
    noted = [line for line in lines if line.strip() and "it/s" not in line and "%|" not in line]
    number = code if isinstance(code, int) else int(code is not None)
    return CommandAnswer(number, out.getvalue(), noted)


def add_answer(values: GoldenValues, name: str, answer: CommandAnswer) -> None:
    """Record what a command printed as JSON, its notes and its exit code."""
    values.add(f"{name}/code", answer.code)
    values.add(f"{name}/printed", json.loads(answer.said))
    values.add(f"{name}/noted", answer.noted)


def record_commands(values: GoldenValues, inputs: Path, scratch: Path) -> None:
    """Record what every command prints and writes."""
    for section in (_labels, _caches, _exports, _synths, _inspections, _checks, _studies):
        with values.section(f"commands {section.__name__.strip('_')}"):
            section(values, inputs, scratch)


def add_label_folder(values: GoldenValues, name: str, folder: Path) -> None:
    """Record the files of a folder of ``label`` or ``demo``; the gallery's page does not count."""
    for file in ("labels.json", "report.json"):
        values.add_json(f"{name}/{file}", folder / file)
    values.add_csv(f"{name}/labels.csv", folder / "labels.csv")
    for path in sorted((folder / "overlays").iterdir()):
        values.add_picture(f"{name}/overlays/{path.name}", path)


def _labels(values: GoldenValues, inputs: Path, scratch: Path) -> None:
    model = ("--model", inputs / "animals-model.pkl")
    paper = ("--method", "paper", "--residual", "literal", "--axes", "landmarks")
    jobs: dict[str, tuple[str | Path, ...]] = {
        "animals": (inputs / "animals", *model),
        "animals-known": (inputs / "animals", *model, "--stored-pose", "exact", "--tail", "drop"),
        "dogs": (inputs / "dogs", "--body", "dog", "--species-scale"),
        "dogs-paper": (inputs / "dogs", *paper, "--focal-px", "400", "--metres-per-unit", "0.8"),
        "coco": (inputs / "coco", "--method", "basic", "--axes", "pca", "--altitude-m", "12"),
        "deeplabcut": (inputs / "deeplabcut", "--min-keypoints", "8"),
        "meshes": (inputs / "meshes_cameras",),
        "faulty": (inputs / "faulty_dogs",),
    }
    for name, words in jobs.items():
        out = scratch / f"label-{name}"
        answer = command("label", *words, "--out", out, "--json", expected=(0, 4))
        add_answer(values, f"label/{name}", answer)
        add_label_folder(values, f"label/{name}", out)


def _caches(values: GoldenValues, inputs: Path, scratch: Path) -> None:
    whole = ("label", inputs / "animals", "--model", inputs / "animals-model.pkl", "--json")
    known = ("--stored-pose", "exact", "--mask-iou")
    jobs: dict[str, tuple[str | Path, ...]] = {
        "shard": (*whole, *known, "--cache", scratch / "filled", "--shard", "1/2"),
        "resumed": (*whole, *known, "--cache", scratch / "filled", "--resume"),
        "faulty": ("label", inputs / "faulty_dogs", "--json", "--cache", scratch / "filled-dogs"),
    }
    for name, words in jobs.items():
        add_answer(values, f"fill/{name}", command(*words, expected=(0, 4)))


def _exports(values: GoldenValues, inputs: Path, scratch: Path) -> None:
    sources: dict[str, tuple[str | Path, ...]] = {
        "labels": (inputs / "labels", "--metres-per-unit", "0.9"),
        "free": (inputs / "labels", "--scale-free"),
        "foreign": (inputs / "things" / "things.json",),
    }
    for name, words in sources.items():
        for form in ("omni3d", "coco", "kitti"):
            out = scratch / f"export-{name}-{form}"
            answer = command("export", *words, "--to", form, "--out", out, expected=(0, 4))
            values.add(f"export/{name}/{form}/code", answer.code)
            values.add(f"export/{name}/{form}/said", answer.said.splitlines())
            values.add(f"export/{name}/{form}/noted", answer.noted)
            for path in sorted(path for path in out.rglob("*") if path.is_file()):
                _add_file(values, f"export/{name}/{form}/{path.relative_to(out)}", path)


def _add_file(values: GoldenValues, name: str, path: Path) -> None:
    """Record a JSON by its leaves, a text by its lines, anything else by its bytes."""
    if path.suffix == ".json":
        values.add_json(name, path)
    elif path.suffix in (".txt", ".toml"):
        values.add(name, path.read_text().splitlines())
    else:
        values.add_bytes(name, path)


def _synths(values: GoldenValues, inputs: Path, scratch: Path) -> None:
    size = ("--n", "5", "--width", "160", "--height", "120")
    faults = ("--noise-px", "2", "--outliers", "0.1", "--swap", "legs", "--mask-px", "-2")
    fits = ("--missing", "0.1", "--joint-deg", "3", "--body-scale", "1.1", "--focal-factor", "0.9")
    jobs: dict[str, tuple[str, ...]] = {
        "animal3d": (*size, "--seed", "21", *faults, *fits),
        "stanfordextra": (*size, "--seed", "22", "--format", "stanfordextra", "--mark-hidden"),
    }
    for name, words in jobs.items():
        out = scratch / f"synth-{name}"
        command("synth", "--out", out, *words)
        for path in sorted(path for path in out.rglob("*") if path.is_file()):
            _add_file(values, f"synth/{name}/{path.relative_to(out)}", path)
    values.add_bytes("synth/model", scratch / "synth-animal3d-model.pkl")


def _inspections(values: GoldenValues, inputs: Path, scratch: Path) -> None:
    model = ("--model", inputs / "animals-model.pkl")
    jobs: dict[str, tuple[str | Path, ...]] = {
        "animals": (inputs / "animals", *model),
        "animals-bare": (inputs / "animals",),
        **{name: (inputs / name,) for name in ("dogs", "coco", "deeplabcut")},
        **{name: (inputs / name,) for name in ("meshes_cameras", "meshes_keypoints")},
        **{name: (inputs / name,) for name in ("faulty_dogs", "faulty_coco", "faulty_animals")},
    }
    for name, words in jobs.items():
        answer = command("inspect", *words, "--json", expected=(0, 4))
        add_answer(values, f"inspect/{name}", answer)


def _checks(values: GoldenValues, inputs: Path, scratch: Path) -> None:
    model = ("--model", inputs / "animals-model.pkl")
    jobs: dict[str, tuple[str | Path, ...]] = {
        "labels": (inputs / "labels",),
        "spoilt-labels": (inputs / "spoilt_labels",),
        "things": (inputs / "things" / "things.json",),
        "animals": (inputs / "animals", *model, "--stored-pose", "exact"),
        "faulty": (inputs / "faulty_coco",),
    }
    for name, words in jobs.items():
        add_answer(values, f"check/{name}", command("check", *words, "--json", expected=(0, 4)))


def _studies(values: GoldenValues, inputs: Path, scratch: Path) -> None:
    """Record the evaluations' tables and the demonstration."""
    model = ("--model", inputs / "animals-model.pkl")
    jobs: dict[str, tuple[str | Path, ...]] = {
        "world": ("--n", "3", "--seed", "5", "--no-pictures"),
        "animals": (inputs / "animals", *model),
        "dogs": (inputs / "dogs",),
    }
    for name, words in jobs.items():
        out = scratch / f"evaluate-{name}"
        command("evaluate", *words, "--workers", "1", "--out", out, expected=(0, 4))
        values.add_json(f"evaluate/{name}", out / "evaluation.json")
        values.add(f"evaluate/{name}/text", (out / "evaluation.txt").read_text().splitlines())
    out = scratch / "demo"
    answer = command("demo", "--n", "3", "--seed", "6", "--out", out, "--rigid", "--json")
    add_answer(values, "demo", answer)
    add_label_folder(values, "demo", out)
    values.add_json("demo/demo.json", out / "demo.json")
