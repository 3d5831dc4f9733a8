"""_source.json beside a table's parts: what it is of, for pages that are made of it later.

Readers of a folder of Parquet pass over names that begin so.
"""

import os
from pathlib import Path

import msgspec

from animal3dbox.datasets.images.remote_files import is_remote
from animal3dbox.datasets.label_dataset import LabelDataset
from animal3dbox.datasets.storage.fingerprint import digest
from animal3dbox.datasets.storage.json_files import decode_json
from animal3dbox.errors import ConfigError
from animal3dbox.files import portable_path, write_whole
from animal3dbox.report.table.keys import row_keys, table_length
from animal3dbox.report.table.parts import parts_of

NAME = "_source.json"
MOST_KEYS = 200
"""Indices whose keys are looked at, evenly spaced: an annotation that is put in or taken out moves
all that follow it."""


class TableSource(msgspec.Struct, frozen=True, kw_only=True):
    """What a table is of.

    Attributes:
        source: the dataset, as it was given; of an absolute path the name alone.
        body: the body source's name.
        method: of the labels.
        images: the folder that images' names are relative to, from the table's folder; None if
            they are not all in one.
        labels_digest: names code, bodies, config and options, as in the rows; "" in older files.
        animals: names the animals, by their number and some of their keys; likewise.
    """

    source: str
    body: str
    method: str
    images: str | None
    labels_digest: str = ""
    animals: str = ""


def write_source(folder: Path, dataset: LabelDataset, path: Path) -> None:
    """Write _source.json, or check that the one that is there is of the same table.

    Shards look at no row of each other: this is what keeps jobs of other options, or of annotations
    that were changed since, from adding to the table.

    Args:
        folder: of the table, which is there.
        dataset: whose table it is.
        path: where the dataset is.

    Raises:
        ConfigError: the folder is that of another table.
        DatasetFormatError: the file that is there is damaged.

    """
    animals = _animals_digest(dataset)
    if (folder / NAME).exists() and parts_of(folder):
        earlier = read_source(folder)
        if earlier.labels_digest not in ("", dataset.labels_digest):
            raise ConfigError(
                f"{folder} is a table of labels that were made by another version of animal3dbox"
                " or its libraries, or with other options or bodies: give another folder, or the"
                " same options and version"
            )
        if earlier.animals not in ("", animals):
            raise ConfigError(
                f"{folder} is a table of other animals: the annotations have changed since, or are"
                " others; give another folder"
            )
    bodies = getattr(dataset.source, "bodies", None)
    content = TableSource(
        source=portable_path(path),
        body="given boxes" if bodies is None else bodies.name,
        method=dataset.config.method,
        images=_images_folder(dataset, folder),
        labels_digest=dataset.labels_digest,
        animals=animals,
    )
    write_whole(folder / NAME, msgspec.json.format(msgspec.json.encode(content), indent=1))


def _animals_digest(dataset: LabelDataset) -> str:
    """A digest of the number of a table's indices, and of the keys of MOST_KEYS of them at most."""
    count = table_length(dataset)
    places = sorted({place * (count - 1) // (MOST_KEYS - 1) for place in range(MOST_KEYS)})
    keys = [key.encode() for _, key in row_keys(dataset, places if count else ())]
    return digest(str(count).encode(), *keys).hex()


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
    is_below = file.parts[-len(name.parts) :] == name.parts
    if not sample.image_path or is_remote(sample.image_path) or not is_below:
        return None
    root = file.parents[len(name.parts) - 1].absolute()
    return Path(os.path.relpath(root, folder.absolute())).as_posix()
