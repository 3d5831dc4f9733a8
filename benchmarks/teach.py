"""How well our labels teach: the detector of examples/train_detector.py under many settings.

    OMP_NUM_THREADS=1 nice -n 5 python benchmarks/teach.py detector BENCH --work WORK
    OMP_NUM_THREADS=1 nice -n 5 python benchmarks/teach.py labels PICTURES --work WORK
    python benchmarks/teach.py table --work WORK

`detector` trains on bench-v1 and judges on its test splits: three seeds, fewer images, without
parts of the augmentation, and beside the baselines. `labels` trains on the same pictures of
benchmarks/teach_pictures.py with true labels, with fitted ones, with fitted ones where every tenth
animal's left and right keypoints were exchanged before the fit, and with fitted ones weighted by
their confidence; it judges on true labels of other bodies and scenes. Runs that are in WORK are not
made again, and one that was stopped goes on at its last whole epoch.

heading: median angle of the forward axes. flank: of animals seen from aside, |sin azimuth| >= 0.35.
Intervals are 95 %, by the bootstrap over images and seeds together; losses are paired by image and
seed. CPU is the process's, on one thread.
"""

import argparse
import json
import runpy
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from animal3dbox.datasets import Omni3DDataset
from animal3dbox.training.detector_targets import (
    BoxCoder,
    ConstantBaseline,
    CropViews,
    NearestNeighbourBaseline,
    StoredCrops,
)

EXAMPLE = runpy.run_path(str(Path(__file__).parent.parent / "examples" / "train_detector.py"))
TESTS = ("test-id", "test-species")
PLAIN = CropViews(mirror=False, zoom=0.0, shift=0.0, turn_deg=(0.0, 0.0, 0.0))
AUGMENTATIONS = {
    "mirror, zoom, shift and virtual cameras": CropViews(),
    "without virtual cameras": CropViews(turn_deg=(0.0, 0.0, 0.0)),
    "without any geometric augmentation": PLAIN,
}
ALL = next(iter(AUGMENTATIONS))
TEACHERS = ("true", "fitted", "fitted, 10 % exchanged", "fitted, weighted by confidence")
BOX = ("center", "rotation", "size", "confidence")
LATERAL_SINE = 0.35
DRAWS = 2000
Floats = NDArray[np.float64]


def errors_of(boxes: dict[str, Tensor], crops: StoredCrops) -> dict[str, Any]:
    """What was made of each animal: the heading's error in degrees, and whether the flank is right.

    The flank is NaN where the camera is within 20.5 degrees of the animal's axis.
    """
    cosine = (boxes["rotation"][:, :, 0] * crops.rotation[:, :, 0]).sum(1).clamp(-1, 1)
    true, said = (
        -(box["rotation"].mT @ box["center"][:, :, None])[:, :2, 0] for box in (crops.truth, boxes)
    )
    lateral = true[:, 1].abs() >= LATERAL_SINE * true.norm(dim=1)
    right = torch.where(lateral, ((said[:, 1] > 0) == (true[:, 1] > 0)).float(), torch.nan)
    heading = torch.rad2deg(torch.acos(cosine))
    return {"heading": heading.tolist(), "flank": right.tolist(), "image": crops.image.tolist()}


