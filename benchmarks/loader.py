"""Samples a second of a training loader, against reading the same JPEGs and masks alone.

Run: python benchmarks/loader.py [--images N] [--rounds R] [--workers 0 1 2] [--faults N]

All kinds of loading take turns in one run, so that what else the machine does falls on all alike;
the figures are medians of rounds, the ratios those of times per image to the floor's with as many
workers. The floors decode as Datasets do, JPEGs by OpenCV (datasets/images/jpeg.py): with masks,
without, and JPEGs alone by Pillow. Pictures are synthetic, 640 x 480, one animal each. With
--masks-off only "cached labels, no masks" and its floor take turns, in one process and processor
time, and the same with a flip, a virtual camera, a crop and normalisation, whose floor is the
decode with one warp by the same maps and a table of the normalised grey levels ("pixels only").
"""

import argparse
import os
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image
from torch.utils.data import DataLoader, Dataset

from animal3dbox.datasets import Animal3DDataset, LabelDataset, SyntheticSet, collate
from animal3dbox.datasets.images.exif import PhotoFacts
from animal3dbox.datasets.images.photos import read_photo
from animal3dbox.datasets.labelling.skipped import Target
from animal3dbox.datasets.labelling.targets import image_tensor
from animal3dbox.datasets.labelling.threads import one_thread
from animal3dbox.datasets.records import AnimalRecord
from animal3dbox.datasets.synthetic.animal3d_writer import write_animal3d
from animal3dbox.datasets.synthetic.synthetic_set import animal3d_world
from animal3dbox.datasets.synthetic.world.config import WorldConfig
from animal3dbox.transforms import (
    ColorJitter,
    Compose,
    Normalize,
    RandomHorizontalFlip,
    RandomResizedCrop,
    RandomVirtualCamera,
)

torch.set_num_threads(1)
cv2.setNumThreads(1)
BATCH = 8


def by_opencv(path: Path) -> NDArray[np.uint8]:
    """The pixels of a JPEG by the decoder that Datasets use, without any check."""
    colour = cv2.IMREAD_COLOR_RGB | cv2.IMREAD_IGNORE_ORIENTATION
    return np.asarray(cv2.imdecode(np.fromfile(path, np.uint8), colour), dtype=np.uint8)


def by_pillow(path: Path) -> NDArray[np.uint8]:
    """The same pixels by Pillow."""
    with Image.open(path) as image:
        return np.array(image.convert("RGB"))


class Decoded(Dataset[Any]):
    """Images and masks of a Dataset, decoded as it decodes them and nothing else: the floor.

    Args:
        dataset: the Dataset.
        masks: whether masks are decoded, too.
        decode: the decoder of pictures.
    """

    def __init__(
        self,
        dataset: LabelDataset,
        *,
        masks: bool = True,
        decode: Callable[[Path], NDArray[np.uint8]] | None = None,
    ) -> None:
        self.masks, self.decode = masks, decode or by_opencv
        samples = [dataset.source.sample(index) for index in range(len(dataset))]
        self.records: list[tuple[AnimalRecord, ...]] = [sample.records for sample in samples]  # type: ignore[misc]

    def __len__(self) -> int:
        return len(self.records)

    def __getitem__(self, index: int) -> tuple[torch.Tensor, Target]:
        first, *others = self.records[index]
        image = image_tensor(self.decode(first.image_path))  # type: ignore[arg-type]
        if not self.masks:
            return image, {}
        masks = [record.mask for record in (first, *others)]
        whole = np.stack(masks) if others else masks[0][None]  # type: ignore[arg-type,index]
        return image, {"masks": torch.from_numpy(whole.view(np.uint8))}


def write_dataset(folder: Path, images: int) -> tuple[Path, Path]:
    """A synthetic Animal3D folder of one animal an image, and its model."""
    world = replace(animal3d_world(WorldConfig()), animals=(1, 1))
    write_animal3d(SyntheticSet(0, images, world), folder / "set", folder / "model.pkl")
    return folder / "set", folder / "model.pkl"


def seconds_an_image(dataset: Dataset[Any], workers: int) -> float:
    """Time of one epoch by its images; of workers that are already running."""
    loader: Any = DataLoader(
        dataset,
        batch_size=BATCH,
        collate_fn=collate,
        num_workers=workers,
        persistent_workers=workers > 0,
    )
    if workers:
        for _ in loader:  # starts the workers, and lets them open what they need
            pass
    start = time.perf_counter()
    for _ in loader:
        pass
    return (time.perf_counter() - start) / len(loader.dataset)


