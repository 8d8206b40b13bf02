"""The page that ``validate`` writes of a matrix of other software."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from sonocal.cli.screen.plain import say
from sonocal.errors import UnsupportedError

if TYPE_CHECKING:
    from sonocal.existing.difference import Difference
    from sonocal.existing.worth import Worth
    from sonocal.geometry import Array

__all__ = ["matrix_report_files"]


def matrix_report_files(
    worth: Worth, against: Mapping[str, Difference], area_px: Array, *, name: str
) -> dict[str, bytes]:
    """The page by its file's name; nothing, and a note on stderr, where its libraries are not installed.

    Args:
        worth: what is known of the matrix.
        against: how far it is from others, by what they are called.
        area_px: (2, d): of the image, or what was seen of it.
        name: of the page.
    """
    from sonocal import __version__
    from sonocal.cli.screen.existing import (
        OWN,
        difference_section,
        meaning_sentences,
        quantities_in_turn,
    )
    from sonocal.existing.choice import AS
    from sonocal.existing.worth import MATRIX_ALONE
    from sonocal.report.svg import matrix_svg
    from sonocal.report.templates import filled, now
    from sonocal.validation import CANNOT_SHOW, give_verdict

    existing, meant = worth.existing, worth.reread or worth.existing
    sections = [] if worth.difference is None else [difference_section(OWN, worth.difference)]
    sections += [difference_section(f"Against {other}", apart) for other, apart in against.items()]
    try:
        page = filled(
            "matrix.html",
            made=now(),
            name=existing.said,
            format=existing.format,
            source=worth.source,
            answer=worth.sentence,
            misread=worth.misread,
            scale=worth.scale_sentence,
            ours=None if worth.own is None else give_verdict(worth.own),
            quantities=quantities_in_turn(worth),
            differences=sections,
            findings=worth.diagnostics,
            standing=(CANNOT_SHOW, [MATRIX_ALONE]),
            how=", read so" if worth.reread else "",
            matrix=meant.matrix,
            figure=matrix_svg(meant.probe_from_image, area_px, worth.own),
            words=meaning_sentences(meant),
            provenance=[
                ("matrix", f"{existing.said} ({existing.format})"),
                ("read", AS[existing.form]),
                *(("compared with", other) for other in against),
                ("input", worth.source),
                ("input's SHA-256", worth.sha256),
                ("sonocal", __version__),
            ],
        )
    except UnsupportedError as error:
        say(f"Note: {error}", err=True)
        return {}
    return {name: page}