class Runs:
    """The runs of a folder, one json each; what is there is not run again."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        folder.mkdir(parents=True, exist_ok=True)

    def add(self, name: dict[str, Any], run: Callable[[], dict[str, Any]]) -> None:
        """Run what is not there yet; `run` gives the errors by the name of their split."""
        path = self.folder / (
            "-".join(str(part) for part in name.values()).replace(" ", "_") + ".json"
        )
        if not path.exists():
            start = time.process_time()
            tests = run()
            cpu = time.process_time() - start
            path.write_text(json.dumps({**name, "cpu_s": cpu, "tests": tests}))
            print(path.stem, f"{cpu:.0f} s of CPU", flush=True)

    def read(self, study: str) -> list[dict[str, Any]]:
        """The runs of a study."""
        runs = [json.loads(path.read_text()) for path in sorted(self.folder.glob("*.json"))]
        return [run for run in runs if run["study"] == study]


def taught(
    crops: StoredCrops, tests: dict[str, StoredCrops], path: Path, views: CropViews, **options: int
) -> dict[str, Any]:
    """The errors on the tests of a detector that learned from crops; its checkpoint is at path."""
    detector = EXAMPLE["train"](crops, path, views, **options)
    path.unlink()  # the run's errors are what is kept
    return {name: errors_of(EXAMPLE["predict"](detector, one), one) for name, one in tests.items()}


def of_baseline(kind: Any, crops: StoredCrops, tests: dict[str, StoredCrops]) -> dict[str, Any]:
    """The errors of a baseline, which is told the 2D boxes and the cameras."""
    baseline = kind.fit(BoxCoder(virtual_focal_px=1000.0), [baseline_target(crops)])
    return {
        name: errors_of(
            {
                field: value.float()
                for field, value in baseline.predict(baseline_target(one)).items()
            },
            one,
        )
        for name, one in tests.items()
    }


def baseline_target(crops: StoredCrops) -> dict[str, Tensor]:
    """Crops as one target, with the 2D boxes in the crops: they lie in the middle."""
    side = crops.pixels.shape[-1]
    sides = crops.boxes[:, 2:] - crops.boxes[:, :2]
    half = sides * (side / 1.8 / sides.amax(1, keepdim=True)) / 2
    middle = (side - 1) / 2
    return {**crops.truth, "boxes": torch.cat((middle - half, middle + half), 1)}


def study_detector(bench: Path, work: Path, options: argparse.Namespace) -> None:
    """Baselines, seeds, the learning curve and the parts of the augmentation, on bench-v1."""
    start, runs = time.process_time(), Runs(work / "runs")
    names = ("train", *(TESTS if not options.val else ("val",)))
    read = {
        name: StoredCrops.kept(Omni3DDataset(bench / "truth" / f"{name}.json"), work / f"{name}.pt")
        for name in names
    }
    print(f"reading crops: {time.process_time() - start:.0f} s of CPU")
    crops = read.pop("train")
    baselines = {"constant": ConstantBaseline, "1-NN": NearestNeighbourBaseline}
    available = len(crops.images)
    counts = sorted({n for n in options.curve if n < available} | {available})
    settings = [(available, ALL)]
    settings += [(n, ALL) for n in counts[:-1]]
    settings += [
        (counts[min(options.ablate_at, len(counts) - 1)], views)
        for views in list(AUGMENTATIONS)[1:]
    ]
    for kind, baseline in baselines.items():
        name = {"study": "detector", "setting": kind, "images": available, "seed": 0}
        runs.add(name, lambda kind=baseline: of_baseline(kind, crops, read))  # type: ignore[misc]
    for images, views in settings:
        some = crops.at(crops.image <= crops.images[images - 1])
        epochs = min(options.epochs * available // images, options.most_epochs)
        for seed in range(options.seeds):
            name = {"study": "detector", "setting": views, "images": images, "seed": seed}
            path = work / f"{'-'.join(map(str, name.values()))}.pt"
            runs.add(
                {**name, "epochs": epochs},
                lambda some=some, path=path, views=views, seed=seed, epochs=epochs: taught(  # type: ignore[misc]
                    some, read, path, AUGMENTATIONS[views], seed=seed, epochs=epochs
                ),
            )


def pictures_of(folder: Path, split: str, teacher: str) -> StoredCrops:
    """The crops of a split of benchmarks/teach_pictures.py with the labels of a teacher."""
    chunks = [torch.load(path) for path in sorted(folder.glob(f"{split}-*.pt"))]
    labels = {"true": "true", TEACHERS[2]: "exchanged"}.get(teacher, "fitted")
    fields = {
        name: torch.cat([chunk[part][name] for chunk in chunks])
        for part, names in (("shown", ("pixels", "K", "boxes")), (labels, BOX))
        for name in names
    }
    confidence = fields.pop("confidence")
    weight = confidence if teacher == TEACHERS[3] else torch.ones(len(confidence))
    crops = StoredCrops(**fields, image=torch.arange(len(weight)), weight=weight)
    return crops.at(~crops.center.isnan().any(1))  # of a rejection there is nothing to learn


def study_labels(folder: Path, work: Path, options: argparse.Namespace) -> None:
    """The teachers, over the same pictures and seeds."""
    runs, tests = Runs(work / "runs"), {"test": pictures_of(folder, "test", "true")}
    for seed in range(options.seeds):
        for teacher in TEACHERS:
            crops = pictures_of(folder, "train", teacher)
            name = {"study": "labels", "setting": teacher, "images": len(crops), "seed": seed}
            path = work / f"labels-{TEACHERS.index(teacher)}-{seed}.pt"
            runs.add(
                {**name, "epochs": options.epochs},
                lambda crops=crops, path=path, seed=seed: taught(  # type: ignore[misc]
                    crops, tests, path, CropViews(), seed=seed, epochs=options.epochs
                ),
            )


def statistics(errors: Sequence[dict[str, Any]], rng: np.random.Generator) -> Floats:
    """Heading median and flank of runs on one split: as they are, then DRAWS of the bootstrap.

    Args:
        errors: of each seed, S.
        rng: equal ones draw equal images and seeds, so that differences are paired.

    Returns:
        (1 + DRAWS, 2), means over the seeds.

    """
    heading, flank = (np.array([run[key] for run in errors], float) for key in ("heading", "flank"))
    image = np.unique(errors[0]["image"], return_inverse=True)[1]
    members = np.split(np.argsort(image, kind="stable"), np.cumsum(np.bincount(image))[:-1])
    rows = [_of(heading, flank, np.arange(len(errors)), np.arange(len(image)))]
    for _ in range(DRAWS):
        drawn = rng.integers(len(members), size=len(members))
        seeds = rng.integers(len(errors), size=len(errors))
        rows.append(_of(heading, flank, seeds, np.concatenate([members[k] for k in drawn])))
    return np.array(rows)


def _of(
    heading: Floats, flank: Floats, seeds: NDArray[np.int64], animals: NDArray[np.int64]
) -> tuple[float, float]:
    """The mean over seeds of the heading's median and of the flank's rate, of some animals."""
    medians = np.median(heading[seeds][:, animals], axis=1)
    return float(medians.mean()), float(np.nanmean(flank[seeds][:, animals]))


def print_tables(work: Path) -> None:
    """Every setting with its interval; of labels the loss against true ones too."""
    runs = Runs(work / "runs")
    for study in ("detector", "labels"):
        groups: dict[tuple[str, int, str], list[dict[str, Any]]] = {}
        for run in runs.read(study):
            setting = (
                f"{run['setting']}, {run['epochs']} epochs" if "epochs" in run else run["setting"]
            )
            for split in run["tests"]:
                groups.setdefault((split, run["images"], setting), []).append(run)
        print(
            f"\n{study}: split | images | setting | seeds | heading deg | flank | n | CPU s a seed"
        )
        drawn = {}
        for (split, images, setting), members in sorted(groups.items()):
            errors = [run["tests"][split] for run in sorted(members, key=lambda run: run["seed"])]
            drawn[split, members[0]["setting"]] = values = statistics(
                errors, np.random.default_rng(0)
            )
            cells = [_shown(values[:, 0], "{:.1f}"), _shown(values[:, 1], "{:.3f}")]
            count = int((~np.isnan(np.array(errors[0]["flank"], float))).sum())
            cpu = np.mean([run["cpu_s"] for run in members])
            print(
                f"{split} | {images} | {setting} | {len(errors)} |",
                *cells,
                f"| {count} | {cpu:.0f}",
            )
        for (split, setting), values in drawn.items():
            if study == "labels" and setting != TEACHERS[0]:
                loss = (values - drawn[split, TEACHERS[0]]) * [1, -100]
                cells = [_shown(loss[:, 0], "{:+.1f} deg"), _shown(loss[:, 1], "{:+.1f} points")]
                print(f"loss of {setting}: heading", cells[0], "flank", cells[1])


def _shown(values: Floats, form: str) -> str:
    """The first of values, and the interval that the others give."""
    low, high = np.nanpercentile(values[1:], (2.5, 97.5))
    return f"{form.format(values[0])} ({form.format(low)} to {form.format(high)})"


def main() -> None:
    """Run a study, or print what there is."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("study", choices=("detector", "labels", "table"))
    parser.add_argument("folder", type=Path, nargs="?")
    parser.add_argument("--work", type=Path, required=True)
    parser.add_argument("--seeds", type=int, default=None)
    parser.add_argument("--epochs", type=int, default=None)
    parser.add_argument("--most-epochs", type=int, default=40, help="of fewer images")
    parser.add_argument("--curve", type=int, nargs="*", default=[1250, 2500, 5000, 10000])
    parser.add_argument("--ablate-at", type=int, default=1, help="place in the curve")
    parser.add_argument("--val", action="store_true", help="judge on val, to tune")
    options = parser.parse_args()
    torch.set_num_threads(1)
    if options.study == "table":
        print_tables(options.work)
    elif options.study == "detector":
        options.seeds, options.epochs = options.seeds or 3, options.epochs or 10
        study_detector(options.folder, options.work, options)
    else:
        options.seeds, options.epochs = options.seeds or 5, options.epochs or 40
        study_labels(options.folder, options.work, options)


if __name__ == "__main__":
    main()
