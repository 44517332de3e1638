"""Lines of text, counted and put back, in the letters of several programs."""

from __future__ import annotations

import io
from pathlib import Path

import pytest

from ergoqp.arguments import unseen
from ergoqp.errors import RecordingError
from ergoqp.mocap.formats.text import TextLines


def lines_of(content: str | bytes) -> TextLines:
    raw = content if isinstance(content, bytes) else content.encode()
    return TextLines(Path("a.csv"), io.BytesIO(raw), len(raw), unseen)


def test_lines_are_counted_and_put_back() -> None:
    lines = lines_of("\ufeffa\x0bb\x85c\r\n\n \nlast")
    assert lines.next("a") == "a\x0bb\x85c"
    assert (lines.peek(), lines.line) == ("last", 3)
    assert (lines.next("b"), lines.line, lines.ends) == ("last", 4, False)
    assert lines.peek() == ""
    with pytest.raises(RecordingError, match=r"^a\.csv: the file ends in line 4, required is c$"):
        lines.next("c")


def test_a_line_of_latin_letters() -> None:
    assert lines_of("é,ü\n".encode("latin-1")).next("names") == "é,ü"
    assert lines_of("é,ü\n").next("names") == "é,ü"


def test_several_lines_are_put_back_in_their_order() -> None:
    lines = lines_of("a\nb\nc\nd")
    rows = lines.take(4)
    assert (lines.line, lines.ends) == (4, False)
    lines.put_back(*rows[1:])
    assert (lines.line, lines.ends) == (1, True)
    assert (lines.take(2), lines.line, lines.ends) == (["b", "c"], 3, True)
    assert (lines.take(9), lines.line, lines.ends) == (["d"], 4, False)
    assert lines.take(1) == []


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-16-be"])
def test_utf_16_is_told_with_and_without_its_mark(encoding: str) -> None:
    with pytest.raises(RecordingError, match="line 1: got text in UTF-16, allowed UTF-8: save"):
        lines_of("time,neck.x\n0,1\n".encode(encoding)).take(1)
