"""Making a benchmark: whole at every moment, the same however it was made, and nothing else's."""

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bench_folders import in_both, made, tiny_plan
from PIL import Image

from animal3dbox.bench import (
    make,
    make_bench,
    read_manifest,
    run_baseline,
    score_result,
    verify_bench,
)
from animal3dbox.bench.image_rows import draw_image, pixel_digest
from animal3dbox.bench.plan import bench_plan
from animal3dbox.datasets import read_omni3d
from animal3dbox.datasets.synthetic.world.animals import draw_betas
from animal3dbox.errors import ConfigError
from animal3dbox.smal.quadruped.preset_bodies import quadruped_names


def files_of(root: Path) -> dict[str, bytes]:
    """Every file below a folder, by its path."""
    return {
        path.relative_to(root).as_posix(): path.read_bytes()
        for path in sorted(root.rglob("*"))
        if path.is_file()
    }


def test_the_plan_has_the_numbers_of_images_that_were_promised() -> None:
    full = {split.name: split.images for split in bench_plan("full").splits}
    assert full == {
        "train": 20_000,
        "val": 2000,
        "test-id": 1000,
        "test-species": 1000,
        "test-aerial": 1000,
        "test-crowd": 1000,
        "test-focal": 1000,
    }
    assert sum(split.images for split in bench_plan("small").splits) == 300
    assert bench_plan("full").digest != bench_plan("small").digest


def test_the_digest_of_a_plan_names_every_dial_of_a_split() -> None:
    plan = tiny_plan(val=2)
    split = plan.split("val")
    others = [
        replace(split, seed=1),
        replace(split, images=3),
        replace(split, world=replace(split.world, roll_deg=14.0)),
        replace(split, faults=replace(split.faults, noise_px=2.0)),
    ]
    digests = {plan.digest, *(replace(plan, splits=(other,)).digest for other in others)}
    assert len(digests) == 5


def test_splits_have_seeds_of_their_own() -> None:
    seeds = [split.seed for split in bench_plan("full").splits]
    assert len(set(seeds)) == len(seeds)


def test_no_other_split_has_the_species_of_test_species_not_even_as_a_part() -> None:
    plan = bench_plan("full")
    held_out = set(plan.split("test-species").world.presets)
    assert len(held_out) == 2
    for split in plan.splits:
        species = {*split.world.presets, *split.world.mixed}
        assert species == held_out if split.name == "test-species" else not species & held_out


def test_only_the_species_that_may_be_mixed_in_are() -> None:
    names = quadruped_names()
    columns = [names.columns.index(name) for name in names.presets]
    rng = np.random.default_rng(0)
    betas = np.stack([draw_betas(rng, "dog", 1.0, mixed=("dog", "cat")).numpy() for _ in range(40)])
    mixed = {name for name, column in zip(names.presets, columns, strict=True)
             if (betas[:, column] != 0).any()}  # fmt: skip
    assert mixed == {"dog", "cat"}


def test_a_killed_run_leaves_whole_files_and_the_next_one_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = tiny_plan(val=5)
    monkeypatch.setattr(make, "CHUNK", 1)
    drawn: list[int] = []

    def killed_at_3(split: Any, index: int) -> Any:
        if index == 3 and not (tmp_path / "again").exists():
            raise KeyboardInterrupt
        drawn.append(index)
        return draw_image(split, index)

    monkeypatch.setattr(make, "draw_image", killed_at_3)
    with pytest.raises(KeyboardInterrupt):
        make_bench(plan, tmp_path / "killed")
    partial = read_omni3d(tmp_path / "killed" / "truth" / "val.json")
    assert len(partial.images) == 2  # written after the first chunk and the second
    assert partial.faults == ()
    assert all(image.image_path is not None for image in partial.images)
    (tmp_path / "again").mkdir()
    drawn.clear()
    make_bench(plan, tmp_path / "killed")
    assert drawn == [3, 4]
    make_bench(plan, tmp_path / "again")
    assert files_of(tmp_path / "killed") == files_of(tmp_path / "again")


