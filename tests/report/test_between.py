"""Values between two ends, in words."""

import pytest

from ergoqp.report.between import around, between, levels_between, risk_between, shares_of


@pytest.mark.parametrize(
    ("best", "low", "high", "words"),
    [
        (4, 4, 4, "4"),
        (4, 4, 7, "4 to 7"),
        (5, 4, 7, "5 (4 to 7)"),
        (7, 4, 7, "7 (4 to 7)"),
    ],
)
def test_the_likeliest_is_named_unless_it_is_the_lower_end(best, low, high, words):
    assert around(best, low, high) == words


def test_numbers_that_are_written_alike_are_one():
    assert around(2.61, 2.6, 2.62, lambda value: f"{value:.1f}") == "2.6"
    assert between("1", "1") == "1"


def test_risks_and_levels_of_two_scores():
    assert risk_between(1, 1) == "negligible"
    assert risk_between(2, 9) == "low to high"
    assert levels_between(2, 9) == (1, 2, 3)
    assert levels_between(1.4, 1.6) == (0, 1)
    assert levels_between(11, 15) == (4,)


def test_shares_of_which_two_are_equal_are_one():
    low, high = {"low": 1.0, "high": 0.0}, {"low": 0.0, "high": 1.0}
    half = {"low": 0.5, "high": 0.5}

    def names(*shares):
        ends = zip(("_low", "", "_high"), shares, strict=True)
        return list(shares_of({f"share{end}": each for end, each in ends}))

    assert names(low, low, low) == ["all"]
    assert names(low, low, high) == ["lowest", "highest"]
    assert names(low, half, high) == ["lowest", "likeliest", "highest"]
