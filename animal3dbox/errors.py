"""The errors this package raises; each message says what was expected, what came and what to do."""

import json
import re

_NOTE = "animal3dbox sample error: "
_ADDRESS = re.compile(r" at 0x[0-9a-fA-F]+")


def without_addresses(message: str) -> str:
    """Another library's message without addresses in memory, which differ from run to run.

    Example:
        >>> without_addresses("cannot read <_io.BytesIO object at 0x7f2c81a0>")
        'cannot read <_io.BytesIO object>'
    """
    return _ADDRESS.sub("", message)


class Animal3DBoxError(Exception):
    """Base of every error that this package raises on purpose."""


class ShapeError(Animal3DBoxError, ValueError):
    """An array has the wrong shape, type or values; the message names it."""


class ConfigError(Animal3DBoxError, ValueError):
    """An option has a value it cannot have, or two options contradict each other."""


class ModelFileError(Animal3DBoxError, ValueError):
    """A body model's file is refused.

    Says which file, where in it, what is wrong and what to do.
    """


class DatasetNotFoundError(Animal3DBoxError, FileNotFoundError):
    """The path given holds no annotations that are recognised."""


class DatasetFormatError(Animal3DBoxError, ValueError):
    """An annotation file as a whole cannot be read as what it should be."""


class WorkerError(Animal3DBoxError, OSError):
    """A worker process ended before its work: it was killed, or the machine ran out of memory."""


class SampleError(Animal3DBoxError, ValueError):
    """One sample is unusable; says which, in which field, why and what to do.

    Attributes:
        sample_id: the sample, as its dataset names it.
        field: the name of the faulty field.
        problem: what is wrong and, where there is one, the remedy.
    """

    def __init__(
        self, sample_id: str | None, field: str | None = None, problem: str | None = None
    ) -> None:
        if (
            field is None or problem is None
        ):  # torch's DataLoader makes a worker's error anew from its printed traceback alone
            told = str(sample_id)
            sample_id, field, problem = _told_by_worker(told)
            self.add_note(told)
        super().__init__(
            sample_id, field, problem
        )  # all three, so that the error survives pickling between processes
        self.sample_id = sample_id
        self.field = field
        self.problem = problem

    def __str__(self) -> str:
        return f"{self.sample_id or 'sample'}: {self.field}: {self.problem}"

    def note_for_parent(self) -> None:
        """Add a note to the traceback from which the parent of a worker makes the error anew."""
        self.add_note(_NOTE + json.dumps([self.sample_id, self.field, self.problem]))


def _told_by_worker(traceback: str) -> tuple[str | None, str, str]:
    """Sample, field and problem of a worker's printed traceback."""
    for line in reversed(traceback.splitlines()):
        if line.startswith(_NOTE):
            sample_id, field, problem = json.loads(line.removeprefix(_NOTE))
            return sample_id, field, problem
    return None, "unknown", traceback
