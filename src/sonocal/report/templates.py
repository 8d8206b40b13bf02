"""The pages' templates, filled in: self-contained HTML."""

from __future__ import annotations

import datetime
from importlib.resources import files
from typing import Any

from sonocal.errors import UnsupportedError
from sonocal.findings import PAGE, anchor_of, begun
from sonocal.report.style import DETECTED, TRACKED, UNUSED

__all__ = ["filled", "now"]

EXPLAINED = f"Each code has a section in {PAGE} of sonocal's documentation: why it matters, and what to do."


def now() -> str:
    """The date, as pages have it."""
    return datetime.datetime.now().astimezone().strftime("%Y-%m-%d %H:%M %Z")


def filled(template: str, **values: Any) -> bytes:
    """A template of this room.

    Raises:
        UnsupportedError: jinja2 is not installed.
    """
    try:
        import jinja2
    except ImportError as error:
        raise UnsupportedError(
            f"the report needs {error.name}, which is not installed; pip install matplotlib jinja2, or --no-report"
        ) from None
    loader = jinja2.FunctionLoader(lambda name: files("sonocal.report").joinpath(name).read_text("utf-8"))
    environment = jinja2.Environment(loader=loader, autoescape=True, trim_blocks=True, lstrip_blocks=True)
    environment.filters |= {"typeset": _typeset, "begun": begun, "coded": _coded}
    always = {
        "detected_colour": DETECTED,
        "tracked_colour": TRACKED,
        "unused_colour": UNUSED,
        "explained": EXPLAINED,
    }
    return environment.get_template(template).render(**always, **values).encode()


def _typeset(sentence: str) -> str:
    """A sentence of the terminal's letters in those of a page."""
    return sentence.replace("+-", "\N{PLUS-MINUS SIGN}")


def _coded(code: str) -> Any:
    """A finding's code, which says where the documentation explains it when it is pointed at."""
    from markupsafe import Markup

    return Markup('<span class="code" title="{}">{}</span>').format(anchor_of(code), code)
