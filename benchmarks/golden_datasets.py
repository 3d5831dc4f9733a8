"""What every Dataset gives for the golden record: its targets, batches, caches and reports."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from golden_labels import configs, label_config
from golden_names import attribute, made, named
from golden_values import GoldenValues

HW = (120, 160)
SKIP = {"on_bad": "skip"}


@dataclass(frozen=True)
class GoldenSet:
    """One dataset on disk, and how it is opened.

    Attributes:
        kind: its Dataset's name.
        values: the Dataset's first arguments.
        options: its others.
    """

    kind: str
    values: tuple[Any, ...]
    options: Mapping[str, Any]

    def opened(self, **options: Any) -> Any:
        """The Dataset, with more options; bad samples are skipped unless they say otherwise."""
        kind = named(f"animal3dbox.datasets.{self.kind}")
        return made(kind, *self.values, **{**SKIP, **self.options, **options})


def golden_sets(inputs: Path) -> dict[str, GoldenSet]:
    """Every dataset of the record, by name."""
    model, things = inputs / "animals-model.pkl", inputs / "things" / "things.json"
    return {
        "animals": GoldenSet("Animal3DDataset", (inputs / "animals", model), {}),
        "known": GoldenSet("Animal3DDataset", (inputs / "animals", model), {"pose": "exact"}),
        "cats": GoldenSet("Animal3DDataset", (inputs / "animals",), {"body": "cat"}),
        "dogs": GoldenSet("StanfordExtraDataset", (inputs / "dogs",), {}),
        "coco": GoldenSet("CocoKeypointsDataset", (inputs / "coco",), {}),
        "deeplabcut": GoldenSet("DeepLabCutDataset", (inputs / "deeplabcut",), {}),
        "meshes_cameras": GoldenSet("MeshFolderDataset", (inputs / "meshes_cameras",), {}),
        "meshes_keypoints": GoldenSet("MeshFolderDataset", (inputs / "meshes_keypoints",), {}),
        "things": GoldenSet("Omni3DDataset", (things,), {}),
        "named_things": GoldenSet("Omni3DDataset", (things,), {"heading_known": True}),
        "world": GoldenSet("SyntheticDataset", (_world(),), {}),
        "guessed_world": GoldenSet("SyntheticDataset", (_world(),), {"pose": "hypothesis"}),
    }


def _world() -> Any:
    """Five small scenes of the synthetic world with faulty annotations."""
    config = named("animal3dbox.datasets.world.config.WorldConfig")
    faults = named("animal3dbox.datasets.faults.FaultConfig")
    kind = named("animal3dbox.datasets.SyntheticSet")
    world = replace(config(), image_hw=HW, focal_px=(150.0, 500.0))
    return kind(41, 5, world, faults(noise_px=1.0, swap="legs", swapped=0.3, joint_deg=2.0))


def add_samples(values: GoldenValues, name: str, samples: Sequence[Any]) -> None:
    """Record images and targets, and of skipped samples why."""
    for number, sample in enumerate(samples):
        if isinstance(sample, tuple):
            values.add(f"{name}/{number}/image", sample[0])
            values.add_target(f"{name}/{number}", sample[1])
        else:
            values.add(f"{name}/{number}/skipped", sample)


def add_dataset(values: GoldenValues, name: str, dataset: Any) -> None:
    """Record every sample of a Dataset, its classes, its notes and its report."""
    add_samples(values, name, [dataset[number] for number in range(len(dataset))])
    values.add(f"{name}/classes", dataset.classes)
    values.add(f"{name}/notes", attribute(dataset, "source.notes"))
    values.add(f"{name}/report/counts", dataset.report().counts)
    values.add(f"{name}/report/cases", dataset.report().cases)


def record_datasets(values: GoldenValues, inputs: Path, scratch: Path) -> None:
    """Record every Dataset as it is, under every method, in batches, and through a cache."""
    for name, golden in golden_sets(inputs).items():
        with values.section(f"dataset {name}"):
            add_dataset(values, f"dataset/{name}", golden.opened())
        with values.section(f"batches {name}"):
            dataset = golden.opened()
            batch = dataset.__getitems__([*range(len(dataset)), (2, 0), -1])
            add_samples(values, f"batch/{name}", batch)
        with values.section(f"cache {name}"):
            _add_cached(values, f"cache/{name}", golden, scratch / f"cache-{name}")
    methods = ("animals", "dogs", "coco", "deeplabcut", "meshes_keypoints")
    for name in (*methods, "known", "meshes_cameras", "guessed_world"):
        golden = golden_sets(inputs)[name]
        for method, config in configs().items():
            if name in methods or method in ("default", "axes-landmarks", "axes-pca"):
                fast = config if method == "default" else replace(config, surface_share=False)
                with values.section(f"dataset {name} {method}"):
                    add_dataset(values, f"{name}/{method}", golden.opened(config=fast))


def _add_cached(values: GoldenValues, name: str, golden: GoldenSet, folder: Path) -> None:
    """Record the samples of a Dataset that fills a cache, and of one that reads it."""
    add_dataset(values, f"{name}/filled", golden.opened(cache=folder))
    stored = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
    add_dataset(values, f"{name}/read", golden.opened(cache=folder))
    after = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
    values.add(f"{name}/grew", after > stored)


def record_options(values: GoldenValues, inputs: Path, scratch: Path) -> None:
    """Record Datasets with scales, filters, fewer fields, and samples that are faulty."""
    scale = "animal3dbox.datasets.scale"
    species, known = named(f"{scale}.SpeciesScale"), named(f"{scale}.KnownScale")
    altitude = named(f"{scale}.AltitudeScale")
    limits = named("animal3dbox.datasets.LabelFilter")
    strict = limits(min_mask_iou=0.7, max_truncation=0.3, min_box_px=60.0)
    loose = limits(min_confidence=0.3, max_reprojection_error_px=9.0, min_inlier_share=0.5)
    jobs: dict[str, tuple[str, dict[str, Any]]] = {
        "species": ("animals", {"scale": species()}),
        "species-table": ("coco", {"scale": species({"dog": 0.7, "cheetah": 1.1})}),
        "known-scale": ("dogs", {"scale": known(0.85)}),
        "altitude": ("world", {"scale": altitude(15.0, (0.0, 0.4, 0.9))}),
        "own-unit": ("meshes_cameras", {"scale": known(2.0)}),
        "no-masks": ("known", {"masks": False}),
        "whole": ("known", {"config": label_config(tail="drop")}),
        "focal": ("dogs", {"focal_px": 444.0}),
        "classes": ("coco", {"classes": ("king cheetah", "dog")}),
        "body": ("deeplabcut", {"body": "horse"}),
        "strict": ("animals", {"filters": strict}),
        "strict-dogs": ("dogs", {"filters": strict}),
        "loose": ("deeplabcut", {"filters": loose}),
        "partial": ("animals", {"filters": strict, "partial": "skip"}),
        "unseen": ("meshes_cameras", {"filters": limits(allow_unseen=True)}),
        "in-front": ("world", {"filters": limits(allow_behind_camera=False)}),
    }
    sets = golden_sets(inputs)
    for name, (which, options) in jobs.items():
        with values.section(f"options {name}"):
            add_dataset(values, f"options/{name}", sets[which].opened(**options))
    _record_faulty(values, inputs)


def _record_faulty(values: GoldenValues, inputs: Path) -> None:
    """Record what faulty datasets give, what they report, and what they raise."""
    model = inputs / "animals-model.pkl"
    options: dict[str, dict[str, Any]] = {
        "faulty_dogs": {},
        "faulty_coco": {},
        "faulty_animals": {"model": model},
    }
    for name, more in options.items():
        golden = GoldenSet("AnnotatedDataset", (inputs / name,), more)
        with values.section(f"faulty {name}"):
            add_dataset(values, f"faulty/{name}", golden.opened())
            values.add(f"faulty/{name}/text", str(golden.opened().report()).splitlines())
            values.add(f"faulty/{name}/raised", _raised(golden))
    known = GoldenSet("AnnotatedDataset", (inputs / "faulty_animals",), {"model": model})
    with values.section("faulty known"):
        add_dataset(values, "faulty/known", known.opened(pose="exact"))


def _raised(golden: GoldenSet) -> str:
    """The error of a dataset whose faults are errors."""
    try:
        golden.opened(on_bad="error")
    except named("animal3dbox.errors.SampleError") as error:
        return str(error)
    return ""


def record_loading(values: GoldenValues, inputs: Path, scratch: Path) -> None:
    """Record batches as a DataLoader collates them, and formats that are recognised."""
    with values.section("collate"):
        dataset = golden_sets(inputs)["animals"].opened()
        images, targets = named("animal3dbox.datasets.collate")([*dataset])
        add_samples(values, "collate", list(zip(images, targets, strict=True)))
        values.add("collate/skipped", targets.skipped)
        stacked, _ = named("animal3dbox.datasets.collate_stacked")([*dataset])
        values.add("collate/stacked", stacked)
    for name in ("animals", "dogs", "coco", "deeplabcut", "meshes_cameras"):
        with values.section(f"recognised {name}"):
            dataset = GoldenSet("AnnotatedDataset", (inputs / name,), {}).opened()
            values.add(f"recognised/{name}/classes", dataset.classes)
            values.add(f"recognised/{name}/length", len(dataset))
            add_samples(values, f"recognised/{name}", [dataset[0]])
    with values.section("read_omni3d"):
        reader = named("animal3dbox.datasets.exchange.omni3d_reader.read_omni3d")
        read = reader(inputs / "things" / "things.json", inputs / "things")
        values.add("read_omni3d/notes", read.notes)
        values.add("read_omni3d/records", read.records)
