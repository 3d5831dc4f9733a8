"""Pickles that ask for code to run, for memory, or for a crash; by class."""

import struct
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.sparse import csc_matrix
from smal_pickles import (
    Made,
    Name,
    Raw,
    python2_dtype,
    python2_pickle,
    python2_record,
    random_content,
    written,
)

FLAG = ("hostile_target", "fire")
"""A function that the watching process defines: to call it, nothing need be imported."""

COMMANDS = (
    ("os", "system"), ("posix", "system"), ("nt", "system"), ("os", "popen"), ("subprocess",
        "getoutput"), ("subprocess", "check_call"),
    ("pty", "spawn"), ("commands", "getoutput"),
)  # fmt: skip
CODE = (
    ("builtins", "eval"), ("builtins", "exec"), ("__builtin__", "eval"), ("__builtin__",
        "execfile"), ("timeit", "timeit"), ("cProfile", "run"),
    ("pdb", "run"), ("code", "interact"), ("numpy.testing._private.utils", "runstring"),
    ("numpy.f2py.crackfortran", "myeval"),
    ("torch._inductor.codecache", "compile_file"), ("trace", "run"),
)  # fmt: skip
FILES = (
    ("builtins", "__import__"), ("importlib", "import_module"), ("runpy", "run_path"), ("pickle",
        "load"), ("pickle", "loads"), ("torch", "load"),
    ("numpy", "load"), ("shutil", "rmtree"), ("os", "remove"), ("webbrowser", "open"), ("socket",
        "create_connection"), ("_io", "FileIO"),
)  # fmt: skip
NATIVE = (
    ("numpy", "memmap"), ("numpy.core.memmap", "memmap"), ("numpy._core.memmap", "memmap"),
    ("numpy", "fromfile"), ("numpy", "save"),
    ("ctypes", "CDLL"), ("ctypes", "PyDLL"), ("ctypes", "string_at"), ("_ctypes", "dlopen"),
    ("ctypes.util", "find_library"),
    ("numpy.ctypeslib", "load_library"), ("numpy.f2py.diagnose", "run"), ("numpy.f2py", "compile"),
    ("numpy.f2py.capi_maps", "load_f2cmap_file"),
    ("numpy.distutils.exec_command", "exec_command"), ("cffi", "FFI"), ("mmap", "mmap"),
    ("torch.ops", "load_library"),
    ("torch.storage", "_load_from_bytes"), ("scipy.io", "loadmat"),
)  # fmt: skip
PROTOCOLS = (0, 1, 2, 4, 5)


def text(value: str) -> bytes:
    raw = value.encode("utf-8", "surrogatepass")
    return b"X" + struct.pack("<I", len(raw)) + raw


def named(module: str, name: str) -> bytes:
    return f"c{module}\n{name}\n".encode()


def stack_named(module: str, name: str) -> bytes:
    return text(module) + text(name) + b"\x93"


def payloads(marker: Path) -> list[tuple[tuple[str, str], bytes]]:
    """Functions with arguments (opcodes, no tuple) that create the marker if they are called."""
    script = f"open({str(marker)!r}, 'w')"
    found = [(name, text(f"touch {marker}")) for name in COMMANDS] + [
        (name, text(script)) for name in CODE
    ]
    return [
        *found,
        *((name, text(str(marker))) for name in FILES),
        (("builtins", "open"), text(str(marker)) + text("w")),
        (FLAG, b""),
    ]


def within(snippet: bytes, key: str = "v_template") -> bytes:
    """An honest file with one value replaced by opcodes."""
    return python2_pickle({**random_content(), key: Raw(snippet)}, 2)


def alone(snippet: bytes) -> bytes:
    return b"\x80\x04" + snippet + b"."


def reduced(marker: Path) -> list[bytes]:
    calls = [named(*name) + b"(" + args + b"tR" for name, args in payloads(marker)]
    return (
        [alone(call) for call in calls]
        + [within(call) for call in calls]
        + [within(call, "J_regressor") for call in calls[:8]]
    )


