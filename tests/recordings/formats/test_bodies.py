"""Folders with a table of poses for each body: names, order of quaternions, poses."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from small_files import BODY, folder_of, read, refused, write

from ergoqp.errors import RecordingError
from ergoqp.mocap.formats.bodies import is_folder_of_bodies, read_bodies

POSED = "The quaternions are taken as "


def test_names_places_turns_poses_and_times(tmp_path: Path) -> None:
    other = BODY.replace("1,2,3", "4,5,6").replace("1.5,2,3", "4.5,5,6")
    folder = folder_of(tmp_path, ann_LHand_pose=BODY, ann_Hip_pose=other)
    assert is_folder_of_bodies(folder)
    motion = read(read_bodies, folder, rate=10)
    assert motion.names == ("Hip", "LHand")
    np.testing.assert_array_equal(motion.of("LHand"), [[1, 2, 3], [1.5, 2, 3], [1, 2, 3]])
    np.testing.assert_array_equal(motion.of("Hip")[1], [4.5, 5, 6])
    assert motion.time == pytest.approx([0, 0.1, 0.2])
    assert motion.turns["Hip"][1] == pytest.approx([0, 0, 0.6, 0.8])
    pose = motion.objects["Hip"][1]
    assert pose[:3, :3] == pytest.approx(Rotation.from_quat([0, 0, 0.6, 0.8]).as_matrix())
    np.testing.assert_array_equal(pose[:, 3], [4.5, 5, 6, 1])
    assert motion.notes[0] == "There are 10 frames per second, as stated."
    assert (motion.unit, motion.up, motion.markers) == (None, None, False)


@pytest.mark.parametrize(
    "content",
    [
        "\ufeff" + BODY,
        BODY.replace("\n", "\r\n"),
        BODY.rstrip(),
        BODY.replace(",", "\t"),
        BODY.replace(",", " "),
        BODY.replace(",", ";").replace(".", ","),
        BODY.replace("x,y,z,q0,q1,q2,q3", '"X", "Y", "Z", "Q0", "Q1", "Q2", "Q3"'),
        BODY.replace("q0,q1,q2,q3", "qx,qy,qz,qw"),
        BODY.replace("\n", ",7\n").replace("q3,7", "q3,error"),
        "q3,z,y,x,q2,q1,q0\n1,3,2,1,0,0,0\n0.8,3,2,1.5,0.6,0,0\n1,3,2,1,0,0,0\n",
        "x,y,z,qw,qx,qy,qz\n1,2,3,1,0,0,0\n1.5,2,3,.8,0,0,.6\n1,2,3,1,0,0,0\n",
    ],
)
def test_the_same_table_of_other_programs(content: str, tmp_path: Path) -> None:
    motion = read(read_bodies, folder_of(tmp_path, box=content), rate=10)
    assert motion.names == ("box",)
    np.testing.assert_array_equal(motion.of("box"), [[1, 2, 3], [1.5, 2, 3], [1, 2, 3]])
    assert motion.turns["box"][1] == pytest.approx([0, 0, 0.6, 0.8])


@pytest.mark.parametrize("row", [",,,,,,", "nan,nan,nan,nan,nan,nan,nan", "1,2,3,0,0,0,0"])
def test_what_is_not_seen_keeps_its_time(row: str, tmp_path: Path) -> None:
    content = BODY.replace("1.5,2,3,0,0,0.6,0.8", row)
    motion = read(read_bodies, folder_of(tmp_path, a=content, b=BODY), rate=10)
    assert motion.positions.shape == (3, 2, 3)
    assert np.isnan(motion.turns["a"][1]).all()
    assert np.isnan(motion.of("a")[1]).all() == ("2" not in row)


BROKEN = {
    "other lengths": (BODY + "1,2,3,0,0,0,1\n", "take: got 3 rows for box and 4 for a, allowed"),
    "head only": ("x,y,z,q0,q1,q2,q3\n", "a.csv: got no row below the names, allowed rows"),
    "cut in a row": (
        BODY[:-6],
        "a.csv, line 4: got a row of 5 numbers, allowed 7: the file is cut",
    ),
    "a wide row": (BODY.replace("1.5", "1,5"), "a.csv, line 3: got a row of 8 numbers, allowed 7"),
    "a word": (BODY.replace("1.5", "one"), "a.csv, line 3: got 'one', allowed a number"),
    "a column twice": (BODY.replace("q3\n", "q3,x\n"), "a.csv, line 1: got the column x twice"),
    "infinite": (BODY.replace("1.5", "inf"), "a.csv, line 3: got a number that is not finite"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_table_is_told(name: str, tmp_path: Path) -> None:
    content, sentence = BROKEN[name]
    folder = folder_of(tmp_path, a=content, box=BODY)
    with pytest.raises(RecordingError, match=sentence):
        read(read_bodies, folder, rate=10)


@pytest.mark.parametrize(
    "content",
    ["", "x,y,z\n1,2,3\n", BODY[:8], "x y z,q0 q1 q2 q3\n1,2\n", bytes(999), BODY.encode("utf-16")],
)
def test_a_folder_without_poses(content: str | bytes, tmp_path: Path) -> None:
    folder = folder_of(tmp_path, a=content)
    assert not is_folder_of_bodies(folder)
    refused(
        read_bodies, folder, "take: got no table of poses, allowed one with the columns", rate=1
    )


def timed(times: list[float], head: str = "time", body: str = BODY) -> str:
    rows = body.splitlines()
    return "\n".join(f"{time},{row}" for time, row in zip([head, *times], rows, strict=True)) + "\n"


def test_times_of_the_tables(tmp_path: Path) -> None:
    late = timed([3.001, 3.201, 3.301], "Timestamp")
    folder = folder_of(tmp_path, a=timed([3, 3.2, 3.3]), b=late, c=BODY)
    refused(read_bodies, folder, "take: got tables of poses without times, allowed a column that")
    (folder / "c.csv").unlink()
    motion = read(read_bodies, folder)
    assert motion.time == pytest.approx([0, 0.2, 0.3])
    assert motion.notes[0].startswith("The frames are not uniform in time")
    stated = read(read_bodies, folder, rate=10)
    assert stated.time == pytest.approx([0, 0.1, 0.2])
    assert stated.notes[1] == (
        "The times of the tables are not used: the frames per second are stated (rate)."
    )
    write(folder / "b.csv", timed([3, 3.1, 3.3]))
    refused(read_bodies, folder, "take: got other times for b than for a, allowed the same times")
    write(folder / "b.csv", timed([3000, 3200, 3300], "time (ms)"))
    refused(read_bodies, folder, "take: got other times for b than for a, allowed the same times")


def test_poses_of_one_time(tmp_path: Path) -> None:
    same = BODY.replace("1.5,2,3,0,0,0.6,0.8", "1,2,3,0,0,0,1")
    folder = folder_of(tmp_path, a=timed([3, 3, 3.1], body=same), b=timed([3, 3, 3.1], body=same))
    motion = read(read_bodies, folder)
    assert motion.time == pytest.approx([0, 0.1])
    assert motion.positions.shape == (2, 2, 3)
    assert motion.turns["a"].shape == (2, 4)
    assert motion.objects["a"].shape == (2, 4, 4)
    write(folder / "b.csv", timed([3, 3, 3.1]))
    refused(read_bodies, folder, r"take: 1 of 3 frames have the time .* per second \(rate\)$")


def test_a_rate_is_needed(tmp_path: Path) -> None:
    folder = folder_of(tmp_path, a=BODY)
    refused(read_bodies, folder, r"^take: got tables of poses without times, allowed .* \(rate\)$")
    refused(read_bodies, folder, "take: rate: got -1, allowed frames per second", rate=-1)


def test_what_is_no_folder(tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", BODY)
    refused(read_bodies, path, "'a.csv' cannot be read: Not a directory, allowed a folder", rate=1)
    refused(read_bodies, tmp_path / "none", "'none' cannot be read: No such file", rate=1)
    with pytest.raises(RecordingError, match="cannot be read: embedded null byte"):
        read(read_bodies, Path("a\0b"), rate=1)


def test_the_bones_of_a_handover(shared: Path) -> None:
    folder = shared / "mocap" / "kth_handover_giver"
    motion = read(read_bodies, folder, rate=120)
    arms = [f"{side}{bone}" for side in "LR" for bone in ("FArm", "Hand", "Shoulder", "UArm")]
    assert motion.names == ("baton", *arms, "ab", "chest", "head", "hip", "neck")
    for name in motion.names:
        path = folder / f"{'' if name == 'baton' else 'giver_'}{name}_pose_saved.csv"
        with path.open(newline="") as file:
            numbers = np.array([[float(w) for w in row] for row in list(csv.reader(file))[1:]])
        np.testing.assert_array_equal(motion.of(name), numbers[:, :3].astype(np.float32))
        assert motion.turns[name] == pytest.approx(numbers[:, 3:], abs=1e-6)
        expected = Rotation.from_quat(numbers[:, 3:]).as_matrix()
        # What is not the giver's is the thing that is given.
        assert (name in motion.objects) == (name == "baton")
        if name in motion.objects:
            assert motion.objects[name][:, :3, :3] == pytest.approx(expected, abs=1e-6)
    assert motion.time == pytest.approx(np.arange(801) / 120)
    assert motion.notes[1].startswith(
        f"{POSED}x, y, z, w: a bone's neighbour then moves in its axes by 1 mm"
    )
    assert motion.notes[2] == "76 of 801 frames repeat the frame before."
