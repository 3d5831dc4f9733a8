"""A dataset's report: the animals that were left out and why, by all processes that load it.

A line a case, appended to one file: workers come and go, but what they wrote stays, also after kill
-9. A line is written by a single call, which the file system does not mix with others'.
"""

import os
import tempfile
import weakref
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from uuid import uuid4

import msgspec

from animal3dbox.errors import Animal3DBoxError
from animal3dbox.files import user_path


class CaseFileError(Animal3DBoxError, OSError):
    """A case could not be written down: rather than lose it, loading stops."""


class Case(msgspec.Struct, frozen=True, kw_only=True):
    """One animal or image that did not come through.

    Attributes:
        kind: "fault" (unusable), "rejected" (no label could be made), "filtered" (a label that a
            filter refused) or "cache" (a cached label that was damaged and was made anew, or could
            not be stored; nothing is lost).
        sample_id: which.
        field: of the record, or of the filter.
        problem: why, and what to do.
    """

    kind: str
    sample_id: str
    field: str
    problem: str

    def __str__(self) -> str:
        return f"{self.sample_id}: {self.field}: {self.problem}"


@dataclass(frozen=True)
class LoadReport:
    """The animals and images that were left out so far, by every process.

    Attributes:
        cases: each once, however often it was met; in the order in which they were met first.

    Example:
        >>> case = Case(kind="fault", sample_id="a.jpg", field="image", problem="cannot be decoded")
        >>> print(LoadReport((case,)))
        left out: 1 fault
          fault: a.jpg: image: cannot be decoded
    """

    cases: tuple[Case, ...]

    @property
    def counts(self) -> dict[str, int]:
        """Kind -> how many cases."""
        return dict(Counter(case.kind for case in self.cases))

    def of(self, kind: str) -> tuple[Case, ...]:
        """The cases of one kind."""
        return tuple(case for case in self.cases if case.kind == kind)

    def __str__(self) -> str:
        counted = ", ".join(f"{count} {kind}" for kind, count in self.counts.items()) or "nothing"
        return "\n".join(
            [f"left out: {counted}", *(f"  {case.kind}: {case}" for case in self.cases)]
        )


class CaseFile:
    """The file of cases of one dataset.

    Args:
        path: kept, and read again by a later run; None: a temporary file, which is made for the
            first case and ends with this object.

    """

    def __init__(self, path: Path | str | None = None) -> None:
        if path is None:
            self.path = Path(tempfile.gettempdir(), f"animal3dbox-{uuid4().hex}.jsonl")
            self._mode = 0o600  # in a folder of everybody's
            weakref.finalize(self, _remove_in, os.getpid(), self.path)
        else:
            self.path, self._mode = user_path(path), 0o644
            self.path.parent.mkdir(parents=True, exist_ok=True)
        self._written: set[Case] | None = None

    def add(self, case: Case) -> None:
        """Write one case down, unless it stands there: an epoch that meets it again writes nothing.

        Raises:
            CaseFileError: it cannot be written.

        """
        if self._written is None:
            self._written = set(self.report().cases)
        if case in self._written:
            return
        line = msgspec.json.encode(case) + b"\n"
        try:
            descriptor = os.open(self.path, os.O_WRONLY | os.O_APPEND | os.O_CREAT, self._mode)
            try:
                written = os.write(descriptor, line)
            finally:
                os.close(descriptor)
        except OSError as error:
            raise CaseFileError(f"{case} could not be written to {self.path}: {error}") from error
        if written != len(line):
            raise CaseFileError(
                f"{case} could not be written whole to {self.path}: is the disk full?"
            )
        self._written.add(case)

    def report(self) -> LoadReport:
        """All cases that processes have written so far, but a last line cut off by a crash."""
        cases: dict[Case, None] = {}
        lines = self.path.read_bytes().split(b"\n")[:-1] if self.path.exists() else []
        for line in lines:
            try:
                case = msgspec.json.decode(line, type=Case)
            except msgspec.DecodeError:
                case = Case(
                    kind="fault",
                    sample_id=self.path.name,
                    field="line",
                    problem=f"is damaged: {line[:80]!r}",
                )
            cases[case] = None
        return LoadReport(tuple(cases))


def _remove_in(process: int, path: Path) -> None:
    """Remove a temporary file, but not at the end of a worker that only inherited it."""
    if os.getpid() == process:
        path.unlink(missing_ok=True)