def kinds(root: Path, model: Path, cache: Path) -> dict[str, Dataset[Any]]:
    """The Datasets that are compared, by name; the first is the floor."""
    augment = Compose([RandomHorizontalFlip(), RandomResizedCrop(512), ColorJitter(0.2)])
    exact = Animal3DDataset(root, model, stored_cameras="exact")
    return {
        "decode only": Decoded(exact),
        "decode only, no masks": Decoded(exact, masks=False),
        "decode only, no masks, Pillow": Decoded(exact, masks=False, decode=by_pillow),
        "cached labels, no masks": Animal3DDataset(
            root, model, stored_cameras="exact", cache=cache, masks=False
        ),
        "cached labels": Animal3DDataset(root, model, stored_cameras="exact", cache=cache),
        "labels, known pose": exact,
        "labels, pose searched": Animal3DDataset(root, model, on_bad="skip"),
        "cached labels, transforms": Animal3DDataset(
            root, model, stored_cameras="exact", cache=cache, transform=augment
        ),
        "known pose, transforms": Animal3DDataset(
            root, model, stored_cameras="exact", transform=augment
        ),
    }


def compare(root: Path, model: Path, cache: Path, *, workers: list[int], rounds: int) -> None:
    """Print the samples a second of each kind of loading, and its time by the floor's."""
    compared = kinds(root, model, cache)
    for _ in range(2):
        seconds_an_image(compared["cached labels"], 0)  # fills the cache, then sees it
    print(f"{'':28}" + "".join(f"{f'{n} workers':>24}" for n in workers))
    seconds: dict[tuple[str, int], list[float]] = {}
    for turn in range(rounds):
        for count in workers:
            order = -1 if turn % 2 else 1  # so that none always comes after the same other
            for name, dataset in list(compared.items())[::order]:
                seconds.setdefault((name, count), []).append(seconds_an_image(dataset, count))
    for name in compared:
        cells = []
        for count in workers:
            times, floor = np.array(seconds[name, count]), np.array(seconds["decode only", count])
            cells.append(f"{1 / np.median(times):10.1f} /s {np.median(times / floor):8.2f} x")
        print(f"{name:28}" + "".join(f"{cell:>24}" for cell in cells))


SIZE = 512
VIEWS = Compose(
    [RandomHorizontalFlip(), RandomVirtualCamera(5, 5, 10), RandomResizedCrop(SIZE), Normalize()]
)
NORMALISED = [np.arange(256, dtype=np.float32) / 255 - 0.5] * 3
"""A table of normalised grey levels a channel; which ones does not matter to the time."""


def pixels_only(path: Path, H_in_out: NDArray[np.float64]) -> list[Any]:
    """What a sample after VIEWS needs at least: its decode, one warp, its normalised planes.

    OpenCV warps four channels in less than half the time that it takes for three.
    """
    rgba = cv2.cvtColor(by_opencv(path), cv2.COLOR_RGB2RGBA)
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    planes = cv2.split(cv2.warpPerspective(rgba, H_in_out, (SIZE, SIZE), flags=flags))
    return [cv2.LUT(plane, table) for plane, table in zip(planes, NORMALISED, strict=False)]


def pixel_floor(dataset: LabelDataset) -> Callable[[list[int]], Any]:
    """The loading of batches that has nothing but pixels, by maps that VIEWS draws beforehand."""
    paths, maps = [], []
    for index in range(len(dataset)):
        image, target = dataset[index]  # type: ignore[misc]  # a world without faults
        plan = VIEWS.sample_params((image.shape[1], image.shape[2]), target)
        paths.append(dataset.source.sample(index).records[0].image_path)
        maps.append(np.linalg.inv(plan.H_out_in))
    return lambda batch: [pixels_only(paths[index], maps[index]) for index in batch]  # type: ignore[arg-type]


def masks_off(root: Path, model: Path, cache: Path, rounds: int) -> None:
    """Print what a cached sample without masks costs by its own decoder's decode, in batches.

    Processor time of one process: what else the machine does counts less.
    """
    dataset = Animal3DDataset(root, model, stored_cameras="exact", cache=cache, masks=False)
    augmented = Animal3DDataset(
        root, model, stored_cameras="exact", cache=cache, masks=False, transform=VIEWS
    )
    floor, other = (
        Decoded(dataset, masks=False, decode=decode) for decode in (by_opencv, by_pillow)
    )
    batches = [[*range(i, min(i + BATCH, len(dataset)))] for i in range(0, len(dataset), BATCH)]
    loadings: dict[str, Callable[[list[int]], Any]] = {
        "decode only": lambda batch: [floor[index] for index in batch],
        "decode only, Pillow": lambda batch: [other[index] for index in batch],
        "cached labels": dataset.__getitems__,
        "pixels only": pixel_floor(dataset),
        "cached labels, transforms": augmented.__getitems__,
    }
    for batch in batches:
        dataset.__getitems__(batch)  # fills the cache
    seconds: dict[str, list[float]] = {name: [] for name in loadings}
    for _ in range(rounds):
        for name, load in loadings.items():
            begin = time.process_time()
            for batch in batches:
                samples = load(batch)
            del samples
            seconds[name].append((time.process_time() - begin) / len(dataset))
    floors = np.array(seconds["decode only"])
    print("no masks, one process, processor time of an image")
    for name, times in seconds.items():
        ratio = np.median(np.array(times) / floors)
        print(f"  {name:28} {1e3 * float(np.median(times)):7.3f} ms {ratio:7.2f} x")


