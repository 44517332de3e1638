"""TRC files: the same markers as other readers', and one sentence for those that are broken."""

from __future__ import annotations

import csv
import warnings
from pathlib import Path

import numpy as np
import pytest
from small_files import TRC, read, refused, write

from ergoqp.mocap.formats.trc import read_trc

POINTS = np.array(
    [[[1, 2, 3], [4, 5, 6]], [[1.5, 2.5, 3.5], [4.5, 5.5, 6.5]], [[-0.1, 2, 3], [4, 5, 6.25]]],
    dtype=np.float32,
)
UNIFORM = "The frames are uniform in time, 0.1 s apart."


def test_the_markers_times_unit_and_notes(tmp_path: Path) -> None:
    motion = read(read_trc, write(tmp_path / "a.trc", TRC))
    assert motion.names == ("LASI", "R Knee")
    np.testing.assert_array_equal(motion.positions, POINTS)
    assert motion.time == pytest.approx([0, 0.1, 0.2])
    assert (motion.markers, motion.unit, motion.up) == (True, 0.001, None)
    assert motion.notes == (UNIFORM,)


@pytest.mark.parametrize(
    "content",
    [
        "\ufeff" + TRC,
        TRC.replace("\n", "\r\n"),
        TRC.rstrip(),
        TRC.replace("\n\n", "\n"),
        TRC.replace("\t", ","),
        TRC.replace("\t", ";").replace("0.1", "0,1"),
        TRC.replace("6\n", "6\t\n"),
        TRC.replace("1.5", "1,5"),
        TRC.replace("R Knee", '"R Knee"'),
        TRC.replace("\t\t\tR Knee\t\t\t", "\tR Knee"),
        TRC.replace("PathFileType\t4\t(X/Y/Z)\ttake.trc", "PathFileType 4 (X/Y/Z) C:\\a,b.trc"),
        TRC.replace("Frame#", "frame#"),
    ],
)
def test_the_same_file_of_other_programs(content: str, tmp_path: Path) -> None:
    motion = read(read_trc, write(tmp_path / "a.trc", content))
    assert (motion.names, motion.unit) == (("LASI", "R Knee"), 0.001)
    np.testing.assert_array_equal(motion.positions, POINTS)
    assert motion.notes == (UNIFORM,)


def test_what_is_not_seen(tmp_path: Path) -> None:
    content = TRC.replace("1.5\t2.5\t3.5", "\t\t").replace("4\t5\t6.25", "")
    found = read(read_trc, write(tmp_path / "a.trc", content)).positions
    assert np.isnan(found[[1, 2], [0, 1]]).all()
    assert np.isfinite(found).sum() == 12


@pytest.mark.parametrize(
    ("unit", "metres"),
    [("m", 1), ("MM", 0.001), ("cm", 0.01), ("inches", 0.0254), ("meters", 1), ("el", None)],
)
def test_units(unit: str, metres: float | None, tmp_path: Path) -> None:
    content = TRC.replace("2\tmm", f"2\t{unit}")
    assert read(read_trc, write(tmp_path / "a.trc", content)).unit == metres


@pytest.mark.parametrize(
    ("counts", "notes"),
    [
        ("3\t2", ()),
        ("1000000000\t2", ("The file states 1000000000 frames and has 3: all are read.",)),
        ("3\t1000000000", ("The file states 1000000000 markers and has 2: all are read.",)),
        ("9" * 5000 + "\t2", (f"The file states {10**18 - 1} frames and has 3: all are read.",)),
        ("²\t-1", ()),
        ("\t", ()),
    ],
)
def test_counts_are_compared(counts: str, notes: tuple[str, ...], tmp_path: Path) -> None:
    content = TRC.replace("3\t2\tmm", f"{counts}\tmm")
    assert read(read_trc, write(tmp_path / "a.trc", content)).notes == (UNIFORM, *notes)


@pytest.mark.parametrize("separator", ["\t", ","])
def test_further_markers_at_the_end_of_rows_are_left_out(separator: str, tmp_path: Path) -> None:
    further = TRC.replace("5.5\t6.5", "5.5\t6.5\t7\t8\t9").replace("6.25", "6.25\t1\t1\t1\t\t\t")
    content = further.replace("\t", separator)
    motion = read(read_trc, write(tmp_path / "a.trc", content))
    np.testing.assert_array_equal(motion.positions, POINTS)
    said = "2 of 3 rows have up to 1 more markers than the head names: these are left out."
    assert motion.notes == (UNIFORM, said)


@pytest.mark.parametrize(
    ("unit", "word"),
    [(1e3, "milliseconds"), (1e6, "microseconds"), (1e9, "nanoseconds")],
)
def test_the_rate_tells_the_unit_of_the_times(unit: float, word: str, tmp_path: Path) -> None:
    content = TRC.replace("\t0.1\t", f"\t{0.1 * unit:.0f}\t").replace(
        "\t0.2\t", f"\t{0.2 * unit:.0f}\t"
    )
    motion = read(read_trc, write(tmp_path / "a.trc", content))
    assert motion.time == pytest.approx([0, 0.1, 0.2])
    assert motion.notes == (
        f"Times are taken as {word}: the file states 10 frames per second.",
        UNIFORM,
    )


@pytest.mark.parametrize("rate", ["0", "-10", "1e9", "120", "6", "11.2"])
def test_a_rate_that_is_not_that_of_the_times(rate: str, tmp_path: Path) -> None:
    content = TRC.replace("10\t10\t3", f"{rate}\t10\t3")
    motion = read(read_trc, write(tmp_path / "a.trc", content))
    assert motion.time == pytest.approx([0, 0.1, 0.2])
    assert motion.notes == (
        f"The file states {float(rate):g} frames per second, but its times give 10: the times"
        " are used.",
        UNIFORM,
    )


