"""Keep the photographs that show an animal's left flank, for re-identification.

Coats differ between an animal's sides, so like is compared with like.

Run: python examples/side_filter_for_reid.py [PHOTOS] [OUT]

PHOTOS is any dataset that is read, such as a StanfordExtra folder; without it a synthetic one is
made. OUT is the folder for the copies, left-flanks unless named.
"""

import shutil
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

from animal3dbox.datasets import AnnotatedDataset, LabelFilter, Skipped, SyntheticSet
from animal3dbox.datasets.synthetic.stanfordextra_writer import write_stanfordextra
from animal3dbox.datasets.synthetic.world.config import WorldConfig
from animal3dbox.geometry.cuboid import FACE_NAMES
from animal3dbox.smal.keypoints.vocabularies import VOCABULARIES

LEFT = FACE_NAMES.index("left")
LEAST_SHARE = 0.5
"""A flank is shown if it takes at least so much of the visible box."""


def copy_left_flanks(photos: Path, out: Path) -> int:
    """Copy the images that show a left flank into a folder; returns how many there are.

    Folders may have files of one name, so dogs/a.jpg becomes dogs__a.jpg.
    """
    out.mkdir(parents=True, exist_ok=True)
    dataset = AnnotatedDataset(photos, on_bad="skip", filters=LabelFilter(max_truncation=0.3))
    copies = 0
    for index in range(len(dataset)):
        sample = dataset[index]
        if isinstance(sample, Skipped):
            continue
        _, target = sample
        share = float(target["face_share_in_image"][:, LEFT].max())
        shows_left = share >= LEAST_SHARE
        print(f"{'keep' if shows_left else '    '}  left {share:4.0%}  {target['image_id']}")
        path = dataset.source.sample(index).records[0].image_path
        if shows_left and path is not None:
            shutil.copy(path, out / target["image_id"].replace("/", "__"))
            copies += 1
    print(dataset.report())
    return copies


def write_synthetic_photos(folder: Path) -> None:
    """Twelve synthetic animals in StanfordExtra's files and with its keypoints."""
    world = replace(WorldConfig(), vocabulary=VOCABULARIES["stanfordextra24"])
    write_stanfordextra(SyntheticSet(1, 12, world), folder)


def main() -> None:
    """Filter the photographs that the command line names."""
    arguments = [Path(word) for word in sys.argv[1:]]
    out = arguments[1] if len(arguments) > 1 else Path("left-flanks")
    with tempfile.TemporaryDirectory() as temporary:
        photos = arguments[0] if arguments else Path(temporary) / "animals"
        if not arguments:
            write_synthetic_photos(photos)
        print(f"{copy_left_flanks(photos, out)} images with a left flank in {out}")


if __name__ == "__main__":
    main()