def stages(root: Path, model: Path, cache: Path, rounds: int) -> None:
    """Print the cost of one image, stage by stage, in units of its JPEG's decoding.

    As in a worker, each stage comes right after a batch's JPEGs have been decoded: the processor's
    caches are then full of them.
    """
    exact, searched, stored = (
        Animal3DDataset(root, model, **more)
        for more in ({"stored_cameras": "exact"}, {}, {"stored_cameras": "exact", "cache": cache})
    )
    pictures = [exact.source.sample(i).records[0].image_path for i in range(len(exact))]
    masks = [exact.source.sample(i).mask(0) for i in range(len(exact))]

    def labelled(dataset: LabelDataset, batch: list[int]) -> Any:
        requests = []
        for i in batch:
            request = dataset._store.request(dataset.source.sample(i), 0, PhotoFacts())
            request.__dict__["mask"] = masks[i]  # its cached property: decoded already
            requests.append(request)
        return dataset._store.labels(requests)

    parts: dict[str, tuple[int, Callable[[list[int]], Any]]] = {
        "JPEG": (BATCH, lambda batch: [read_photo(pictures[i], "x") for i in batch]),  # type: ignore[arg-type]
        "mask": (BATCH, lambda batch: [exact.source.sample(i).mask(0) for i in batch]),
        "label, known pose": (BATCH, lambda batch: labelled(exact, batch)),
        "label, known pose, alone": (1, lambda batch: labelled(exact, batch)),
        "label, pose searched": (BATCH, lambda batch: labelled(searched, batch)),
        "label, from the cache": (BATCH, lambda batch: labelled(stored, batch)),
        "whole sample, cached": (BATCH, stored.__getitems__),
    }
    print(
        f"\nstages of an image of one animal in the main process, batches of {BATCH} after their"
        " JPEGs"
    )
    with one_thread():
        times = time_after_jpegs(parts, len(pictures), rounds)
    for name, (seconds, jpeg_seconds) in times.items():
        print(
            f"  {name:28} {1e3 * float(np.median(seconds)):7.3f} ms"
            f" {np.median(np.array(seconds) / np.array(jpeg_seconds)):7.2f} x JPEG"
        )


def time_after_jpegs(
    parts: dict[str, tuple[int, Callable[[list[int]], Any]]], images: int, rounds: int
) -> dict[str, tuple[list[float], list[float]]]:
    """For each part its seconds an image, and those of the JPEGs that were decoded just before."""
    times = {name: (list[float](), list[float]()) for name in parts}
    for _ in range(rounds):
        for name, (size, part) in parts.items():
            for first in range(0, images, size):
                batch = [*range(first, min(first + size, images))]
                begin = time.perf_counter()
                parts["JPEG"][1](batch)
                middle = time.perf_counter()
                part(batch)
                end = time.perf_counter()
                times[name][0].append((end - middle) / len(batch))
                times[name][1].append((middle - begin) / len(batch))
    return times


def epoch_with_faults(folder: Path, images: int) -> None:
    """An epoch over many small images with 5 % planted faults and two workers.

    It must end, and name every fault.
    """
    sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "support"))
    from planted_epoch import planted_epoch, told_apart

    start = time.perf_counter()
    planted, report, loaded = planted_epoch(folder, images)
    unnamed, strangers = told_apart(planted, report)
    print(
        f"\n{images} small images, {len(planted)} spoiled: {loaded} loaded in"
        f" {time.perf_counter() - start:.0f} s (written, spoiled and loaded)"
    )
    print(f"named {len(planted) - len(unnamed)} of {len(planted)}, {len(strangers)} others")


def main() -> None:
    """Compare the loaders and their stages, or load an epoch with planted faults."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--images", type=int, default=64)
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--workers", type=int, nargs="+", default=[0, 1, 2])
    parser.add_argument(
        "--faults",
        type=int,
        default=0,
        help="instead: an epoch over so many small images with planted faults",
    )
    parser.add_argument("--masks-off", action="store_true", help="see above")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if options.faults:
            epoch_with_faults(folder, options.faults)
            return
        root, model = write_dataset(folder, options.images)
        if options.masks_off:
            masks_off(root, model, folder / "cache", options.rounds)
            return
        compare(root, model, folder / "cache", workers=options.workers, rounds=options.rounds)
        stages(root, model, folder / "cache", options.rounds)


if __name__ == "__main__":
    main()
