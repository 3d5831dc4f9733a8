"""Verifying: one changed pixel, one changed number and one missing file are each found."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from bench_folders import made, tiny_plan
from PIL import Image

from animal3dbox.bench import BenchFindings, verify_bench
from animal3dbox.errors import ConfigError, DatasetFormatError, DatasetNotFoundError

PLAN = tiny_plan(val=2, test_id=1)


@pytest.fixture(scope="module")
def pristine(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return made(tmp_path_factory.mktemp("bench") / "pristine", PLAN)


@pytest.fixture
def bench(pristine: Path, tmp_path: Path) -> Path:
    """A copy of a benchmark, to spoil."""
    return Path(shutil.copytree(pristine, tmp_path / "copy"))


def findings(bench: Path) -> BenchFindings:
    return verify_bench(bench, plan=PLAN)


def faults(bench: Path) -> list[tuple[str, str]]:
    """The file and the field of each fault."""
    return [(str(fault.sample_id), fault.field) for fault in findings(bench).faults]


def test_a_benchmark_as_it_was_made_has_no_fault(bench: Path) -> None:
    found = findings(bench)
    assert (found.files, found.images, found.faults) == (12, 3, ())


def test_one_changed_pixel_is_found(bench: Path) -> None:
    path = bench / "images" / "val" / "000001.png"
    with Image.open(path) as image:
        pixels = np.asarray(image).copy()
    pixels[100, 50, 1] ^= 1
    Image.fromarray(pixels).save(path)
    assert faults(bench) == [("images/val/000001.png", "pixels")]


def test_an_image_saved_anew_with_the_same_pixels_is_no_fault(bench: Path) -> None:
    path = bench / "images" / "val" / "000001.png"
    with Image.open(path) as image:
        image.load()
        image.save(path, compress_level=9)
    assert faults(bench) == []


def test_one_changed_number_of_the_truth_is_found(bench: Path) -> None:
    path = bench / "truth" / "val.json"
    truth = json.loads(path.read_text())
    truth["annotations"][0]["center_cam"][2] += 1e-9
    path.write_text(json.dumps(truth))
    assert faults(bench) == [("truth/val.json", "sha256")]


@pytest.mark.parametrize(
    "file",
    ["images/val/000000.png", "truth/val.json", "keypoints/test-id.json", "README.md", "VERSION"],
)
def test_one_missing_file_is_found(bench: Path, file: str) -> None:
    (bench / file).unlink()
    assert [name for name, _ in faults(bench)] == [file]


def test_a_changed_version_is_found(bench: Path) -> None:
    (bench / "VERSION").write_text((bench / "VERSION").read_text().replace("v1", "v2"))
    assert faults(bench) == [("VERSION", "line")]
    (fault,) = findings(bench).faults
    assert f"write this line into it, if the rest verifies: bench-v1 small {PLAN.digest}" in str(
        fault
    )


def test_an_image_that_is_none_and_one_that_does_not_belong_are_found(bench: Path) -> None:
    (bench / "images" / "val" / "000000.png").write_bytes(b"no picture")
    shutil.copy(bench / "images" / "val" / "000001.png", bench / "images" / "val" / "000002.png")
    assert faults(bench) == [("images/val/000000.png", "image"), ("images/val/000002.png", "file")]


def test_files_of_images_in_no_split_s_folder_are_found(bench: Path) -> None:
    picture = bench / "images" / "val" / "000000.png"
    (bench / "images" / "other").mkdir()
    for name in ("000000.png", "other/000000.png"):
        shutil.copy(picture, bench / "images" / name)
    expected = [("images/000000.png", "file"), ("images/other/000000.png", "file")]
    assert faults(bench) == expected
    assert [one.field for one in verify_bench(bench, splits=["val"], plan=PLAN).faults] == [
        "file",
        "file",
    ]


def test_pixels_and_their_digest_changed_together_are_found(bench: Path) -> None:
    """Someone who repairs digests/ must also change the manifest, which results name."""
    path = bench / "digests" / "val.json"
    text = path.read_text()
    digests = json.loads(text)
    pixels = digests["images/val/000000.png"]["pixels"]
    path.write_text(text.replace(pixels, "0" * 64))
    assert faults(bench) == [
        ("digests/val.json", "sha256"),
        ("digests/val.json", "pixels"),
        ("images/val/000000.png", "pixels"),
    ]


@pytest.mark.parametrize("left", [0, 200])
def test_a_manifest_that_was_cut_off_is_refused_with_a_remedy_that_helps(
    bench: Path, left: int
) -> None:
    path = bench / "MANIFEST.json"
    whole = path.read_bytes()
    path.write_bytes(whole[:left])
    with pytest.raises(DatasetFormatError, match=r"MANIFEST\.json .*copy it again .*or delete it"):
        findings(bench)
    path.unlink()
    assert made(bench, PLAN) == bench
    assert path.read_bytes() == whole


def test_a_benchmark_of_another_seed_file_is_refused(bench: Path) -> None:
    with pytest.raises(ConfigError, match="made from another seed file"):
        verify_bench(bench)  # the small edition has 300 images


def test_a_split_that_is_not_whole_is_refused_and_so_is_a_folder_without_a_manifest(
    bench: Path, tmp_path: Path
) -> None:
    with pytest.raises(ConfigError, match=r"no whole split train \(whole: test-id, val\)"):
        verify_bench(bench, splits=["train"], plan=PLAN)
    with pytest.raises(DatasetNotFoundError, match="make the benchmark there first"):
        verify_bench(tmp_path)