def test_a_split_that_is_whole_is_not_drawn_again_but_for_images_that_are_missing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = tiny_plan(val=2)
    root = made(tmp_path / "bench", plan)
    before = files_of(root)
    drawn: list[int] = []

    def counted(split: Any, index: int) -> Any:
        drawn.append(index)
        return draw_image(split, index)

    monkeypatch.setattr(make, "draw_image", counted)
    make_bench(plan, root)
    assert drawn == []
    (root / "images" / "val" / "000001.png").unlink()
    make_bench(plan, root)
    assert drawn == [1]
    assert files_of(root) == before


def test_a_split_made_alone_is_the_same_as_among_others(tmp_path: Path) -> None:
    plan = tiny_plan(val=1, test_focal=1)
    alone = make_bench(plan, tmp_path / "alone", splits=["test-focal"])
    assert list(alone.splits) == ["test-focal"]
    both = make_bench(plan, tmp_path / "both")
    assert both.splits["test-focal"] == alone.splits["test-focal"]


def test_the_folder_of_something_else_is_refused(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(ConfigError, match="new or an empty folder"):
        make_bench(tiny_plan(val=1), tmp_path)
    root = made(tmp_path / "bench", tiny_plan(val=1))
    with pytest.raises(ConfigError, match=r"holds 'bench-v1 small .*give another folder"):
        make_bench(tiny_plan(val=2), root)


def test_a_split_that_there_is_not_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="the splits of bench-v1 are val; got 'test'"):
        make_bench(tiny_plan(val=1), tmp_path / "bench", splits=["test"])
    with pytest.raises(ConfigError, match="workers must be at least 1"):
        make_bench(tiny_plan(val=1), tmp_path / "bench", workers=0)


def test_pixels_are_hashed_decoded_so_another_compression_changes_nothing(tmp_path: Path) -> None:
    _, pixels = draw_image(bench_plan("small").split("val"), 0)
    Image.fromarray(pixels).save(tmp_path / "a.png", compress_level=9)
    Image.fromarray(pixels).save(tmp_path / "b.bmp")
    for name in ("a.png", "b.bmp"):
        with Image.open(tmp_path / name) as image:
            assert pixel_digest(np.asarray(image)) == pixel_digest(pixels)
    assert pixel_digest(pixels.reshape(256, 192, 3)) != pixel_digest(pixels)


def test_the_search_for_what_two_splits_share_finds_a_split_of_the_same_seed(
    tmp_path: Path,
) -> None:
    plan = tiny_plan(train=2, val=2)
    train, val = plan.splits
    root = made(tmp_path / "bench", replace(plan, splits=(train, replace(val, seed=train.seed))))
    bodies, scenes, pixels = in_both(root, "train", "val")
    assert bodies
    assert len(scenes) == len(pixels) == 2
    # The individuals alone, in other scenes: other cameras of the same world
    other = replace(val, seed=train.seed, world=replace(val.world, focal_px=(900.0, 901.0)))
    shutil.rmtree(root)
    made(root, replace(plan, splits=(train, other)))
    bodies, scenes, pixels = in_both(root, "train", "val")
    assert bodies
    assert not scenes
    assert not pixels


def test_the_manifest_says_what_is_there(tmp_path: Path) -> None:
    root = made(tmp_path / "bench", tiny_plan(val=2))
    manifest = read_manifest(root)
    truth = read_omni3d(root / "truth" / "val.json")
    entry = manifest.splits["val"]
    assert (entry.images, entry.animals) == (len(truth.images), len(truth.records))
    assert entry.images == 2
    listed = {*entry.files, *manifest.files, "MANIFEST.json", "VERSION"}
    images = {image.image_id for image in truth.images}
    assert set(files_of(root)) == listed | images


def test_paths_may_be_text(tmp_path: Path) -> None:
    plan = bench_plan("small")
    tiny = replace(plan, splits=(replace(plan.split("val"), images=1),))
    root, result = str(tmp_path / "bench"), str(tmp_path / "result")
    make_bench(tiny, root)
    assert not verify_bench(root, plan=tiny).faults
    run_baseline(root, "labels-preset", result, splits=["val"])
    assert score_result(root, result, resamples=0)[1][0].metrics["images"] == 1
