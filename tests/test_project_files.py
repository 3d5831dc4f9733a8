"""What a stranger reads before the code: the citation, the licence, the CI file, the templates."""

import re
import tomllib
from pathlib import Path

import animal3dbox

ROOT = Path(__file__).parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
CITATION = (ROOT / "CITATION.cff").read_text()
CI = (ROOT / ".github" / "workflows" / "ci.yml").read_text()


def test_the_version_is_one_in_the_package_its_metadata_and_the_citation() -> None:
    (cited,) = re.findall(r"^version: (\S+)$", CITATION, re.MULTILINE)
    assert cited == PROJECT["version"] == animal3dbox.__version__


def test_the_citation_names_the_package_s_authors_and_the_paper_s_in_their_order() -> None:
    package, _, paper = CITATION.partition("preferred-citation:")
    (author,) = PROJECT["authors"]
    assert re.findall(r"- name: (.+)", package) == [author["name"]]
    assert re.findall(r"family-names: (\w+)", paper) == ["Shukla", "Remondino", "Risse"]
    assert "Adding Another Dimension to Image-based Animal Detection" in paper


def test_the_citation_s_licence_is_the_package_s() -> None:
    assert f"\nlicense: {PROJECT['license']}\n" in CITATION
    assert (ROOT / "LICENSE").read_text().startswith(f"{PROJECT['license']} License")


def test_the_public_ci_calls_what_every_change_must_pass_on_a_python_that_is_admitted() -> None:
    assert "run: bash .ci/run\n" in CI
    (lowest,) = re.findall(r">=(3\.\d+)", PROJECT["requires-python"])
    assert set(re.findall(r'python-version: "(.+)"', CI)) == {lowest}


def test_every_make_command_of_the_public_ci_and_the_documents_exists() -> None:
    rules = set(re.findall(r"^([a-z][\w-]*):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    documents = [
        *ROOT.glob("*.md"),
        *(ROOT / "docs").glob("*.md"),
        *(ROOT / ".github").rglob("*.*"),
    ]
    in_words, alone = r"`make ([a-z][\w-]*)`", r"^ *(?:- run: )?make ([a-z][\w-]*)(?: *#.*)?$"
    named = {
        name
        for path in documents
        for pattern in (in_words, alone)
        for name in re.findall(pattern, path.read_text(), re.MULTILINE)
    }
    assert {"test", "docs", "check-wheel", "demo"} <= named
    assert named - rules == set()
