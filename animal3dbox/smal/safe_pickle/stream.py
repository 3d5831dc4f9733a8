"""The bytes of a pickle and the limits under which they are read.

Every refusal is built here, with file and offset.
"""

from dataclasses import dataclass

from animal3dbox.errors import ModelFileError

DAMAGED = "the file is damaged or cut short: download or copy it again, in binary mode"
NOT_A_MODEL = (
    "a SMAL model file needs none of this: get the model from its authors' site, and do not open"
    " this file with pickle itself"
)
UNREADABLE = "if the file is an honest one of another kind, save this key as a plain NumPy array"


@dataclass(frozen=True)
class PickleLimits:
    """How much a model pickle may ask for; honest ones stay far below.

    Attributes:
        file_bytes: size of the file.
        opcodes: instructions in all; memory besides the file's own bytes grows with them alone.
        stack: values, and open marks, on the machine's stack.
        nesting: containers within containers.
        dense_cells: entries of a sparse matrix once it is filled.
    """

    file_bytes: int = 512 * 2**20
    opcodes: int = 200_000
    stack: int = 20_000
    nesting: int = 64
    dense_cells: int = 2**22


@dataclass(frozen=True, slots=True)
class Global:
    """A name that the file mentions; nothing is ever imported for it."""

    module: str
    name: str

    def __str__(self) -> str:
        """Short and printable, whatever the file calls it."""
        return ascii(f"{self.module[:60]}.{self.name[:60]}")[1:-1]


@dataclass(slots=True, eq=False, repr=False)
class Call:
    """A call, or a new object, that the file asks for and that is never made.

    Attributes:
        func: what would be called: a Global or, in a chain, another Call.
        args: the arguments.
        offset: where in the file the call stands.
        state: what BUILD would give the result; None before.
        has_state: whether there was a BUILD.
        added: what would be appended to the result or set in it.
    """

    func: object
    args: tuple[object, ...]
    offset: int
    state: object = None
    has_state: bool = False
    added: list[object] | None = None


def describe(value: object) -> str:
    """A few words on a value of any size and depth, for messages."""
    if isinstance(value, Global):
        return f"the global {value}"
    if isinstance(value, Call):
        return (
            "a call of"
            f" {value.func if isinstance(value.func, Global) else 'the result of another call'}"
        )
    if isinstance(value, str | bytes | list | tuple | dict):
        return f"a {type(value).__name__} of length {len(value)}"
    return repr(value)


def refusal(source: str, offset: int | None, problem: str, remedy: str) -> ModelFileError:
    """The error for a pickle that is not read on; an offset of None stands for the whole."""
    place = source if offset is None else f"{source}: at byte {offset}"
    return ModelFileError(f"{place}: {problem}; {remedy}")


class ByteStream:
    """The bytes of a pickle, taken from front to back and never beyond their end."""

    def __init__(self, data: bytes, source: str) -> None:
        self.data = data
        self.source = source
        self.position = 0
        self.opcode_at = 0

    @property
    def left(self) -> int:
        """The number of bytes that are not read yet."""
        return len(self.data) - self.position

    def fail(self, problem: str, remedy: str = NOT_A_MODEL) -> ModelFileError:
        """The error for the opcode that is being read."""
        return refusal(self.source, self.opcode_at, problem, remedy)

    def opcode(self) -> int:
        """The next opcode; later errors name its place."""
        self.opcode_at = self.position
        if not self.left:
            raise self.fail("the file ends before the pickle does", DAMAGED)
        return self.take(1)[0]

    def take(self, count: int) -> bytes:
        """The next bytes; their count is checked before anything is allocated."""
        if count > self.left:
            raise self.fail(f"{count} bytes are announced, but only {self.left} follow", DAMAGED)
        begin, self.position = self.position, self.position + count
        return self.data[begin : self.position]

    def unsigned(self, size: int) -> int:
        """The little-endian number in the next bytes, so many."""
        return int.from_bytes(self.take(size), "little")

    def signed(self, size: int) -> int:
        """The little-endian number in two's complement in the next bytes, so many."""
        return int.from_bytes(self.take(size), "little", signed=True)

    def sized(self, size: int) -> bytes:
        """The bytes that follow their own unsigned length, which takes size bytes."""
        return self.take(self.unsigned(size))

    def line(self, longest: int | None = None) -> bytes:
        """The bytes up to the next line feed, without it."""
        end = self.data.find(
            b"\n", self.position, None if longest is None else self.position + longest + 1
        )
        if end < 0 and longest is not None and longest < self.left:
            raise self.fail(
                f"a line of more than {longest} bytes where a short one belongs", DAMAGED
            )
        if end < 0:
            raise self.fail("the file ends within a line", DAMAGED)
        begin, self.position = self.position, end + 1
        return self.data[begin:end]
