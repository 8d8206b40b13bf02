"""Text files of every mark."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sonocal import FormatError
from sonocal.files import read_text
from sonocal.files.kinds import Head
from sonocal.files.text import MARKS, decoded

TEXT = st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=50)


@pytest.mark.parametrize(("mark", "encoding"), MARKS)
@given(text=TEXT)
def test_a_mark_says_how_text_is_written(mark, encoding, text):
    assert decoded(mark + text.encode(encoding)) == text


@given(text=TEXT.filter(lambda text: not text.startswith("\ufeff")))
def test_what_has_no_mark_is_utf_8(text):
    assert decoded(text.encode()) == text


@pytest.mark.parametrize(("mark", "encoding"), MARKS)
def test_a_head_is_known_whatever_the_mark(mark, encoding, tmp_path):
    """The start of a file may end within a character."""
    (tmp_path / "a.csv").write_bytes(mark + ("time_s;Ä_qw\n" + "ä" * 5001).encode(encoding))
    assert Head.of(tmp_path / "a.csv").columns == ("time_s", "Ä_qw")


def test_text_that_is_not_what_its_mark_says_is_refused(tmp_path):
    (tmp_path / "a.csv").write_bytes(b"\xff\xfea\0b")
    with pytest.raises(FormatError, match=r"a\.csv: byte 2 is not UTF-16-LE; a table is UTF-8 text"):
        read_text(tmp_path / "a.csv", "a table")
