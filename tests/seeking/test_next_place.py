"""Which place is next, by the score that was measured: scripts in plain numbers."""

from __future__ import annotations

import numpy as np
import pytest

from ergoqp.errors import InputError
from ergoqp.identification.loops import Resting
from ergoqp.identification.promising import LIKELY, Candidate
from ergoqp.seeking.next_place import DESCENT, THEIRS, Place, SearchState, SeekOptions


def at(x: float) -> np.ndarray:
    pose = np.eye(4)
    pose[0, 3] = x
    return pose


def rest(time: float, x: float) -> Resting:
    return Resting(time, at(x), np.zeros(32))


def promise(pose: np.ndarray, gain: float) -> Candidate:
    return Candidate(pose, gain, 1.0, np.ones(LIKELY))


A, B = Place("a", at(0.2)), Place("b", at(0.4))


def test_descent_first_then_the_places_and_back_to_the_best() -> None:
    tries = SearchState([A, B], SeekOptions(), 1.0)
    assert tries.measured(rest(5, 0.0), 3.0) is A
    assert tries.measured(rest(12, 0.2), 4.0) is B
    home = tries.measured(rest(19, 0.4), 5.0)
    assert home is not None
    assert home.name == DESCENT
    np.testing.assert_array_equal(home.pose, at(0.0))
    assert tries.measured(rest(25, 0.0), 3.1) is None
    assert tries.done
    assert [each.name for each in tries.account] == [DESCENT, "a", "b", DESCENT]
    assert tries.account[-1].why == "returned to"
    assert tries.best is tries.account[-1]


def test_who_is_well_is_left_alone() -> None:
    tries = SearchState([A, B], SeekOptions(enough=0.5), 1.0)
    assert tries.measured(rest(5, 0.0), 1.4) is None
    assert tries.done


def test_where_the_last_is_about_the_best_it_stays() -> None:
    tries = SearchState([A], SeekOptions(better=0.2), 1.0)
    assert tries.measured(rest(5, 0.0), 3.0) is A
    assert tries.measured(rest(9, 0.2), 3.15) is None
    assert tries.done


def test_a_best_place_that_is_worse_the_second_time_gives_way_to_the_next() -> None:
    tries = SearchState([A, B], SeekOptions(), 1.0)
    tries.measured(rest(5, 0.0), 5.0)
    tries.measured(rest(9, 0.2), 2.0)
    home = tries.measured(rest(13, 0.4), 3.0)
    assert home is not None
    assert home.name == "a"
    again = tries.measured(rest(17, 0.2), 4.5)
    assert again is not None
    assert again.name == "b"
    assert tries.measured(rest(21, 0.4), 6.0) is None
    assert tries.done


def test_places_that_were_met_are_not_tried() -> None:
    tries = SearchState([Place("same", at(0.01)), B], SeekOptions(), 1.0)
    assert tries.measured(rest(5, 0.0), 3.0) is B


def test_tries_and_time_are_bounded() -> None:
    many = [Place(str(i), at(0.2 * i)) for i in range(1, 20)]
    tries = SearchState(many, SeekOptions(tries=3), 1.0)
    for i in range(3):
        assert not tries.done
        tries.measured(rest(5.0 * i, -1.0 - 0.2 * i), 5.0 - i)
    assert tries.done
    tries = SearchState(many, SeekOptions(longest=20.0), 1.0)
    assert tries.measured(rest(9, 0.0), 5.0) is None
    assert tries.done


def test_who_does_not_come_to_rest_is_waited_for_no_longer_than_that() -> None:
    tries = SearchState([A], SeekOptions(patience=15.0), 1.0)
    assert not tries.overdue(14.9)
    assert tries.overdue(15.1)
    assert tries.unrested(15.1, at(0.0)) is A
    assert np.isnan(tries.account[0].score)
    assert tries.best is None
    assert tries.unrested(30.2, at(0.1)) is None
    assert tries.done


def test_a_place_whose_way_cost_too_much_is_left_out_from_then_on() -> None:
    tries = SearchState([A], SeekOptions(), 1.0, thinks=True)
    assert tries.measured(rest(5, 0.0), 3.0) is A
    assert tries.measured(rest(12, 0.0), 3.0) is None
    assert "cost too much" in tries.account[-1].note
    assert tries.thinking
    promises = [promise(at(0.21), 1.5), promise(at(0.7), 0.5)]
    going = tries.suggested(12.5, promises)
    assert going is not None
    np.testing.assert_array_equal(going.pose, at(0.7))
    assert going.name == THEIRS