def stack_globals(marker: Path) -> list[bytes]:
    dotted = [(("os", "path.os.system"), text("true")), (FLAG, b"")]
    files = [
        within(stack_named(*name) + b"(" + args + b"tR")
        for name, args in [*payloads(marker), *dotted]
    ]
    wrong = [
        b"K\x01K\x02\x93",
        b"NN\x93",
        text("os") + b"\x93",
        b"]]\x93",
        named("os", "system") + text("x") + b"\x93",
    ]
    return files + [alone(snippet) for snippet in wrong]


def instances(marker: Path) -> list[bytes]:
    made = []
    for (module, name), args in payloads(marker):
        made += [
            within(b"(" + args + f"i{module}\n{name}\n".encode()),
            within(b"(" + named(module, name) + args + b"o"),
            within(named(module, name) + b"(" + args + b"t\x81"),
            within(named(module, name) + b"(" + args + b"t}\x92"),
        ]
    return [
        *made,
        alone(b"(o"),
        alone(b"o"),
        alone(b"i"),
        alone(b"(iabc"),
        alone(b"K\x01)\x81"),
        alone(b"K\x01)}\x92"),
    ]


def states(marker: Path) -> list[bytes]:
    ndarray = (
        named("numpy.core.multiarray", "_reconstruct")
        + named("numpy", "ndarray")
        + b"K\x00\x85U\x01b\x87R"
    )
    chumpy = named("chumpy.ch", "Ch") + b")\x81"
    fire = named(*FLAG) + b")R"
    targets = [
        b"]",
        b"}",
        b")",
        b"K\x01",
        named("os", "environ"),
        named("sys", "modules"),
        named("builtins", "dict"),
    ]
    plain = [alone(target + b"}" + text("x") + fire + b"sb") for target in targets]
    arrays = [
        within(ndarray + state + b"b")
        for state in (
            b")",
            b"}",
            b"N",
            fire,
            b"(K\x01)N\x89U\x00t",
            b"(" + fire * 5 + b"t",
            b"]",
            b"(K\x02)" + fire + b"\x89U\x00t",
        )
    ]
    chumpies = [
        within(chumpy + state + b"b")
        for state in (
            fire,
            b"}",
            b"N",
            b")",
            b"}U\x01x" + fire + b"s",
            b"}U\x0c__setstate__" + fire + b"s",
        )
    ]
    twice = [
        within(ndarray + b")b)b"),
        within(chumpy + b"}b}b"),
        alone(b"}b"),
        alone(named("os", "system") + text(f"touch {marker}") + b"b"),
    ]
    setter = named("hostile_target", "Setter") + b")\x81" + text("x") + b"b"
    return [
        *plain,
        *arrays,
        *chumpies,
        *twice,
        within(setter),
        alone(setter),
        within(chumpy + b"}U\x01x" + setter + b"sb"),
    ]


def extensions(marker: Path) -> list[bytes]:
    codes = [
        b"\x82\x01",
        b"\x82\xff",
        b"\x82\x00",
        b"\x83\x01\x00",
        b"\x83\xff\xff",
        b"\x84\x01\x00\x00\x00",
        b"\x84\xff\xff\xff\x7f",
        b"\x84\xff\xff\xff\xff",
    ]
    persistent = [b"P0\n", b"Pos.system\n", b"K\x01Q", b")Q", b"\x97", b"\x97\x98"]
    return [file for code in [*codes, *persistent] for file in (alone(code), within(code))]


def attribute_chains(marker: Path) -> list[bytes]:
    files = []
    for module in ("builtins", "__builtin__"):
        getter = named(module, "getattr")
        imported = named(module, "__import__") + text("os") + b"\x85R"
        files += [
            within(
                getter + imported + text("system") + b"\x86R" + text(f"touch {marker}") + b"\x85R"
            )
        ]
        files += [
            within(getter + named(*FLAG) + text("__call__") + b"\x86R)R"),
            within(getter + named(module, "type") + text("mro") + b"\x86R)R"),
        ]
        files += [
            within(named(module, "map") + named(*FLAG) + b"]K\x01a\x86R"),
            within(named(module, "vars") + named(module, "type") + b"\x85R"),
        ]
    for maker in (
        ("operator", "attrgetter"),
        ("operator", "methodcaller"),
        ("functools", "partial"),
        ("types", "FunctionType"),
        ("types", "CodeType"),
    ):
        files += [
            within(
                named(*maker)
                + text("fire")
                + b"\x85R"
                + named("hostile_target", "module")
                + b"\x85R"
            )
        ]
        files += [within(stack_named(*maker) + named(*FLAG) + b"\x85R)R")]
    deep = named(*FLAG) + b")R" * 5000
    return [*files, within(deep), alone(deep)]


