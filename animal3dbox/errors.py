"""The errors this package raises; each message says what was expected, what came and what to do."""


class Animal3DBoxError(Exception):
    """Base of every error that this package raises on purpose."""


class ShapeError(Animal3DBoxError, ValueError):
    """An array has the wrong shape, type or values; the message names it."""


class ConfigError(Animal3DBoxError, ValueError):
    """An option has a value it cannot have, or two options contradict each other."""


class ModelFileError(Animal3DBoxError, ValueError):
    """A body model's file is refused: says which file, where in it, what is wrong and what to do."""


class DatasetNotFoundError(Animal3DBoxError, FileNotFoundError):
    """The path given holds no annotations that are recognised."""


class DatasetFormatError(Animal3DBoxError, ValueError):
    """An annotation file as a whole cannot be read as what it should be."""


class SampleError(Animal3DBoxError, ValueError):
    """One sample is unusable; says which, in which field, why and what to do.

    Attributes:
        sample_id: the sample, as its dataset names it.
        field: the name of the faulty field.
        problem: what is wrong and, where there is one, the remedy.
    """

    def __init__(self, sample_id: str | None, field: str, problem: str) -> None:
        super().__init__(sample_id, field, problem)  # all three, so that the error survives pickling between workers
        self.sample_id = sample_id
        self.field = field
        self.problem = problem

    def __str__(self) -> str:
        return f"{self.sample_id or 'sample'}: {self.field}: {self.problem}"
