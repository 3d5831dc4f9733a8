"""The examples in docstrings give what they show."""

import doctest
import importlib
import pkgutil

import pytest

import animal3dbox

MODULES = sorted(
    module.name
    for module in pkgutil.walk_packages(animal3dbox.__path__, "animal3dbox.")
    if not module.name.endswith("__main__")
)


def shown_by(module: str) -> list[doctest.DocTest]:
    """The docstrings of a module that show values."""
    finder = doctest.DocTestFinder(exclude_empty=True)
    return [test for test in finder.find(importlib.import_module(module), module) if test.examples]


def test_every_room_is_looked_through() -> None:
    assert {"animal3dbox.labels.types", "animal3dbox.transforms.camera_law"} <= {
        name.rsplit(".", depth)[0] if depth else name for name in MODULES for depth in (0, 1)
    }


@pytest.mark.parametrize("module", MODULES)
def test_docstrings_give_what_they_show(module: str) -> None:
    said: list[str] = []
    runner = doctest.DocTestRunner()
    for test in shown_by(module):
        runner.run(test, out=said.append)
    assert "".join(said) == ""