@pytest.mark.parametrize("rate", ["10.9", "9.2", "10,0", "", "fast", "ten"])
def test_a_rate_that_says_nothing_else(rate: str, tmp_path: Path) -> None:
    content = TRC.replace("10\t10\t3", f"{rate}\t10\t3")
    motion = read(read_trc, write(tmp_path / "a.trc", content))
    assert motion.time == pytest.approx([0, 0.1, 0.2])
    assert motion.notes == (UNIFORM,)


BROKEN = {
    "empty": ("", "^a.trc: the file ends in line 0, required is the line PathFileType"),
    "other": ("HIERARCHY\n", "line 1: got 'HIERARCHY', allowed PathFileType"),
    "cut in the head": (TRC[:40], "the file ends in line 2, required is the row of values"),
    "cut below the head": (TRC[: TRC.index("\n1\t0.0")], "a.trc: got no row of numbers"),
    "no names": (TRC[: TRC.index("Frame#")], "the file ends in line 3, required is the names"),
    "no coordinates": (
        TRC.replace("\t\tX1\tY1\tZ1\tX2\tY2\tZ2\n", "").replace("\n\n", "\n"),
        r"line 5: got '1\\t0\.0.*', allowed X1, Y1, Z1 and so on",
    ),
    "cut in a row": (TRC[:-8], "line 9: got a row of 6 numbers, allowed 8: the file is cut"),
    "no markers": (TRC.replace("LASI", "").replace("R Knee", ""), "line 4: got no marker"),
    "names two columns apart": (
        TRC.replace("LASI\t\t\t", "LASI\t\t"),
        "line 4: got names that are not three columns apart",
    ),
    "other first column": (TRC.replace("Frame#", "Number"), "line 4: got 'Number', allowed Frame#"),
    "a wide row": (TRC.replace("5.5\t6.5", "5.5\t6.5\t7"), "line 8: got a row of 9 numbers"),
    "further markers between white space": (
        TRC.replace("R K", "RK").replace("\t", " ").replace("5.5 6.5", "5.5 6.5 7 8 9"),
        "line 8: got a row of 11 numbers, allowed 8",
    ),
    "decimal commas between commas": (
        TRC.replace("\t", ",").replace("1.5,2.5,3.5,4.5,5.5,6.5", ",".join("123456789012")),
        "line 8: got a row of 14 numbers, allowed 8: a comma seems",
    ),
    "a word": (TRC.replace("5.5", "five"), "line 8: got 'five', allowed a number"),
    "no times": (TRC.replace("2\t0.1", "2\t").replace("3\t0.2", "3\t"), "frame 2 has no time"),
    "time back": (TRC.replace("2\t0.1", "2\t0.3"), "time runs backwards from frame 2 to 3"),
    "UTF-16": (TRC.encode("utf-16"), "line 1: got text in UTF-16"),
    "garbage": (bytes(range(256)), "line 1: got '.*', allowed PathFileType"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_file_is_told(name: str, tmp_path: Path) -> None:
    content, sentence = BROKEN[name]
    refused(read_trc, write(tmp_path / "a.trc", content), sentence)


def test_the_time_of_a_frame_twice(tmp_path: Path) -> None:
    content = TRC.replace("2\t0.1\t1.5\t2.5\t3.5\t4.5\t5.5\t6.5", "2\t0.0\t1\t2\t3\t4\t5\t6")
    motion = read(read_trc, write(tmp_path / "a.trc", content))
    np.testing.assert_array_equal(motion.positions, POINTS[[0, 2]])
    assert motion.notes[1].startswith("1 of 3 frames have the time of the frame before")
    other = write(tmp_path / "b.trc", TRC.replace("2\t0.1", "2\t0.0"))
    refused(read_trc, other, "^b.trc: 1 of 3 frames have the time of the frame before and show")


def test_as_another_reader_reads_it(tmp_path: Path) -> None:
    trc = pytest.importorskip("trc", reason="trc-data-reader is absent")
    rows = np.random.default_rng(2).normal(size=(20, 6)).round(4)
    body = "\n".join(
        "\t".join([str(i + 1), f"{i / 10:.3f}", *map(str, row)]) for i, row in enumerate(rows)
    )
    head = TRC[: TRC.index("1\t0.0")].replace("10\t10\t3\t2\tmm", "10\t10\t20\t2\tmm\t10\t1\t20")
    head = head.replace("Units\n", "Units\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames\n")
    path = write(tmp_path / "a.trc", head.replace("R Knee", "RKNE") + body + "\n")
    theirs, motion = trc.TRCData(), read(read_trc, path)
    theirs.load(str(path))
    assert motion.time == pytest.approx(theirs["Time"])
    for name in motion.names:
        assert motion.of(name) == pytest.approx(np.array(theirs[name]), abs=1e-6)


def test_the_file_of_a_spreadsheet(shared: Path) -> None:
    path = shared / "mocap" / "trc" / "pyomeca_comma_badcount.trc"
    motion = read(read_trc, path)
    with path.open(newline="") as file:
        rows = list(csv.reader(file))
    assert list(motion.names) == [name for name in rows[3][2:] if name]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        numbers = np.array([[float(word or "nan") for word in row] for row in rows[6:]])
    assert motion.time == pytest.approx(numbers[:, 1])
    expected = numbers[:, 2:].reshape(len(numbers), -1, 3).astype(np.float32)
    np.testing.assert_array_equal(motion.positions, expected)
    assert "The file states 652 frames and has 93: all are read." in motion.notes
    assert (motion.unit, len(motion.names)) == (0.001, 51)
