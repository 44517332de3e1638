"""A user's cost and response are tried when the problem is made."""

from __future__ import annotations

import time
from functools import partial
from typing import Any

import casadi as ca
import numpy as np
import pytest

from ergoqp.errors import ProblemError
from ergoqp.joints import INDEX, JOINTS
from ergoqp.problem import validate
from ergoqp.problem.load import load_problem
from ergoqp.problem.problem import Problem

TRUNK = INDEX["trunk_flexion"]


class Upright:
    """Grows with the trunk's flexion."""

    name = "upright"
    minimum = 1.0

    def expression(self, q: Any) -> Any:
        return 1 + 2 * q[TRUNK] ** 2

    def __call__(self, postures: Any) -> np.ndarray:
        return 1 + 2 * np.atleast_2d(postures)[:, TRUNK] ** 2


class Other(Upright):
    def expression(self, q: Any) -> Any:
        return 1 + 2 * ca.sumsqr(q)


class Shape(Upright):
    def __call__(self, postures: Any) -> Any:
        return np.atleast_2d(postures)


class Raises(Upright):
    def __call__(self, postures: Any) -> Any:
        raise KeyError("no table")


class Above(Upright):
    minimum = 5.0


class OneNorm(Upright):
    def expression(self, q: Any) -> Any:
        return 1 + ca.norm_1(q)

    def __call__(self, postures: Any) -> np.ndarray:
        return 1 + np.abs(np.atleast_2d(postures)).sum(axis=1)


class Stairs(Upright):
    def expression(self, q: Any) -> Any:
        return 1 + ca.if_else(q[TRUNK] > 0.3, 4, 0)

    def __call__(self, postures: Any) -> np.ndarray:
        return 1 + 4.0 * (np.atleast_2d(postures)[:, TRUNK] > 0.3)


class SteepStairs(Upright):
    """A small jump where the cost is flat, far from where it is steep."""

    def expression(self, q: Any) -> Any:
        return 1 + 40 * q[TRUNK] ** 2 + ca.if_else(q[TRUNK] > 0.06, 0.05, 0)

    def __call__(self, postures: Any) -> np.ndarray:
        bent = np.atleast_2d(postures)[:, TRUNK]
        return 1 + 40 * bent**2 + 0.05 * (bent > 0.06)


class JumpAtATop(Upright):
    """A small jump where the slope of the cost is zero and changes evenly."""

    def expression(self, q: Any) -> Any:
        return 10 + 5 * ca.cos(8 * (q[TRUNK] - 0.4)) + ca.if_else(q[TRUNK] > 0.4, 0.05, 0)

    def __call__(self, postures: Any) -> np.ndarray:
        bent = np.atleast_2d(postures)[:, TRUNK]
        return 10 + 5 * np.cos(8 * (bent - 0.4)) + 0.05 * (bent > 0.4)


class Kink(Upright):
    def expression(self, q: Any) -> Any:
        return 1 + ca.fmax(0, q[TRUNK] - 0.3)

    def __call__(self, postures: Any) -> np.ndarray:
        return 1 + np.maximum(0, np.atleast_2d(postures)[:, TRUNK] - 0.3)


class Edge(Upright):
    def expression(self, q: Any) -> Any:
        return 1 + ca.sqrt(0.2 - q[TRUNK])

    def __call__(self, postures: Any) -> np.ndarray:
        with np.errstate(invalid="ignore"):
            return 1 + np.sqrt(0.2 - np.atleast_2d(postures)[:, TRUNK])


class Soft(Upright):
    """Twice differentiable almost everywhere, narrow, and steep: nothing is wrong with it."""

    def expression(self, q: Any) -> Any:
        return 1 + ca.fmax(0, q[TRUNK]) ** 2 + ca.tanh(200 * (q[TRUNK] - 0.2)) / 2 + 0.5

    def __call__(self, postures: Any) -> np.ndarray:
        bent = np.atleast_2d(postures)[:, TRUNK]
        return 1 + np.maximum(0, bent) ** 2 + np.tanh(200 * (bent - 0.2)) / 2 + 0.5


@pytest.fixture(scope="module")
def base() -> Problem:
    return load_problem("screwing")


@pytest.mark.parametrize("cost", [Upright(), Soft()], ids=["upright", "soft"])
def test_a_cost_that_is_what_it_says_is_taken(base: Problem, cost: Any) -> None:
    assert set(base.replace(cost=cost).own_times) == {"cost upright"}
    assert base.own_times == {}


