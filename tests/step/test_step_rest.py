"""Rest and hysteresis against the same law in plain words, step after step, over whole
histories."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ergoqp.problem.settings import Control
from ergoqp.step.rest import STATES, rest_update, stalled


def compiled(control: Control) -> ca.Function:
    rest = ca.SX.sym("rest", STATES)
    known = [ca.SX.sym(name) for name in ("gain", "value", "must_move", "dt", "counts")]
    return ca.Function("rest", [rest, *known], [rest_update(control, rest, *known), stalled(rest)])


class Plain:
    """The law, one event at a time."""

    def __init__(self, control: Control) -> None:
        self.control = control
        self.rests, self.asked, self.gain, self.cost, self.lowest, self.unimproved = (
            False,
            0.0,
            0.0,
            0.0,
            0.0,
            0.0,
        )

    def frame(self, gain: float, value: float, must_move: bool, dt: float) -> None:
        c = self.control
        if self.cost <= 0:
            # The first frame is believed as it is.
            self.gain, self.cost, self.lowest, self.unimproved = gain, value, value, 0.0
        else:
            share = min(1.0, dt / c.rest_filter)
            self.gain += share * (gain - self.gain)
            self.cost += share * (value - self.cost)
            self.unimproved += dt
            if self.cost < self.lowest - c.stall_gain:
                self.lowest, self.unimproved = self.cost, 0.0
        if must_move:
            asks = self.rests
        elif self.rests:
            asks = self.gain > c.move_above
        else:
            asks = self.gain < c.rest_below
        self.asked = self.asked + dt if asks else 0.0
        patience = c.move_after if self.rests else c.rest_after
        long_enough = asks and self.asked >= patience - 1e-12
        at_lowest = self.cost <= self.lowest + c.stall_gain
        tired = (
            not self.rests
            and not must_move
            and self.unimproved >= c.stall_after * (1.0 if at_lowest else 2.0)
        )
        if long_enough or tired:
            self.asked = 0.0
            if self.rests:
                self.lowest, self.unimproved = self.cost, 0.0
            self.rests = not self.rests

    def state(self) -> list[float]:
        return [float(self.rests), self.asked, self.gain, self.cost, self.lowest, self.unimproved]


CONTROLS = [
    Control(),
    Control(rest_filter=0.004, stall_after=0.3, stall_gain=0.2),
    Control(move_above=0.3, rest_below=0.2),
    # At once, and only then: it rested whatever the gain was.
    Control(rest_after=0.0, move_after=0.0, rest_below=0.5, move_above=1.0),
]


@pytest.mark.slow
@pytest.mark.parametrize(
    "control", CONTROLS, ids=["default", "no filter, soon tired", "narrow", "at once"]
)
@settings(deadline=None, max_examples=25)
@given(seed=st.integers(0, 2**32 - 1))
def test_rest_is_what_the_words_say(control: Control, seed: int) -> None:
    rng = np.random.default_rng(seed)
    update, plain, rest = compiled(control), Plain(control), np.zeros(STATES)
    level = 2.0
    for _ in range(250):
        if rng.random() < 0.04:
            level = rng.uniform(1.0, 4.0)
        gain = abs(rng.normal(0, 0.3)) if rng.random() < 0.7 else rng.uniform(0, 3)
        value, must, counts = level + rng.normal(0, 0.05), rng.random() < 0.1, rng.random() < 0.9
        dt = float(rng.choice([0.005, 0.01, 0.02, 0.05]))
        after, still_for = (
            np.array(part).ravel() for part in update(rest, gain, value, must, dt, counts)
        )
        assert still_for[0] == (rest[5] if rest[0] < 0.5 else 0)
        if counts:
            plain.frame(gain, value, must, dt)
        else:
            np.testing.assert_array_equal(after, rest)
        np.testing.assert_allclose(after, plain.state(), rtol=1e-12, atol=1e-12)
        rest = after


def test_rest_and_motion_both_occur() -> None:
    """Little gain rests after `rest_after`, much moves after `move_after`, no improvement gives up
    after `stall_after`."""
    control = Control()
    update, rest, dt = compiled(control), np.zeros(STATES), 0.01

    def time_until(
        rests: bool, gain: float, value: float, must_move: bool = False, most: float = 60.0
    ) -> float:
        nonlocal rest
        for count in range(round(most / dt)):
            if bool(rest[0]) == rests:
                return count * dt
            rest = np.array(update(rest, gain, value, must_move, dt, 1)[0]).ravel()
        return most

    assert time_until(True, 0.0, 2.0) == pytest.approx(control.rest_after, abs=1.5 * dt)
    moves = time_until(False, 10 * control.move_above, 2.0)
    assert control.move_after <= moves <= control.move_after + control.rest_filter
    assert time_until(True, 10 * control.move_above, 2.0) == pytest.approx(
        control.stall_after, abs=2 * dt
    )
    assert time_until(False, 0.0, 2.0, must_move=True) <= control.move_after + 1.5 * dt
    assert (
        time_until(True, 0.0, 2.0, must_move=True, most=3 * control.stall_after)
        == 3 * control.stall_after
    )


def test_an_object_that_left_its_lowest_cost_gives_up_after_twice_the_time() -> None:
    control, dt = Control(stall_after=0.3, rest_filter=0.01), 0.01
    update, rest, moved = compiled(control), np.zeros(STATES), 0
    # One frame at the lowest cost, and then far above it.
    for value in [2.0] + [3.0] * 200:
        rest = np.array(update(rest, 10 * control.move_above, value, False, dt, 1)[0]).ravel()
        moved += rest[0] < 0.5
        if rest[0] > 0.5:
            break
    assert moved * dt == pytest.approx(2 * control.stall_after, abs=2 * dt)