def native_names(marker: Path) -> list[bytes]:
    call = [
        within(named(*name) + text(str(marker)) + b"\x85R", key)
        for name in NATIVE
        for key in ("v_template", "kintree_table")
    ]
    mapped = Made(
        Name("numpy.core.multiarray", "_reconstruct"),
        (Name("numpy", "memmap"), (0,), "b"),
        (1, (12, 3), python2_dtype(np.dtype(float)), False, b"\0" * 288),
    )
    return [
        *call,
        python2_pickle({**random_content(), "v_template": mapped}, 2),
        python2_pickle({**random_content(), "v_template": mapped}, 0),
    ]


def recursive(marker: Path) -> list[bytes]:
    chumpy = named("chumpy.ch", "Ch") + b")\x81q\xc8"
    loops = [
        b"]q\xc8h\xc8a", b"}q\xc8U\x01ah\xc8s", b"(]q\xc8h\xc8tq\xc9h\xc8h\xc9a0",
        b"]q\xc8]q\xc9h\xc8ah\xc9a", b"}q\xc8K\x01]h\xc8as",
        chumpy + b"}U\x01xh\xc8sb", chumpy + b"h\xc8b", chumpy + b"}U\x01x]h\xc8asb",
        b"\x8fq\xc8(h\xc8\x90", named("a", "b") + b")Rq\xc8h\xc8b",
    ]  # fmt: skip
    deep = [
        b")" + b"\x85" * 100_000, b"(" * 15_000 + b"l" + b"l" * 14_999,
        b"]" * 15_000 + b"a" * 14_999, b"N" + b"\x85" * 150_000,
        b"(" * 15_000 + b"t" * 15_000,
        b"}" + b"U\x01a}" * 6000 + b"s" * 6000, named("a", "b") + b")R" * 60_000,
        b")" + b"\x85" * 64, named("chumpy.ch", "Ch") + b")\x81}U\x01x" * 1,
        (named("chumpy.ch", "Ch") + b")\x81}U\x01x") * 5000 + b"]" + b"sb" * 5000,
    ]  # fmt: skip
    return [make(snippet) for snippet in [*loops, *deep] for make in (alone, within)]


def memo_bombs(marker: Path) -> list[bytes]:
    files = []
    for depth in (30, 60, 2000):
        for start, step in (
            (b")", b"2\x86"),
            (b"K\x01", b"2\x86"),
            (b"]K\x01a", b"q\xc8]h\xc8ah\xc8a"),
            (b"}", b"q\xc8}K\x01h\xc8sK\x02h\xc8s"),
        ):
            body = (
                step * depth
                if step[:1] == b"2"
                else step.replace(b"]", b"0]").replace(b"}", b"0}") * depth
            )
            files += [alone(start + body), within(start + body)]
    floods = [
        b"N" + b"2" * 199_000,
        b"N" + b"2\x94" * 120_000,
        b"]" + b"\x94" * 300_000 + b"0N",
        b"]" * 250_000,
        b"(" * 250_000,
        b"]\x940" * 66_000 + b"N",
    ]
    floods += [
        b"\x8f\x940" * 66_000 + b"N",
        b"}\x940" * 66_000 + b"N",
        b"cab\ncd\n\x940" * 66_000 + b"N",
        b"Nj\xff\xff\xff\xff",
        b"h\x07",
        b"g99999999999\n",
        b"Np-1\n",
    ]
    row, array = b"(" + b"K\x01" * 19_000 + b"l", python2_pickle(np.zeros(2**17), 2)[2:-1]
    floods += [b"](" + shared + b"q\xc8" + b"h\xc8" * 10_000 + b"e" for shared in (row, array)]
    return [*files, *(make(flood) for flood in floods for make in (alone, within))]


