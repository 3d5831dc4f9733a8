"""The label cache: what was computed once is read the next time, by any process.

A folder for each fingerprint of method, body and code holds segments (segments.py), one a writing
process. Entries are found by the content that they were computed from, so nothing stale can be
read: another config, code or annotation is another key.
"""

import os
import time
from bisect import bisect_right
from collections import OrderedDict
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from animal3dbox.datasets.labelling.label_codec import packed_outcome, unpacked_outcome
from animal3dbox.datasets.storage.segments import SUFFIX, SegmentReader, SegmentWriter
from animal3dbox.errors import DatasetFormatError, ShapeError
from animal3dbox.labels.types import CuboidLabel, Rejection

REFRESH_S = 0.5
"""After a miss, other processes' new entries are looked for, but not more often than this."""
MAPPED = 64
"""So many segments are open at once in a process: each takes a file descriptor."""


@dataclass
class _State:
    """The segments that one process has open, and where each entry stands."""

    process: int
    readers: list[SegmentReader]
    names: set[str]
    halves: memoryview  # sorted first halves of the keys, as numbers
    segments: memoryview  # of the same keys, newest last among equal ones
    offsets: memoryview  # in their segments
    writer: SegmentWriter | None
    refreshed: float
    problems: tuple[str, ...]
    mapped: OrderedDict[int, None]  # readers that hold a map, the one used last at the end


class LabelCache:
    """Cached labels of one fingerprint.

    Safe to use from forked and spawned workers: each process opens its own files.

    Args:
        folder: of all caches; it may hold several fingerprints, and several datasets.
        fingerprint: 16 bytes that name everything that labels depend on, but the animal.

    Raises:
        DatasetFormatError: the folder cannot be made or is no folder.

    """

    def __init__(self, folder: Path, fingerprint: bytes) -> None:
        self.folder = folder / fingerprint.hex()
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise DatasetFormatError(
                f"the cache's folder {self.folder} cannot be made: {error}"
            ) from error
        self._state: _State | None = None

    def __getstate__(self) -> dict[str, object]:
        return {"folder": self.folder, "_state": None}

    def get(self, key: bytes) -> tuple[CuboidLabel | Rejection | None, bool]:
        """The outcome stored under a key, None if there is none; and whether a copy is damaged."""
        state = self._process_state()
        outcome, damaged = self._read(state, key)
        if outcome is None and time.monotonic() - state.refreshed > REFRESH_S:
            self._refresh(state)
            outcome, damaged = self._read(state, key)
        return outcome, damaged

    def put(self, key: bytes, outcome: CuboidLabel | Rejection) -> None:
        """Store an outcome.

        Raises OSError if it cannot be written, and then nothing has changed.
        """
        state = self._process_state()
        # Somebody may have emptied the folder: a file without a name would take labels unseen.
        if state.writer is None or not state.writer.path.exists():
            state.writer = SegmentWriter(self.folder)
            state.names.add(state.writer.path.name)
            state.readers.append(SegmentReader(state.writer.path))
        state.writer.append(key, packed_outcome(outcome))

    def __len__(self) -> int:
        """The number of entries that can be seen, copies included."""
        state = self._process_state()
        self._refresh(state)
        return len(state.halves)

    def problems(self) -> tuple[str, ...]:
        """The damages of the files, in whole sentences.

        Nothing in them is lost but what the sentences name, and that is made anew.
        """
        return self._process_state().problems

    def _problems_of(self, readers: list[SegmentReader]) -> tuple[str, ...]:
        problems = []
        for reader in readers:
            if reader.damaged:
                problems.append(
                    f"{reader.path.name} has {reader.damaged} damaged places: the disk or a program"
                    " changed it; their labels are made anew"
                )
            if reader.unfinished:
                problems.append(
                    f"{reader.path.name} ends within an entry: its process was killed or the file"
                    " was cut; what is missing is made anew"
                )
        return tuple(problems)

    def _process_state(self) -> _State:
        if self._state is None or self._state.process != os.getpid():
            empty = (
                np.zeros(0, np.uint64).data,
                np.zeros(0, np.int64).data,
                np.zeros(0, np.int64).data,
            )
            self._state = _State(os.getpid(), [], set(), *empty, None, 0.0, (), OrderedDict())
            self._refresh(self._state)
        return self._state

    def _refresh(self, state: _State) -> None:
        """Take in what has been written since the last look."""
        state.refreshed = time.monotonic()
        problems = self._open_new_segments(state)
        new: list[tuple[int, int, int]] = []
        for number, reader in enumerate(state.readers):
            try:
                entries = list(reader.new_entries())
            except (OSError, ValueError) as error:  # ValueError: cut while it was being mapped
                problems.append(
                    f"{reader.path.name} cannot be read ({error}): what is not found is made anew"
                )
                continue
            self._use(state, number)
            new += [(_half(key), number, offset) for key, offset in entries]
        if new:
            _merge_entries(state, new)
        state.problems = (*problems, *self._problems_of(state.readers))

    def _open_new_segments(self, state: _State) -> list[str]:
        """Open the segments that have appeared in the folder; what is wrong with the folder."""
        try:
            names = sorted(
                entry.name for entry in os.scandir(self.folder) if entry.name.endswith(SUFFIX)
            )
        except OSError as error:
            return [f"the cache's folder cannot be read ({error}): what is not found is made anew"]
        for name in names:
            if name not in state.names:
                state.names.add(name)
                state.readers.append(SegmentReader(self.folder / name))
        return []

    def _use(self, state: _State, number: int) -> None:
        """Note the use of a segment, and close the one not used for longest if many are open."""
        state.mapped[number] = None
        state.mapped.move_to_end(number)
        if len(state.mapped) > MAPPED:
            state.readers[state.mapped.popitem(last=False)[0]].release()

    def _read(self, state: _State, key: bytes) -> tuple[CuboidLabel | Rejection | None, bool]:
        """The newest whole copy of an entry, and whether a newer one is damaged."""
        half = _half(key)
        place = bisect_right(state.halves, half) - 1
        damaged = False
        while place >= 0 and state.halves[place] == half:
            number, offset = state.segments[place], state.offsets[place]
            place -= 1
            self._use(state, number)
            try:
                payload = state.readers[number].payload(offset, key)
            except (OSError, ValueError):  # the file is gone, or empty now
                payload = None
            if payload is None:
                damaged = True  # or, once in 2^64, another key's
                continue
            try:
                return unpacked_outcome(payload), damaged
            except (ShapeError, ValueError, KeyError, TypeError):
                damaged = True
        return None, damaged


def _merge_entries(state: _State, new: list[tuple[int, int, int]]) -> None:
    """Add entries (half of the key, segment, offset) to a process's sorted columns."""
    halves, segments, offsets = (
        np.concatenate((column, np.array(values, dtype=column.format)))
        for column, values in zip(
            (state.halves, state.segments, state.offsets), zip(*new, strict=True), strict=True
        )
    )
    order = np.argsort(halves, kind="stable")
    state.halves, state.segments, state.offsets = (
        column[order].data for column in (halves, segments, offsets)
    )


def _half(key: bytes) -> int:
    """The first half of a key as a number."""
    return int.from_bytes(key[:8], "little")
