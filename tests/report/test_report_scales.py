from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ergoqp.report.charts.axes import (
    Scale,
    changes,
    highest_per_column,
    padded,
    round_ticks,
    thinned,
    words_of,
)

numbers = st.floats(-1e6, 1e6)


def test_scale_maps_its_ends_to_its_pixels():
    scale = Scale(2, 4, 100, 20)
    assert scale.at(2) == 100
    assert scale.at(4) == 20
    assert scale.at(3) == 60


def test_logarithmic_scale_puts_the_geometric_mean_in_the_middle():
    scale = Scale(10, 1000, 0, 100, logarithmic=True)
    assert scale.at(100) == pytest.approx(50)
    assert scale.ticks() == pytest.approx([10, 20, 50, 100, 200, 500, 1000])


def test_logarithmic_ticks_of_many_decades_are_powers_of_ten():
    assert Scale(1, 1e6, 0, 1, logarithmic=True).ticks() == pytest.approx(
        [1, 10, 100, 1e3, 1e4, 1e5, 1e6]
    )


@given(numbers, st.floats(1e-6, 1e6), st.integers(1, 12))
def test_ticks_are_round_and_inside(low, width, count):
    high = low + width
    if high <= low:
        return
    ticks = round_ticks(low, high, count)
    assert len(ticks) <= count + 1
    rounding = 1e-6 * width + 4 * np.spacing(max(abs(low), abs(high)))
    assert all(low - rounding <= tick <= high + rounding for tick in ticks)


def test_ticks_of_a_score_axis():
    assert round_ticks(0, 20, 4) == [0, 5, 10, 15, 20]
    assert [words_of(tick) for tick in round_ticks(-0.2, 0.2, 4)] == [
        "−0.2",
        "−0.1",
        "0",
        "0.1",
        "0.2",
    ]


@given(st.lists(st.one_of(numbers, st.just(np.nan)), min_size=1, max_size=400), st.integers(1, 20))
def test_thinning_keeps_every_extreme_in_its_place(values, columns):
    y = np.array(values)
    x = np.arange(len(y), dtype=float)
    few_x, few_y = thinned(x, y, columns)
    assert len(few_x) <= max(4 * columns, 1)
    assert (np.diff(few_x) > 0).all()
    np.testing.assert_array_equal(few_y, y[few_x.astype(int)])
    if np.isfinite(y).any():
        assert np.nanmax(few_y) == np.nanmax(y)
        assert np.nanmin(few_y) == np.nanmin(y)


def test_a_single_peak_among_sixty_thousand_samples_stays():
    y = np.zeros(60_000)
    y[31_415] = 7
    few_x, few_y = thinned(np.arange(60_000) / 1000, y)
    assert len(few_x) <= 2800
    assert few_y.max() == 7
    assert few_x[few_y.argmax()] == pytest.approx(31.415)


def test_a_long_gap_interrupts_a_thinned_line():
    y = np.ones(10_000)
    y[4000:6000] = np.nan
    _, few = thinned(np.arange(10_000.0), y, 100)
    assert np.isnan(few).any()


def test_padding_ignores_what_is_not_a_number():
    low, high = padded(np.array([1.0, np.nan, 3.0, np.inf]))
    assert low < 1 < 3 < high < 4
    assert padded(np.array([np.nan])) == (0.0, 1.0)
    low, high = padded(np.full(3, 5.0), least=0.1)
    assert (low, high) == pytest.approx((4.95, 5.05))


def test_changes_are_where_a_new_value_starts():
    assert changes(np.array([3, 3, 1, 1, 3])).tolist() == [0, 2, 4]
    assert changes(np.array([], dtype=int)).tolist() == []


def test_stretches_of_a_short_series_are_exact():
    time = np.array([0.0, 1.0, 2.0, 3.0])
    assert highest_per_column(time, np.array([1, 1, 0, 2])) == [(0, 2, 1), (2, 3, 0), (3, 3, 2)]


@given(st.lists(st.integers(0, 5), min_size=1, max_size=500), st.integers(1, 30))
def test_stretches_cover_the_time_and_keep_the_highest(values, columns):
    time = np.arange(len(values)) / 10
    stretches = highest_per_column(time, np.array(values), columns)
    assert len(stretches) <= max(columns, 1)
    assert stretches[0][0] == time[0]
    assert stretches[-1][1] == time[-1]
    assert all(before[1] == after[0] for before, after in pairwise(stretches))
    assert max(value for _, _, value in stretches) == max(values)


def test_no_samples_no_stretches():
    assert highest_per_column(np.array([]), np.array([], dtype=int)) == []
