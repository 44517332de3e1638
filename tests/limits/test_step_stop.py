"""How far the object goes when the mean of the plan is sent: never further than the law says,
whatever the periods."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from contexts import brake_of
from hypothesis import given, settings
from hypothesis import strategies as st

from ergoqp.limits import TwistLimit
from ergoqp.limits.twist_and_stopping import Stop
from ergoqp.problem.load import load_problem

LIMIT = TwistLimit(0.2, 0.8, 0.6, 2.5)
WINDOW = 0.05
LONGEST = 0.03


class Plan:
    """A planned twist, a line from one end of a period to the next, and the integrals of it."""

    def __init__(self, first: np.ndarray, span: float = WINDOW) -> None:
        self.times, self.twists, self.span = [-1.0, 0.0], [first, first], span

    def go(self, twist: np.ndarray, dt: float) -> None:
        self.times.append(self.times[-1] + dt)
        self.twists.append(twist)

    @property
    def now(self) -> np.ndarray:
        return self.twists[-1]

    def window(self) -> tuple[np.ndarray, np.ndarray]:
        """Times and twists of the last `span` seconds, finer than any period, and with every
        corner."""
        end = self.times[-1]
        times = np.union1d(
            np.linspace(end - self.span, end, 400), [t for t in self.times if t > end - self.span]
        )
        return times, np.column_stack(
            [np.interp(times, self.times, axis) for axis in np.array(self.twists).T]
        )

    def mean(self) -> np.ndarray:
        times, twists = self.window()
        return np.trapezoid(twists, times, axis=0) / self.span

    def left(self, sign: int) -> np.ndarray:
        """What was planned this way and is not yet sent: of a moment x seconds ago the share 1 - x
        / W."""
        times, twists = self.window()
        share = 1 - (times[-1] - times) / self.span
        return np.trapezoid(np.maximum(sign * twists, 0) * share[:, None], times, axis=0)

    def climb(self, sign: int) -> np.ndarray:
        """What periods of `LONGEST` add this way while the mean rises to the twist planned last."""
        times, twists = self.window()
        way = np.maximum(sign * twists, 0)
        return LONGEST * np.trapezoid(np.maximum(way[-1] - way, 0), times, axis=0) / self.span


def braked(twist: np.ndarray, dt: float) -> np.ndarray:
    seconds = np.max(np.abs(twist) / LIMIT.acceleration)
    return twist * max(0.0, 1 - dt / max(seconds, 1e-12))


def drawn(seed: int) -> tuple[np.random.Generator, Plan]:
    """A plan that speeds up, slows down and turns round within its limits, in uneven periods."""
    rng = np.random.default_rng(seed)
    plan = Plan(np.zeros(6))
    goal = rng.uniform(-1, 1, 6) * LIMIT.speed
    for _ in range(rng.integers(0, 40)):
        if rng.random() < 0.1:
            goal = rng.uniform(-1, 1, 6) * LIMIT.speed
        dt = float(rng.uniform(0.002, LONGEST))
        plan.go(
            np.clip(goal, plan.now - LIMIT.acceleration * dt, plan.now + LIMIT.acceleration * dt),
            dt,
        )
    return rng, plan


def stopped(
    plan: Plan, dt: float, twist: np.ndarray, rng: np.random.Generator | None
) -> tuple[np.ndarray, np.ndarray]:
    """Go on at a twist, stop from it, and return the furthest ways (6,) along each axis and against
    it.

    Periods are of any length; without `rng` they are as long as may be while the mean along x
    rises, and short while it falls.
    """
    plan.go(twist, dt)
    way = plan.mean() * dt
    furthest = np.maximum(way, 0), np.maximum(-way, 0)
    while plan.window()[1].any():
        later = float(rng.choice([0.002, LONGEST, rng.uniform(0.002, LONGEST)])) if rng else 0.002
        if rng is None:
            ahead = Plan(np.zeros(6), plan.span)
            ahead.times, ahead.twists = [*plan.times], [*plan.twists]
            ahead.go(braked(plan.now, LONGEST), LONGEST)
            later = LONGEST if ahead.mean()[0] > plan.mean()[0] else later
        plan.go(braked(plan.now, later), later)
        way = way + plan.mean() * later
        # At every moment, not only at the end.
        furthest = np.maximum(furthest[0], way), np.maximum(furthest[1], -way)
    return furthest


def kept_free(plan: Plan, dt: float, twist: np.ndarray, climbs: bool = True) -> list[np.ndarray]:
    """What is under way along each axis and against it (6,), and what the law adds for a twist."""
    law = brake_of(LIMIT, twist, dt, average=plan.span, longest=LONGEST)["displacement"]
    # What is under way may be done already or not, the half of this period that leads away from the
    # last twist too.
    under_way = [
        plan.left(sign) + np.maximum(sign * plan.now, 0) * dt / 2 + climbs * plan.climb(sign)
        for sign in (1, -1)
    ]
    return [part + np.maximum(sign * law, 0) for part, sign in zip(under_way, (1, -1), strict=True)]


@pytest.mark.slow
@given(st.integers(0, 2**32 - 1))
@settings(deadline=None, max_examples=150)
def test_with_the_mean_a_stop_goes_no_further_than_what_is_under_way_and_the_law(seed: int) -> None:
    rng, plan = drawn(seed)
    dt = float(rng.uniform(0.002, LONGEST))
    reach = LIMIT.acceleration * dt
    twist = np.clip(rng.uniform(-1, 1, 6) * LIMIT.speed * 2, plan.now - reach, plan.now + reach)
    twist = np.clip(twist, -LIMIT.speed, LIMIT.speed)
    ends = kept_free(plan, dt, twist)
    for way, end in zip(stopped(plan, dt, twist, rng), ends, strict=True):
        assert np.all(way <= end + 1e-9)


@pytest.mark.parametrize("steps", [1, 4, 8, 12, 20])
def test_long_periods_while_the_mean_rises_and_short_ones_while_it_falls_are_kept_free_too(
    steps: int,
) -> None:
    beyond = []
    for climbs in (True, False):
        plan = Plan(np.zeros(6), span=4 * WINDOW)
        for number in range(1, steps + 1):
            plan.go(LIMIT.acceleration * 0.01 * number, 0.01)
        twist = plan.now + LIMIT.acceleration * 0.01
        end = kept_free(plan, 0.01, twist, climbs)[0]
        beyond.append(float(np.max(stopped(plan, 0.01, twist, None)[0] - end)))
    assert beyond[0] <= 1e-9
    # The control: without what the mean climbs some of them would not be.
    assert steps < 12 or beyond[1] > 1e-5


@given(st.integers(0, 2**32 - 1), st.floats(0.002, LONGEST))
@settings(deadline=None, max_examples=60)
def test_a_robot_that_may_be_faster_goes_further_by_as_much(seed: int, dt: float) -> None:
    twist = np.random.default_rng(seed).uniform(-1, 1, 6) * LIMIT.speed
    for law in ({}, {"average": WINDOW, "longest": LONGEST}):
        plain, faster = (
            brake_of(LIMIT, twist, dt, **law, stretch=stretch) for stretch in (1.0, 1.1)
        )
        np.testing.assert_allclose(faster["displacement"], 1.1 * plain["displacement"], atol=1e-15)
        np.testing.assert_allclose(faster["reach"], 1.1 * plain["reach"], atol=1e-15)
        # What is planned is the same.
        np.testing.assert_array_equal(faster["twist"], plain["twist"])


def test_without_a_mean_the_law_is_the_plain_one() -> None:
    twist = 0.5 * LIMIT.speed
    found = brake_of(LIMIT, twist, 0.01)
    seconds = np.max(twist / LIMIT.acceleration)
    np.testing.assert_allclose(found["displacement"], twist * (0.01 + seconds / 2), atol=1e-15)
    assert found["time"][0] == pytest.approx(seconds)


@pytest.mark.parametrize(
    "law", [{}, {"average": WINDOW, "longest": LONGEST}], ids=["plain", "mean"]
)
def test_a_declared_hold_is_judged_as_a_way_of_its_own(law: dict[str, float]) -> None:
    twist, dt = np.array([0.1, -0.05, 0, 0.3, 0, -0.2]), 0.01

    def ways(stop: Stop) -> np.ndarray:
        u, period = ca.SX.sym("u", 6), ca.SX.sym("dt")
        return np.array(ca.Function("ways", [u, period], [stop.ways(u, period)])(twist, dt))

    plain, held = ways(Stop(LIMIT, **law)), ways(Stop(LIMIT, **law, hold=0.2, stretch=1.1))
    np.testing.assert_allclose(held[:, 0], 1.1 * plain[:, 0], atol=1e-15)
    # The robot goes on at this twist for as long, as fast as it may.
    np.testing.assert_allclose(held[:, 1] - held[:, 0], 1.1 * 0.2 * twist, atol=1e-15)
    assert held.shape[1] == plain.shape[1] + 1
    np.testing.assert_allclose(held[:, 2:], 1.1 * plain[:, 1:], atol=1e-15)
    if law:
        np.testing.assert_allclose(plain[:, 1], 1.5 * LONGEST * twist, atol=1e-15)
        np.testing.assert_allclose(
            plain[:, 2], (LONGEST * dt + LONGEST**2 / 8) * LIMIT.acceleration, atol=1e-15
        )


def test_what_a_hold_of_another_twist_covers_is_twice_as_old_as_it_may_be() -> None:
    assert Stop(LIMIT, hold=0.2, memory=0.3, stretch=1.1).held == pytest.approx(
        1.1 * (0.2 + 2 * 0.3)
    )
    assert Stop(LIMIT, memory=0.3).held == 0


def test_rows_are_stopped_from_the_rate_that_a_period_a_hold_and_a_parabola_leave_room_for() -> (
    None
):
    """v held for h, then slowed by a: beyond the knee 'd = v h + v^2 / (2 a)' with what is kept
    free, and no jump at it."""
    u, left, dt = np.array([0.1, 0, 0, 0, 0, 0]), ca.SX.sym("left", 2), 0.01
    for hold in (0.0, 0.15):
        stop = Stop(LIMIT, hold=hold, memory=0.02)
        brake = stop.braking(ca.SX(ca.DM(u)), ca.SX(dt))
        rate = ca.Function("rate", [left], [brake.fastest(left, ca.DM([0.6, 0.6]), ca.DM([1, 0]))])
        distances = np.linspace(0.0, 0.3, 400)
        found = np.array([np.array(rate([far, far])).ravel() for far in distances])
        reach = float(ca.evalf(ca.SX(brake.reach)))
        for column, held in ((0, stop.held), (1, 0.0)):
            rates = found[:, column]
            knee = 0.6 * reach * (reach + held)
            below, beyond = distances <= knee, distances > knee
            np.testing.assert_allclose(rates[below], distances[below] / (reach + held), atol=1e-12)
            # (v + a H)^2 = (a H)^2 + 2 a d - (a h)^2
            v = rates[beyond]
            np.testing.assert_allclose(
                (v + 0.6 * held) ** 2,
                (0.6 * held) ** 2 + 1.2 * distances[beyond] - (0.6 * reach) ** 2,
                atol=1e-12,
            )
            assert np.all(np.diff(rates) > 0)
            assert np.abs(np.diff(rates, 2)).max() < 2e-3


def test_the_longest_stop_is_that_of_the_slowest_axis_and_of_what_the_mean_still_holds() -> None:
    problem = load_problem("desk")
    limit = problem.twist_limit
    seconds = max(
        limit.linear_speed / limit.linear_acceleration,
        limit.angular_speed / limit.angular_acceleration,
    )
    assert problem.stop.duration == pytest.approx(seconds + problem.average + 3 * problem.dt)


@pytest.mark.parametrize("stretch", [1.0, 1.2])
def test_in_a_stop_from_a_small_twist_a_mean_that_rises_goes_on_for_longer(stretch: float) -> None:
    u, dt = ca.SX(6, 1), ca.SX(0.01)
    plain, mean = (
        Stop(LIMIT, average=average, longest=0.03, stretch=stretch).braking(u, dt)
        for average in (0.0, 0.05)
    )
    assert float(ca.evalf(ca.SX(plain.slowest))) == pytest.approx(
        float(ca.evalf(ca.SX(plain.swing)))
    )
    assert float(ca.evalf(ca.SX(mean.slowest - mean.swing))) == pytest.approx(stretch * 1.5 * 0.03)