@pytest.mark.parametrize(
    ("cost", "words"),
    [
        (Other(), r"from the expression of upright and [\d.]+ from its call at the same posture"),
        (Shape(), r"got shape \(8, 32\) from the call of upright, allowed costs \(8,\)"),
        (Raises(), "got KeyError .*no table.* from the call of upright"),
        (Above(), "got minimum 5 of upright, but 1"),
        (OneNorm(), r"got a slope of upright that jumps at .* -?[\d.e-]+ deg"),
        (Stairs(), "got a jump of upright by 4"),
        (SteepStairs(), "got a jump of upright by 0.05"),
        (JumpAtATop(), "got a jump of upright by 0.05"),
        (Kink(), "got a slope of upright that jumps at trunk flexion 17.2 deg, allowed"),
        (Edge(), "got NaN or infinity from the expression of upright"),
    ],
    ids=lambda each: type(each).__name__ if not isinstance(each, str) else "",
)
def test_a_cost_that_contradicts_itself_is_refused(base: Problem, cost: Any, words: str) -> None:
    with pytest.raises(ProblemError, match=f"^cost: .*{words}"):
        base.replace(cost=cost)


def test_a_cost_slower_than_the_period_is_refused(
    base: Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = validate._Cost.at

    def slow(self: Any, posture: np.ndarray) -> Any:
        time.sleep(0.011)
        return real(self, posture)

    monkeypatch.setattr(validate._Cost, "at", slow)
    with pytest.raises(
        ProblemError,
        match=r"^cost: got 1\d.* ms for one evaluation of the cost upright, allowed less than the"
        " period of 10 ms: ",
    ):
        base.replace(cost=Upright())
    assert base.replace(cost=Upright(), dt=0.03).own_times["cost upright"] > 0.01


class Elbow:
    """The right elbow lifts the object."""

    coordinates = JOINTS
    largest = float(np.pi)
    joints = ("right_elbow_flexion",)
    weight_vector = np.ones(32)
    comfort = np.full(32, 0.5)
    forearm, factor, locks, other, rigid = 0.3, 1.0, True, 0.0, 1.0

    def __init__(self, **changes: Any) -> None:
        vars(self).update(changes)

    def expression(self, q: Any) -> Any:
        return self.sensitivity()(q, 0)[0] + self.other

    def sensitivity(self) -> ca.Function:
        q, locked, elbow = ca.SX.sym("q", 32), ca.SX.sym("locked", 32), INDEX[self.joints[0]]
        S = ca.SX(32, 6)
        S[elbow, 2] = self.factor * (1 - self.locks * locked[elbow]) / self.forearm
        return ca.Function("S", [q, locked], [ca.densify(S), ca.DM.zeros(1, 6)])

    def contact(self) -> ca.Function:
        q, pose = ca.SX.sym("q", 32), ca.SX.eye(4)
        angle = q[INDEX[self.joints[0]]]
        pose[2, 3] = 1.1 - self.forearm * ca.cos(angle)
        pose[0, 0] = self.rigid
        return ca.Function("contact", [q], [ca.densify(pose), ca.DM.eye(4)])


def with_response(base: Problem, response: Any) -> Problem:
    return base.replace(response=response, cost=Upright())


def test_a_response_that_is_what_it_says_is_taken(base: Problem) -> None:
    assert set(with_response(base, Elbow()).own_times) == {"cost upright", "response"}


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"other": 0.1}, "got an expression that is not what the sensitivity gives"),
        ({"locks": False}, "got a motion of right elbow flexion although it is locked"),
        ({"factor": -1.0}, r"got a contact that moves -\d.* m along z when the object moves 1 m"),
        ({"factor": 57.3}, r"got a contact that moves [\d.]+ m along z"),
        ({"factor": np.nan}, "got NaN or infinity from the sensitivity"),
        ({"rigid": 2.0}, "got a contact that is no rigid pose"),
        ({"expression": lambda q: q}, "got shapes"),
        ({"contact": partial(int, "x")}, "got ValueError"),
    ],
)
def test_a_response_that_contradicts_itself_is_refused(
    base: Problem, changes: dict[str, Any], words: str
) -> None:
    with pytest.raises(ProblemError, match=f"^response: {words}"):
        with_response(base, Elbow(**changes))


def test_the_same_object_is_tried_once(base: Problem, monkeypatch: pytest.MonkeyPatch) -> None:
    cost, counts = Upright(), []
    real = validate._Cost.judged
    monkeypatch.setattr(validate._Cost, "judged", lambda self: counts.append(1) or real(self))
    base.replace(cost=cost).replace(dt=0.02)
    assert len(counts) == 1


def test_only_a_term_that_takes_a_tenth_of_a_period_is_called_slow() -> None:
    times = {"cost upright": 0.0011, "response": 0.0005}
    assert validate.slowest(times, 0.01) == "cost upright (1.1 ms when it was tried)"
    assert validate.slowest({name: took / 2 for name, took in times.items()}, 0.01) == ""
    assert validate.slowest({}, 0.01) == ""
