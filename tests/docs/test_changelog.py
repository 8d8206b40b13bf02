"""Every new place that the changelog sends users to is there; no old one of its table still works."""

import importlib
import re
from pathlib import Path

import pytest

import sonocal

CHANGELOG = (Path(__file__).parents[2] / "CHANGELOG.md").read_text(encoding="utf-8")
MOVES = re.findall(
    r"^\| `(sonocal[\w.]+)(?:\(.*?\))?` \| `(sonocal[\w.]+)(\(.*?\))?` \|", CHANGELOG, re.MULTILINE
)
# Of another signature at its old place, or an argument more.
STAYED = {"sonocal.setup_checks.check_setup"}


def found(name):
    """What a dotted name leads to: modules as long as there are any, then attributes."""
    value, parts = sonocal, name.split(".")[1:]
    for index, part in enumerate(parts):
        if not hasattr(value, part):
            importlib.import_module(".".join(["sonocal", *parts[: index + 1]]))
        value = getattr(value, part)
    return value


def test_the_table_is_read():
    assert len(MOVES) == len(re.findall(r"^\| `sonocal", CHANGELOG, re.MULTILINE)) > 40


@pytest.mark.parametrize(("new", "call"), sorted({(new, call) for _, new, call in MOVES}))
def test_what_moved_is_at_its_new_place(new, call):
    value = found(new)
    assert callable(value)
    given = [name.strip() for name in call.strip("()").split(",") if name.strip() not in ("", "...")]
    names = value.__code__.co_varnames if given else ()
    assert list(names[: len(given)]) == given


@pytest.mark.parametrize("old", sorted({old for old, _, _ in MOVES} - STAYED))
def test_what_moved_is_no_longer_at_its_old_place(old):
    with pytest.raises((AttributeError, ImportError)):
        found(old)
