"""The tiers of the tests: what is listed is there, and no law escapes them."""

import ast
import multiprocessing
import re
from pathlib import Path

import pytest
from thorough import PROFILE, examples_under

HERE = Path(__file__).parent


def is_there(name: str) -> bool:
    """Whether a file of the tests, or a test in one, exists."""
    file, _, function = name.partition("::")
    if not (HERE / file).is_file():
        return False
    nodes = ast.parse((HERE / file).read_text()).body
    functions = {node.name for node in nodes if isinstance(node, ast.FunctionDef)}
    return not function or function in functions


def test_what_a_tier_leaves_out_is_there(pytestconfig: pytest.Config) -> None:
    conftest = pytestconfig.pluginmanager.get_plugin(str(HERE / "conftest.py"))
    assert conftest is not None
    tiers = conftest.TIERS
    assert set(tiers) == {"process", "long"}
    assert [name for names in tiers.values() for name in sorted(names) if not is_there(name)] == []


def test_a_law_gets_what_it_asks_for_ten_in_the_fast_tier_and_ten_times_that_at_night() -> None:
    profiles = ("fast", "ci", "nightly")
    assert [examples_under(profile, 200) for profile in profiles] == [10, 200, 2000]
    assert [examples_under(profile, 3) for profile in profiles] == [3, 3, 30]


def test_no_test_sets_its_own_number_of_examples() -> None:
    own = re.compile("max_examples *=")
    files = {path.name for path in HERE.rglob("*.py") if own.search(path.read_text())}
    assert files == {"conftest.py", "thorough.py"}


def test_the_fast_tier_is_no_tier_for_processes() -> None:
    process = multiprocessing.get_context("spawn").Process(target=print)
    if PROFILE != "fast":
        pytest.skip("only the fast profile forbids processes")
    with pytest.raises(pytest.fail.Exception, match="list it under PROCESS"):
        process.start()
