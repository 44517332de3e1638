"""Numbers out of range that would be in range in another unit."""

from __future__ import annotations

import pytest

from ergoqp.arguments import check_number, perhaps
from ergoqp.errors import InputError
from ergoqp.human import Body


@pytest.mark.parametrize(
    ("values", "low", "high", "unit", "said"),
    [
        ([250, -300, 700], -3, 3, "m", " (millimetres?)"),
        ([168], 1.2, 2.3, "m", " (centimetres?)"),
        ([1680], 1.2, 2.3, "m", " (millimetres?)"),
        ([0.52], 3.2, 170, "deg", " (radians?)"),
        ([80], 0, 0.5, "s", " (milliseconds?)"),
        ([5], 0, 0.5, "share", " (per cent?)"),
        ([57], 0.02, 4, "rad/s", " (deg/s?)"),
        ([-80], 0, 0.5, "s", ""),
        ([250, -30000], -3, 3, "m", ""),
        ([0], 0.1, 0.5, "m", ""),
        ([float("nan")], -3, 3, "m", ""),
        ([7], 0, 3, "", ""),
    ],
)
def test_a_unit_is_named_only_if_all_numbers_fit(
    values: list[float], low: float, high: float, unit: str, said: str
) -> None:
    assert perhaps(values, low, high, unit) == said


def test_a_number_out_of_range_names_the_unit_it_may_be_in() -> None:
    with pytest.raises(InputError, match=r"got 168 m, allowed 1.2 to 2.3 m \(centimetres\?\)$"):
        Body(168)
    with pytest.raises(InputError, match=r"dt: got -1 s, allowed 0 to 0.1 s$"):
        check_number("dt", -1, 0.0, 0.1, "s")
