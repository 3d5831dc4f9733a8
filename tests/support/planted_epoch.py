"""An epoch over many small synthetic images, of which a twentieth is spoiled."""

from pathlib import Path

import numpy as np
from planted_file_faults import ENTRY_FAULTS, FILE_FAULTS, plant_many
from small_animals import small_dataset, write_small_animals
from torch.utils.data import DataLoader

from animal3dbox.datasets import collate
from animal3dbox.datasets.labelling.load_report import LoadReport

SILENT = ("mask vanished",)
"""For which the rendered mask stands in: no fault, but a note."""


def planted_epoch(folder: Path, images: int) -> tuple[list[str], LoadReport, int]:
    """Write, spoil and load.

    The spoiled images, what the report says, and how many samples came through.
    """
    root = write_small_animals(folder / "set", images, hw=(60, 80))
    faults = [name for name in (*FILE_FAULTS, *ENTRY_FAULTS) if name not in SILENT]
    rng = np.random.default_rng(0)
    planted = plant_many(root, [faults[k % len(faults)] for k in range(images // 20)], rng)
    dataset = small_dataset(root, on_bad="skip")
    loader = DataLoader(
        dataset, batch_size=16, collate_fn=collate, num_workers=2, multiprocessing_context="fork"
    )
    loaded = sum(len(targets) for _, targets in loader)
    return planted, dataset.report(), loaded


def told_apart(planted: list[str], report: LoadReport) -> tuple[list[str], list[str]]:
    """The planted samples that no case of the report names, each wanting one of its own, and the
    cases that name no planted sample."""
    names = [case.sample_id for case in report.of("fault")]
    strangers = [name for name in names if not any(image in name for image in planted)]
    unnamed = []
    for image in sorted(planted, key=len, reverse=True):
        own = next((name for name in names if image in name), None)
        if own is None:
            unnamed.append(image)
        else:
            names.remove(own)
    return unnamed, strangers
