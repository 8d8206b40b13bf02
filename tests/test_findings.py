"""How the words of a finding begin a sentence."""

import pytest

from sonocal.findings import begun

PLAIN = {
    "frames share an error": "Frames share an error",
    "a needle sags": "A needle sags",
    "frames, rows and needles": "Frames, rows and needles",
    "re-scan it": "Re-scan it",
    "mirrored": "Mirrored",
    "u is off by 3 %, and a needle sags": "u is off by 3 %, and a needle sags",
}
NAMES = (
    "sweep.igs.mha, frame 3: is cut",
    "trajectory_tum.txt: are these metres?",
    "table.csv has no rows",
    "stylus: 2 of 9 poses are invalid",
    "probeToTracker is at most 9 mm from its origin",
    "3 of 9 rows",
    "ProbeToTracker: lost",
    "mm/px differ",
)


@pytest.mark.parametrize("words", [*PLAIN, *NAMES])
def test_a_sentence_begins_with_a_capital_and_a_name_with_its_own_letter(words):
    assert begun(words) == PLAIN.get(words, words)
    assert begun(begun(words)) == begun(words)
