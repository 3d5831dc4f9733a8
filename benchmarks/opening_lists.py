"""How long Omni3D, StanfordExtra and Animal3D files take to open, of which no index is kept.

Makes a file of so many animals by writing a small dataset and repeating its elements under other
names and ids, each with a picture where the format looks for one; then opens it in fresh processes,
as a whole and for one shard of a thousand, and prints processor seconds and peak memory of each.

Run: python benchmarks/opening_lists.py /tmp/opening stanfordextra --animals 12000
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec

MOST_LINKS = 10_000
"""Names that one file gets, as file systems limit them."""


def link(original: Path, path: Path, number: int) -> None:
    """Give a file one more name; a copy from time to time, where it has enough of them."""
    path.parent.mkdir(parents=True, exist_ok=True)
    source = original.with_name(f"{original.stem}-{number // MOST_LINKS}{original.suffix}")
    if not source.exists():
        source.write_bytes(original.read_bytes())
    os.link(source, path)


def write_omni3d_file(folder: Path, animals: int) -> Path:
    """Two boxes an image; no pictures, which the format does without."""
    import numpy as np

    from animal3dbox.datasets import CuboidRecord, CuboidSet, write_omni3d

    K = np.array([[500.0, 0, 319.5], [0, 500, 239.5], [0, 0, 1]])
    R = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])
    records = [
        CuboidRecord(
            *("a.jpg" if k == 0 else f"a.jpg#{k}", "a.jpg", None, (480, 640), "dog", K),
            center=np.array([x, 0.2, 6.0]),
            rotation=R,
            size=np.array([0.9, 0.3, 0.6]),
        )
        for k, x in enumerate((-0.7, 0.8))
    ]
    small, file = folder / "small.json", folder / f"omni3d-{animals}.json"
    write_omni3d(CuboidSet("dogs", tuple(records), ()), small, scale_free=True)
    content = json.loads(small.read_text())
    (image,), boxes = content["images"], content["annotations"]
    content["images"] = [
        {**image, "id": number, "file_path": f"{number // 1000:04d}/{number:07d}.jpg"}
        for number in range(animals // 2)
    ]
    content["annotations"] = [
        {**boxes[number % 2], "id": number, "image_id": number // 2}
        for number in range(animals // 2 * 2)
    ]
    file.write_bytes(msgspec.json.encode(content))
    return file


def write_stanfordextra_file(folder: Path, animals: int) -> Path:
    """One dog an image, with its mask."""
    from animal3dbox.datasets.synthetic import SyntheticSet, WorldConfig, write_stanfordextra
    from animal3dbox.smal.keypoints.vocabularies import VOCABULARIES

    root, small = folder / f"stanfordextra-{animals}", folder / "small-stanfordextra"
    if not small.exists():
        world = replace(WorldConfig(), vocabulary=VOCABULARIES["stanfordextra24"])
        write_stanfordextra(SyntheticSet(0, 8, world), small)
    first: dict[str, dict[str, Any]] = {}
    for entry in json.loads((small / "annotations.json").read_text()):
        first.setdefault(entry["img_path"], entry)
    templates, entries = [*first.values()], []
    for number in range(animals):
        template = templates[number % len(templates)]
        name = f"{number // 1000:04d}/{number:07d}.jpg"
        link(small / "images" / template["img_path"], root / "images" / name, number)
        entries.append({**template, "img_path": name})
    (root / "annotations.json").write_bytes(msgspec.json.encode(entries))
    return root / "annotations.json"


def write_animal3d_file(folder: Path, animals: int) -> Path:
    """One animal an image, with its mask and body."""
    from animal3dbox.datasets.synthetic import SyntheticSet, WorldConfig, write_animal3d
    from animal3dbox.datasets.synthetic.synthetic_set import animal3d_world

    root, small = folder / f"animal3d-{animals}", folder / "small-animal3d"
    if not small.exists():
        pictures = SyntheticSet(0, 8, animal3d_world(WorldConfig()))
        write_animal3d(pictures, small, folder / "model.pkl")
    content = json.loads((small / "train.json").read_text())
    templates, entries = content["data"], []
    paths = [key for key in templates[0] if key.endswith("_path")]
    for number in range(animals):
        entry = dict(templates[number % len(templates)])
        for key in paths:
            old = Path(entry[key])
            entry[key] = (old.parent / f"{number:07d}{old.suffix}").as_posix()
            if (small / old).is_file() and not (root / entry[key]).exists():
                link(small / old, root / entry[key], number)
        entries.append(entry)
    (root / "train.json").write_bytes(msgspec.json.encode({**content, "data": entries}))
    (root / "test.json").write_bytes(msgspec.json.encode({**content, "data": []}))
    return root


WRITERS: dict[str, Callable[[Path, int], Path]] = {
    "omni3d": write_omni3d_file,
    "stanfordextra": write_stanfordextra_file,
    "animal3d": write_animal3d_file,
}


def opened(format: str, path: Path) -> Any:
    """The Dataset of a file."""
    from animal3dbox.datasets import Animal3DDataset, Omni3DDataset, StanfordExtraDataset

    if format == "omni3d":
        return Omni3DDataset(path, on_bad="skip")
    if format == "stanfordextra":
        return StanfordExtraDataset(path, body="dog", on_bad="skip")
    return Animal3DDataset(path, path.parent / "model.pkl", on_bad="skip")


def measure(format: str, path: Path, *, shard: bool) -> None:
    """Open in this process, plan a shard's rows if asked for, and print what it cost as JSON."""
    import animal3dbox.datasets
    from animal3dbox.report import table_plan

    _ = animal3dbox.datasets.StanfordExtraDataset
    begin = time.process_time()
    dataset = opened(format, path)
    opening = time.process_time()
    rows = len(dataset)
    if shard:
        rows = len([*table_plan(dataset, path.with_name("nowhere"), shard=(1, 1000)).indices])
        for index in range(0, len(dataset), 1000):
            _ = dataset.source.sample(index).records
    end = time.process_time()
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    content = {"open": opening - begin, "shard": end - opening, "peak": peak, "rows": rows}
    print(json.dumps({**content, "faults": len(dataset.source.faults)}))


def main() -> None:
    """Make the file, and measure its openings."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("format", choices=[*WRITERS])
    parser.add_argument("--animals", type=int, default=3400)
    parser.add_argument("--measure", choices=["whole", "shard"], help="for its own processes")
    options = parser.parse_args()
    if options.measure:
        measure(options.format, options.folder, shard=options.measure == "shard")
        return
    options.folder.mkdir(parents=True, exist_ok=True)
    path = WRITERS[options.format](options.folder, options.animals)
    file = path if path.is_file() else path / "train.json"
    print(f"{options.format}: {options.animals} animals, {file.stat().st_size / 1e6:.0f} MB")
    for name in ("whole", "shard"):
        ran = subprocess.run(
            [sys.executable, __file__, str(path), options.format, "--measure", name],
            capture_output=True,
            text=True,
            check=False,
            env={**os.environ, "OMP_NUM_THREADS": "1"},
        )
        if ran.returncode:
            sys.exit(ran.stderr)
        result = json.loads(ran.stdout.splitlines()[-1])
        print(
            f"{name:>6}: open {result['open']:.2f} s CPU, shard {result['shard']:.2f} s, peak"
            f" {result['peak']:.0f} MB, {result['rows']} images, {result['faults']} faults",
            flush=True,
        )


if __name__ == "__main__":
    main()
