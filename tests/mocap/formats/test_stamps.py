"""Times of frames: their unit is found, what is no time is told."""

from __future__ import annotations

import numpy as np
import pytest

from ergoqp.errors import RecordingError
from ergoqp.mocap.formats.times import (
    count_repeated_frames,
    time_head,
    to_seconds,
    uniform_times,
    unit_by_rate,
)

STEPS = np.array([0.0, 0.1, 0.2, 0.35])


@pytest.mark.parametrize(
    ("factor", "said"),
    [(1, None), (1e3, "milliseconds"), (1e6, "microseconds"), (1e9, "nanoseconds")],
)
@pytest.mark.parametrize("begin", [0, 1_700_000_000.5])
def test_the_unit_is_found(factor: float, said: str | None, begin: float) -> None:
    time, kept, notes = to_seconds("a", factor * (begin + STEPS))
    assert time == pytest.approx(STEPS, abs=1e-6)
    assert kept.all()
    assert any(note.startswith(f"Times are taken as {said}") for note in notes) == (
        said is not None
    )
    assert notes[-1] == (
        "The frames are not uniform in time: 0.1 s apart in the median, 0.15 s at most."
    )


@pytest.mark.parametrize("unit", [1.0, 1e-3])
def test_a_stated_unit_is_taken(unit: float) -> None:
    time, _, notes = to_seconds("a", np.arange(3.0), unit)
    np.testing.assert_array_equal(time, unit * np.arange(3))
    assert notes == [f"The frames are uniform in time, {unit:.4g} s apart."]


@pytest.mark.parametrize(
    "stamps",
    [
        [0, 0.1, 0.1, 0.1, 0.2],
        [0, 100, 100, 100, 200],
        [5, 5 + 0.1, 5 + 0.1, 5 + 0.1, 5 + 0.2],
    ],
)
def test_a_time_that_is_there_twice_is_taken_once(stamps: list[float]) -> None:
    time, kept, notes = to_seconds("a", np.array(stamps))
    assert time == pytest.approx([0, 0.1, 0.2])
    assert list(kept) == [True, True, False, False, True]
    assert "2 of 5 frames have the time of the frame before and are left out." in notes


@pytest.mark.parametrize(
    ("stamps", "unit"),
    [
        ([0, 5e-324, 100, 200], None),  # a thousandth of the smallest number is nothing
        ([-1e30, 0, 1, 2], 1.0),
        ([0, 1e-320, 1, 2], 1e-9),
    ],
)
def test_times_increase_whatever_is_rounded(stamps: list[float], unit: float | None) -> None:
    time, kept, _ = to_seconds("a", np.array(stamps), unit)
    assert (np.diff(time) > 0).all()
    assert len(time) == kept.sum() >= 2


@pytest.mark.parametrize(
    ("stamps", "sentence"),
    [
        ([], "^a: got no frame, allowed a recording with movement in it$"),
        ([0, np.nan, 1, np.nan, np.nan], "^a: frame 2 has no time$"),
        ([0, 0.2, 0.1], r"^a: time runs backwards from frame 2 to 3, from 0\.2 to 0\.1$"),
        ([0, 1e15, 2e15], r"^a: the frames are 1e\+15 apart in time, allowed a"),
        ([0, 1e-5, 2e-5], r"^a: the frames are 1e-05 apart in time, allowed a"),
    ],
)
def test_what_is_no_time_is_told(stamps: list[float], sentence: str) -> None:
    with pytest.raises(RecordingError, match=sentence):
        to_seconds("a", np.array(stamps, dtype=float))


def test_frames_without_a_time_are_left_out() -> None:
    time, kept, notes = to_seconds("a", np.array([np.nan, 5.0, 5.1, np.nan, 5.2, 5.2, 5.3]))
    np.testing.assert_allclose(time, [0, 0.1, 0.2, 0.3])
    np.testing.assert_array_equal(np.flatnonzero(kept), [1, 2, 4, 6])
    assert notes[0] == "2 of 7 frames have no time and are left out."


TICKS = "Times are taken as ticks of 100 nanoseconds"
MICRO = "Times are taken as microseconds"
NANO = "Times are taken as nanoseconds"
NET = 637_000_000_000_000_000


@pytest.mark.parametrize(
    ("first", "step", "unit", "said"),
    [
        # Without a date the rate decides: a usual one before a rare one.
        (0, 1_000_000, 1e-7, f"{TICKS}."),  # 10 Hz, and not 1000
        (0, 333_333, 1e-7, f"{TICKS}."),  # 30 Hz, and not 3
        (0, 166_666, 1e-7, f"{TICKS}."),
        (0, 33_333, 1e-6, f"{MICRO}."),  # 30 Hz; 300 as ticks
        (0, 8_333_333, 1e-9, f"{NANO}."),  # 120 Hz; 1.2 as ticks
        (0, 2_000, 1e-6, f"{MICRO}."),
        (
            0,
            100_000,
            1e-6,
            f"{MICRO}, 10 frames per second (they would be 100 as ticks of 100 nanoseconds).",
        ),
        # A date shows it.
        (NET, 1_000_000, 1e-7, f"{TICKS}."),
        (NET, 100_000, 1e-7, f"{TICKS}."),
        (132_000_000_000_000_000, 100_000, 1e-7, f"{TICKS}."),
        (1_600_000_000_000_000, 500_000, 1e-6, f"{MICRO}."),
        (1_600_000_000_000_000_000, 1_000_000, 1e-9, f"{NANO}."),
        (1_600_000_000_000, 33, 1e-3, "Times are taken as milliseconds."),
        (1_600_000_000, 0.033, 1.0, None),
    ],
)
def test_the_unit_by_the_date_and_the_rate(
    first: float, step: float, unit: float, said: str | None
) -> None:
    stamps = first + step * np.arange(20.0)
    time, kept, notes = to_seconds("a", stamps)
    assert kept.all()
    np.testing.assert_allclose(time[-1], 19 * unit * step, rtol=1e-3)
    assert [note for note in notes if note.startswith("Times")] == ([] if said is None else [said])


