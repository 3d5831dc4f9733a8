"""README.md: the data card of a benchmark, with the front matter that dataset hubs read."""

from animal3dbox.bench.plan import BenchPlan, SplitPlan

CARD = "README.md"
"""The file of the data card, in the benchmark's folder."""
SIZES = (
    (1_000, "n<1K"),
    (10_000, "1K<n<10K"),
    (100_000, "10K<n<100K"),
)
"""Hugging Face's names of numbers of images, below each bound."""
TEXT = """---
license: cc0-1.0
pretty_name: animal3dbox {version} ({edition} edition)
task_categories:
- object-detection
tags:
- 3d-object-detection
- monocular
- animals
- synthetic
size_categories:
- {size}
configs:
- config_name: truth
  data_files:
{configs}---

# {version}, {edition} edition

Monocular 3D detection of animals: {total} drawn images of {width} x {height} px with exact oriented
boxes, whose six faces have names. Nobody took these pictures: bodies, coats, ground and light are
drawn from a seed file by `animal3dbox bench make`, and are given to the public domain (CC0 1.0).

| split | images | species | animals an image | elevation, deg | focal length, px |
| --- | --- | --- | --- | --- | --- |
{rows}
No body and no scene of `train` or `val` is in a test split, which `digests/` shows. The species of
`test-species` are in no other split. `test-aerial` is seen from higher, `test-crowd` has more
animals, and `test-focal` shorter focal lengths than `train`.

- `images/SPLIT/*.png`: the pictures, without loss.
- `truth/SPLIT.json`: boxes in Omni3D's layout, in the camera's frame, with `face_visible`,
  `face_area`, `face_share` and `face_share_in_image` in the order front, back, left, right, top,
  bottom. Lengths are in the world's unit, a body's length, and not metres (`info.units`).
- `keypoints/SPLIT.json`: COCO keypoints as a detector might give them: noise, gaps, outliers.
- `digests/SPLIT.json`: SHA-256 of each image's decoded pixels, and digests of scene and bodies.
- `MANIFEST.json`, `VERSION`: digests of all other files; of which seed file this is.

Check a copy with `animal3dbox bench verify`, a detector with `animal3dbox bench score` (its
`--help` says what a result's folder holds). What it cannot tell: how a detector does on
photographs.
"""
"""The card; what stands in braces is filled in."""


def card_text(plan: BenchPlan) -> str:
    """The text of the card, by the plan alone.

    Example:
        >>> from animal3dbox.bench import bench_plan
        >>> card_text(bench_plan("small")).splitlines()[1]
        'license: cc0-1.0'
    """
    total = sum(split.images for split in plan.splits)
    size = next(name for bound, name in SIZES if total < bound)
    configs = "".join(
        f"  - split: {split.name.replace('-', '_')}\n    path: truth/{split.name}.json\n"
        for split in plan.splits
    )
    rows = "".join(_row(split) for split in plan.splits)
    height, width = plan.splits[0].world.image_hw
    return TEXT.format(
        version=plan.version,
        edition=plan.edition,
        size=size,
        configs=configs,
        total=total,
        width=width,
        height=height,
        rows=rows,
    )


def _row(split: SplitPlan) -> str:
    """The line of one split in the card's table."""
    world = split.world
    low, high = world.elevation_deg
    cells = (
        split.name,
        str(split.images),
        ", ".join(world.presets),
        f"{world.animals[0]} to {world.animals[1]}",
        f"{low:g} to {high:g}",
        f"{world.focal_px[0]:g} to {world.focal_px[1]:g}",
    )
    return f"| {' | '.join(cells)} |\n"
