"""Places of a low confidence are taken as not seen, by the scale of each column."""

from __future__ import annotations

import numpy as np
import pytest

from ergoqp.mocap.formats.columns import ConfidenceColumn, ConfidenceFilter

NAN = np.nan


@pytest.mark.parametrize(
    ("values", "seen", "words"),
    [
        ([0, 1, 2, 3], [0, 1, 1, 1], "0"),
        ([0, 1, 1, 1], [0, 1, 1, 1], "0"),
        ([-1, 0, 2, NAN], [0, 0, 1, 0], "0"),
        ([0, 0.25, 0.5, 1], [0, 1, 1, 1], "0"),
        ([0.02, 0.99, 0.99, 1], [0, 1, 1, 1], "below 0.3"),
        ([0.29, 0.3, 0.31, 0], [0, 1, 1, 0], "below 0.3"),
        ([0.1, 1.02, 0.9, 0.9], [0, 1, 1, 1], "below 0.3"),
        ([0, 29, 30, 100], [0, 0, 1, 1], "below 30"),
        ([0, 29.9, 30.1, 4], [0, 0, 1, 0], "below 30"),
        ([0, 1, 500, 1e30], [0, 1, 1, 1], "0"),
    ],
)
def test_what_is_seen_on_each_scale(values: list[float], seen: list[int], words: str) -> None:
    confidence = ConfidenceFilter([ConfidenceColumn(3, 1, "score")])
    rows = np.array(values)[:, None]
    confidence.add(rows[:1], 0.1)
    confidence.add(rows[1:], 1.0)
    positions = np.ones((4, 2, 3), np.float32)
    notes = confidence.mask_low_confidence(positions)
    np.testing.assert_array_equal(np.isfinite(positions[:, 1, 0]), np.array(seen, bool))
    assert np.isfinite(positions[:, 0]).all()
    lost = 4 - sum(seen)
    assert notes == [
        f"{lost} of 8 places are taken as not seen: their score is {words} or missing."
    ]


def test_columns_that_are_called_differently_have_scales_of_their_own() -> None:
    confidence = ConfidenceFilter(
        [
            ConfidenceColumn(3, 0, "state"),
            ConfidenceColumn(4, 0, "score"),
            ConfidenceColumn(5, 1, "score"),
        ]
    )
    confidence.add(np.array([[0, 0.9, 0.9], [2, 0.2, 0.9], [1, 0.4, 0.9]]), 1.0)
    positions = np.ones((3, 2, 3), np.float32)
    assert [note[:6] for note in confidence.mask_low_confidence(positions)] == ["1 of 6", "1 of 6"]
    np.testing.assert_array_equal(np.isfinite(positions[:, :, 0]), [[0, 1], [0, 1], [1, 1]])


def test_where_everything_is_seen_nothing_is_said() -> None:
    assert ConfidenceFilter([]).mask_low_confidence(np.ones((2, 1, 3))) == []
    confidence = ConfidenceFilter([ConfidenceColumn(3, 0, "score")])
    confidence.add(np.array([[0.9], [0.1]]), 1.0)
    # What is blank anyway is not lost by its score.
    assert confidence.mask_low_confidence(np.array([[[1.0, 1, 1]], [[NAN, NAN, NAN]]])) == []
