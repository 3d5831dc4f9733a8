"""_source.json beside a table's parts: what it is of, for pages that are made of it later.

Readers of a folder of Parquet pass over names that begin so.
"""

import os
from pathlib import Path

import msgspec

from animal3dbox.datasets.label_dataset import LabelDataset
from animal3dbox.datasets.storage.json_files import decode_json
from animal3dbox.files import portable_path, write_whole

NAME = "_source.json"


class TableSource(msgspec.Struct, frozen=True, kw_only=True):
    """What a table is of.

    Attributes:
        source: the dataset, as it was given; of an absolute path the name alone.
        body: the body source's name.
        method: of the labels.
        images: the folder that images' names are relative to, from the table's folder; None if
            they are not all in one.
    """

    source: str
    body: str
    method: str
    images: str | None


def write_source(folder: Path, dataset: LabelDataset, path: Path) -> None:
    """Write _source.json.

    Args:
        folder: of the table, which is there.
        dataset: whose table it is.
        path: where the dataset is.

    """
    bodies = getattr(dataset.source, "bodies", None)
    content = TableSource(
        source=portable_path(path),
        body="given boxes" if bodies is None else bodies.name,
        method=dataset.config.method,
        images=_images_folder(dataset, folder),
    )
    write_whole(folder / NAME, msgspec.json.format(msgspec.json.encode(content), indent=1))


def read_source(folder: Path) -> TableSource:
    """Read _source.json.

    Raises:
        DatasetNotFoundError: there is none.
        DatasetFormatError: it is damaged.

    """
    source: TableSource = decode_json(folder / NAME, TableSource)
    return source


def _images_folder(dataset: LabelDataset, folder: Path) -> str | None:
    """The images' folder as it is seen from another; None without images in files."""
    if not len(dataset):
        return None
    sample = dataset.source.sample(0)
    file, name = Path(sample.image_path), Path(sample.image_id)
    if not sample.image_path or file.parts[-len(name.parts) :] != name.parts:
        return None
    root = file.parents[len(name.parts) - 1].absolute()
    return Path(os.path.relpath(root, folder.absolute())).as_posix()