def huge(marker: Path) -> list[bytes]:
    big4, big8 = b"\xff\xff\xff\x7f", b"\xff" * 7 + b"\x7f"
    lengths = [
        b"T" + big4, b"T\xff\xff\xff\xff", b"U\xff", b"B\xff\xff\xff\xff", b"C\xff", b"\x8e" + big8,
        b"\x8e" + b"\xff" * 8, b"X\xff\xff\xff\xff",
        b"\x8c\xff", b"\x8d" + big8, b"\x96" + big8, b"\x95" + big8 + b"N", b"\x8b" + big4,
        b"\x8b\xff\xff\xff\xff", b"\x8a\xff",
        b"\x8a\x20" + b"\x7f" * 32,
        b"I" + b"9" * 100_000 + b"\n", b"L" + b"9" * 1_000_000 + b"L\n",
        b"L99999999999999999999999L\n", b"F1e" + b"9" * 5000 + b"\n", b"I1_0\n",
        b"I 1\n", b"\x80\xff",
    ]  # fmt: skip
    shapes = [
        (2**31, 2**31), (2**62,), (-1,), (-2, -3), (True, 6), (2.0, 3.0), ("2", "3"), (None,), (2,
            3, 2**32 - 1), (0, 2**31, 2**31),
        (0, 2**32 - 1, 2**32 - 1, 2**32 - 1),
        (1,) * 40, (2**64 - 1, 2), (7, 3), (5,), [2, 3], 6, None, (), ((2,), 3),
    ]  # fmt: skip
    honest = python2_record(np.zeros((2, 3)), 2)
    assert isinstance(honest.state, tuple)
    arrays = [replace(honest, state=(1, shape, *honest.state[2:])) for shape in shapes]
    arrays.append(
        replace(honest, state=(1, (0, 2**32 - 1, 2**32 - 1, 2**32 - 1), *honest.state[2:4], b""))
    )
    types = [
        "O8",
        "V8",
        "S8",
        "M8[s]",
        "f16",
        "c16",
        "f8,f8",
        "8f8",
        "(1000000000,1000000000)f8",
        "U2",
        "f3",
        "",
        "object",
        "i1000000",
    ]
    arrays += [
        replace(
            honest,
            state=(
                *honest.state[:2],
                Made(Name("numpy", "dtype"), (t, 0, 1), (3, "<", None, None, None, -1, -1, 0)),
                *honest.state[3:],
            ),
        )
        for t in types
    ]
    details: list[object] = [
        (3, "<"),
        (3, "<", (1, 2), None, None, -1, -1, 0),
        None,
        (3, "<", None, ("a",), {}, -1, -1, 0),
        5,
    ]
    wrong = [Made(Name("numpy", "dtype"), ("f8", 0, 1), detail) for detail in details]
    arrays += [
        replace(honest, state=(*honest.state[:2], dtype, *honest.state[3:])) for dtype in wrong
    ]
    return [
        *(make(s) for s in lengths for make in (alone, within)),
        *(python2_pickle({**random_content(), "v_template": a}, 2) for a in arrays),
    ]


def sparse_states() -> list[dict[str, object]]:
    matrix = csc_matrix(np.arange(35.0 * 12).reshape(35, 12) % 5)
    honest = {
        "_shape": (35, 12),
        "indptr": matrix.indptr,
        "indices": matrix.indices,
        "data": matrix.data,
    }
    total, count = len(matrix.data), np.int32

    def pointers(*values: int, dtype: type = count) -> dict[str, object]:
        return {**honest, "indptr": np.array(values).astype(dtype)}

    even = [*range(12), total]
    rows = [
        np.where(np.arange(total) == 3, bad, matrix.indices)
        for bad in (-1, 35, 2**31 - 1, -(2**31))
    ]
    return [
        pointers(-5, *even[1:]), pointers(*even[:5], -1, *even[6:]), pointers(*even[:5], 99,
            *even[6:]), pointers(*even[:-1], total + 1),
        pointers(*even[:-1], 2**31 - 1),
        pointers(*even, total), pointers(0), pointers(), pointers(1, *even[1:]), pointers(*even,
            dtype=np.float64),
        {**honest, "indptr": np.zeros((1, 13), np.int32)},
        *({**honest, "indices": row} for row in rows), {**honest, "indices": matrix.indices[:-1]},
        {**honest, "indices": matrix.indices.astype(float)},
        {**honest, "indices": np.full(total, 2**64 - 1, np.uint64)}, {**honest,
            "indptr": np.full(13, 2**64 - 1, np.uint64)},
        {**honest, "data": matrix.data[:-1]}, {**honest, "data": matrix.data[None]}, {**honest,
            "_shape": (2**31, 2**31)},
        {**honest, "_shape": (-35, 12)},
        {**honest, "_shape": (35, 12, 1)}, {**honest, "_shape": (2**22, 12)}, {**honest,
            "_shape": (12, 35)}, {**honest, "_shape": None},
        {k: v for k, v in honest.items() if k != "indptr"}, {k: v for k,
            v in honest.items() if k != "_shape"}, {},
        {**honest, "data": np.full(total, np.inf)},
    ]  # fmt: skip


