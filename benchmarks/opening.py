"""How long a COCO keypoints file takes to open: the first time, later, and a shard of 100 images.

Makes the file (17 keypoints, no polygons; every fourth image has two animals) and, where asked,
pictures; then opens it in fresh processes, and prints CPU seconds and peak memory of each.

Then compares names, order and records with those of the plain reader, of 1,000 random images or,
with --whole, of all.

Run: python benchmarks/opening.py /tmp/opening --animals 1000000
     python benchmarks/opening.py /tmp/opening --animals 20000 --pictures 200
"""

import argparse
import json
import os
import random
import resource
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from PIL import Image

HW = (480, 640)
"""Height and width of every image."""
SHARD = 100
"""Images of the shard that is read."""
MOST_LINKS = 10_000
"""Names that one picture gets, as file systems limit them."""
NAMES = (
    *("Left Eye", "Right Eye", "Nose", "Neck", "Root of tail"),
    *("Left Shoulder", "Left Elbow", "Left Front Paw"),
    *("Right Shoulder", "Right Elbow", "Right Front Paw"),
    *("Left Hip", "Left Knee", "Left Back Paw", "Right Hip", "Right Knee", "Right Back Paw"),
)
"""The keypoints of AP-10K."""


def animals_of_image(image: int) -> int:
    """How many animals an image has, by its number."""
    return 2 if image % 4 == 0 else 1


def numbers_of_animals(animals: int) -> Iterator[tuple[int, int]]:
    """Image and number of each animal."""
    image = number = 0
    while number < animals:
        for _ in range(min(animals_of_image(image), animals - number)):
            yield image, number
            number += 1
        image += 1


def image_name(image: int) -> str:
    """The name of an image's file, a thousand in a folder."""
    return f"{image // 1000:04d}/{image:07d}.jpg"


def annotation(image: int, number: int, rng: np.random.Generator) -> dict[str, Any]:
    """An element of "annotations": an animal somewhere in its image."""
    points = rng.uniform((40, 40), (HW[1] - 40, HW[0] - 40), (len(NAMES), 2)).round(2)
    marks = rng.choice([0, 1, 2], len(NAMES), p=[0.1, 0.15, 0.75])
    keypoints = [
        value
        for (x, y), mark in zip(points.tolist(), marks.tolist(), strict=True)
        for value in ((x, y, mark) if mark else (0.0, 0.0, 0))
    ]
    low, high = points.min(0) - 10, points.max(0) + 10
    box = [round(value, 2) for value in (*low.tolist(), *(high - low).tolist())]
    return {
        "id": number,
        "image_id": image,
        "category_id": 1 + number % 3,
        "bbox": box,
        "area": round(box[2] * box[3], 2),
        "iscrowd": 0,
        "num_keypoints": int((marks > 0).sum()),
        "keypoints": keypoints,
    }


def write_annotations(file: Path, animals: int) -> int:
    """Write the file piece by piece; gives the number of its images."""
    rng = np.random.default_rng(0)
    images = 1 + max(image for image, _ in numbers_of_animals(animals))
    categories = [
        {"id": number, "name": name, "keypoints": list(NAMES)}
        for number, name in enumerate(("dog", "horse", "cow"), 1)
    ]
    with file.open("wb") as out:
        out.write(b'{"categories": ' + msgspec.json.encode(categories) + b', "images": [')
        for image in range(images):
            element = {"id": image, "file_name": image_name(image), "height": HW[0], "width": HW[1]}
            out.write((b",\n" if image else b"\n") + msgspec.json.encode(element))
        out.write(b'],\n"annotations": [')
        for image, number in numbers_of_animals(animals):
            element = annotation(image, number, rng)
            out.write((b",\n" if number else b"\n") + msgspec.json.encode(element))
        out.write(b"]}\n")
    return images


def write_pictures(folder: Path, images: int) -> None:
    """One blank picture under the names of the first images."""
    content = BytesIO()
    Image.new("RGB", HW[::-1], "gray").save(content, "JPEG")
    original = folder
    for image in range(images):
        path = folder / image_name(image)
        path.parent.mkdir(parents=True, exist_ok=True)
        if image % MOST_LINKS == 0:
            path.write_bytes(content.getvalue())
            original = path
        else:
            os.link(original, path)


def opened(job: dict[str, Any]) -> Any:
    """The Dataset of a job: its file, folder of pictures and cache."""
    from animal3dbox.datasets import CocoKeypointsDataset  # its import is measured

    return CocoKeypointsDataset(
        job["file"], images=job["images"], body="dog", on_bad="skip", cache=job["cache"]
    )


