"""Limits of users whose rows contradict themselves are refused when the problem is made."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
import pytest

import ergoqp
from benchmarks.boundary import FirstOrder, Outward, draw_case
from ergoqp.errors import ProblemError
from ergoqp.joints import INDEX
from ergoqp.limits import Ball, Box, HalfSpace, KeepOut, LimitContext, Rows
from ergoqp.limits.custom import OwnRates
from ergoqp.limits.limit import straight_margins
from ergoqp.responses import LinearResponse


@dataclass(frozen=True)
class Own:
    """The members that all limits below share."""

    sign: float = 1.0
    counts: bool = True
    tolerance: float = 1e-6
    recovery_time: float = 2.0
    names: Any = ("own",)
    unit = "m"
    hard: bool = True
    recovers = (True,)
    yield_zone: float = 0.0
    margin_is_lower_bound: bool = False

    def measure(self) -> ca.Function | None:
        return None

    def told(self, context: LimitContext, matrix: Any, above: Any) -> Rows:
        free = ca.DM([ca.inf])
        rows = Rows(self.sign * matrix, free, above, free, ca.DM.zeros(1))
        return context.reduced(self.names[0], rows) if self.counts else rows

    def rows(self, context: LimitContext) -> Rows:
        raise NotImplementedError

    def margins(self, context: LimitContext, displacement: Any) -> Any:
        return straight_margins(self.rows(context), displacement)


class Ceiling(Own):
    """The contact point stays below a height."""

    def rows(self, context: LimitContext) -> Rows:
        matrix = ca.DM([[0, 0, 1, 0, 0, 0]])
        return self.told(context, matrix, 1.3 - context.pose[2, 3])


class Tool(Own):
    """The tool's axis does not point up too far; its slope changes as the object turns."""

    def rows(self, context: LimitContext) -> Rows:
        axis = context.pose[:3, 0]
        # d(axis)/dt = w x axis, of which the third entry grows.
        matrix = ca.horzcat(ca.SX(1, 3), -axis[1] * -1, -axis[0], 0)
        return self.told(context, matrix, 0.5 - axis[2])


class InBall(Own):
    """The contact point stays in a ball, by its tangent alone: the ball bends away from it."""

    def rows(self, context: LimitContext) -> Rows:
        from_centre = context.pose[:3, 3] - ca.DM([0.5, 0, 1])
        distance = ca.norm_2(from_centre)
        matrix = ca.horzcat((from_centre / distance).T, ca.SX(1, 3))
        return self.told(context, matrix, 0.4 - distance)


class Wrist(Own):
    """The right wrist stays below an angle, with or without what is still to come."""

    def rows(self, context: LimitContext) -> Rows:
        wrist = INDEX["right_wrist_flexion"]
        angle = context.posture[wrist]
        if self.counts:
            angle += context.shift[wrist]
        free = ca.DM([ca.inf])
        matrix = context.sensitivity[wrist, :]
        return Rows(self.sign * matrix, free, 0.3 - angle, free, ca.DM.zeros(1))


class Saddle(Own):
    """A product of two coordinates stays below a value: curved along diagonals alone."""

    def rows(self, context: LimitContext) -> Rows:
        x, y = context.pose[0, 3], context.pose[1, 3]
        return self.told(context, ca.horzcat(y, x, ca.SX(1, 4)), 0.2 - x * y)


class WrongWhereOneWorks(Own):
    """A ceiling whose sign is wrong in a part of the space."""

    def rows(self, context: LimitContext) -> Rows:
        x, y, z = ca.vertsplit(context.pose[:3, 3])
        here = ca.logic_and(ca.logic_and(x > 0.3, x < 0.6), ca.fabs(y) < 0.2)
        matrix = ca.horzcat(ca.SX(1, 2), ca.if_else(here, -1, 1), ca.SX(1, 3))
        return self.told(context, matrix, 1.3 - z)


class Uncounted(Ceiling):
    """Its rows are counted, its margins are not."""

    def margins(self, context: LimitContext, displacement: Any) -> Any:
        return 1.3 - context.pose[2, 3] - ca.fmax(displacement[2], 0)


class Carefree(Wrist):
    """A posture row with a margin that is always the same."""

    def margins(self, context: LimitContext, displacement: Any) -> Any:
        return ca.SX(1) * 10


class Eager(Ceiling):
    """A row with a negative reserve."""

    def told(self, context: LimitContext, matrix: Any, above: Any) -> Rows:
        rows = super().told(context, matrix, above)
        return Rows(rows.matrix, rows.to_lower, rows.to_upper, rows.rate, ca.DM([-0.1]))


