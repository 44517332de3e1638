"""The exact stopping bound of the arm's joints."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

pytest.importorskip("mink")

from ergoqp.whole_body.state import joint_bounds, stopping_speed


def _way(speed, acceleration, dt):
    """What is covered by one period at a speed and a stop afterwards."""
    way = 0.0
    while speed > 0:
        way += speed * dt
        speed -= acceleration * dt
    return way


@given(st.floats(1e-6, 2.0), st.floats(0.5, 20.0), st.sampled_from([0.001, 0.01, 0.05]))
def test_a_stop_from_the_bound_ends_at_the_distance(distance, acceleration, dt):
    speed = float(stopping_speed(distance, acceleration, dt))
    assert _way(speed, acceleration, dt) <= distance + 1e-9
    assert _way(speed * (1 + 1e-6) + 1e-9, acceleration, dt) > distance


@settings(max_examples=25)
@given(st.integers(0, 2**32 - 1))
def test_whatever_the_joints_do_within_their_bounds_they_never_leave(seed):
    rng, dt = np.random.default_rng(seed), 0.01
    limits, velocity, acceleration = (
        (np.full(3, -0.3), np.full(3, 0.3)),
        np.full(3, 1.0),
        np.array([2.0, 7.5, 20.0]),
    )
    position, speed = rng.uniform(-0.3, 0.3, 3), np.zeros(3)
    for _ in range(200):
        low, high = joint_bounds(position, speed, limits, velocity, acceleration, dt)
        assert (low <= high).all()
        after = np.where(rng.random(3) < 0.7, high, low)
        assert (np.abs(after - speed) <= acceleration * dt + 1e-9).all()
        position, speed = position + after * dt, after
        assert (np.abs(speed) <= velocity + 1e-12).all()
        assert (np.abs(position) <= 0.3 + 1e-9).all()
