"""What is in a file twice, or has no name, refuses no file: it is left out with a sentence."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from small_files import MOTIVE, NEXUS, STORAGE, TABLE, TRC, Reader, read, write

from ergoqp.errors import RecordingError
from ergoqp.mocap.formats.bvh import read_bvh
from ergoqp.mocap.formats.motive import read_motive
from ergoqp.mocap.formats.nexus import read_nexus
from ergoqp.mocap.formats.opensim import read_storage
from ergoqp.mocap.formats.table import read_table
from ergoqp.mocap.formats.trc import read_trc
from ergoqp.mocap.recording import JointMotion

BVH = """HIERARCHY
ROOT Hips
{
  OFFSET 0 0 0
  CHANNELS 3 Xposition Yposition Zposition
  JOINT Tip
  {
    OFFSET 0 1 0
    CHANNELS 0
  }
  JOINT Tip
  {
    OFFSET 0 2 0
    CHANNELS 0
  }
}
MOTION
Frames: 2
Frame Time: 0.1
1 2 3
4 5 6
"""
TWICE: dict[str, tuple[Reader, str, str]] = {
    "bvh": (read_bvh, BVH, "Tip"),
    "motive": (read_motive, MOTIVE.replace("Rigid Body", "Bone").replace("Box", "A:Hip"), "A:Hip"),
    "nexus": (read_nexus, NEXUS.replace("R Knee", "LASI"), "Anna:LASI"),
    "table": (read_table, TABLE.replace("hip", "neck"), "neck"),
    "table of two ways": (read_table, TABLE.replace("hip.", "neck_"), "neck"),
    "trc": (read_trc, TRC.replace("R Knee", "LASI"), "LASI"),
}


@pytest.mark.parametrize("name", TWICE)
def test_the_first_of_two_points_is_read_and_said(name: str, tmp_path: Path) -> None:
    reader, content, twice = TWICE[name]
    motion = read(reader, write(tmp_path / "a.csv", content))
    assert motion.names.count(twice) == 1
    if name != "bvh":
        np.testing.assert_array_equal(motion.of(twice)[0], [1, 2, 3])
    assert any(f"the others are left out: {twice} (up to " in note for note in motion.notes)


def test_two_columns_of_joint_angles(tmp_path: Path) -> None:
    both = STORAGE.replace("pelvis_tx", "knee_angle_r")
    motion = read(read_storage, write(tmp_path / "a.mot", both))
    assert motion.angles["knee_angle_r"] == pytest.approx([np.pi / 2, np.pi / 4, 0])
    with pytest.raises(RecordingError, match=r"^a: got 'knee_angle_r' more than once with diff"):
        motion.check_once(["knee_angle_r"], "a")
    motion.check_once(["another"], "a")
    alike = both.replace("\t0.5", "\t90").replace("\t0.6", "\t45").replace("\t0.7", "\t0")
    assert read(read_storage, write(tmp_path / "b.mot", alike)).twice == ()


def test_points_that_are_equal_in_all_frames_are_no_matter(tmp_path: Path) -> None:
    rows = [row.split(",") for row in TABLE.replace("hip", "neck").splitlines()]
    alike = "\n".join(",".join([*row[:4], *row[1:4]]) for row in rows)
    for content in (alike, alike.replace("1.5,2.5,3.5", ",,")):
        motion = read(read_table, write(tmp_path / "a.csv", content))
        assert "In the file more than once, of which the first is used: neck." in motion.notes


def test_points_of_equal_names_are_one_unless_they_differ() -> None:
    first, other = np.zeros((4, 3)), np.zeros((4, 3))
    first[0], other[1] = np.nan, np.nan
    motion = JointMotion(("a", "b", "a"), np.stack([first, first, other], axis=1), np.arange(4.0))
    said = "In the file more than once, of which the first is used: a."
    once = motion.once()
    assert (once.names, once.notes) == (("a", "b"), (said,))
    assert np.isfinite(once.of("a")).all()
    assert np.isnan(motion.positions[0, 0]).all()
    never = replace(motion, positions=motion.positions * [[[np.nan], [1], [1]]]).once()
    np.testing.assert_array_equal(never.of("a"), other)
    other[3] = [0.003, 0.004, 0]
    motion = replace(motion, positions=np.stack([first, first, other], axis=1))
    for unit, apart in ((None, "0.005"), (0.01, "0 mm"), (1.0, "5 mm")):
        once = replace(motion, unit=unit).once()
        np.testing.assert_array_equal(once.of("a"), first)
        assert once.notes[0].endswith(f"the others are left out: a (up to {apart} apart).")


def test_the_rest_pose_of_points_of_equal_names() -> None:
    motion = JointMotion(("A:a", "A:b"), np.zeros((2, 2, 3)), np.arange(2.0))
    repeated = replace(motion, names=("A:a", "A:a"), rest=np.array([[1.0, 0, 0], [2.0, 0, 0]]))
    once = repeated.once()
    assert (once.names, once.positions.shape) == (("A:a",), (2, 1, 3))
    assert once.rest is not None
    np.testing.assert_array_equal(once.rest, [[1, 0, 0]])


@pytest.mark.parametrize(
    ("change", "place"),
    [
        (lambda t: t.replace("LASI", ""), 1),
        (lambda t: t.replace("R Knee", ""), 0),
        (lambda t: t.replace("\tR Knee\t\t\t", ""), 0),
        (lambda t: t.replace("\tLASI\t\t\tR Knee\t\t\t", "\tLASI"), 0),
    ],
)
def test_markers_without_a_name(change: Callable[[str], str], place: int, tmp_path: Path) -> None:
    motion = read(read_trc, write(tmp_path / "a.trc", change(TRC)))
    assert motion.names == (("LASI", "R Knee")[place],)
    np.testing.assert_array_equal(motion.positions[0, 0], [[1, 2, 3], [4, 5, 6]][place])
    assert "1 markers have no name and are left out." in motion.notes


def test_a_column_of_angles_without_a_name(tmp_path: Path) -> None:
    content = STORAGE.replace("\tpelvis_tx", "\t\tpelvis_tx").replace("\t0.", "\t7\t0.")
    motion = read(read_storage, write(tmp_path / "a.mot", content))
    assert list(motion.angles) == ["knee_angle_r", "pelvis_tx"]
    np.testing.assert_array_equal(motion.angles["pelvis_tx"], [0.5, 0.6, 0.7])
    assert "1 columns have no name and are left out." in motion.notes
