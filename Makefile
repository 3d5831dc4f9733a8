# `make demo` and `make test` do everything on a fresh machine: Python 3.11+, make and git are all they need.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.complete
export PYTHONSAFEPATH := 1

.PHONY: setup demo test test-fast test-slow test-extras test-lowest lint docs links wheel check-wheel clean

# The set-up is kept only while it works here: a moved checkout or a half-made environment is made anew.
setup:
	@if ! { [ -f $(STAMP) ] && [ $(STAMP) -nt pyproject.toml ] && [ $(STAMP) -nt constraints.txt ] \
	    && [ "$$($(BIN)/python -c 'import animal3dbox, pathlib; print(pathlib.Path(animal3dbox.__file__).parent.parent)' 2>/dev/null)" = "$$(pwd -P)" ]; }; then \
	  $(PYTHON) -c 'import sys; sys.exit("animal3dbox needs Python 3.11 or newer, this is %s: run make PYTHON=python3.11 ..." % sys.version.split()[0] if sys.version_info < (3, 11) else 0)' && \
	  rm -rf $(VENV) && $(PYTHON) -m venv $(VENV) && \
	  echo "setting up $(VENV) (a minute or two)" && \
	  $(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[dev]' && \
	  touch $(STAMP); \
	fi

# Synthetic animals, their truth and their labels on one page, demo-output/index.html.
demo: setup
	$(BIN)/animal3dbox demo --out demo-output

test: setup
	$(BIN)/python -m pytest -n 2 -m "not slow"

# Laws at ten examples, no processes, no whole worlds (tests/conftest.py): under a minute.
test-fast: setup
	HYPOTHESIS_PROFILE=fast $(BIN)/python -m pytest -q -n 2 -m "not slow and not process and not long"

# Builds the quadruped anew (a minute or two) and compares it with the shipped asset.
test-slow: setup
	$(BIN)/python -m pytest -m slow

# What needs extras that the set-up leaves out (their licences and sizes: CONTRIBUTING.md).
EXTRAS := lightning,parquet,ray,remote,rerun
test-extras: setup
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[dev,$(EXTRAS)]'
	$(BIN)/python -c 'import fsspec, pyarrow, pytorch_lightning, ray, rerun'
	$(BIN)/python -m pytest -q tests/test_examples.py -k lightning
	$(BIN)/python -m pytest -q tests/report/table tests/report/test_rerun_view.py tests/cli/test_ray_tables.py

# The same tests on the lowest versions of everything that pyproject.toml admits. PyPI's torch of that version brings
# several gigabytes of CUDA, which the tests do not use.
test-lowest:
	rm -rf .venv-lowest && $(PYTHON) -m venv .venv-lowest
	.venv-lowest/bin/python -m pip install --quiet --disable-pip-version-check -c constraints-lowest.txt -e '.[dev]'
	.venv-lowest/bin/python -m pytest -n 2 -m "not slow"

lint: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

# The site, in site/: what it needs (26 small packages, 64 MB, most under MIT, ISC and BSD) is
# installed here. Nothing is fetched while it is built.
docs: setup
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[dev,docs]'
	NO_MKDOCS_2_WARNING=1 OMP_NUM_THREADS=1 $(BIN)/mkdocs build --quiet
	@echo "open site/index.html; its search needs a server: python3 -m http.server -d site"

# Every address outside the repository that a document links to, by page; nothing is fetched.
links: setup
	$(BIN)/python docs/hooks/page_links.py

wheel: setup
	rm -rf dist build
	$(BIN)/python -m build --quiet --wheel

# What a package index checks of a wheel: its metadata, and that the README can be shown. twine (Apache-2.0) has an
# environment of its own, for a part of docutils, which it needs, is under the GPL.
check-wheel: wheel
	$(PYTHON) -m venv .venv-release
	.venv-release/bin/python -m pip install --quiet --disable-pip-version-check 'twine==7.0.0'
	.venv-release/bin/twine check --strict dist/*

clean:
	rm -rf $(VENV) .venv-lowest .venv-release dist build demo-output site *.egg-info
