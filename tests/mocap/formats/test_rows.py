"""Rows of numbers: the plain and the odd ones give the same, and mistakes have their line."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest

from ergoqp.arguments import unseen
from ergoqp.errors import RecordingError
from ergoqp.mocap.formats import text
from ergoqp.mocap.formats.text import (
    GrowableArray,
    TextLines,
    cells,
    count_of,
    read_rows,
    separator_of,
)

NAN = np.nan


def lines_of(content: str | bytes) -> TextLines:
    raw = content if isinstance(content, bytes) else content.encode()
    return TextLines(Path("a.csv"), io.BytesIO(raw), len(raw), unseen)


def blocks(lines: TextLines, separator: str | None, width: int, most: float = np.inf) -> list[int]:
    """Return the number of rows in each block that is split, of at most so many numbers."""
    sizes: list[int] = []

    def split(rows: np.ndarray) -> list[np.ndarray]:
        assert rows.size < most
        sizes.append(len(rows))
        return [rows[:, 0]]

    read_rows(lines, separator, width, split)
    return sizes


def numbers(content: str | bytes, separator: str | None = ",", width: int = 3, **how) -> np.ndarray:
    (values,) = read_rows(lines_of(content), separator, width, lambda rows: [rows], **how)
    return values


@pytest.mark.parametrize(
    ("content", "separator"),
    [
        ("1,2,3\n4,5,6\n", ","),
        ("1,2,3\n4,5,6", ","),
        ("1,2,3\r\n4,5,6\r\n", ","),
        ("\ufeff1,2,3\n4,5,6\n", ","),
        (" 1 , 2,\t3\n4,5,6\n", ","),
        ('"1","2","3"\n4,5,6\n', ","),
        ("1,2,3,\n4,5,6, \n", ","),
        ("1,2,3,,,\n4,5,6\n", ","),
        ("\n1,2,3\n\n , ,\n4,5,6\n\n", ","),
        ("1;2,0;3\n4;5,0;6\n", ";"),
        ("1\t2\t3\n4\t5,0\t6\n", "\t"),
        ("1\t2\t3\t\n4\t5\t6\t\n", "\t"),
        ("  1 2\t 3\n4 5 6\n", None),
        ("+1.0,2e0,3\n.4e1,5.,6\n", ","),
    ],
)
def test_the_same_numbers_however_they_are_written(content: str, separator: str | None) -> None:
    np.testing.assert_array_equal(numbers(content, separator), [[1, 2, 3], [4, 5, 6]])


@pytest.mark.parametrize("word", ["", " ", "nan", "NaN", "-nan", "NA", "null", "None", "1.#QNAN"])
def test_words_for_what_was_not_seen(word: str) -> None:
    found = numbers(f"1,{word},3\n{word},2,{word}\n1,2\n1\n1,2,3\n")
    expected = [[1, NAN, 3], [NAN, 2, NAN], [1, 2, NAN], [1, NAN, NAN], [1, 2, 3]]
    np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("blanks", [False, True])
def test_a_row_of_separators_is_a_frame_only_where_it_is_asked_for(blanks: bool) -> None:
    found = numbers("1,2,3\n,,\n\n  \n1,2,3\n", blanks=blanks)
    assert len(found) == 2 + blanks
    assert np.isnan(found).any() == blanks


@pytest.mark.parametrize(
    ("content", "separator", "sentence"),
    [
        ("1,2,3\n1,two,3\n", ",", "a.csv, line 2: got 'two', allowed a number"),
        ("1,2,3\n\n1,1_0,3\n", ",", "line 3: got '1_0', allowed a number"),
        ("1,2,\u0663\n", ",", "line 1: got '\u0663', allowed a number"),
        ("1,2,0x10\n", ",", "line 1: got '0x10', allowed a number"),
        (
            "1,2,3\n1,inf,3\n",
            ",",
            r"line 2: got a number that is not finite, allowed numbers up to 1e\+30",
        ),
        (
            "1,,3\n1,nan,-Infinity\n",
            ",",
            r"line 2: got a number that is not finite, allowed numbers up to 1e\+30",
        ),
        ("1,2,3\n1,'1',1e999\n", ",", "line 2: got \"'1'\", allowed a number"),
        (
            '1,"2",3\n"1",2,1e31\n',
            ",",
            r"line 2: got 1e\+31, which is too large, allowed numbers up to 1e\+30",
        ),
        ("1,2,-1e300\n", ",", r"line 1: got -1e\+300, which is too large, allowed numbers up to"),
        ("1,2,3,4\n", ",", "line 1: got a row of 4 numbers, allowed 3"),
        ("1,2,3,,4\n", ",", "line 1: got a row of 5 numbers, allowed 3"),
        ("1 2 3\n1 2\n", None, "line 2: got a row of 2 numbers, allowed 3$"),
        ("1,2,3\n1,2", ",", "line 2: got a row of 2 numbers, allowed 3: the file is cut"),
        ("1,2,3\n1", ",", "line 2: got a row of 1 numbers, allowed 3: the file is cut"),
        ("1,2,3\n1,\x00,3\n", ",", r"line 2: got '\\x00', allowed a number"),
        ("1,2,3\n1,\x0c2,3\n1,\x0cx,3\n", ",", r"line 3: got 'x', allowed"),
        (b"\xff\xfe1\x00,\x002\x00", ",", "line 1: got text in UTF-16, allowed UTF-8"),
        ("1,2,3\r4,5,6\r7,8,9\r", ",", "line 1: got lines that end in a carriage return alone"),
        ("1,2," + 50 * "x" + "\n", ",", r"line 1: got 'x{37}\.\.\.', allowed a number"),
    ],
)
def test_a_mistake_is_told_with_its_line(content, separator: str | None, sentence: str) -> None:
    with pytest.raises(RecordingError, match=sentence):
        numbers(content, separator)


@pytest.mark.parametrize("block", [1, 2, 3, 5])
def test_blocks_are_as_the_whole(block: int, monkeypatch: pytest.MonkeyPatch) -> None:
    content = "1,2,3\n\n4,,6\n7,8,nan\n,,\n1,2,3"
    whole = numbers(content)
    monkeypatch.setattr(text, "_BLOCK", block)
    np.testing.assert_array_equal(numbers(content), whole)
    with pytest.raises(RecordingError, match="line 7: got 'x'"):
        numbers(content + "\nx,2,3\n")


def test_a_line_without_end_is_not_read_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(text, "_LONGEST", 1 << 20)
    lines = lines_of(b"1,2,3\n" + b"1," * (1 << 20) + b"1\n")
    with pytest.raises(RecordingError, match="line 2: got a line of more than 1 MB, allowed"):
        blocks(lines, ",", 3)
    assert lines.file.tell() <= (1 << 20) + 6


@pytest.mark.slow
def test_rows_that_are_left_out_do_not_fill_the_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(text, "_BEARABLE", 1_000_000)
    assert sum(blocks(lines_of("1\n" * 999), ",", 1000)) == 999
    assert sum(blocks(lines_of("1,2,3\n" * 400_000), ",", 3)) == 400_000
    with pytest.raises(RecordingError, match="got rows with hardly any numbers, allowed 100000 in"):
        blocks(lines_of("1\n" * 100_000), ",", 100_000, most=5e6)


def test_a_block_of_long_lines_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(text, "_MOST", 100)
    assert blocks(lines_of("1,2,3\n" * 40), ",", 3) == [17, 17, 6]


def test_progress_ends_at_one() -> None:
    told: list[float] = []
    content = b"1,2,3\n" * 9000
    blocks(TextLines(Path("a"), io.BytesIO(content), len(content), told.append), ",", 3)
    assert told == sorted(told)
    assert told[-1] == 1.0


@pytest.mark.parametrize(
    ("row", "separator", "found"),
    [
        ('a, "b, c" ,"d"', ",", ["a", "b, c", "d"]),
        ('"a";b', ";", ["a", "b"]),
        ('"a b" c', None, ["a", "b", "c"]),
        ('"a', ",", ["a"]),
        ('"a\rb",c\r', ",", ["a\rb", "c"]),
        ('a"' + 200_000 * "b" + "\r,c", ",", ['a"' + 200_000 * "b", "c"]),
        ("", ",", [""]),
    ],
)
def test_words_above_the_numbers(row: str, separator: str | None, found: list[str]) -> None:
    assert cells(row, separator) == found


@pytest.mark.parametrize(
    ("text", "count"),
    [
        ("12", 12),
        ("0", 0),
        ("", None),
        ("-1", None),
        ("1.5", None),
        ("²", None),
        ("9" * 5000, 10**18 - 1),
    ],
)
def test_counts_that_files_state(text: str, count: int | None) -> None:
    assert count_of(text) == count


def test_what_parts_columns() -> None:
    assert separator_of("1,5;2,5") == ";"
    assert separator_of("1,5\t2,5", "a;b") == "\t"
    assert separator_of("1", "a,b") == ","
    assert separator_of("1 2", "a b") is None


@pytest.mark.parametrize("shares", [(1.0, 1.0, 1.0), (0.3, 0.6, 1.0), (0.9, 0.99, 1.0), (0, 0, 0)])
def test_blocks_become_one_array(shares: tuple[float, ...]) -> None:
    values = np.arange(36.0).reshape(12, 3)
    gathered = GrowableArray()
    assert not gathered
    gathered.add(values[:0], 0.1)
    for part, share in zip(np.split(values, [4, 9]), shares, strict=True):
        gathered.add(part, share)
    np.testing.assert_array_equal(gathered.view, values)
    assert len(gathered) == 12