def measure(job: dict[str, Any]) -> None:
    """Open in this process, read a shard if the job says so, and print what it cost as JSON."""
    start = time.process_time()
    import animal3dbox.datasets.format_datasets

    imported = time.process_time()
    before_mb = peak_mb()
    dataset = opened(job)
    opening = time.process_time()
    if job["shard"]:
        step = max(len(dataset) // SHARD, 1)
        for index in range(0, SHARD * step, step):
            if index < len(dataset):
                _ = dataset.source.sample(index).records
    shard = time.process_time()
    result = {
        "images": len(dataset),
        "import_s": round(imported - start, 2),
        "open_s": round(opening - imported, 3),
        "shard_s": round(shard - opening, 3),
        "peak_mb": round(peak_mb()),
        "imported_mb": round(before_mb),
        "notes": [*dataset.notes],
    }
    del animal3dbox
    print(json.dumps(result))


class _ImageOfAnnotation(msgspec.Struct):
    """The part of an annotation that says whose it is."""

    image_id: int


class _File(msgspec.Struct):
    """A file taken apart without the package's readers."""

    images: list[dict[str, Any]]
    annotations: list[msgspec.Raw]
    categories: msgspec.Raw


def compare(file: Path, pictures: Path, *, whole: bool) -> None:
    """Compare what an index says of a file with what the plain reader says of its elements."""
    from animal3dbox.datasets.readers.coco import reader as coco
    from animal3dbox.datasets.readers.coco.animal import with_confidence
    from animal3dbox.datasets.readers.coco.opening import opened_plainly
    from animal3dbox.datasets.readers.tolerance import Tolerance
    from animal3dbox.datasets.storage.fingerprint import content_digest

    indexed = coco.read_coco(file, pictures, check_paths=False)
    content = msgspec.json.decode(file.read_bytes(), type=_File)
    names = {image["id"]: image["file_name"] for image in content.images}
    members: dict[int, list[msgspec.Raw]] = {number: [] for number in names}
    for raw in content.annotations:
        members[msgspec.json.decode(raw, type=_ImageOfAnnotation).image_id].append(raw)
    expected = [
        names[number] + (f"#{k}" if k else "")
        for number in names
        for k in range(len(members[number]))
    ]
    place_of = {name: place for place, name in enumerate(expected)}
    step = 1 if whole else max(len(expected) // 20_000, 1)
    looked_at = range(0, len(expected), step)
    ids_right = sum(indexed.records[place].sample_id == expected[place] for place in looked_at)
    print(
        f"{len(indexed.records)} of {len(expected)} animals, {len(indexed.faults)} faults", end="; "
    )
    print(f"{ids_right} of {len(looked_at)} names are right", end="; ")
    some = [*names] if whole else random.Random(0).sample([*names], min(1000, len(names)))
    part = file.with_suffix(".part.json")
    chosen = {
        "images": [image for image in content.images if image["id"] in set(some)],
        "annotations": [raw for number in some for raw in members[number]],
        "categories": content.categories,
    }
    part.write_bytes(msgspec.json.encode(chosen))
    options = coco.CocoReading(part, pictures, None, Tolerance(), ())
    plain = coco.CocoContent(options, checks=False)
    opened = opened_plainly(plain.ranges, plain.reading, plain.read)
    records = [
        with_confidence(one.record, opened.counts.graded > 0) for one in opened.plain.animals
    ]
    same = sum(
        content_digest(indexed.records[place_of[record.sample_id]]) == content_digest(record)
        for record in records
    )
    print(f"{same} of {len(records)} records are the plain reader's")


def peak_mb() -> float:
    """The most memory that this process has held, in megabytes."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def in_fresh_process(name: str, job: dict[str, Any]) -> None:
    """Run a job in a process of its own, and print a line of what it cost."""
    ran = subprocess.run(
        [sys.executable, __file__, "--job", json.dumps(job)],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
    )
    result = json.loads(ran.stdout.strip().splitlines()[-1])
    print(
        f"{name:>16}: open {result['open_s']:8.3f} s CPU, shard {result['shard_s']:6.3f} s,"
        f" peak {result['peak_mb']} MB ({result['imported_mb']} MB and {result['import_s']} s of it"
        f" imports), {result['images']} images",
        flush=True,
    )


def main() -> None:
    """Make the file, and measure its openings."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("folder", type=Path, nargs="?")
    parser.add_argument("--animals", type=int, default=10_000)
    parser.add_argument("--pictures", type=int, default=0, help="of so many images, the first ones")
    parser.add_argument("--keep", action="store_true", help="use the file that is there")
    parser.add_argument("--whole", action="store_true", help="compare every record")
    parser.add_argument("--job", help="for the processes that this one starts")
    options = parser.parse_args()
    if options.job:
        measure(json.loads(options.job))
        return
    folder: Path = options.folder
    file, pictures, cache = (
        folder / f"{options.animals}.json",
        folder / f"{options.animals}-images",
        folder / "cache",
    )
    folder.mkdir(parents=True, exist_ok=True)
    if not (options.keep and file.is_file()):
        images = write_annotations(file, options.animals)
        shutil.rmtree(pictures, ignore_errors=True)
        pictures.mkdir()
        write_pictures(pictures, min(images, options.pictures))
    shutil.rmtree(cache, ignore_errors=True)
    print(f"{options.animals} animals, {file.stat().st_size / 1e6:.0f} MB")
    job = {"file": str(file), "images": str(pictures), "cache": str(cache), "shard": False}
    in_fresh_process("first opening", job)
    in_fresh_process("later opening", job)
    in_fresh_process("shard of 100", {**job, "shard": True})
    compare(file, pictures, whole=options.whole)


if __name__ == "__main__":
    main()