def sparse(marker: Path) -> list[bytes]:
    kind = Name("scipy.sparse.csc", "csc_matrix")
    return [
        python2_pickle({**random_content(), "J_regressor": Made(kind, (), state)}, 2)
        for state in sparse_states()
    ]


def truncated(marker: Path) -> list[bytes]:
    honest = [written(random_content(), protocol) for protocol in PROTOCOLS]
    return [file[: len(file) * k // 12] for file in honest for k in range(12)] + [
        file[:-1] for file in honest
    ]


def trailing(marker: Path) -> list[bytes]:
    call = named("os", "system") + text(f"touch {marker}") + b"\x85R."
    tails = (b"\n", b".", b"\0", b"N.", call, b"\0" * 100_000)
    return [written(random_content(), protocol) + tail for protocol in PROTOCOLS for tail in tails]


def misshapen(marker: Path) -> list[bytes]:
    """Files that no pickler writes.

    Keys that hash for ever, appending to the wrong thing, unknown opcodes.
    """
    bomb = b")" + b"2\x86" * 60
    keys = [
        bomb,
        b"]",
        b"}",
        named("os", "system"),
        named(*FLAG) + b")R",
        b"G" + struct.pack(">d", 1.0),
    ]
    files = [alone(b"}" + key + b"Ns") for key in keys] + [
        within(b"}(" + key + b"Nu") for key in keys
    ]
    codes = [
        b"\xff",
        b"A",
        b"z",
        b"Na",
        b"NNa",
        b"NNNs",
        b"N(Ne",
        b"N(NNu",
        b"K\x01)R",
        b"NNR",
        named("a", "b") + b"NR",
        b"t",
        b"(((",
        b"a",
        b"0",
        b"1",
        b"2",
    ]
    codes += [
        b"N\x98",
        b"S'a\n",
        b"Sa\n",
        b"S'\\q'\n",
        b"S'\\x4'\n",
        b"S'\\'\n",
        b"V\\u12\n",
        b"X\x02\x00\x00\x00\xff\xfe",
        b"c\xff\nx\n",
        b"(NdN",
        b"(NNNd",
        b"NN",
        b"",
    ]
    return files + [alone(code) for code in codes]


CLASSES: dict[str, tuple[Callable[[Path], list[bytes]], int]] = {
    "reduce": (reduced, 60), "build": (states, 25), "stack_global": (stack_globals, 30),
    "inst_obj": (instances, 100), "extension": (extensions, 20),
    "getattr": (attribute_chains, 20), "native": (native_names, 40), "recursive": (recursive, 30),
    "memo_bomb": (memo_bombs, 40), "huge": (huge, 70),
    "sparse": (sparse, 25), "truncated": (truncated, 60), "trailing": (trailing, 30),
    "misshapen": (misshapen, 35),
}  # fmt: skip
"""Class -> its files, given the path that none of them may create, and how many there are at least.
"""


def harmless_extras(marker: Path) -> list[bytes]:
    """Honest files with calls under a key that nobody needs: these are read."""
    return [within(named(*name) + b"(" + args + b"tR", "extra") for name, args in payloads(marker)]
