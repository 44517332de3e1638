"""A start that was finished counts again only for the task that it was solved for."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
import pytest
from step_samples import problem_of

from ergoqp.costs.smooth_reba import SmoothReba
from ergoqp.limits import Ball, Box, HalfSpace, KeepOut
from ergoqp.placing import optimise as placing
from ergoqp.placing.ledger import FILE, key_of
from ergoqp.placing.optimise import PlaceTask, begin_from
from ergoqp.problem.problem import Problem
from ergoqp.rest.model_person import Alike


def without(*limits: object) -> Problem:
    problem = problem_of("screwing")
    return problem.replace(limits=[*problem.limits, *limits])


def key(problem: Problem) -> str:
    person = Alike(problem.response)
    begin = begin_from(person, person.response.comfort, None)
    return key_of(PlaceTask(problem, person, begin, "stackelberg", "ipopt", 0, 0.5))


@dataclass(frozen=True)
class Rounded:
    """A region of the user's own, made of another one."""

    core: Ball
    more: float

    def nearest(self, point: ca.SX) -> tuple[ca.SX, ca.SX]:
        """The ball, and this much around it."""
        distance, direction = self.core.nearest(point)
        return distance - self.more, direction


class Plain:
    """A region of the user's own that is no dataclass."""

    def __init__(self, height: float) -> None:
        self.height = height

    def nearest(self, point: ca.SX) -> tuple[ca.SX, ca.SX]:
        """What is below a height."""
        return point[2] - self.height, ca.SX([0, 0, 1])


# As far from (0.1, -0.2, 0.3) each, as somewhere else too.
CORNER = (0.2, -0.4, 0.6)
REGIONS = [
    Box(CORNER, (0.3, 0.0, 0.8)),
    Box(CORNER, (0.5, 0.0, 1.3)),
    Ball((0.1, -0.2, 1.3), 0.2),
    Ball((1.1, -0.2, 0.3), 0.2),
    HalfSpace((0.0, 0.0, 1.0), -0.5),
    HalfSpace((0.0, 0.0, -1.0), -1.1),
    Rounded(Ball((0.1, -0.2, 1.3), 0.1), 0.1),
    Rounded(Ball((0.1, -0.2, 1.3), 0.15), 0.05),
    Plain(0.4),
    Plain(0.41),
]


@pytest.mark.slow
def test_every_region_is_another_task() -> None:
    keys = [key(without(KeepOut(region))) for region in REGIONS]
    assert len({key(without()), *keys}) == len(REGIONS) + 1
    assert keys == [key(without(KeepOut(region))) for region in REGIONS]


def test_so_is_every_field_of_a_limit() -> None:
    limits = [
        KeepOut(REGIONS[0]),
        KeepOut(REGIONS[0], tolerance=1e-3),
        KeepOut(REGIONS[0], name="head"),
    ]
    assert len({key(without(each)) for each in limits}) == len(limits)


@pytest.mark.slow
@pytest.mark.parametrize("grown", [Box(CORNER, (0.5, 0.0, 1.3)), Plain(1.3)], ids=["box", "plain"])
def test_a_region_that_was_edited_is_kept_out_of(grown: object, tmp_path) -> None:
    small = Box(CORNER, (0.3, 0.0, 0.8)) if isinstance(grown, Box) else Plain(0.3)
    before = placing.optimise(without(KeepOut(small)), starts=2, seed=0, out=tmp_path)
    problem = without(KeepOut(grown))
    assert problem.own_limits.broken(before.pose, before.posture)
    found = placing.optimise(problem, starts=2, seed=0, out=tmp_path)
    assert not problem.own_limits.broken(found.pose, found.posture)
    fresh = placing.optimise(problem, starts=2, seed=0)
    np.testing.assert_array_equal(found.pose, fresh.pose)


@pytest.mark.slow
def test_what_was_taken_over_is_judged_again(tmp_path, monkeypatch) -> None:
    """Whatever the key says: a place that the limits forbid is solved anew."""
    monkeypatch.setattr(placing, "key_of", lambda task: "the same")
    before = placing.optimise(without(), starts=2, seed=0, out=tmp_path)
    assert len((tmp_path / FILE).read_text(encoding="utf-8").splitlines()) == 2
    problem = without(KeepOut(Ball(tuple(before.pose[:3, 3].tolist()), 0.1)))
    found = placing.optimise(problem, starts=2, seed=0, out=tmp_path)
    assert not problem.own_limits.broken(found.pose, found.posture)


def test_a_cost_is_known_by_what_it_is_made_of() -> None:
    problem = problem_of("screwing")

    @dataclass(frozen=True)
    class Far:
        """The sheet, and more where the elbow is bent by more than anybody can."""

        more: float
        name = "far"
        minimum = 1.0
        sheet = SmoothReba()

        def expression(self, q: ca.SX) -> ca.SX:
            """See above."""
            return self.sheet.expression(q) + ca.if_else(q[10] > 3.1, self.more, 0)

        def __call__(self, postures: np.ndarray) -> np.ndarray:
            """See above."""
            rows = np.atleast_2d(postures)
            return self.sheet(rows) + np.where(rows[:, 10] > 3.1, self.more, 0)

    assert key(problem.replace(cost=Far(1.0))) != key(problem.replace(cost=Far(2.0)))
