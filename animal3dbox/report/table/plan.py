"""What of a table is still to be made here, and where it goes: the seam between rows and engines.

An engine locks its shard (`locked_shard`), asks the plan for the indices, makes their rows by
`label_table` in whatever processes and batches it likes, and gives them to a `PartWriter`, or to
`TablePlan.write`. Which engine made which row is not seen in the table.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from animal3dbox.datasets.label_dataset import LabelDataset
from animal3dbox.errors import ConfigError
from animal3dbox.report.table.columns import Table
from animal3dbox.report.table.keys import missing_indices, row_keys, table_length
from animal3dbox.report.table.parts import (
    WHOLE_TABLE,
    Part,
    check_part,
    part_format,
    parts_of,
    read_part,
    write_part,
)


@dataclass(frozen=True)
class TablePlan:
    """Which rows of a table are to be made here.

    Attributes:
        folder: of the table's parts.
        shard: (i, n), counted from 1.
        indices: to be made, see label_table.
        known_keys: of rows that are there, which are not written again.
        status: what became of the animals of the rows that are there, status -> how many.
    """

    folder: Path
    shard: tuple[int, int]
    indices: Sequence[int]
    known_keys: frozenset[str] = frozenset()
    status: Counter[str] = field(default_factory=Counter)

    def write(self, table: Table) -> Path | None:
        """Write rows as a part, but for those that are there; see parts.write_part."""
        return write_part(self.folder, without_rows(table, self.known_keys), self.shard)


def table_plan(
    dataset: LabelDataset,
    folder: Path,
    *,
    shard: tuple[int, int] = WHOLE_TABLE,
    resume: bool = False,
) -> TablePlan:
    """What is to be made of a dataset's table.

    Args:
        dataset: whose table it is.
        folder: of its parts, made when the first is written.
        shard: (i, n): only the indices i, i + n, ... counted from 1.
        resume: whether rows that are there are kept, and the others made.

    Raises:
        ConfigError: there are parts and resume is not set; or their rows are of another code,
            config or dataset, or of annotations that have changed.
        DatasetFormatError: a part is damaged.

    Example:
        >>> from animal3dbox.datasets import SyntheticDataset
        >>> dataset = SyntheticDataset(5, seed=0, image_hw=(120, 160))
        >>> [*table_plan(dataset, Path("nowhere"), shard=(2, 3)).indices]
        [1, 4]
    """
    number, of = shard
    if not 1 <= number <= of:
        raise ConfigError(f"a shard must be (i, n) with i from 1 to n, got {shard}")
    if folder.exists() and not folder.is_dir():
        raise ConfigError(f"{folder} is a file: give a folder for the table's parts")
    shard_indices = range(number - 1, table_length(dataset), of)
    parts = [part for part in parts_of(folder) if _may_hold(part, shard)]
    if not parts:
        return TablePlan(folder, shard, shard_indices)
    if not resume:
        raise ConfigError(
            f"{folder} holds parts of this table, such as {parts[0].path.name}: go on with"
            " --resume, or give another folder"
        )
    part_format(folder)
    keys: set[str] = set()
    status: Counter[str] = Counter()
    for part in parts:
        part_keys = _checked_keys(dataset, part, status)
        if not keys.isdisjoint(part_keys):
            raise ConfigError(
                f"{part.path} holds rows that another part of {folder} holds, too: delete it"
            )
        keys |= part_keys
    is_whole = any(part.shard != shard for part in parts)
    check_known(dataset, range(table_length(dataset)) if is_whole else shard_indices, keys, folder)
    indices = missing_indices(dataset, shard_indices, keys)
    return TablePlan(folder, shard, indices, frozenset(keys), status)


def without_rows(table: Table, keys: frozenset[str]) -> Table:
    """The rows of a table whose keys are not among these."""
    if keys.isdisjoint(table["key"]):
        return table
    places = [place for place, key in enumerate(table["key"]) if key not in keys]
    return {name: [values[place] for place in places] for name, values in table.items()}


def _may_hold(part: Part, shard: tuple[int, int]) -> bool:
    """Whether a part may hold rows of a shard: all may but those of the other ones of as many."""
    return part.shard[1] != shard[1] or part.shard == shard


def _checked_keys(dataset: LabelDataset, part: Part, status: Counter[str]) -> set[str]:
    """The keys of a part, which must be whole, its rows of the same code, config and options."""
    columns = read_part(part, ["key", "labels_digest", "status"])
    others = {*columns["labels_digest"]} - {dataset.labels_digest}
    if others:
        raise ConfigError(
            f"{part.path} holds labels that were made by another version of animal3dbox or its"
            f" libraries, or with other options or bodies (labels_digest {min(map(str, others))},"
            f" now {dataset.labels_digest}): give another folder, or the same options and version"
        )
    check_part(part)
    status.update(map(str, columns["status"]))
    return {*map(str, columns["key"])}


def check_known(
    dataset: LabelDataset, indices: Sequence[int], keys: set[str], folder: Path
) -> None:
    """Raise a ConfigError if keys of rows in a folder are none of these indices'."""
    strangers = len(keys.difference(key for _, key in row_keys(dataset, indices)))
    if strangers:
        raise ConfigError(
            f"{folder} holds {strangers} rows of animals that the dataset does not have, or whose"
            " annotations, options or code have changed since: give another folder, or begin anew"
        )