def test_what_promises_too_little_is_not_tried() -> None:
    tries = SearchState([A], SeekOptions(worth=0.15), 1.0, thinks=True)
    tries.measured(rest(5, 0.0), 3.0)
    assert tries.measured(rest(12, 0.2), 4.0) is None
    assert tries.thinking
    assert not tries.overdue(99.0)
    home = tries.suggested(13.0, [promise(at(0.7), 0.1)])
    assert home is not None
    assert home.name == DESCENT


@pytest.mark.parametrize("back", [3.6, 4.4, None])
def test_a_best_place_that_is_worse_the_second_time_is_thought_about_again(
    back: float | None,
) -> None:
    tries = SearchState([A, B], SeekOptions(), 1.0, thinks=True)
    tries.measured(rest(5, 0.0), 5.0)
    tries.measured(rest(10, 0.2), 3.5)
    assert tries.measured(rest(15, 0.4), 5.0) is None
    home = tries.suggested(16.0, [])
    assert home is not None
    assert tries.returning
    after = tries.unrested(20.0, at(0.2)) if back is None else None
    after = tries.measured(rest(20, 0.2), back) if back is not None else after
    assert after is None
    if back == 3.6:
        assert tries.done
        return
    assert tries.thinking
    assert not tries.done
    going = tries.suggested(21.0, [promise(at(0.7), 0.5)])
    assert going is not None
    assert going.name == THEIRS
    assert not tries.returning
    assert tries.measured(rest(26, 0.7), 3.0) is None
    assert tries.thinking
    assert tries.suggested(27.0, []) is None
    assert tries.kept


def test_the_account_says_what_was_promised() -> None:
    tries = SearchState([], SeekOptions(), 1.0, thinks=True)
    tries.measured(rest(5, 0.0), 5.0)
    assert tries.done
    tries = SearchState([A], SeekOptions(), 1.0, thinks=True)
    tries.measured(rest(5, 0.0), 5.0)
    tries.measured(rest(9, 0.2), 4.0)
    tries.suggested(9.5, [promise(at(0.7), 1.23)])
    tries.measured(rest(15, 0.7), 2.0)
    assert tries.account[-1].why == "promises 1.2 points"
    assert tries.account[-1].begun == pytest.approx(9.5)


def test_all_is_tried_anew_only_after_three_worse_rests() -> None:
    tries = SearchState([], SeekOptions(worse=1.0), 1.0)
    tries.measured(rest(5, 0.0), 2.0)
    said = [tries.worsened(at(0.0), score) for score in (3.5, 3.5, 2.5, 3.5, 3.5, 3.5)]
    assert said == [False] * 5 + [True]


def test_a_return_without_a_rest_forgets_no_rest() -> None:
    tries = SearchState([B], SeekOptions(tries=2), 1.0)
    tries.measured(rest(3, 0.0), 2.0)
    tries.measured(rest(6, 0.4), 3.0)
    tries.unrested(21, at(0.4))
    tries.unrested(36, at(0.4))
    assert tries.done
    assert not tries.kept
    assert tries.best is not None
    assert tries.best.score == 2.0


def test_it_knows_whether_it_is_where_it_measured_best() -> None:
    tries = SearchState([B], SeekOptions(tries=2), 1.0)
    for now, x, score in ((3, 0.0, 2.0), (6, 0.4, 3.0), (9, 0.0, 5.0), (12, 0.4, 6.0)):
        assert not tries.kept
        tries.measured(rest(now, x), score)
    assert tries.done
    assert not tries.kept, "6 where it is, 5 elsewhere"
    good = SearchState([], SeekOptions(), 1.0)
    good.measured(rest(3, 0.0), 2.0)
    assert good.kept


def test_who_rests_at_last_and_badly_is_begun_with() -> None:
    for score, again in ((5.0, True), (1.2, False)):
        tries = SearchState([], SeekOptions(), 1.0)
        tries.unrested(15, at(0.0))
        assert tries.done
        said = [tries.worsened(at(0.0), score) for _ in range(3)]
        assert said == [False, False, again]


def test_all_is_tried_anew_where_somebody_moved_the_object() -> None:
    tries = SearchState([], SeekOptions(worse=1.0), 1.0)
    tries.measured(rest(5, 0.0), 2.0)
    said = [tries.worsened(at(x), 2.0) for x in (0.01, 0.2, 0.2, 0.01, 0.2, 0.2, 0.2)]
    assert said == [False] * 6 + [True]


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (dict(tries=-1), r"seeking\.tries"),
        (dict(longest=float("nan")), "seeking.longest"),
        (dict(better="much"), "seeking.better"),
        (dict(returns=1.5), "seeking.returns"),
    ],
)
def test_mistakes_are_named(wrong: dict, said: str) -> None:
    with pytest.raises(InputError, match=said):
        SeekOptions(**wrong)
    with pytest.raises(InputError, match=r"place\.pose"):
        Place("a", np.zeros((4, 4)))
