"""What the columns of a table are: places, times, how surely a place is seen, or nothing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from small_files import TABLE, read, refused, write

from ergoqp.mocap.formats.table import read_table

COMMAS = (
    r"^a.csv, line 2: got a row of 13 numbers below a head of 7 names, allowed as many: a comma"
    " seems to be the decimal mark, too; export the table with decimal points, or with semicolons"
)
HEAD, _, ROWS = TABLE.partition("\n")


def headed(*head: str) -> str:
    return "\n".join([*head, ROWS])


@pytest.mark.parametrize(
    ("column", "factor"),
    [
        ("Time (Seconds)", 1),
        ("time_s", 1),
        ("timestamp[ms]", 1e3),
        ("Time (milliseconds)", 1e3),
        ("t_us", 1e6),
        ("time (µs)", 1e6),
        ("time (μs)", 1e6),
        ("time (\u017f)", 1),
        ("time [ns]", 1e9),
        ("timestamp", 1e6),
        ("timestamps", 1e6),
        ("ts", 1e9),
        ("Time", 1e3),
    ],
)
def test_units_of_time(column: str, factor: float, tmp_path: Path) -> None:
    content = TABLE.replace("time,", f"{column},").replace("0.1,", f"{0.1 * factor},")
    content = content.replace("0.2,", f"{0.2 * factor},")
    motion = read(read_table, write(tmp_path / "a.csv", content))
    assert motion.time == pytest.approx([0, 0.1, 0.2])


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (f"{HEAD}\n" + "0,1,0,2,0,3,0,4,0,5,0,6,0\n" * 3, COMMAS),
        (
            f"{HEAD}\n" + "0,1,2,3,4,5,6,7\n" * 3,
            "a row of 8 numbers below .* 7 .*name every column",
        ),
        (TABLE.replace("hip.z", "hip.z,"), None),
        (TABLE.replace("\n", ",,\n"), None),
        (TABLE.replace("0.2,-1e-1", "0,2,-1e-1"), "line 4: got a row of 8 numbers, allowed 7$"),
        (headed("a note, of two words", HEAD), None),
    ],
)
def test_a_row_is_as_wide_as_the_head(content: str, sentence: str | None, tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", content)
    if sentence is None:
        assert read(read_table, path).names == ("neck", "hip")
    else:
        refused(read_table, path, sentence)


@pytest.mark.parametrize(
    ("content", "unit", "tick"),
    [
        (TABLE.replace(".x", ".x (mm)"), 0.001, 1),
        (TABLE.replace(".x", ".x [cm]"), 0.01, 1),
        (headed("time,neck,,,hip,,", ",x,y,z,x,y,z", "s,mm,mm,mm,mm,mm,mm"), 0.001, 1),
        (headed("time,neck,,,hip,,", ",x,y,z,x,y,z", ",m,m,m,m,m,m"), 1.0, 1),
        (headed(HEAD, "(ms),[mm],[mm],[mm],[mm],[mm],[mm]"), 0.001, 1e-3),
        (headed(HEAD, "μs,m,m,m,m,m,m"), 1.0, 1e-6),
    ],
)
def test_units_in_the_head(content: str, unit: float, tick: float, tmp_path: Path) -> None:
    motion = read(read_table, write(tmp_path / "a.csv", content))
    assert (motion.names, motion.unit) == (("neck", "hip"), unit)
    assert motion.time == pytest.approx([0, 0.1 * tick, 0.2 * tick])


def test_confidence_below_the_names(tmp_path: Path) -> None:
    content = ",a,,,,b,,,\ntime,x,y,z,Confidence,x,y,z,Confidence\n0,1,2,3,0,4,5,6,1\n"
    found = read(read_table, write(tmp_path / "a.csv", content)).positions
    np.testing.assert_array_equal(found, [[[np.nan] * 3, [4, 5, 6]]])


CONFIDENCES = ("a.conf", "a c", "a_p", "a.confidence_level", "A.Confidence (0-2)")
PROBABILITIES = ("a.prob", "a probability", "a.visibility[0..1]")
STATES = ("aTrackingState", "a.tracking_state", "a.state", "a:tracked")


@pytest.mark.parametrize("head", CONFIDENCES + PROBABILITIES + STATES)
def test_heads_of_how_surely_a_place_is_seen(head: str, tmp_path: Path) -> None:
    content = f"time,a.x,a.y,a.z,{head},b.x,b.y,b.z\n0,1,2,3,0,4,5,6\n0.1,1,2,3,2,4,5,6\n"
    motion = read(read_table, write(tmp_path / "a.csv", content))
    np.testing.assert_array_equal(np.isnan(motion.positions[..., 0]), [[1, 0], [0, 0]])
    assert motion.notes[1].startswith("1 of 4 places are taken as not seen: their ")
    words = content.replace("3,0,4", "3,NOT_TRACKED,4").replace("3,2,4", "3,TRACKED,4")
    found = read(read_table, write(tmp_path / "b.csv", words))
    np.testing.assert_array_equal(found.positions, motion.positions)


def test_columns_of_joints_that_are_not_understood_are_named(tmp_path: Path) -> None:
    content = (
        "time,joint,a.x,a.y,a.z,a.foo,a.qw,a.id,b.x,b.y,b.z,b.gain (dB),mood\n"
        "0,left,1,2,3,7,1,3,4,5,6,0,good\n"
    )
    motion = read(read_table, write(tmp_path / "a.csv", content))
    assert motion.notes[1] == "The columns joint, a.foo, b.gain (dB), mood are not read."
    motion = read(read_table, write(tmp_path / "a.csv", "time,a.x,a.y,a.z,a.foo\n0,1,2,3,4\n"))
    assert motion.notes[1] == "The column a.foo is not read."


@pytest.mark.parametrize(
    "heads",
    [
        "sec,nanosec",
        "secs,nsecs",
        "stamp_sec,stamp_nanosec",
        "header.stamp.sec,header.stamp.nanosec",
    ],
)
def test_times_in_two_columns(heads: str, tmp_path: Path) -> None:
    content = TABLE.replace("time", heads).replace("\n0.0", "\n1700000000,900000000")
    content = content.replace("\n0.1", "\n1700000001,0").replace("\n0.2", "\n1700000001,100000000")
    motion = read(read_table, write(tmp_path / "a.csv", content))
    assert motion.time == pytest.approx([0, 0.1, 0.2], abs=1e-6)


def test_stated_names_that_are_not_used(tmp_path: Path) -> None:
    motion = read(read_table, write(tmp_path / "a.csv", TABLE), columns=("a", "b"))
    assert motion.names == ("neck", "hip")
    assert "The stated names (columns) are not used: the table has its own." in motion.notes


def test_columns_that_are_no_places(tmp_path: Path) -> None:
    content = (
        "frame,time,a.x,a.y,a.z,a.qx,a.qy,a.qz,a.qw,a.rot.x,a.rot.y,a.rot.z,aVelX,aVelY,aVelZ,"
        "qx,qy,qz,qw,b.x,b.y,max,may,state\n"
        "1,0,1,2,3,0,0,0,1,7,7,7,8,8,8,0,0,0,1,5,5,1,1,2\n"
    )
    motion = read(read_table, write(tmp_path / "a.csv", content))
    assert motion.names == ("a",)
    np.testing.assert_array_equal(motion.positions, [[[1, 2, 3]]])


@pytest.mark.parametrize("content", ["1 2 3 4 5 6\n1 2 3 4 5 6\n", "1,2,3,4,5,6,\n\n1,2,3,4,5,6,,"])
def test_a_table_without_names(content: str, tmp_path: Path) -> None:
    path = write(tmp_path / "a.txt", content)
    motion = read(read_table, path, columns=("b", "a"), rate=10)
    assert motion.names == ("b", "a")
    np.testing.assert_array_equal(motion.positions, [[[1, 2, 3], [4, 5, 6]]] * 2)
    for columns, rate, sentence in (
        ((), 10, r"line 1: got 6 numbers and no names above .* \(columns\)$"),
        (("a", "a"), 10, "line 1: columns: got a name twice, allowed different names"),
        (("a",), 10, r"line 1: got 6 numbers and 1 names \(columns\), allowed three"),
        (("a", "b"), None, "got no column of times"),
    ):
        refused(read_table, path, sentence, columns, rate)
