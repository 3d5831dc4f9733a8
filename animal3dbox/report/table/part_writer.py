"""Gathering rows into the parts of a table, by the one process that writes them."""

import time
from collections import Counter

from animal3dbox.errors import ConfigError
from animal3dbox.report.table.columns import Table
from animal3dbox.report.table.plan import TablePlan

PART_SECONDS = 60.0
"""A part is written after so many seconds, if it is not full before: a crash loses no more."""


class PartWriter:
    """Gathers rows and writes them as parts, each when it is full or a minute old.

    Rows are written by the process that starts the workers, and by no worker: none can go on
    writing when it has ended.

    Used in a ``with`` block, whose end writes the rows that are left, also if it ends by an error.

    Args:
        plan: of the table.
        part_rows: of a part, about: batches are not divided.

    Attributes:
        status: what became of the animals whose rows are written, status -> how many.

    Raises:
        ConfigError: part_rows is not positive.

    Example:
        >>> import tempfile
        >>> from pathlib import Path
        >>> from animal3dbox.datasets import SyntheticDataset
        >>> from animal3dbox.report import label_table, table_plan
        >>> dataset = SyntheticDataset(3, seed=0, image_hw=(120, 160))
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     with PartWriter(table_plan(dataset, Path(folder)), part_rows=2) as writer:
        ...         for index in writer.plan.indices:
        ...             writer.add(label_table(dataset, [index]))
        ...     count = len([*Path(folder).iterdir()])
        >>> count, dict(writer.status)
        (2, {'labelled': 3})
    """

    def __init__(self, plan: TablePlan, part_rows: int) -> None:
        if part_rows < 1:
            raise ConfigError(f"a part must have rows, got {part_rows} (--part-rows)")
        self.plan, self.part_rows = plan, part_rows
        self.status = Counter(plan.status)
        self._rows: Table = {}
        self._began = time.monotonic()

    def __enter__(self) -> "PartWriter":
        return self

    def __exit__(self, *error: object) -> None:
        self.flush()

    def add(self, table: Table) -> None:
        """Take the rows of a batch."""
        for name, values in table.items():
            self._rows.setdefault(name, []).extend(values)
        is_old = time.monotonic() - self._began > PART_SECONDS
        if is_old or len(self._rows["key"]) >= self.part_rows:
            self.flush()

    def flush(self) -> None:
        """Write what has been gathered."""
        rows, self._rows = self._rows, {}
        self._began = time.monotonic()
        if rows and self.plan.write(rows) is not None:
            self.status.update(rows["status"])
