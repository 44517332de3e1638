"""Takes of Motive: bones, rigid bodies and markers, each where it belongs."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from small_files import MOTIVE, read, refused, write

from ergoqp.mocap.formats.motive import read_motive

HIP = np.array([[1, 2, 3], [1.5, 2.5, 3.5], [1, 2, 3]], dtype=np.float32)
UNIFORM = "The frames are uniform in time, 0.1 s apart."


def without_bones(content: str = MOTIVE) -> str:
    """The same take in which the bone is a labelled marker."""
    return content.replace("Bone,", "Marker,").replace("A:Hip", "LASI")


def test_bones_bodies_times_and_notes(tmp_path: Path) -> None:
    motion = read(read_motive, write(tmp_path / "a.csv", MOTIVE))
    assert motion.names == ("A:Hip",)
    np.testing.assert_array_equal(motion.of("A:Hip"), HIP)
    assert motion.time == pytest.approx([0, 0.1, 0.2])
    assert list(motion.turns) == ["A:Hip"]
    turns = [[0, 0, 0, 1], [0, 0, 0.6, 0.8], [0, 0, 0, -1]]
    assert motion.turns["A:Hip"] == pytest.approx(np.array(turns), abs=1e-7)
    assert (motion.markers, motion.unit, motion.up, motion.notes) == (False, 1.0, None, (UNIFORM,))


def test_the_poses_of_things(tmp_path: Path) -> None:
    poses = read(read_motive, write(tmp_path / "a.csv", MOTIVE)).objects["Box"]
    expected = np.tile(np.eye(4), (2, 1, 1))
    expected[:, :3, :3] = Rotation.from_quat([[1, 0, 0, 0], [0, 1, 0, 0]]).as_matrix()
    expected[:, :3, 3] = [[7, 8, 9], [7.5, 8, 9]]
    assert poses[:2] == pytest.approx(expected)
    assert np.isnan(poses[2, :3]).all()
    np.testing.assert_array_equal(poses[2, 3], [0, 0, 0, 1])


def test_markers_without_bones(tmp_path: Path) -> None:
    motion = read(read_motive, write(tmp_path / "a.csv", without_bones()))
    assert motion.names == ("LASI", "Box")
    np.testing.assert_array_equal(motion.of("LASI"), HIP)
    np.testing.assert_array_equal(motion.of("Box")[0], [7, 8, 9])
    assert motion.markers
    assert list(motion.objects) == ["Box"]


def test_bodies_alone_are_no_markers(tmp_path: Path) -> None:
    content = without_bones().replace("LASI", "Unlabeled:1")
    motion = read(read_motive, write(tmp_path / "a.csv", content))
    assert (motion.names, motion.markers) == (("Box",), False)


def test_a_marker_of_the_name_of_a_bone_or_body(tmp_path: Path) -> None:
    # Markers stand before or behind; neither takes the place of what has their name.
    first = MOTIVE.replace("Bone", "?").replace("Marker", "Bone").replace("?", "Marker")
    for content, name in ((MOTIVE, "A:Hip"), (first, "A:Hip"), (MOTIVE, "Box")):
        motion = read(read_motive, write(tmp_path / "a.csv", content.replace("Unlabeled:7", name)))
        kept = motion.of("A:Hip")
        if content is first and name == "A:Hip":
            np.testing.assert_array_equal(kept, [[np.nan] * 3, [5, 5, 5], [5, 5, 5]])
        else:
            np.testing.assert_array_equal(kept, HIP)
        np.testing.assert_array_equal(motion.objects["Box"][0, :3, 3], [7, 8, 9])


def test_a_bone_of_the_name_of_a_body(tmp_path: Path) -> None:
    motion = read(read_motive, write(tmp_path / "a.csv", MOTIVE.replace("A:Hip", "Box")))
    assert motion.names == ("Box",)
    np.testing.assert_array_equal(motion.of("Box"), HIP)
    np.testing.assert_array_equal(motion.turns["Box"][0], [0, 0, 0, 1])
    np.testing.assert_array_equal(motion.objects["Box"][0, :3, 3], [7, 8, 9])


@pytest.mark.parametrize(
    "content",
    [
        "\ufeff" + MOTIVE,
        MOTIVE.replace("\n", "\r\n"),
        MOTIVE.rstrip(),
        MOTIVE.replace("hand, over", '"hand, over"'),
        MOTIVE.replace("hand, over", "hand, over, Take Notes, a, b"),
        MOTIVE.replace("A:Hip", '"A:Hip"'),
        MOTIVE.replace("\n\n", "\n,,,,\n"),
        MOTIVE.replace("\n,,Rotation", "\n,Parent,,,,,,,\n,,Rotation"),
        MOTIVE.replace("Total Exported Frames,3", "Total Exported Frames,²"),
        MOTIVE.replace("10.000000", '"10,0"'),
        MOTIVE.replace("10.000000", "nan"),
        MOTIVE.replace("10.000000", "30"),
    ],
)
def test_harmless_variants(content: str, tmp_path: Path) -> None:
    motion = read(read_motive, write(tmp_path / "a.csv", content))
    np.testing.assert_array_equal(motion.of("A:Hip"), HIP)
    assert motion.time == pytest.approx([0, 0.1, 0.2])
    assert (motion.unit, motion.notes) == (1.0, (UNIFORM,))


@pytest.mark.parametrize("stated", ["17263", "9" * 5000])
def test_fewer_frames_than_stated_are_read(stated: str, tmp_path: Path) -> None:
    content = MOTIVE[: MOTIVE.index("2,0.2")].replace("Frames,3", f"Frames,{stated}")
    motion = read(read_motive, write(tmp_path / "a.csv", content))
    np.testing.assert_array_equal(motion.of("A:Hip"), HIP[:2])
    assert f"The file states {stated[:18]} frames and has 2: all are read." in motion.notes


def test_names_with_accents(tmp_path: Path) -> None:
    content = MOTIVE.replace("A:Hip", "Hüfte").encode("latin-1")
    assert read(read_motive, write(tmp_path / "a.csv", content)).names == ("Hüfte",)


@pytest.mark.parametrize(("word", "unit"), [("Millimeters", 0.001), ("Furlongs", None)])
def test_units(word: str, unit: float | None, tmp_path: Path) -> None:
    content = MOTIVE.replace("Units,Meters", f"Units,{word}")
    assert read(read_motive, write(tmp_path / "a.csv", content)).unit == unit


def test_times_in_whole_milliseconds_are_those_of_the_rate(tmp_path: Path) -> None:
    # As in a take at 360 Hz with 0, 0.003, 0.006, 0.008 s.
    content = MOTIVE.replace("10.000000", "360").replace("0.100000", "0.003")
    motion = read(read_motive, write(tmp_path / "a.csv", content.replace("0.200000", "0.006")))
    assert motion.time == pytest.approx(np.arange(3) / 360, abs=1e-12)
    fast = MOTIVE.replace("10.000000", "2000").replace("0.100000", "0.001")
    motion = read(read_motive, write(tmp_path / "a.csv", fast.replace("0.200000", "0.001")))
    assert motion.time == pytest.approx(np.arange(3) / 2000, abs=1e-12)


def test_more_frames_than_stated_are_read(tmp_path: Path) -> None:
    content = MOTIVE.replace("Total Exported Frames,3", "Total Exported Frames,2")
    motion = read(read_motive, write(tmp_path / "a.csv", content))
    assert motion.notes == (UNIFORM, "The file states 2 frames and has 3: all are read.")


BROKEN = {
    "times too coarse": (
        MOTIVE.replace("1,0.100000", "0,0.000000"),
        "1 of 3 frames have the time of the frame before and show something else",
    ),
    "empty": ("", "^a.csv: the file ends in line 0, required is the row 'Format Version'"),
    "blank": ("\n\n", "line 1: got '', allowed 'Format Version'"),
    "other": ("time,a.x\n", "line 1: got 'time', allowed 'Format Version'"),
    "first row only": (MOTIVE[: MOTIVE.index("\n")], "ends in line 1, required is the row 'Frame'"),
    "cut in the head": (
        MOTIVE[: MOTIVE.index(",ID")],
        "the file ends in line 4, required is the row 'Frame'",
    ),
    "head only": (MOTIVE[: MOTIVE.index("\n0,0") + 1], "^a.csv: got no row of numbers, allowed"),
    "cut in a row": (MOTIVE[:-14], "line 10: got a row of 10 numbers, allowed 20: the file is cut"),
    "Euler angles": (MOTIVE.replace("Quaternion", "XYZ"), "line 1: Rotation Type: got 'XYZ'"),
    "local": (MOTIVE.replace("Global", "Local"), "line 1: Coordinate Space: got 'Local', allowed"),
    "many rows above": (
        MOTIVE.replace("\n,ID", "\n,more" * 6 + "\n,ID"),
        "line 11: got more than 8 rows above the numbers",
    ),
    "many empty rows above": (
        MOTIVE.replace("\n\n", "\n" * 200),
        "line 101: got more than 8 rows above the numbers",
    ),
    "few rows above": (
        "Format Version,1.23\nFrame,Time (Seconds),X\n0,0,1\n",
        "line 2: got too few rows above the numbers",
    ),
    "no time": (
        MOTIVE.replace("Time (Seconds)", "X"),
        "line 7: got the second column 'X', allowed",
    ),
    "frame alone": (MOTIVE.replace("Frame,Time", "Frame\n,"), "line 7: got the second column ''"),
    "nothing labelled": (
        without_bones()
        .replace("LASI", "Unlabeled:1")
        .replace("Box", "Unlabeled:2")
        .replace("Rigid Body", "Marker"),
        "^a.csv: got a take in which nothing is tracked, allowed bones",
    ),
    "a word": (MOTIVE.replace("1.5", "one"), "line 9: got 'one', allowed a number"),
    "time back": (MOTIVE.replace("0.200000", "0.05"), "time runs backwards from frame 2 to 3"),
    "UTF-16": (MOTIVE.encode("utf-16"), "line 1: got text in UTF-16"),
    "garbage": (bytes(range(256)) * 20, "line 1: got '.*', allowed 'Format Version'"),
    "a quote without end": ('"' + "a" * 200_000, "line 1: got 'a{37}...', allowed 'Format"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_take_is_told(name: str, tmp_path: Path) -> None:
    content, sentence = BROKEN[name]
    refused(read_motive, write(tmp_path / "a.csv", content), sentence)


def independent(path: Path) -> tuple[list[list[str]], np.ndarray]:
    """The rows above the numbers that are not empty, and the numbers."""
    with path.open(newline="") as file:
        rows = [row for row in csv.reader(file) if row]
    numbers = [[float(word or "nan") for word in row] for row in rows[6:]]
    return rows[1:6], np.array(numbers)


def columns(head: list[list[str]], kind: str, name: str, what: str) -> list[int]:
    wanted = list(enumerate(zip(head[0], head[1], head[3], strict=True)))
    return [i for i, each in wanted if each == (kind, name, what)]


@pytest.mark.parametrize(
    ("file", "bones", "bodies", "markers"),
    [
        ("derived_motive_skeleton_giver", 13, ["Baton"], 0),
        ("motive_v121_rigidbodies_markers", 0, ["Rigid Body 1"], 3),
    ],
)
def test_takes_of_others(file: str, bones: int, bodies: list[str], markers: int, shared: Path):
    path = shared / "mocap" / "motive" / f"{file}.csv"
    motion = read(read_motive, path)
    head, numbers = independent(path)
    assert motion.time == pytest.approx(numbers[:, 1], abs=1e-6)
    assert len(motion.names) == bones or markers + len(bodies)
    assert list(motion.objects) == bodies
    assert (motion.markers, motion.unit) == (not bones, 1.0)
    assert not any(name.startswith("Unlabeled") for name in motion.names)
    for name in motion.names:
        kind = "Bone" if bones else "Rigid Body" if name in bodies else "Marker"
        places = numbers[:, columns(head, kind, name, "Position")].astype(np.float32)
        np.testing.assert_array_equal(motion.of(name), places)
        if kind != "Marker":
            turns = numbers[:, columns(head, kind, name, "Rotation")]
            assert motion.turns[name] == pytest.approx(turns, abs=1e-5)
    for name in bodies:
        turns = numbers[:, columns(head, "Rigid Body", name, "Rotation")]
        expected = Rotation.from_quat(turns).as_matrix()
        assert motion.objects[name][:, :3, :3] == pytest.approx(expected, abs=1e-5)


def test_a_take_without_anything(shared: Path) -> None:
    path = shared / "mocap" / "motive" / "motive_v123_empty_no_bodies.csv"
    refused(read_motive, path, "got a take in which nothing is tracked, allowed bones, rigid")
