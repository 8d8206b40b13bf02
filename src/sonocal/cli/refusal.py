"""What is printed of a refusal beside its sentence: what was found in the data, for people and for programs."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from sonocal.cli.screen.plain import say, say_json
from sonocal.errors import SonocalError
from sonocal.findings import anchor_of

__all__ = ["refusing"]


@contextmanager
def refusing(*, as_json: bool) -> Iterator[None]:
    """Within it, a refusal that carries findings prints them: as JSON on stdout, or in words on stderr.

    Its own sentence, which leads with the first of them, is printed by whoever ends the program.
    """
    try:
        yield
    except SonocalError as error:
        if as_json:
            say_json(_record(error))
        for finding in error.diagnostics[1:]:
            say(f"Note: {finding.message}; {finding.advice} ({finding.code})", err=True)
        raise


def _record(error: SonocalError) -> dict[str, Any]:
    code = getattr(error, "code", None)
    return {
        "error": str(error),
        "kind": type(error).__name__,
        "code": code,
        "anchor": anchor_of(code) if code else None,
        "diagnostics": error.diagnostics,
    }
