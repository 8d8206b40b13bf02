"""CITATION.cff says of the package what the package says of itself."""

import re
import tomllib

import pytest

import sonocal
from tests.builders.pasted import ROOT, text_of

CITATION = text_of(ROOT / "CITATION.cff")


def said(name):
    return re.search(rf"^{name}: (.+)$", CITATION, flags=re.MULTILINE).group(1)


def test_the_version_and_the_license_are_the_packages():
    project = tomllib.loads(text_of(ROOT / "pyproject.toml"))["project"]
    assert said("version") == sonocal.__version__
    assert said("license") == project["license"]
    assert said("title") == project["name"]
    keywords = CITATION.partition("\nkeywords:\n")[2].partition("\nreferences:")[0]
    assert re.findall(r"- (\w+)", keywords) == project["keywords"]


def test_it_is_what_the_format_asks_for():
    ruamel = pytest.importorskip("ruamel.yaml", reason="ruamel.yaml is not installed")
    found = ruamel.YAML(typ="safe").load(CITATION)
    assert {"cff-version", "message", "title", "authors"} <= set(found)
    assert found["cff-version"] == "1.2.0"
    assert found["type"] == "software"
    for one in found["references"]:
        assert {"type", "title", "authors"} <= set(one)
        assert all({"family-names", "given-names"} <= set(author) for author in one["authors"])


def test_the_paper_is_the_one_that_the_readme_names():
    title = re.search(r"^    title: (.+)$", CITATION, flags=re.MULTILINE).group(1)
    assert title in " ".join(text_of(ROOT / "README.md").split()) or title in " ".join(
        text_of(ROOT / "docs" / "theory.md").split()
    )
