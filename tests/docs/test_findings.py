"""The registry of codes, the page about them and the source say the same."""

import re
from fnmatch import fnmatch
from pathlib import Path

import msgspec
import pytest

from sonocal.findings import CODES, PAGE, REASONS, REFUSALS, Diagnostic, anchor_of
from sonocal.validation import verdict
from tests.builders.codes_in_source import made_in

ROOT = Path(__file__).parents[2]
REGISTRIES = {"Diagnostic": CODES, "DegenerateGeometryError": REFUSALS}
MADE = [
    (path.relative_to(ROOT), one)
    for path in sorted((ROOT / "src" / "sonocal").rglob("*.py"))
    for one in made_in(path.read_text(encoding="utf-8"))
]
TEXT = (ROOT / PAGE).read_text(encoding="utf-8")
SECTIONS = dict(re.findall(r"^### (\S+)\n(.*?)(?=^##|\Z)", TEXT, flags=re.MULTILINE | re.DOTALL))


def unknown(kind, codes):
    return [code for code in codes if not any(fnmatch(known, code) for known in REGISTRIES[kind])]


def example(section):
    return " ".join(line.removeprefix("> ") for line in section.splitlines() if line.startswith("> "))


def test_every_code_that_is_given_is_in_the_registry():
    wrong = [f"{path}:{one.line}: {unknown(one.kind, one.codes)}" for path, one in MADE]
    assert [text for text in wrong if not text.endswith("[]")] == []
    assert all(one.codes for _, one in MADE)


@pytest.mark.parametrize("kind", REGISTRIES)
def test_every_code_of_the_registry_is_given_somewhere(kind):
    given = {code for _, one in MADE if one.kind == kind for code in one.codes}
    assert [code for code in REGISTRIES[kind] if not any(fnmatch(code, one) for one in given)] == []


def test_the_verdict_knows_its_codes():
    assert {verdict.NO_PREDICTION, verdict.HOPELESS_ERROR} == set(REASONS)
    assert set(CODES) >= verdict.SPOILING


@pytest.mark.parametrize(
    "source",
    [
        'Diagnostic(code="weak-moton", severity="info", message="", advice="")',
        'Diagnostic("weak-moton", "info", "", "")',
        'Diagnostic(code="weak-motion" if x else "weak-moton", severity="info", message="", advice="")',
        'Diagnostic(code=f"weak-{x}-moton", severity="info", message="", advice="")',
        'def warn(code, message):\n    return Diagnostic(code, "info", message, "")\nwarn("weak-moton", "")',
        'found = {"weak-moton": 1}\nfor code in found:\n    Diagnostic(code, "info", "", "")',
        'raise DegenerateGeometryError("", "weak-moton")',
        'raise DegenerateGeometryError("", code="weak-moton")',
    ],
)
def test_a_misspelt_code_does_not_pass(source):
    (one,) = made_in(source)
    assert len(unknown(one.kind, one.codes)) == 1


def test_every_code_has_its_section_and_no_section_is_of_nothing():
    assert set(SECTIONS) == {*CODES, *REFUSALS, *REASONS}
    for code, section in SECTIONS.items():
        assert "\n- Why it matters: " in section, code
        assert "\n- What to do: " in section, code
        assert example(section), code


def test_examples_have_the_words_that_the_program_says():
    """The parts of a message that are always the same, of one of the places that give the code."""
    for code, section in SECTIONS.items():
        messages = [
            one.message for _, one in MADE if any(fnmatch(code, c) for c in one.codes) and one.message
        ]
        shown = [all(part in example(section) for part in message) for message in messages]
        assert any(shown) or not messages, f"{code}: {messages}"


def test_a_message_and_an_advice_end_without_a_mark():
    """What prints them ends their sentence."""
    assert [f"{path}:{one.line}" for path, one in MADE if any(end[-1] in ".?!,;:" for end in one.ends)] == []
    assert sum(len(one.ends) > 0 for _, one in MADE) > 0.5 * len(MADE)


def test_most_messages_can_be_compared():
    assert sum(bool(one.message) for _, one in MADE) > 0.9 * len(MADE)


def test_a_code_leads_to_its_section():
    for code in SECTIONS:
        assert anchor_of(code) == f"docs/findings.md#{code}"
    assert Diagnostic("latency", "info", "m", "a").anchor == "docs/findings.md#latency"


def test_a_file_of_another_version_may_hold_other_codes():
    other = {"code": "of-tomorrow", "severity": "warning", "message": "m", "advice": "a"}
    found = msgspec.convert(other, Diagnostic)
    assert found.anchor == PAGE
    assert msgspec.to_builtins(found) == other
