import json
import pickle
import subprocess
import sys
from pathlib import Path
from typing import Any

import hostile_pickles
import numpy as np
import pytest
import smal_pickles
from hostile_pickles import CLASSES, alone
from hypothesis import given
from hypothesis import strategies as st
from smal_pickles import (
    Chumpy,
    Name,
    Unicode,
    python2_pickle,
    python3_pickle,
    random_content,
    written,
)

from animal3dbox.errors import ModelFileError
from animal3dbox.smal.safe_pickle.arrays import Place, read_array, read_array_list
from animal3dbox.smal.safe_pickle.reader import DEFAULT_LIMITS, parse_pickle, read_pickle
from animal3dbox.smal.safe_pickle.stream import Call, Global, PickleLimits

WATCH = Path(smal_pickles.__file__).with_name("pickle_watch.py")

plain = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**63), 2**64 - 1)
    | st.floats(allow_nan=False)
    | st.text()
    | st.binary(),
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.tuples(inner, inner, inner, inner)
        | st.tuples(inner)
        | st.dictionaries(st.text(), inner, max_size=4)
    ),
    max_leaves=12,
)
plain_python2 = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**63), 2**64 - 1)
    | st.floats(allow_nan=False)
    | st.text(st.characters(max_codepoint=255)),
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.tuples(inner, inner, inner, inner)
        | st.tuples(inner)
        | st.dictionaries(st.just("k"), inner, max_size=4)
    ),
    max_leaves=12,
)


def parse(data: bytes) -> Any:
    return parse_pickle(data, "test.pkl")


def place(key: str = "key") -> Place:
    return Place("test.pkl", key, DEFAULT_LIMITS)


def without_bytes(value: object) -> bool:
    """Whether a value holds no bytes: protocols 0 to 2 write them as calls."""
    if isinstance(value, list | tuple):
        return all(map(without_bytes, value))
    return (
        all(map(without_bytes, value.values()))
        if isinstance(value, dict)
        else not isinstance(value, bytes)
    )


@given(plain, st.integers(0, 5))
def test_plain_values_are_read_as_python_reads_them(value: object, protocol: int) -> None:
    if protocol > 2 or without_bytes(value):
        assert parse(pickle.dumps(value, protocol)) == value


@given(plain_python2, st.integers(0, 2))
def test_what_python_2_wrote_is_read_as_python_reads_it_with_latin1(
    value: object, protocol: int
) -> None:
    data = python2_pickle(value, protocol)
    assert parse(data) == value == pickle.loads(data, encoding="latin1")


def test_backslashes_and_quotes_of_python_2_are_read() -> None:
    for text in ("\\q", "\\\\x4", "\\", "'\"\\'", "\x00\r\n\t\xff"):
        assert parse(python2_pickle(text, 0)) == text


def test_unicode_of_python_2_is_read() -> None:
    for protocol in range(3):
        assert parse(python2_pickle([Unicode("añ€\U0001f40e\\")], protocol)) == ["añ€\U0001f40e\\"]


@pytest.mark.parametrize("protocol", range(6))
@pytest.mark.parametrize(
    "dtype", ["f8", ">f8", "<f4", "f2", "i1", "u1", ">i2", "u4", "i8", "u8", "?"]
)
def test_arrays_are_read_in_every_type_order_and_protocol(protocol: int, dtype: str) -> None:
    whole = (np.arange(24).reshape(2, 3, 4) * 7 % 251).astype(dtype)
    cases = {
        "c": whole,
        "f": np.asfortranarray(whole),
        "one": whole[0, 0, 1:2],
        "scalar": whole[1, 1, 1],
        "empty": whole[:, :0],
        "wrapped": Chumpy(whole),
    }
    for data in (written(cases, protocol), python3_pickle(cases, protocol)):
        values = parse(data)
        for key, expected in cases.items():
            array, wanted = (
                read_array(values[key], place(key)),
                np.asarray(expected.x if isinstance(expected, Chumpy) else expected),
            )
            assert array.dtype == wanted.dtype.newbyteorder("=")
            assert array.flags.c_contiguous
            assert array.flags.writeable
            np.testing.assert_array_equal(array, wanted)


