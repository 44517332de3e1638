"""Recordings that were once read wrongly or refused without a way out (see their index)."""

from __future__ import annotations

from pathlib import Path

import pytest

from ergoqp.errors import RecordingError
from ergoqp.mocap import Recording, load_recording


@pytest.fixture
def faults(shared: Path) -> Path:
    folder = shared / "recording_faults"
    if not folder.is_dir():
        pytest.skip("the shared folder has no recording_faults")
    return folder


def said(recording: Recording) -> str:
    return " ".join(recording.assumptions)


def test_a_trolley_is_pulled_with_a_hand_behind(faults: Path) -> None:
    recording = load_recording(faults / "2_pulls_a_trolley.csv")
    assert recording.scored.all()
    assert "although the hands reach backward, and the knees bend forward" in said(recording)
    exchanged = faults / "2b_sides_exchanged_as_told.csv"
    with pytest.raises(RecordingError, match=r"the knees bend backward: .* \(trust sides\)"):
        load_recording(exchanged)
    assert "as stated, although" in said(load_recording(exchanged, trust=["sides"]))


def test_ticks_of_a_clock(faults: Path) -> None:
    recording = load_recording(faults / "5_times_in_ticks.csv")
    assert len(recording.time) == 150
    assert recording.time[-1] == pytest.approx(14.9, abs=1e-3)
    assert "Times are taken as ticks of 100 nanoseconds." in recording.assumptions


def test_decimal_commas_between_commas(faults: Path) -> None:
    with pytest.raises(
        RecordingError,
        match=r"line 2: got a row of \d+ numbers below a head of \d+ names, .* decimal points",
    ):
        load_recording(faults / "6_decimal_commas_and_commas.csv")


@pytest.mark.parametrize("name", ["7_wrist_bar.trc", "btk_T.trc"])
def test_bars_across_the_wrists_are_read(name: str, faults: Path) -> None:
    recording = load_recording(faults / name)
    # All is scored, apart from a T-pose at the start or the end.
    assert set(recording.not_scored) <= {"calibration pose"}
