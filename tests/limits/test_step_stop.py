"""How far the object goes when the mean of the plan is sent: never further than the law says, whatever the periods."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from situations import brake_of

from ergoqp.limits import TwistLimit

LIMIT = TwistLimit(0.2, 0.8, 0.6, 2.5)
WINDOW = 0.05
LONGEST = 0.03


class Plan:
    """A planned twist, a line from one end of a period to the next, and the integrals of it."""

    def __init__(self, first: np.ndarray) -> None:
        self.times, self.twists = [-1.0, 0.0], [first, first]

    def go(self, twist: np.ndarray, dt: float) -> None:
        self.times.append(self.times[-1] + dt)
        self.twists.append(twist)

    @property
    def now(self) -> np.ndarray:
        return self.twists[-1]

    def window(self) -> tuple[np.ndarray, np.ndarray]:
        """Times and twists of the last `WINDOW` seconds, finer than any period, and with every corner."""
        end = self.times[-1]
        times = np.union1d(np.linspace(end - WINDOW, end, 400), [t for t in self.times if t > end - WINDOW])
        return times, np.column_stack([np.interp(times, self.times, axis) for axis in np.array(self.twists).T])

    def mean(self) -> np.ndarray:
        times, twists = self.window()
        return np.trapezoid(twists, times, axis=0) / WINDOW

    def left(self, sign: int) -> np.ndarray:
        """What was planned this way and is not yet sent: of a moment x seconds ago the share 1 - x / W."""
        times, twists = self.window()
        share = 1 - (times[-1] - times) / WINDOW
        return np.trapezoid(np.maximum(sign * twists, 0) * share[:, None], times, axis=0)


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
        plan.go(np.clip(goal, plan.now - LIMIT.acceleration * dt, plan.now + LIMIT.acceleration * dt), dt)
    return rng, plan


@given(st.integers(0, 2**32 - 1))
@settings(deadline=None, max_examples=150)
def test_with_the_mean_a_stop_goes_no_further_than_what_is_under_way_and_the_law(seed: int) -> None:
    rng, plan = drawn(seed)
    dt = float(rng.uniform(0.002, LONGEST))
    reach = LIMIT.acceleration * dt
    twist = np.clip(rng.uniform(-1, 1, 6) * LIMIT.speed * 2, plan.now - reach, plan.now + reach)
    twist = np.clip(twist, -LIMIT.speed, LIMIT.speed)
    law = brake_of(LIMIT, twist, dt, average=WINDOW, longest=LONGEST)["displacement"]
    # What is under way may be done already or not, the half of this period that leads away from the last twist too.
    ends = [plan.left(sign) + np.maximum(sign * plan.now, 0) * dt / 2 + np.maximum(sign * law, 0) for sign in (1, -1)]
    plan.go(twist, dt)
    way = plan.mean() * dt
    while plan.window()[1].any():
        # At every moment, not only at the end.
        assert np.all(way <= ends[0] + 1e-9)
        assert np.all(-way <= ends[1] + 1e-9)
        later = float(rng.choice([0.002, LONGEST, rng.uniform(0.002, LONGEST)]))
        plan.go(braked(plan.now, later), later)
        way = way + plan.mean() * later


@given(st.integers(0, 2**32 - 1), st.floats(0.002, LONGEST))
@settings(deadline=None, max_examples=60)
def test_a_robot_that_may_be_faster_goes_further_by_as_much(seed: int, dt: float) -> None:
    twist = np.random.default_rng(seed).uniform(-1, 1, 6) * LIMIT.speed
    for law in ({}, {"average": WINDOW, "longest": LONGEST}):
        plain, faster = (brake_of(LIMIT, twist, dt, **law, stretch=stretch) for stretch in (1.0, 1.1))
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