def test_lists_of_numbers_are_arrays_too() -> None:
    np.testing.assert_array_equal(read_array([[1, 2], [3, 4]], place()), np.array([[1, 2], [3, 4]]))
    assert read_array((1, 2.5), place()).dtype == np.float64
    for wrong in ([1, "2"], [[1, 2], [3]], [[[1]]], [None], [2**63]):
        with pytest.raises(ModelFileError, match=r"test\.pkl: key: "):
            read_array(wrong, place())


@pytest.mark.parametrize("protocol", range(6))
def test_sparse_matrices_are_filled_and_duplicates_add_up(protocol: int) -> None:
    content = random_content()
    matrix: Any = content["J_regressor"]
    value = read_array(parse(written(content, protocol))["J_regressor"], place())
    np.testing.assert_array_equal(value, matrix.toarray())
    twice = {
        "_shape": (2, 1),
        "indptr": np.array([0, 2], np.int32),
        "indices": np.array([1, 1], np.int32),
        "data": np.array([1.0, 2.0]),
    }
    made = smal_pickles.python2_instance(Name("scipy.sparse.csc", "csc_matrix"), twice, 2)
    assert read_array(parse(python2_pickle(made, 2)), place()).tolist() == [[0.0], [3.0]]


def test_a_sparse_matrix_is_filled_within_a_limit_only() -> None:
    empty = {
        "_shape": (2**22, 2),
        "indptr": np.zeros(3, np.int32),
        "indices": np.zeros(0, np.int32),
        "data": np.zeros(0),
    }
    value = parse(
        python2_pickle(
            smal_pickles.python2_instance(Name("scipy.sparse.csc", "csc_matrix"), empty, 2), 2
        )
    )
    with pytest.raises(
        ModelFileError, match=r"shape \(4194304, 2\), which has more than 4194304 entries"
    ):
        read_array(value, place())
    assert read_array(value, Place("test.pkl", "key", PickleLimits(dense_cells=2**23))).shape == (
        2**22,
        2,
    )


@pytest.mark.parametrize("protocol", range(6))
def test_several_arrays_come_as_a_list_an_object_array_or_one_array(protocol: int) -> None:
    members = np.arange(12.0).reshape(3, 2, 2)
    objects = np.empty(3, dtype=object)
    objects[:] = list(members)
    for value in (list(members), tuple(members), members, objects):
        content = parse(python3_pickle({"key": value}, protocol))
        np.testing.assert_array_equal(read_array_list(content["key"], place(), (3, 2, 2)), members)


def test_one_array_named_very_often_takes_no_memory() -> None:
    array, row = python2_pickle(np.zeros(2**17), 2)[2:-1], b"(" + b"K\x01" * 19_000 + b"l"
    often = b"](" + array + b"q\xc8" + b"h\xc8" * 19_000 + b"e"
    for shape, message in (
        ((19_001, 2, 2), r"expected an array of shape \(2, 2\), got \(131072,\)"),
        (
            (19_001, 2**17),
            r"expected numbers of shape \(19001, 131072\), which are more than 4194304",
        ),
        ((5, 2, 2), r"expected 5 arrays of shape \(2, 2\), got 19001"),
    ):
        with pytest.raises(ModelFileError, match=message):
            read_array_list(parse(alone(often)), place(), shape)
    with pytest.raises(
        ModelFileError, match=r"a list of 190019000 numbers, more than the file can have written"
    ):
        read_array(parse(alone(b"](" + row + b"q\xc8" + b"h\xc8" * 10_000 + b"e")), place())


