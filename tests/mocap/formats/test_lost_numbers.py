"""A number that is missing (NaN) is a lost sample in every format and refuses no file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from small_files import MOTIVE, MVNX, NEXUS, STORAGE, TABLE, TRC, read, write

from ergoqp.mocap import load_recording
from ergoqp.mocap.formats.bvh import read_bvh
from ergoqp.mocap.formats.motive import read_motive
from ergoqp.mocap.formats.mvnx import read_mvnx
from ergoqp.mocap.formats.nexus import read_nexus
from ergoqp.mocap.formats.opensim import read_storage
from ergoqp.mocap.formats.table import read_table
from ergoqp.mocap.formats.trc import read_trc


def with_nan(demo: Path, folder: Path, frame: int, column: int, word: str = "nan") -> Path:
    """The demo with one number that is missing."""
    lines = demo.read_text(encoding="utf-8").splitlines()
    row = next(i for i, line in enumerate(lines) if line.startswith("Frame Time")) + 1 + frame
    words = lines[row].split()
    words[column] = word
    lines[row] = " ".join(words)
    return write(folder / "take.bvh", "\n".join(lines) + "\n")


@pytest.mark.parametrize("word", ["nan", "NaN", "-nan(ind)", "null"])
def test_in_a_bvh_what_hangs_from_the_joint_is_lost(word: str, demo: Path, tmp_path: Path) -> None:
    whole = read_bvh(demo)
    last = read_bvh(with_nan(demo, tmp_path, 70, -1, word))
    lost = np.isnan(last.positions).any(axis=2)
    assert not lost[np.arange(len(lost)) != 70].any()
    assert 0 <= lost.sum() < len(whole.names) / 3
    np.testing.assert_array_equal(last.positions[~lost], whole.positions[~lost])
    root = read_bvh(with_nan(demo, tmp_path, 70, 0, word))
    assert np.isnan(root.positions[70, :, :]).any(axis=1).all()
    assert (
        "In 1 of 181 frames a number is missing: what hangs from its joint is not seen there."
        in root.notes
    )


def test_a_frame_of_a_bvh_that_is_lost_is_bridged(demo: Path, tmp_path: Path) -> None:
    recording = load_recording(with_nan(demo, tmp_path, 70, 0))
    assert not recording.observed[70].any()
    assert recording.scored.all()


def test_in_a_table_and_in_files_of_markers(tmp_path: Path) -> None:
    for reader, text in ((read_table, TABLE), (read_trc, TRC), (read_nexus, NEXUS)):
        motion = read(reader, write(tmp_path / "a.csv", text.replace("2.5", "NaN")))
        assert np.isnan(motion.positions[1, 0]).any()
        assert np.isfinite(motion.positions[[0, 2]]).all()


def test_a_frame_without_a_time_is_left_out(tmp_path: Path) -> None:
    for reader, text in (
        (read_table, TABLE.replace("0.1,", ",", 1)),
        (read_trc, TRC.replace("2\t0.1", "2\t")),
        (read_storage, STORAGE.replace("0.1\t", "\t")),
        (read_motive, MOTIVE.replace("0.100000", "")),
    ):
        motion = read(reader, write(tmp_path / "a.mot", text))
        assert motion.time == pytest.approx([0, 0.2])
        assert "1 of 3 frames have no time and are left out." in motion.notes
        assert all(np.isfinite(each).all() for each in motion.angles.values())


def test_in_an_mvnx(tmp_path: Path) -> None:
    text = MVNX.replace("1 2 10", "1 nan 10").replace("1 0 1 1 0.5 1.5", "1 0 1 1 NaN 1.5")
    motion = read(read_mvnx, write(tmp_path / "a.mvnx", text))
    assert np.isnan(motion.angles["jL5S1 rotation"][1])
    assert np.isnan(motion.positions[1, 1, 1])
    assert np.isfinite(motion.positions[[0, 2]]).all()


def test_among_joint_angles(tmp_path: Path) -> None:
    motion = read(read_storage, write(tmp_path / "a.mot", STORAGE.replace("45", "")))
    assert np.isnan(motion.angles["knee_angle_r"][1])
    assert np.isfinite(motion.angles["knee_angle_r"][[0, 2]]).all()
    assert "Blanks are taken as not seen, in the columns knee_angle_r." in motion.notes
