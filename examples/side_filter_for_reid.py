"""Keep the photographs that show an animal's left flank.

What re-identification compares like with like needs.

Run: python examples/side_filter_for_reid.py PHOTOS [OUT]   (any dataset that is read, such as
../shared/photos; without PHOTOS a synthetic one)
"""

import shutil
import sys
import tempfile
from pathlib import Path

from animal3dbox.datasets import AnnotatedDataset, LabelFilter, Skipped
from animal3dbox.datasets.synthetic.stanfordextra_writer import write_stanfordextra
from animal3dbox.datasets.synthetic.synthetic_set import SyntheticSet
from animal3dbox.geometry.cuboid import FACE_NAMES

LEFT = FACE_NAMES.index("left")
LEAST_SHARE = 0.5
"""A flank is shown if it takes at least so much of the visible box."""


def left_flanks(photos: Path, out: Path) -> int:
    """Copy the images that show a left flank into a folder, dogs/a.jpg as dogs__a.jpg.

    Gives how many.
    """
    out.mkdir(parents=True, exist_ok=True)
    dataset = AnnotatedDataset(photos, on_bad="skip", filters=LabelFilter(max_truncation=0.3))
    kept = 0
    for index in range(len(dataset)):
        sample = dataset[index]
        if isinstance(sample, Skipped):
            continue
        _, target = sample
        share = float(target["face_share_in_image"][:, LEFT].max())
        path = dataset.source.sample(index).records[0].image_path
        if share >= LEAST_SHARE and path is not None:
            shutil.copy(
                path, out / target["image_id"].replace("/", "__")
            )  # folders may have files of one name
            kept += 1
        print(
            f"{'keep' if share >= LEAST_SHARE else '    '}  left {share:4.0%}  {target['image_id']}"
        )
    print(dataset.report())
    return kept


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as made:
        if len(sys.argv) < 2:
            write_stanfordextra(SyntheticSet(1, 12), Path(made) / "dogs")
        photos = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(made) / "dogs"
        out = Path(sys.argv[2]) if len(sys.argv) > 2 else Path("left-flanks")
        print(f"{left_flanks(photos, out)} images with a left flank in {out}")
