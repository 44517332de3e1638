"""Orientations of another length than 1, and rotations in radians, do not pass in silence."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from small_files import MOTIVE, MVNX, read, write

from ergoqp.errors import RecordingError
from ergoqp.mocap import load_recording
from ergoqp.mocap.formats.motive import read_motive
from ergoqp.mocap.formats.mvnx import read_mvnx
from ergoqp.mocap.formats.turns import UnitTurns

TURNS = np.random.default_rng(0).normal(size=(50, 2, 4))
TURNS /= np.linalg.norm(TURNS, axis=2, keepdims=True)


@pytest.mark.parametrize("size", [0.5, 2.0, 1000.0])
def test_one_length_of_all_is_a_scale(size: float) -> None:
    unit = UnitTurns()
    np.testing.assert_allclose(unit.of(size * TURNS), TURNS)
    # The scale is that of the file.
    assert np.isnan(unit.of(TURNS)).all()
    assert unit.said() == [
        f"The orientations have the length {size:.3g} and not 1: they are scaled.",
        "100 of 200 orientations have another length and are not seen.",
    ]


def test_some_of_another_length_are_counted() -> None:
    unit, turns = UnitTurns(), TURNS.copy()
    turns[:3, 0] *= 0.5
    turns[3, 0], turns[4, 0] = 0.0, np.nan
    found = unit.of(turns)
    assert np.isnan(found[:5, 0]).all()
    np.testing.assert_allclose(found[5:], TURNS[5:])
    assert unit.said() == ["3 of 98 orientations have another length and are not seen."]


def test_what_is_not_seen_has_no_length() -> None:
    unit = UnitTurns()
    assert np.isnan(unit.of(np.full((3, 2, 4), np.nan))).all()
    np.testing.assert_allclose(unit.of(0.5 * TURNS), TURNS)
    assert UnitTurns().said() == []


def test_in_files(tmp_path: Path) -> None:
    content = MVNX.replace("1 0 0 0 0.8 0 0 0.6", "0.5 0 0 0 0.4 0 0 0.3")
    motion, whole = (read(read_mvnx, write(tmp_path / "a.mvnx", each)) for each in (content, MVNX))
    np.testing.assert_allclose(motion.turns["L5"], whole.turns["L5"])
    said = "The orientations have the length 0.5 and not 1: they are scaled."
    assert said in motion.notes
    take = MOTIVE.replace("0,0,0.6,0.8", "0,0,0.3,0.4")
    motion = read(read_motive, write(tmp_path / "a.csv", take))
    assert any("orientations have another length" in note for note in motion.notes)


def in_radians(demo: Path, folder: Path) -> Path:
    """The demo with rotations in radians."""
    head, mark, rest = demo.read_text(encoding="utf-8").partition("Frame Time:")
    time, numbers = rest.split("\n", 1)
    rows = np.loadtxt(numbers.splitlines())
    rows[:, 3:] = np.radians(rows[:, 3:])
    text = "\n".join(" ".join(f"{value:.6f}" for value in row) for row in rows)
    return write(folder / "take.bvh", f"{head}{mark}{time}\n{text}\n")


def test_a_bvh_in_radians_is_refused_unless_it_is_trusted(demo: Path, tmp_path: Path) -> None:
    path = in_radians(demo, tmp_path)
    with pytest.raises(
        RecordingError,
        match=r"^take\.bvh: no rotation exceeds \d.*, allowed degrees: .* \(trust angles\)$",
    ):
        load_recording(path)
    assert len(load_recording(path, trust=["angles"]).time) == 181


def test_a_body_that_stands_like_a_stick_is_in_any_unit(demo: Path, tmp_path: Path) -> None:
    text = demo.read_text(encoding="utf-8")
    head, mark, rest = text.partition("Frame Time:")
    time, numbers = rest.split("\n", 1)
    row = numbers.splitlines()[0].split()
    still = " ".join([*row[:3], *("0.2" for _ in row[3:])])
    head = re.sub(r"Frames: \d+", "Frames: 3", head)
    path = write(tmp_path / "still.bvh", f"{head}{mark}{time}\n" + f"{still}\n" * 3)
    assert len(load_recording(path).time) == 3
