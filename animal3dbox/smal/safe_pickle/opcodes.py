"""A stack machine for pickle's opcodes that imports nothing and calls nothing.

What a pickle would import becomes a Global, what it would call becomes a Call: inert records. All
else becomes plain values: int, float, str, bytes, bool, None, tuple, list, dict.
"""

from collections.abc import Callable

from animal3dbox.smal.safe_pickle.literals import LITERALS, read_index, read_literal, read_name
from animal3dbox.smal.safe_pickle.stream import (
    DAMAGED,
    ByteStream,
    Call,
    Global,
    PickleLimits,
    describe,
)

_PROTOCOL = 5
_STOP = ord(".")
_SET, _FROZEN_SET, _NEW_OBJECT_EX = (
    Global("builtins", "set"),
    Global("builtins", "frozenset"),
    Global("copyreg", "__newobj_ex__"),
)
_KEY_TYPES = (str, bytes, int, bool, type(None))  # hashed in time that does not depend on nesting


def run_pickle(stream: ByteStream, limits: PickleLimits) -> object:
    """The one value of a pickle that fills its stream.

    Where Python would import or call something, the value has an inert record: Global or Call.

    Raises:
        ModelFileError: naming the opcode's offset.

    """
    machine = _Machine(stream, limits)
    for _ in range(limits.opcodes):
        code = stream.opcode()
        if code == _STOP:
            return machine.result()
        if code in LITERALS:
            machine.push(read_literal(stream, code))
        elif code in _STACK_OPCODES:
            _STACK_OPCODES[code](machine)
        elif code in _REFUSED:
            raise stream.fail(_REFUSED[code])
        else:
            raise stream.fail(f"{bytes([code])!r} is no opcode of pickle", DAMAGED)
    raise stream.fail(f"more than {limits.opcodes} opcodes")


class _Machine:
    """The stack, marks and memo of a pickle that is being read."""

    def __init__(self, stream: ByteStream, limits: PickleLimits) -> None:
        self.stream = stream
        self.limits = limits
        self.stack: list[object] = []
        self.marks: list[int] = []
        self.memo: dict[int, object] = {}

    def push(self, value: object) -> None:
        """Put a value on the stack."""
        if len(self.stack) >= self.limits.stack:
            raise self.stream.fail(f"more than {self.limits.stack} values on the stack")
        self.stack.append(value)

    def _filled(self, count: int) -> None:
        if len(self.stack) - (self.marks[-1] if self.marks else 0) < count:
            raise self.stream.fail("an opcode that needs more values than there are", DAMAGED)

    def pop(self) -> object:
        """Take the top value off the stack."""
        self._filled(1)
        return self.stack.pop()

    def top(self) -> object:
        """The top value, which stays on the stack."""
        self._filled(1)
        return self.stack[-1]

    def mark(self) -> None:
        """MARK: remember the height of the stack."""
        if len(self.marks) >= self.limits.stack:
            raise self.stream.fail(f"more than {self.limits.stack} open marks")
        self.marks.append(len(self.stack))

    def since_mark(self) -> list[object]:
        """Take the values above the last mark, and the mark, off the stack."""
        if not self.marks:
            raise self.stream.fail("an opcode that needs a mark, and there is none", DAMAGED)
        begin = self.marks.pop()
        values = self.stack[begin:]
        del self.stack[begin:]
        return values

    def pop_any(self) -> None:
        """POP: the top value, or the mark if that is on top."""
        if self.marks and self.marks[-1] == len(self.stack):
            self.marks.pop()
        else:
            self.pop()

    def get(self, index: int) -> None:
        """GET: put an entry of the memo on the stack."""
        if index not in self.memo:
            raise self.stream.fail(f"the memo has no entry {index}", DAMAGED)
        self.push(self.memo[index])

    def put(self, index: int) -> None:
        """PUT: keep the top value in the memo."""
        self.memo[index] = self.top()

    def call(self, func: object, args: object) -> None:
        """Put the record of a call on the stack; nothing is called."""
        if not isinstance(func, Global | Call):
            raise self.stream.fail(f"a call of {describe(func)}")
        if not isinstance(args, tuple):
            raise self.stream.fail(f"a call with {describe(args)} for arguments")
        self.push(Call(func, args, self.stream.opcode_at))

    def tuple_of(self, count: int) -> None:
        """TUPLE1 to TUPLE3: make a tuple of the top values."""
        self._filled(count)
        values = tuple(self.stack[-count:])
        del self.stack[-count:]
        self.push(values)

    def append(self, values: list[object]) -> None:
        """APPEND and APPENDS: extend the list, or the record, that is on top."""
        target = self.top()
        if isinstance(target, list):
            target.extend(values)
        elif isinstance(target, Call):
            target.added = target.added or []
            target.added.extend(values)
        else:
            raise self.stream.fail(f"something is appended to {describe(target)}")

    def dict_of(self, values: list[object]) -> dict[object, object]:
        """The dictionary of keys and values in turn."""
        keys = values[::2]
        if len(values) % 2:
            raise self.stream.fail("a key without a value", DAMAGED)
        for key in keys:
            if type(key) not in _KEY_TYPES:
                raise self.stream.fail(
                    f"a dictionary's key must be a name or a number, got {describe(key)}"
                )
        return dict(zip(keys, values[1::2], strict=True))

    def set_items(self, values: list[object]) -> None:
        """SETITEM and SETITEMS: keys and values in turn, for what is on top."""
        target = self.top()
        if isinstance(target, dict):
            target.update(self.dict_of(values))
        elif isinstance(target, Call):
            self.append(values)
        else:
            raise self.stream.fail(f"items are set in {describe(target)}")

    def build(self) -> None:
        """BUILD: give the record under the top value that value as its state."""
        state, target = self.pop(), self.top()
        if not isinstance(target, Call):
            raise self.stream.fail(f"a state is given to {describe(target)}")
        if target.has_state:
            raise self.stream.fail("a second state is given to one object")
        target.state, target.has_state = state, True

    def result(self) -> object:
        """STOP: the one value that is left."""
        if self.marks or len(self.stack) != 1:
            raise self.stream.fail(
                f"the pickle ends with {len(self.stack)} values where one belongs", DAMAGED
            )
        if self.stream.left:
            raise self.stream.fail(
                f"{self.stream.left} bytes follow the end of the pickle", DAMAGED
            )
        return self.stack[0]