def test_names_in_errors_are_short_and_printable() -> None:
    value = parse(alone(hostile_pickles.stack_named("a\x1b[2J\ud800" + "x" * 5000, "b\n" * 500)))
    with pytest.raises(ModelFileError) as caught:
        read_array(value, place())
    assert str(caught.value).isascii()
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 600


def test_what_would_be_imported_or_called_is_an_inert_record() -> None:
    value = parse(b"cos\nsystem\n(S'true'\ntR.")
    assert isinstance(value, Call)
    assert (value.func, value.args, value.offset) == (Global("os", "system"), ("true",), 21)
    assert not callable(value)
    assert not callable(value.func)


def test_a_text_pickle_with_changed_line_ends_is_named_as_such(tmp_path: Path) -> None:
    path = tmp_path / "model.pkl"
    path.write_bytes(python2_pickle(random_content(), 0).replace(b"\n", b"\r\n"))
    with pytest.raises(
        ModelFileError, match=rf"{path}.*from LF to CRLF; copy it again in binary mode.*dos2unix"
    ):
        read_pickle(path)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (
            alone(b"T\xff\xff\xff\x7f"),
            (
                "at byte 2: 2147483647 bytes are announced, but only 1 follow; the file is damaged"
                " or cut short"
            ),
        ),
        (
            alone(b"\x82\x01"),
            "at byte 2: an object of the extension registry; a SMAL model file needs none of this",
        ),
        (b"\x80\x02", "at byte 2: the file ends before the pickle does; the file is damaged"),
        (b"", "at byte 0: the file ends before the pickle does"),
        (alone(b"N") + b"\n", "at byte 3: 1 bytes follow the end of the pickle"),
        (b"I12a\n.", "at byte 0: a whole number of at most 20 digits was expected, got b'12a'"),
        (
            alone(b"\x8a\x09" + b"\xff" * 8 + b"\x01"),
            "at byte 2: a whole number of more than 64 bits",
        ),
        (
            alone(b"\x8a\x0a" + b"\0" * 10),
            "at byte 2: a whole number of 10 bytes, which is not 0 to 9",
        ),
        (alone(b"\x8b\xff\xff\xff\xff"), "at byte 2: a whole number of -1 bytes"),
        (alone(b"T\xff\xff\xff\xff"), "at byte 2: a string of -1 bytes"),
        (alone(b"]q\x01h\x01a"), "test.pkl: the value contains itself"),
        (alone(b")" + b"\x85" * 64), "test.pkl: containers within containers, more than 64 deep"),
        (
            alone(hostile_pickles.named("a", "b") + b")R}b}b"),
            "at byte 12: a second state is given to one object",
        ),
        (alone(b"}]Ns"), "a dictionary's key must be a name or a number, got a list of length 0"),
    ],
)
def test_a_refusal_names_file_place_reason_and_remedy(data: bytes, message: str) -> None:
    with pytest.raises(ModelFileError) as caught:
        parse(data)
    assert str(caught.value).startswith("test.pkl: ")
    assert message in str(caught.value)
    assert "; " in str(caught.value)


@pytest.mark.parametrize(
    "nest", [b"\x85", b"q\x020]h\x02a", b"q\x020}K\x01h\x02s", b"q\x020h\x02h\x02\x86"]
)
def test_nesting_is_allowed_up_to_its_limit(nest: bytes) -> None:
    assert parse(alone(b")" + nest * 63)) is not None
    with pytest.raises(ModelFileError, match="more than 64 deep"):
        parse(alone(b")" + nest * 64))


def test_nesting_is_counted_through_shared_parts_too() -> None:
    shared = b")" + b"\x85" * 40 + b"q\x01"
    assert parse(alone(shared))
    with pytest.raises(ModelFileError, match="more than 64 deep"):
        parse(alone(b"(" + shared + b"h\x01" + b"\x85" * 40 + b"t"))


