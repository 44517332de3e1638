import pytest

from ergoqp.report.charts.axes import words_of
from ergoqp.report.page import microseconds, plain


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (4423.7, "4420"),
        (0.03124, "0.0312"),
        (3.2e-9, "< 0.000001"),
        (0, "0"),
        (-12.34, "−12.3"),
        (1234567.0, "1230000"),
        (float("nan"), "–"),
        (float("inf"), "–"),
    ],
)
def test_a_number_has_no_exponent(value, words):
    assert plain(value) == words


def test_durations_and_ticks_have_none_either():
    assert microseconds(6670.2) == "6670 µs"
    assert microseconds(12_345.0) == "12.3 ms"
    assert words_of(2e7) == "20000000"
    assert words_of(-2e-5) == "−0.00002"
    assert words_of(-0.0) == "0"
