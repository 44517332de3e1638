"""Tables of positions: whatever program wrote them, the same points."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from small_files import TABLE, read, refused, write

from ergoqp.mocap.formats.table import read_table

POINTS = np.array(
    [[[1, 2, 3], [4, 5, 6]], [[1.5, 2.5, 3.5], [4.5, 5.5, 6.5]], [[-0.1, 2, 3], [4, 5, 6.25]]]
)
HEAD, _, ROWS = TABLE.partition("\n")


def headed(*head: str) -> str:
    return "\n".join([*head, ROWS])


def decimal_comma(mark: str) -> str:
    return TABLE.replace(",", mark).replace(".", ",").replace("neck,", "neck.")


def test_the_points_times_and_notes(tmp_path: Path) -> None:
    motion = read(read_table, write(tmp_path / "a.csv", TABLE))
    assert motion.names == ("neck", "hip")
    np.testing.assert_array_equal(motion.positions, POINTS.astype(np.float32))
    assert motion.time == pytest.approx([0, 0.1, 0.2])
    assert motion.notes == ("The frames are uniform in time, 0.1 s apart.",)
    assert (motion.unit, motion.up, motion.rest, motion.markers) == (None, None, None, False)


@pytest.mark.parametrize(
    ("content", "names"),
    [
        ("\ufeff" + TABLE, None),
        (TABLE.replace("\n", "\r\n"), None),
        (TABLE.rstrip(), None),
        (TABLE.replace("\n", ",\n"), None),
        (TABLE.replace(",", "\t"), None),
        (TABLE.replace(",", "  "), None),
        (TABLE.replace(",", ";"), None),
        (decimal_comma(";").replace("hip,", "hip."), None),
        (decimal_comma("\t").replace("hip,", "hip."), None),
        ("sep=;\n" + TABLE.replace(",", ";"), None),
        ("\n".join(f"KEY_{i},{i}" for i in range(11)) + "\n" + TABLE, None),
        ("# a comment of somebody\n\n" + TABLE, None),
        (headed('"time","neck.x","neck.y","neck.z","hip.x","hip.y","hip.z"'), None),
        (headed("Time_Stamp,neck_X,neck_Y,neck_Z,hip_X,hip_Y,hip_Z"), None),
        (headed("t,neck tx,neck ty,neck tz,hip:x,hip:y,hip:z"), None),
        (headed("sec,neck_pos_x,neck_pos_y,neck_pos_z,hipPosX,hipPosY,hipPosZ"), None),
        (headed("time,neck,,,hip,,", ",x,y,z,x,y,z"), None),
        (headed(",neck,neck,neck,hip,hip,hip", "time,X1,Y1,Z1,X2,Y2,Z2"), None),
        (headed(",Name:neck,,,Name:hip,,", "Time,TX,TY,TZ,TX,TY,TZ"), None),
        (headed("time,neck,,,hip,,", "s,x,y,z,x,y,z"), None),
        (
            headed(
                "time,Left Wrist.x,Left Wrist.y,Left Wrist.z,R (big) toe x,R (big) toe y,"
            ).replace("y,\n", "y,R (big) toe z\n"),
            ("Left Wrist", "R (big) toe"),
        ),
        (headed("time,FootX,FootY,FootZ,WristX,WristY,WristZ"), ("Foot", "Wrist")),
        (
            headed('time,"a, b x","a, b y","a, b z",c x,c y,c z'),
            ("a, b", "c"),
        ),
        (headed("time,épaule.x,épaule.y,épaule.z,b.x,b.y,b.z"), ("épaule", "b")),
        (headed("time,neck.x,neck.y,neck.z,NECK.x,NECK.y,NECK.z"), ("neck", "NECK")),
    ],
)
def test_the_same_table_of_other_programs(
    content: str, names: tuple[str, str] | None, tmp_path: Path
) -> None:
    motion = read(read_table, write(tmp_path / "a.csv", content))
    assert motion.names == (names or ("neck", "hip"))
    np.testing.assert_array_equal(motion.positions, POINTS.astype(np.float32))
    assert motion.time == pytest.approx([0, 0.1, 0.2])


def test_frames_that_are_there_twice(tmp_path: Path) -> None:
    content = TABLE + "0.2,-1e-1,2,3,4,5,6.25\n0.3,-1e-1,2,3,4,5,6.25\n"
    motion = read(read_table, write(tmp_path / "a.csv", content))
    np.testing.assert_array_equal(motion.positions, POINTS[[0, 1, 2, 2]].astype(np.float32))
    assert motion.time == pytest.approx([0, 0.1, 0.2, 0.3])
    assert motion.notes == (
        "1 of 5 frames have the time of the frame before and are left out.",
        "The frames are uniform in time, 0.1 s apart.",
        "1 of 4 frames repeat the frame before.",
    )
    other = write(tmp_path / "b.csv", TABLE + "0.2,9,9,9,9,9,9\n")
    refused(read_table, other, r"^b.csv: 1 of 4 frames have the time .* per second \(rate\)$")


def test_names_of_windows_programs(tmp_path: Path) -> None:
    content = TABLE.replace("neck", "Schlüsselbein").encode("latin-1")
    assert read(read_table, write(tmp_path / "a.csv", content)).names[0] == "Schlüsselbein"


def test_what_is_not_seen(tmp_path: Path) -> None:
    content = (
        "time,a.x,a.y,a.z,a.confidence,b.x,b.y,b.z,b score\n"
        "0,,null,,1,4,5,6,0.4\n"
        "0.1,1,2,3,0,4,5,6,nan\n"
        "0.2,1,,3,-1,4,5\n"
        "0.3,1,,3,1,NaN,5,6,1\n"
    )
    found = read(read_table, write(tmp_path / "a.csv", content)).positions
    lost = np.full(3, np.nan)
    np.testing.assert_array_equal(found[:, 0], [lost, lost, lost, [1, np.nan, 3]])
    np.testing.assert_array_equal(found[:, 1], [[4, 5, 6], lost, lost, [np.nan, 5, 6]])


def test_words_in_columns_that_are_not_read(tmp_path: Path) -> None:
    rows = [
        row + word for row, word in zip(TABLE.split(), (",n_a", ",é", ",a b", ",1"), strict=True)
    ]
    for content in ("\n".join(rows), "\n".join(rows).replace(",", "\t")):
        motion = read(read_table, write(tmp_path / "a.csv", content))
        np.testing.assert_array_equal(motion.positions, POINTS.astype(np.float32))
        assert motion.notes[1] == "The column n_a is not read."


@pytest.mark.parametrize(
    ("words", "mark"),
    [
        (("12:59:59.95", "13:00:00.05", "13:00:00.15"), ","),
        (("2026-01-31 23:59:59.95", "2026-02-01 00:00:00.05", "2026-02-01 00:00:00.15"), ","),
        (("12:59:59,95", "13:00:00,05", "13:00:00,15"), ";"),
        (("2026-01-31T12:00:00.0Z", "2026-01-31T12:00:00.1Z", "2026-01-31T12:00:00.2Z"), "\t"),
    ],
)
def test_clock_times(words: tuple[str, ...], mark: str, tmp_path: Path) -> None:
    content = TABLE.replace(",", mark)
    for old, word in zip(("0.0", "0.1", "0.2"), words, strict=True):
        content = content.replace(f"\n{old}{mark}", f"\n{word}{mark}")
    motion = read(read_table, write(tmp_path / "a.csv", content))
    assert motion.time == pytest.approx([0, 0.1, 0.2], abs=1e-6)
    np.testing.assert_array_equal(motion.positions, POINTS.astype(np.float32))


@pytest.mark.parametrize("times", [("0", "0", "0"), ("0.2", "0.1", "x"), ("", "", "")])
def test_a_stated_rate_goes_before_times(times: tuple[str, ...], tmp_path: Path) -> None:
    content = TABLE
    for i, word in enumerate(times):
        content = content.replace(f"\n0.{i},", f"\n{word},")
    motion = read(read_table, write(tmp_path / "a.csv", content), rate=10)
    assert motion.time == pytest.approx([0, 0.1, 0.2])
    assert motion.notes[:2] == (
        "There are 10 frames per second, as stated.",
        "The times of the column time are not used: the frames per second are stated (rate).",
    )


@pytest.mark.parametrize("count", [1, 30, 5000])
def test_rows_before_anybody_is_seen_are_frames(count: int, tmp_path: Path) -> None:
    rows = [row.partition(",")[2] for row in TABLE.splitlines()]
    content = "\n".join([",,", rows[0], *[",,,,,"] * count, "", *rows[1:]])
    motion = read(read_table, write(tmp_path / "a.csv", content), rate=10)
    assert np.isnan(motion.positions[:count]).all()
    np.testing.assert_array_equal(motion.positions[count:], POINTS.astype(np.float32))
    without = "\n".join([",,,,,"] * count + rows[1:])
    motion = read(read_table, write(tmp_path / "b.csv", without), ("neck", "hip"), 10)
    assert len(motion.time) == count + 3
    # Where there are times a row without one is none.
    timed = TABLE.replace("\n", "\n" + ",,\n" * count, 1)
    assert len(read(read_table, write(tmp_path / "c.csv", timed)).time) == 3


def test_confidences_of_frames_that_end_in_blanks(tmp_path: Path) -> None:
    header = "neck.x,neck.y,neck.z,neck.score"
    content = "\n".join([header, "1,2,3,0.9", "1,2,3,0.1", ",,,", ",,,"])
    motion = read(read_table, write(tmp_path / "a.csv", content), rate=10)
    np.testing.assert_array_equal(np.isfinite(motion.positions[:, 0, 0]), [True, False])


@pytest.mark.parametrize("row", ["20,Hz", "20 Hz", "20,Hz,,,,,"])
def test_a_rate_in_the_head(row: str, tmp_path: Path) -> None:
    content = "\n".join(line.partition(",")[2] for line in TABLE.splitlines()) + "\n"
    motion = read(read_table, write(tmp_path / "a.csv", f"TRAJECTORIES\n{row}\n{content}"))
    assert motion.time == pytest.approx([0, 0.05, 0.1])
    assert "There are 20 frames per second, as stated." in motion.notes
    stated = read(read_table, write(tmp_path / "a.csv", f"{row}\n{content}"), rate=10)
    assert stated.time == pytest.approx([0, 0.1, 0.2])
    timed = read(read_table, write(tmp_path / "a.csv", f"{row}\n{TABLE}"))
    assert timed.time == pytest.approx([0, 0.1, 0.2])
    for other in ("20,mm", "1e9,Hz", "fast,Hz", "Hz"):
        refused(read_table, write(tmp_path / "a.csv", f"{other}\n{content}"), "no column of times")


def test_a_rate_where_there_are_no_times(tmp_path: Path) -> None:
    rows = "\n".join(row.partition(",")[2] for row in TABLE.splitlines())
    path = write(tmp_path / "a.csv", rows.replace("1.5,2.5,3.5,4.5,5.5,6.5", ",,,,,") + "\n,,,,,\n")
    motion = read(read_table, path, rate=50)
    # A frame in which nothing is seen has its time, but at the end, where spreadsheets add some.
    assert motion.time == pytest.approx([0, 0.02, 0.04])
    np.testing.assert_array_equal(motion.positions[[0, 2]], POINTS[[0, 2]].astype(np.float32))
    assert np.isnan(motion.positions[1]).all()
    assert motion.notes[0] == "There are 50 frames per second, as stated."
    refused(read_table, path, r"^a\.csv: got no column of times, allowed .* \(rate\)$")
    refused(read_table, path, r"^a\.csv: rate: got 0, allowed", rate=0)


BROKEN = {
    "empty": ("", "the file ends in line 0, required is a row of numbers"),
    "blank": ("\n , \n\n", "the file ends in line 3, required is a row of numbers"),
    "head only": (HEAD + "\n", "the file ends in line 1, required is a row of numbers"),
    "cut in the head": (HEAD[:-9], "the file ends in line 1, required is a row of numbers"),
    "cut in a row": (TABLE[:-8], "line 4: got a row of 5 numbers, allowed 7: the file is cut"),
    "prose": ("word\n" * 30, "line 20: got 20 lines without a row of numbers"),
    "empty lines": ("\n" * 9000 + TABLE, "line 1000: got 1000 lines without a row of numbers"),
    "other columns": (
        TABLE.replace(".x", ".u").replace(".y", ".v"),
        r"line 1: got the columns 'time', 'neck\.u', .* and 1 more, allowed three columns for",
    ),
    "two axes": (TABLE.replace(".z", ".u"), "line 1: got the columns"),
    "a name beyond reason": (TABLE.replace("neck", "n." * 90_000), None),
    "a word": (TABLE.replace("4.5", "4.5.6"), r"line 3: got '4\.5\.6', allowed a number"),
    "a wide row": (TABLE + "1,2,3,4,5,6,7,8\n", "line 5: got a row of 8 numbers, allowed 7"),
    "no times": (TABLE.replace("0.1,", ",", 1).replace("0.2,", ","), "frame 2 has no time"),
    "time back": (TABLE.replace("0.2", "0.05"), "time runs backwards from frame 2 to 3"),
    "a word at first": (
        TABLE.replace("\n0.0,1,2", "\n,,\n0.0,1,two"),
        "line 3: got 'two' in the column 'neck.y', allowed a number",
    ),
    "no clock": (
        TABLE.replace("\n0.0", "\n12h"),
        "line 2: got '12h' in the column 'time', allowed a number or a time such as 12:00:00.5",
    ),
    "a clock that stops": (
        TABLE.replace("\n0.0", "\n12:00:00").replace("\n0.1", "\nnoon"),
        "line 3: got 'noon' in the column 'time', allowed a number or a time such as 12:00:00.5",
    ),
    "too large": (TABLE.replace("4.5", "1e31"), r"line 3: got 1e\+31, which is too large, allowed"),
    "infinite": (TABLE.replace("4.5", "inf"), "line 3: got a number that is not finite"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_table_is_told(name: str, tmp_path: Path) -> None:
    content, sentence = BROKEN[name]
    path = write(tmp_path / "a.csv", content)
    if sentence is None:
        assert read(read_table, path).names == ("hip",)
    else:
        refused(read_table, path, sentence)


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (bytes(5000), "line 1|ends in line 1"),
        (bytes(range(256)) * 40, "got 20 lines without a row of numbers"),
        (TABLE.encode("utf-16-le"), "line 1: got text in UTF-16, allowed UTF-8"),
        (TABLE.encode("utf-16"), "line 1: got text in UTF-16, allowed UTF-8"),
        (TABLE.replace("\n", "\r").encode(), "line 1: got lines that end in a carriage return"),
    ],
)
def test_bytes_that_are_no_table(content: bytes, sentence: str, tmp_path: Path) -> None:
    refused(read_table, write(tmp_path / "a.csv", content), sentence)


def test_places_that_are_no_file(tmp_path: Path) -> None:
    refused(read_table, tmp_path / "missing.csv", "no such file")
    refused(read_table, tmp_path, "is not a file")
    refused(read_table, tmp_path / ("x" * 5000), "cannot be read")


def test_the_table_of_a_depth_camera(shared: Path) -> None:
    path = shared / "mocap" / "kinect" / "azure_kinect_body_tracking_part1.csv"
    motion = read(read_table, path)
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(motion.names) == 32
    assert motion.time == pytest.approx([float(row["Timestamp"]) * 1e-6 for row in rows])
    for name in motion.names:
        expected = [[float(row[f"{name}.{axis}"]) for axis in "xyz"] for row in rows]
        seen = np.array([float(row[f"{name}.confidence"]) > 0 for row in rows])
        np.testing.assert_array_equal(motion.of(name)[seen], np.array(expected, np.float32)[seen])
        assert np.isnan(motion.of(name)[~seen]).all()
    assert "Times are taken as microseconds." in motion.notes


@pytest.mark.parametrize("task", ["Task1", "Task4"])
def test_arms_without_names(task: str, shared: Path) -> None:
    path = shared / "mocap" / "arms" / f"assembly_{task}_Human1_trial1.txt"
    columns = ("LWrist", "RWrist", "LElbow", "RElbow", "LShoulder", "RShoulder")
    motion = read(read_table, path, columns, 30)
    expected = np.loadtxt(path, dtype=np.float32).reshape(-1, 6, 3)
    np.testing.assert_array_equal(motion.positions, expected)
    assert motion.time == pytest.approx(np.arange(len(expected)) / 30)
    assert motion.notes == ("There are 30 frames per second, as stated.",)
