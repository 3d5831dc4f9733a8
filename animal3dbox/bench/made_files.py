"""The files of a benchmark that scores and baselines read: refused unless they are as made."""

from pathlib import Path

from animal3dbox.bench.manifest import Manifest, SplitEntry, file_sha256
from animal3dbox.bench.split_files import split_paths
from animal3dbox.datasets.images.photos import stored_size
from animal3dbox.datasets.readers.predictions.truth import read_truth
from animal3dbox.datasets.records import CuboidImage
from animal3dbox.errors import DatasetFormatError, DatasetNotFoundError, SampleError

NAMED = 5
"""Number of images that a message names."""


def truth_file(root: Path, manifest: Manifest, split: str) -> Path:
    """The truth of a split; it and its list of categories must be as they were made.

    Raises:
        DatasetNotFoundError: a file is missing.
        DatasetFormatError: the bytes of one are not those that were made.

    """
    truth, category_meta, *_ = split_paths(split)
    _made(root, manifest.splits[split], category_meta)
    return _made(root, manifest.splits[split], truth)


def keypoints_file(root: Path, manifest: Manifest, split: str) -> Path:
    """The keypoints of a split as they were made; raises as truth_file does."""
    return _made(root, manifest.splits[split], split_paths(split)[-2])


def _made(root: Path, entry: SplitEntry, path: str) -> Path:
    """A file of a split whose bytes are those that were made."""
    if not (root / path).is_file():
        raise DatasetNotFoundError(f"{root} has no {path}: make the split again")
    if file_sha256(root / path) != entry.files.get(path):
        raise DatasetFormatError(
            f"{root / path} is not as it was made, so nothing is scored against it or detected by"
            " it: see `animal3dbox bench verify`"
        )
    return root / path


def check_pictures(root: Path, truth: Path) -> None:
    """Raise unless every picture of a split is there, as large as the truth says.

    Args:
        root: the benchmark's folder.
        truth: the split's Omni3D JSON, as it was made.

    Raises:
        DatasetFormatError: pictures are missing, are none or have another size; it names them.

    """
    images = read_truth(truth, look_for_images=False).usable
    problems = [problem for image in images if (problem := _picture_problem(root, image))]
    if problems:
        named = "; ".join(problems[:NAMED]) + ("; ..." if len(problems) > NAMED else "")
        raise DatasetFormatError(
            f"{root}: {len(problems)} of {len(images)} pictures of {truth.stem} are not as they"
            f" were made ({named}): delete those that are there and make the benchmark again there"
            " (animal3dbox bench make), which draws what is missing"
        )


def _picture_problem(root: Path, image: CuboidImage) -> str | None:
    """What is wrong with one picture by its header, if anything is."""
    name = image.image_id
    if not (root / name).is_file():
        return f"{name} is missing"
    try:
        height, width = stored_size(root / name, name)
    except SampleError as error:
        return str(error)
    if (height, width) == image.image_hw:
        return None
    return f"{name} is {width} x {height}, not {image.image_hw[1]} x {image.image_hw[0]}"
