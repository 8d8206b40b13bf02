"""The page that ``validate`` writes of a matrix of other software."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sonocal.cli.screen.plain import say
from sonocal.errors import UnsupportedError

if TYPE_CHECKING:
    from sonocal.existing.difference import Difference
    from sonocal.existing.worth import Worth

__all__ = ["matrix_report_files"]


def matrix_report_files(worth: Worth, apart: Difference | None, *, name: str) -> dict[str, bytes]:
    """The page by its file's name; nothing, and a note on stderr, where its libraries are not installed.

    Args:
        worth: what is known of the matrix.
        apart: how far it is from another one, where that was asked for.
        name: of the page.
    """
    from sonocal import __version__
    from sonocal.cli.screen.existing import difference_sentence, meaning_sentences, quantities_in_turn
    from sonocal.existing.worth import MATRIX_ALONE
    from sonocal.report.templates import filled, now
    from sonocal.validation import CANNOT_SHOW, give_verdict

    existing = worth.existing
    against = {
        "Against our own calibration of the same rows": worth.difference,
        "Against the other calibration": apart,
    }
    try:
        page = filled(
            "matrix.html",
            made=now(),
            name=existing.said,
            format=existing.format,
            source=worth.source,
            answer=worth.sentence,
            scale=worth.scale_sentence,
            ours=None if worth.own is None else give_verdict(worth.own),
            quantities=quantities_in_turn(worth),
            differences=[
                (title, [one.sentence, difference_sentence(one)], one.rows)
                for title, one in against.items()
                if one is not None
            ],
            findings=worth.diagnostics,
            standing=(CANNOT_SHOW, [MATRIX_ALONE]),
            matrix=existing.matrix,
            words=meaning_sentences(existing),
            provenance=[
                ("matrix", f"{existing.said} ({existing.format})"),
                ("input", worth.source),
                ("input's SHA-256", worth.sha256),
                ("sonocal", __version__),
            ],
        )
    except UnsupportedError as error:
        say(f"Note: {error}", err=True)
        return {}
    return {name: page}