def _protocol(m: _Machine) -> None:
    version = m.stream.unsigned(1)
    if m.stream.opcode_at != 0 or version > _PROTOCOL:
        raise m.stream.fail(
            f"protocol {version} is announced; 0 to {_PROTOCOL} are known, and only at the file's"
            " beginning",
            DAMAGED,
        )


def _frame(m: _Machine) -> None:
    length = m.stream.unsigned(8)
    if length > m.stream.left:
        raise m.stream.fail(
            f"a frame of {length} bytes is announced, but only {m.stream.left} follow", DAMAGED
        )


def _stack_global(m: _Machine) -> None:
    name, module = m.pop(), m.pop()
    if not isinstance(name, str) or not isinstance(module, str):
        raise m.stream.fail(
            f"a global must be named by two texts, got {describe(module)} and {describe(name)}"
        )
    m.push(Global(module, name))


def _reduce(m: _Machine) -> None:
    args, func = m.pop(), m.pop()
    m.call(func, args)


def _new_object_ex(m: _Machine) -> None:
    kwargs, args, func = m.pop(), m.pop(), m.pop()
    m.call(_NEW_OBJECT_EX, (func, args, kwargs))


def _instance(m: _Machine) -> None:
    func = read_name(m.stream)
    m.call(func, tuple(m.since_mark()))


def _object(m: _Machine) -> None:
    values = m.since_mark()
    if not values:
        raise m.stream.fail("an object without a class", DAMAGED)
    m.call(values[0], tuple(values[1:]))


def _append_one(m: _Machine) -> None:
    value = m.pop()
    m.append([value])


def _set_item(m: _Machine) -> None:
    value, key = m.pop(), m.pop()
    m.set_items([key, value])


def _frozen_set(m: _Machine) -> None:
    m.call(_FROZEN_SET, (m.since_mark(),))


def _read_only(m: _Machine) -> None:
    if not isinstance(m.top(), bytes):
        raise m.stream.fail(f"a buffer was expected, got {describe(m.top())}")


_STACK_OPCODES: dict[int, Callable[[_Machine], None]] = {
    0x80: _protocol,
    0x95: _frame,
    ord("("): _Machine.mark,
    ord("0"): _Machine.pop_any,
    ord("1"): lambda m: m.since_mark().clear(),
    ord("2"): lambda m: m.push(m.top()),
    ord("g"): lambda m: m.get(read_index(m.stream)),
    ord("h"): lambda m: m.get(m.stream.unsigned(1)),
    ord("j"): lambda m: m.get(m.stream.unsigned(4)),
    ord("p"): lambda m: m.put(read_index(m.stream)),
    ord("q"): lambda m: m.put(m.stream.unsigned(1)),
    ord("r"): lambda m: m.put(m.stream.unsigned(4)),
    0x94: lambda m: m.put(len(m.memo)),
    ord("t"): lambda m: m.push(tuple(m.since_mark())),
    0x85: lambda m: m.tuple_of(1),
    0x86: lambda m: m.tuple_of(2),
    0x87: lambda m: m.tuple_of(3),
    ord("l"): lambda m: m.push(m.since_mark()),
    ord("a"): _append_one,
    ord("e"): lambda m: m.append(m.since_mark()),
    ord("d"): lambda m: m.push(m.dict_of(m.since_mark())),
    ord("s"): _set_item,
    ord("u"): lambda m: m.set_items(m.since_mark()),
    0x8F: lambda m: m.call(_SET, ()),
    0x90: lambda m: m.append(m.since_mark()),
    0x91: _frozen_set,
    ord("c"): lambda m: m.push(read_name(m.stream)),
    0x93: _stack_global,
    ord("R"): _reduce,
    0x81: _reduce,
    0x92: _new_object_ex,
    ord("i"): _instance,
    ord("o"): _object,
    ord("b"): _Machine.build,
    0x98: _read_only,
}
_REFUSED = {
    ord("P"): "an object that is stored elsewhere (persistent id)",
    ord("Q"): "an object that is stored elsewhere (persistent id)",
    0x82: "an object of the extension registry",
    0x83: "an object of the extension registry",
    0x84: "an object of the extension registry",
    0x97: "a buffer that is stored elsewhere",
}