def test_one_frame_and_frames_of_one_time() -> None:
    for stamps in ([3.0], [3.0, 3.0]):
        time, kept, notes = to_seconds("a", np.array(stamps))
        np.testing.assert_array_equal(time, [0])
        assert kept[0]
        assert notes[-1] == "There is one frame."


def test_the_unit_by_a_stated_rate() -> None:
    # The median of the steps counts, a gap or a frame that is there twice does not.
    stamps = np.array([0, 0, 20, 40, 60, 80, 9000])
    unit, said = unit_by_rate(stamps, 50.0)
    assert unit == 1e-3
    assert said == ["Times are taken as milliseconds: the file states 50 frames per second."]
    assert unit_by_rate(stamps / 1000, 50.0) == (1.0, [])
    for few in ([], [3.0], [3.0, 3.0], [np.nan, np.nan]):
        assert unit_by_rate(np.array(few), 50.0) == (1.0, [])
    for rate in (0.0, -50.0, np.nan, np.inf, 25.0):
        unit, said = unit_by_rate(stamps, rate)
        assert unit == 1.0
        assert "but its times give 0.05: the times are used" in said[0]


def test_a_stated_rate() -> None:
    time, notes = uniform_times("a", 3, 50)
    np.testing.assert_array_equal(time, [0, 0.02, 0.04])
    assert notes == ["There are 50 frames per second, as stated."]
    for rate in (0, -1, np.nan, np.inf, 1e9):
        with pytest.raises(RecordingError, match=r"^a: rate: got .*, allowed frames"):
            uniform_times("a", 3, rate)


def test_frames_that_are_there_twice() -> None:
    positions = np.random.default_rng(0).normal(size=(9000, 2, 3)).astype(np.float32)
    assert count_repeated_frames(positions) == []
    positions[::3, 1] = np.nan
    positions[1::3] = positions[::3]
    assert count_repeated_frames(positions) == ["3000 of 9000 frames repeat the frame before."]
    positions[4000] = positions[3999]  # the first of a block
    assert count_repeated_frames(positions)[0].startswith(f"{3000 + (4000 % 3 != 1)} ")
    assert count_repeated_frames(positions[:1]) == []


SHOWN = np.random.default_rng(1).normal(size=(100, 2, 3)).astype(np.float32)


def test_frames_of_one_time_that_show_the_same_are_one() -> None:
    stamps, shown = 0.1 * (np.arange(100) // 2), np.repeat(SHOWN[:50], 2, axis=0)
    shown[20:22] = np.nan
    time, kept, notes = to_seconds("a", stamps, 1.0, [shown, shown[:, :0]])
    assert len(time) == kept.sum() == 50
    assert notes[0] == "50 of 100 frames have the time of the frame before and are left out."


def test_few_frames_of_one_time_may_differ() -> None:
    stamps = 0.1 * np.arange(100)
    stamps[[20, 40]] = stamps[[19, 39]]
    _, kept, notes = to_seconds("a", stamps, 1.0, [SHOWN])
    np.testing.assert_array_equal(np.flatnonzero(~kept), [20, 40])
    assert notes[0] == (
        "2 of 100 frames have the time of the frame before (2 of them differ from it) and are left"
        " out."
    )
    stamps[60] = stamps[59]
    with pytest.raises(RecordingError, match=r"^a: 3 of 100 frames have the time of the frame"):
        to_seconds("a", stamps, 1.0, [SHOWN])


@pytest.mark.parametrize("stamps", [np.arange(100) // 50, np.zeros(100)])
def test_times_that_are_too_coarse_are_refused(stamps: np.ndarray) -> None:
    with pytest.raises(RecordingError) as caught:
        to_seconds("a", stamps.astype(float), 1.0, [SHOWN], "; or state the rate")
    assert str(caught.value).endswith(
        "frames have the time of the frame before and show something else, so the times are too"
        " coarse or there are several people, allowed times that increase; or state the rate"
    )


@pytest.mark.parametrize(
    ("word", "found"),
    [
        ("%time", (True, None)),
        ("# times", (True, None)),
        ("Timestamp [ms]", (True, 1e-3)),
        ("t_ns", (True, 1e-9)),
        ("tip", (False, None)),
        ("time of day", (False, None)),
    ],
)
def test_heads_of_times(word: str, found: tuple[bool, float | None]) -> None:
    assert time_head(word) == found