def test_limits_are_those_given(tmp_path: Path) -> None:
    path = tmp_path / "model.pkl"
    path.write_bytes(alone(b"]K\x01aK\x01aK\x01a"))
    assert read_pickle(path) == [1, 1, 1]
    size = path.stat().st_size
    assert read_pickle(path, PickleLimits(file_bytes=size, opcodes=9, stack=2, nesting=1)) == [
        1,
        1,
        1,
    ]
    for limits, message in (
        (PickleLimits(file_bytes=size - 1), f"more than {size - 1} bytes"),
        (PickleLimits(opcodes=8), "more than 8 opcodes"),
        (PickleLimits(stack=1), "more than 1 values on the stack"),
    ):
        with pytest.raises(ModelFileError, match=message):
            read_pickle(path, limits)


def test_what_is_no_readable_file_is_refused(tmp_path: Path) -> None:
    for path, message in (
        (tmp_path, "is no file"),
        (tmp_path / "absent.pkl", "cannot be read: No such file"),
        (Path("/dev/zero"), "is no file"),
    ):
        with pytest.raises(ModelFileError, match=message):
            read_pickle(path)


def watch(folder: Path, honest: Path, *options: str) -> Any:
    command = [sys.executable, "-W", "error", str(WATCH), str(folder), str(honest), *options]
    ran = subprocess.run(
        command, capture_output=True, text=True, check=False, cwd=folder, timeout=300
    )
    assert ran.returncode == 0, ran.stderr
    return json.loads(ran.stdout)


@pytest.fixture(scope="module")
def honest(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("honest") / "honest.pkl"
    path.write_bytes(written(random_content(), 0))
    return path


def write_all(folder: Path, files: list[bytes], name: str) -> None:
    for k, data in enumerate(files):
        (folder / f"{name}-{k}.pkl").write_bytes(data)


def test_every_hostile_file_is_refused_and_nothing_that_it_names_happens(
    tmp_path: Path, honest: Path
) -> None:
    marker, folder = tmp_path / "marker", tmp_path / "hostile"
    folder.mkdir()
    for name, (make, least) in CLASSES.items():
        files = make(marker)
        assert len(set(files)) >= least, name
        write_all(folder, files, name)
    before = sorted(path.name for path in folder.iterdir())
    assert len(before) >= 700
    seen = watch(folder, honest)
    assert seen["calls"] == []
    assert seen["events"] == {}
    assert seen["modules"] == []
    assert not marker.exists()
    assert sorted(path.name for path in folder.iterdir()) == before
    assert seen["grown_mb"] <= 64
    assert {name: said for name, said in seen["said"].items() if said != ["refused"] * 2} == {}
    assert len(seen["said"]) == len(before)


def test_calls_under_keys_that_nobody_needs_are_not_made_either(
    tmp_path: Path, honest: Path
) -> None:
    marker, folder = tmp_path / "marker", tmp_path / "extras"
    folder.mkdir()
    write_all(folder, hostile_pickles.harmless_extras(marker), "extra")
    seen = watch(folder, honest)
    assert {tuple(said) for said in seen["said"].values()} == {("read", "refused")}
    assert (seen["calls"], seen["events"], seen["modules"], marker.exists()) == ([], {}, [], False)


def test_the_watch_sees_what_pickle_itself_does(tmp_path: Path, honest: Path) -> None:
    folder, marker = tmp_path / "some", tmp_path / "marker"
    folder.mkdir()
    named = hostile_pickles.named
    write_all(
        folder,
        [alone(named("os", "system") + b"(" + hostile_pickles.text(f"touch {marker}") + b"tR")],
        "system",
    )
    write_all(folder, [alone(named(*hostile_pickles.FLAG) + b")R")], "flag")
    write_all(folder, [alone(named("colorsys", "rgb_to_hsv"))], "module")
    seen = watch(folder, honest, "unpickle")
    assert marker.exists()
    assert seen["calls"] == ["fire"]
    assert "colorsys" in seen["modules"]
    assert any(event.startswith("os.system") for event in seen["events"])
