"""Words that stand for numbers."""

from __future__ import annotations

import pytest

from ergoqp.mocap.formats.columns import ClockTimeParser, parse_tracking_state


@pytest.mark.parametrize(
    ("words", "seconds"),
    [
        (["12:00:00", "12:00:00.5", "12:00:01,25"], [0, 0.5, 1.25]),
        (["9:59:59.9", "10:00:00.0"], [0, 0.1]),
        (["23:59:59.5", "00:00:00.5", "00:00:01"], [0, 1, 1.5]),
        (["2026-01-31T23:59:59.5", "2026-02-01T00:00:00"], [0, 0.5]),
        (["2026-01-31 12:00:00.000001Z", "2026-01-31 12:00:00.000002Z"], [0, 1e-6]),
        (["2026-03-29T01:59:59+01:00", "2026-03-29T03:00:00+0200"], [0, 1]),
        (["2026-03-29T01:00:00-03:30", "2026-03-29T04:30:01 UTC"], [0, 1]),
        (["2026-03-29T01:00:00.123456789", "2026-03-29T01:00:00.223456789"], [0, 0.1]),
    ],
)
def test_clock_times(words: list[str], seconds: list[float]) -> None:
    clock = ClockTimeParser("time")
    found = [float(clock(word)) for word in words]
    assert [each - found[0] for each in found] == pytest.approx(seconds, abs=1e-10)


@pytest.mark.parametrize(
    "word",
    [
        "noon",
        "12:00",
        "12.00.00",
        "01/02/2026 12:00:00",
        "2026-02-30T12:00:00",
        "1:0:0",
        "12:00:0x",
    ],
)
def test_what_is_no_time_is_told(word: str) -> None:
    with pytest.raises(ValueError, match=r"^in the column 'when', allowed a number or a time such"):
        ClockTimeParser("when")(word)


@pytest.mark.parametrize(
    ("word", "number"),
    [
        *[(word, "0") for word in ("NOT_TRACKED", "NotTracked", "lost", "OFF", "False")],
        *[(word, "1") for word in ("TRACKED", "Inferred", "OK", "True", "high")],
        ("K4ABT_JOINT_CONFIDENCE_NONE", "0"),
        ("0.25", "0.25"),
    ],
)
def test_how_a_tracker_says_that_it_sees(word: str, number: str) -> None:
    assert parse_tracking_state(word) == number
