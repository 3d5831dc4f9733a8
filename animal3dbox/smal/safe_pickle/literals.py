"""The pickle opcodes that stand for one plain value: numbers and strings, in text or in binary."""

import codecs
import re
import struct
from collections.abc import Callable

from animal3dbox.smal.safe_pickle.stream import DAMAGED, ByteStream, Global

_SHORT_LINE = 64
_NAME_LINE = 256
_LONG_BYTES = 9  # of the largest unsigned 64-bit number in two's complement
_INT = re.compile(rb"[+-]?[0-9]{1,20}")
_FLOAT = re.compile(
    rb"[+-]?(?:[0-9]+\.?[0-9]*(?:[eE][+-]?[0-9]+)?|\.[0-9]+(?:[eE][+-]?[0-9]+)?|inf|nan)"
)
_BAD_ESCAPE = re.compile(rb"\\(?!x[0-9a-fA-F]{2}|[nrt'\"abfv])")


def read_literal(stream: ByteStream, code: int) -> object:
    """The value of a literal opcode; KeyError cannot occur for a code of LITERALS."""
    return LITERALS[code](stream)


def read_name(stream: ByteStream) -> Global:
    """The global of a module and a name, on a line each."""
    return Global(_name(stream), _name(stream))


def read_index(stream: ByteStream) -> int:
    """The index of a memo's entry, in text."""
    line = stream.line(_SHORT_LINE)
    if not _INT.fullmatch(line) or int(line) < 0:
        raise stream.fail(f"an index of the memo was expected, got {line!r}", DAMAGED)
    return int(line)


def _name(stream: ByteStream) -> str:
    line = stream.line(_NAME_LINE)
    try:
        return line.decode("utf-8")
    except UnicodeDecodeError:
        raise stream.fail(f"a module or name was expected, got {line[:40]!r}", DAMAGED) from None


def _checked_int(stream: ByteStream, value: int) -> int:
    if not -(2**63) <= value < 2**64:
        raise stream.fail("a whole number of more than 64 bits")
    return value


def _text_int(stream: ByteStream, line: bytes) -> int:
    if not _INT.fullmatch(line):
        raise stream.fail(
            f"a whole number of at most 20 digits was expected, got {line[:40]!r}", DAMAGED
        )
    return _checked_int(stream, int(line))


def _int_or_bool(stream: ByteStream) -> int:
    line = stream.line(_SHORT_LINE)
    return {b"00": False, b"01": True}[line] if line in (b"00", b"01") else _text_int(stream, line)


def _text_long(stream: ByteStream) -> int:
    return _text_int(stream, stream.line(_SHORT_LINE).removesuffix(b"L"))


def _binary_long(stream: ByteStream, size: int) -> int:
    length = stream.unsigned(1) if size == 1 else stream.signed(4)
    if not 0 <= length <= _LONG_BYTES:
        raise stream.fail(f"a whole number of {length} bytes, which is not 0 to {_LONG_BYTES}")
    return _checked_int(stream, stream.signed(length))


def _text_float(stream: ByteStream) -> float:
    line = stream.line(_SHORT_LINE)
    if not _FLOAT.fullmatch(line):
        raise stream.fail(f"a number was expected, got {line[:40]!r}", DAMAGED)
    return float(line)


def _binary_float(stream: ByteStream) -> float:
    return float(struct.unpack(">d", stream.take(8))[0])


def _quoted(stream: ByteStream) -> str:
    """Python 2's repr of a byte string, as latin1 text."""
    line = stream.line()
    if len(line) < 2 or line[:1] != line[-1:] or line[:1] not in (b"'", b'"'):
        raise stream.fail(f"a quoted string was expected, got {line[:20]!r}", DAMAGED)
    inside = line[1:-1]
    if b"\\" not in inside:
        return inside.decode("latin1")
    if _BAD_ESCAPE.search(
        inside.replace(b"\\\\", b"  ")
    ):  # so that the codec below can neither fail nor warn
        raise stream.fail("a string with an escape that Python never writes", DAMAGED)
    return codecs.escape_decode(inside)[0].decode("latin1")


def _raw_unicode(stream: ByteStream) -> str:
    line = stream.line()
    try:
        return codecs.raw_unicode_escape_decode(line)[0]
    except UnicodeDecodeError:
        raise stream.fail("a text with a broken \\u escape", DAMAGED) from None


def _utf8(stream: ByteStream, size: int) -> str:
    raw = stream.sized(size)
    try:
        return raw.decode("utf-8", "surrogatepass")
    except UnicodeDecodeError:
        raise stream.fail("a text that is not UTF-8", DAMAGED) from None


def _old_binary_string(stream: ByteStream) -> str:
    length = stream.signed(4)
    if length < 0:
        raise stream.fail(f"a string of {length} bytes")
    return stream.take(length).decode("latin1")


LITERALS: dict[int, Callable[[ByteStream], object]] = {
    ord("I"): _int_or_bool,
    ord("J"): lambda s: s.signed(4),
    ord("K"): lambda s: s.unsigned(1),
    ord("M"): lambda s: s.unsigned(2),
    ord("L"): _text_long,
    0x8A: lambda s: _binary_long(s, 1),
    0x8B: lambda s: _binary_long(s, 4),
    ord("F"): _text_float,
    ord("G"): _binary_float,
    ord("S"): _quoted,
    ord("T"): _old_binary_string,
    ord("U"): lambda s: s.sized(1).decode("latin1"),
    ord("V"): _raw_unicode,
    ord("X"): lambda s: _utf8(s, 4),
    0x8C: lambda s: _utf8(s, 1),
    0x8D: lambda s: _utf8(s, 8),
    ord("B"): lambda s: s.sized(4),
    ord("C"): lambda s: s.sized(1),
    0x8E: lambda s: s.sized(8),
    0x96: lambda s: s.sized(8),
    ord("N"): lambda s: None,
    0x88: lambda s: True,
    0x89: lambda s: False,
    ord(")"): lambda s: (),
    ord("]"): lambda s: [],
    ord("}"): lambda s: {},
}
"""Opcode -> the function that reads its value."""