class Nowhere(Ceiling):
    """A distance that is not a number in half of the space."""

    def told(self, context: LimitContext, matrix: Any, above: Any) -> Rows:
        return super().told(context, matrix, above + 1e-9 * ca.sqrt(context.pose[1, 3]))


class Shy(Ceiling):
    """Margins that are smaller than the distances, and not said to be bounds."""

    def margins(self, context: LimitContext, displacement: Any) -> Any:
        return super().margins(context, displacement) - 0.1


def with_limit(limit: Any) -> ergoqp.Problem:
    problem = ergoqp.load_problem("screwing")
    return problem.replace(limits=[*problem.limits, limit])


@pytest.mark.parametrize("limit", [Ceiling(), Wrist(hard=False)])
def test_a_limit_that_agrees_with_itself_is_taken(limit: Own) -> None:
    assert "own" in with_limit(limit).row_names


@pytest.mark.parametrize(
    "region",
    [Ball((0.1, 0.0, 1.6), 0.2), Box((0.0, 0.0, 0.0), (1.0, 1.0, 0.3)), HalfSpace((1, 2, 3), -1.0)],
)
def test_regions_of_the_package_agree_with_themselves(region: Any) -> None:
    limit: Any = KeepOut(region, name="away")
    OwnRates(limit, with_limit(limit).own_limits._place()).judge()


def test_a_region_of_a_user_is_tried() -> None:
    class Turned(Ball):
        """A ball whose direction leads inward."""

        def nearest(self, point: Any) -> tuple[Any, Any]:
            distance, direction = super().nearest(point)
            return distance, -direction

    with pytest.raises(ProblemError, match="a matrix that is not the derivative"):
        with_limit(KeepOut(Turned((0.1, 0.0, 1.6), 0.2), name="away"))


@pytest.mark.parametrize(
    ("limit", "words"),
    [
        (Ceiling(sign=-1.0), "a matrix that is not the derivative"),
        (Ceiling(sign=1.1), "a matrix that is not the derivative"),
        (Ceiling(counts=False), "distances that do not become smaller by context.margin_reduction"),
        (Wrist(sign=-1.0, hard=False), "a matrix that is not the derivative"),
        (Wrist(counts=False, hard=False), "distances without context.shift"),
        (Tool(), "margins above those that the object has after the displacement"),
        (InBall(), "margins above those that the object has after the displacement"),
        (Saddle(), "margins above those that the object has after the displacement"),
        (WrongWhereOneWorks(), "a matrix that is not the derivative"),
        (Uncounted(), "margins that do not become smaller by context.margin_reduction"),
        (Carefree(hard=False), "margins above the distances at rest"),
        (Eager(), "a negative rate or curvature margin"),
        (Nowhere(), "NaN, allowed numbers, and inf where there is no end"),
        (Shy(), "margins below the distances at rest"),
    ],
)
def test_one_that_contradicts_itself_is_refused(limit: Own, words: str) -> None:
    with pytest.raises(ProblemError, match=f"^limits: rows of own: got {words}"):
        with_limit(limit)


def test_the_name_of_the_counted_rows_is_the_limit_s() -> None:
    class Misnamed(Ceiling):
        def told(self, context: LimitContext, matrix: Any, above: Any) -> Rows:
            free = ca.DM([ca.inf])
            rows = Rows(matrix, free, above, free, ca.DM.zeros(1))
            return context.reduced("another", rows)

    with pytest.raises(ProblemError, match=r"context.reduced\('own', rows\)"):
        with_limit(Misnamed())


def test_margins_at_rest_are_at_most_the_distances() -> None:
    class Generous(Ceiling):
        def margins(self, context: LimitContext, displacement: Any) -> Any:
            return super().margins(context, displacement) + 0.01

    with pytest.raises(ProblemError, match="margins above the distances at rest"):
        with_limit(Generous())


def test_a_boundary_that_believes_its_slope_is_refused() -> None:
    case = draw_case(6, np.random.default_rng(4))
    response = LinearResponse(case.model.coordinates.names, largest=100.0)
    edge: Any = FirstOrder(case.model, hard=True, name="edge")
    with pytest.raises(ProblemError, match="margins above those that the object has"):
        ergoqp.Problem(
            cost=Outward(case.model),
            response=response,
            limits=[ergoqp.load_problem("forearm").twist_limit, edge],
        )


def test_the_same_limit_is_judged_once(monkeypatch: pytest.MonkeyPatch) -> None:
    judged = []
    monkeypatch.setattr(OwnRates, "judge", lambda self: judged.append(self.limit))
    limit = Ceiling()
    problem = with_limit(limit)
    problem.replace(title="another")
    assert judged == [limit]
    with_limit(Ceiling())
    assert len(judged) == 2
