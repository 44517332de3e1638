"""From margins to bounds: braking, the stop that must fit, and the one end that gives way."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from contexts import DEFAULTS, NAMES, SIZES, bounds_of, brake_of, movable_of
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from ergoqp.joints import INDEX, UPPER
from ergoqp.limits import AxisCone, JointLimit, LimitContext, Rows, TwistLimit, WorkspaceBox
from ergoqp.limits.twist_and_stopping import Stop
from ergoqp.solvers.solver import FREE
from ergoqp.step.rows import (
    CLEARANCE,
    ELBOW,
    STEADY_RETURN,
    patience,
    row_bounds,
    unhurried,
)

LIMIT = TwistLimit(0.2, 0.6, 0.6, 2.0)
SMALL = WorkspaceBox((0.0, 0.0, 0.0), (0.02, 0.3, 1.0))
twists = st.lists(st.floats(-1, 1), min_size=6, max_size=6).map(lambda v: np.array(v) * LIMIT.speed)
periods = st.floats(1e-3, 0.05)


def stop(twist: np.ndarray, dt: float) -> np.ndarray:
    """Displacement of one period at a twist and the whole stop after it, by simulation of the
    braking law."""
    total, current = twist * dt, twist
    for _ in range(100_000):
        slowest = np.max(np.abs(current) / LIMIT.acceleration)
        if slowest <= dt:
            return total
        current = current * (1 - dt / slowest)
        total = total + current * dt
    raise AssertionError("the stop never ends")


@given(twists, periods)
@settings(deadline=None, max_examples=100)
def test_the_braking_twist_is_allowed_straight_and_as_fast_as_can_be(
    previous: np.ndarray, dt: float
) -> None:
    brake = brake_of(LIMIT, previous, dt)
    assert np.all(brake["low"] <= brake["twist"])
    assert np.all(brake["twist"] <= brake["high"])
    np.testing.assert_allclose(
        np.outer(brake["twist"], previous), np.outer(previous, brake["twist"]), atol=1e-15
    )
    change = np.abs(brake["twist"] - previous) / (LIMIT.acceleration * dt)
    assert change.max() <= 1 + 1e-9
    # As fast as can be: some axis brakes at its limit, or everything stands.
    assert change.max() >= 1 - 1e-6 or np.abs(brake["twist"]).max() < 1e-12


@given(twists, st.floats(1.0, 4.0), periods)
@settings(deadline=None, max_examples=60)
def test_bounds_hold_speed_and_acceleration_and_come_down_from_above_it(
    twist: np.ndarray, factor: float, dt: float
) -> None:
    previous = factor * twist
    brake = brake_of(LIMIT, previous, dt)
    assert np.all(brake["high"] - previous <= LIMIT.acceleration * dt + 1e-12)
    assert np.all(previous - brake["low"] <= LIMIT.acceleration * dt + 1e-12)
    assert np.all(brake["low"] <= brake["high"])
    inside = np.abs(previous) <= LIMIT.speed
    assert np.all(brake["high"][inside] <= LIMIT.speed[inside] + 1e-12)
    assert np.all(np.abs(brake["low"]) <= np.maximum(np.abs(previous), LIMIT.speed) + 1e-12)


@given(twists, periods)
@settings(deadline=None, max_examples=100)
def test_a_stop_never_goes_further_than_reckoned(twist: np.ndarray, dt: float) -> None:
    brake, real = brake_of(LIMIT, twist, dt), stop(twist, dt)
    reckoned = brake["displacement"]
    assert np.all(np.abs(real) <= np.abs(reckoned) + 1e-12)
    assert np.all(np.abs(reckoned) <= np.abs(real) + np.abs(twist) * dt + 1e-12)
    assert brake["time"][0] == pytest.approx(np.max(np.abs(twist) / LIMIT.acceleration))


def bounds_at(
    point: np.ndarray, previous: np.ndarray, dt: float, box: WorkspaceBox = SMALL
) -> dict[str, np.ndarray]:
    pose = np.eye(4)
    pose[:3, 3] = point
    return bounds_of(box, LIMIT, pose, previous, dt)


@given(st.integers(0, 2**32 - 1), twists, periods)
@settings(deadline=None, max_examples=150)
def test_a_twist_within_the_bounds_can_stop_inside(
    seed: int, previous: np.ndarray, dt: float
) -> None:
    """The bound is for any twist that this period can reach, whatever the other axes do."""
    rng = np.random.default_rng(seed)
    point = rng.uniform(SMALL.lower, SMALL.upper)
    bounds, brake = bounds_at(point, previous, dt), brake_of(LIMIT, previous, dt)
    assert np.all(bounds["lower"] <= bounds["upper"])
    for _ in range(5):
        twist = rng.uniform(brake["low"], brake["high"])
        twist[:3] = np.clip(twist[:3], bounds["lower"], bounds["upper"])
        if np.any(twist < brake["low"]) or np.any(twist > brake["high"]):
            continue
        end = point + stop(twist, dt)[:3]
        assert np.all(end >= np.asarray(SMALL.lower) - 1e-9)
        assert np.all(end <= np.asarray(SMALL.upper) + 1e-9)


@given(st.integers(0, 2**32 - 1), twists, periods)
@settings(deadline=None, max_examples=100)
def test_braking_itself_always_fits_with_the_slack(
    seed: int, previous: np.ndarray, dt: float
) -> None:
    rng = np.random.default_rng(seed)
    point = rng.uniform(np.asarray(SMALL.lower) - 0.05, np.asarray(SMALL.upper) + 0.05)
    bounds, twist = bounds_at(point, previous, dt), brake_of(LIMIT, previous, dt)["twist"][:3]
    upper = bounds["upper"] + np.where(bounds["side"] > 0, bounds["cap"], 0)
    lower = bounds["lower"] - np.where(bounds["side"] < 0, bounds["cap"], 0)
    assert np.all(twist <= upper + 1e-9)
    assert np.all(twist >= lower - 1e-9)
    # From rest, resting is always one of the answers, outside too.
    still = bounds_at(point, np.zeros(6), dt)
    assert np.all(still["upper"] + np.where(still["side"] > 0, still["cap"], 0) >= -1e-9)
    assert np.all(still["lower"] - np.where(still["side"] < 0, still["cap"], 0) <= 1e-9)


@pytest.mark.parametrize(
    ("out", "pace"),
    [
        (0.1, 0.1 / SMALL.recovery_time),
        (0.3, 0.3 / SMALL.recovery_time),
        # The last of it at a steady pace, but never past the end within one period.
        (0.01, STEADY_RETURN),
        (2e-4, STEADY_RETURN),
        (5e-5, 5e-5 / 0.01),
    ],
)
def test_outside_the_row_asks_to_come_back(out: float, pace: float) -> None:
    still, dt = np.zeros(6), 0.01
    above = bounds_at(np.array([0.02 + out, 0.1, 0.5]), still, dt)
    assert above["upper"][0] == pytest.approx(-pace)
    assert (above["side"][0], above["cap"][0]) == (1, pytest.approx(pace, abs=1e-5))
    below = bounds_at(np.array([0.01, -out, 0.5]), still, dt)
    assert below["lower"][1] == pytest.approx(pace)
    assert (below["side"][1], below["cap"][1]) == (-1, pytest.approx(pace, abs=1e-5))


@pytest.mark.parametrize("speed", [0.0, 0.3, 0.6])
def test_outside_a_cone_the_way_back_makes_up_for_the_bend(speed: float) -> None:
    """Half a degree outside, gliding across: so the axis would leave by its curvature; as the row
    asks, it does not."""
    cone, dt, out = AxisCone((1.0, 0.0, 0.0), 20.0), 0.01, np.radians(0.5)
    angle, pose = np.radians(20.0) + out, np.eye(4)
    pose[:3, 0] = np.cos(angle), np.sin(angle), 0.0
    pose[:3, 1] = -np.sin(angle), np.cos(angle), 0.0
    previous = np.array([0.0, 0, 0, 0, speed, 0])
    reach = dt + (speed / LIMIT.acceleration[4] + dt) / 2
    found = bounds_of(cone, LIMIT, pose, previous, dt)
    asked, row = -found["upper"][0], found["matrix"]
    assert asked >= max(out / cone.recovery_time, STEADY_RETURN) * (1 - 1e-9)
    answer = previous - row * max(0.0, asked + row @ previous) / (row @ row)
    glides, obeys = (
        np.arccos((Rotation.from_rotvec(twist[3:] * reach).as_matrix() @ pose[:3, 0])[0]) - angle
        for twist in (previous, answer)
    )
    assert obeys < -0.5 * asked * reach
    assert (glides > 1e-9) == (speed > 0)


@pytest.mark.parametrize("off", [0.0, 0.02, 0.2])
def test_where_an_axis_is_nearest_to_its_cone_it_is_not_asked_to_turn_any_faster(
    off: float,
) -> None:
    """Turning about y alone, an axis 60 deg aside of y = 0 comes no nearer than that: past it,
    every turn leads away again."""
    cone, dt, aside = AxisCone((1.0, 0.0, 0.0), 20.0), 0.01, np.radians(60.0)
    upright = TwistLimit(axes=("ry",))
    pose = np.eye(4)
    pose[:3, 0] = np.cos(aside) * np.cos(off), np.sin(aside), -np.cos(aside) * np.sin(off)
    pose[:3, 1] = np.cross([0.0, 0, 1], pose[:3, 0]) / np.linalg.norm(
        np.cross([0.0, 0, 1], pose[:3, 0])
    )
    pose[:3, 2] = np.cross(pose[:3, 0], pose[:3, 1])
    found = bounds_of(cone, upright, pose, np.zeros(6), dt)
    row, reach = found["matrix"], dt + dt / 2
    fastest, slowest = (
        end[0] / row[4] if abs(row[4]) > 1e-9 else 0.0 for end in (found["lower"], found["upper"])
    )
    for turn in (fastest, slowest):
        ahead = Rotation.from_rotvec([0.0, turn * reach, 0.0]).as_matrix() @ pose[:3, 0]
        assert ahead[0] >= pose[0, 0] - 1e-9


def test_a_row_that_the_object_hardly_moves_is_left_to_the_certificate() -> None:
    """A row of 1e-6 between ends 1e-12 apart was a QP that the solver gave up."""
    cone, dt, off = AxisCone((1.0, 0.0, 0.0), 20.0), 0.01, np.radians(60.0)
    pose = np.eye(4)
    pose[:3, 0], pose[:3, 1] = (np.cos(off), np.sin(off), -1e-5), (-np.sin(off), np.cos(off), 0.0)
    pose[:3, 2] = np.cross(pose[:3, 0], pose[:3, 1])
    found = bounds_of(cone, TwistLimit(axes=("ry",)), pose, np.zeros(6), dt)
    assert found["cap"][0] == 0
    assert -found["lower"][0] > 1e6 < found["upper"][0]


def test_no_row_asks_to_come_back_faster_than_its_own_rate() -> None:
    joint = INDEX["right_elbow_flexion"]
    posture, sensitivity = np.zeros(32), np.zeros((32, 6))
    posture[joint], sensitivity[joint, 0] = UPPER[joint] + 0.5, 1.0
    narrowed = JointLimit(ranges_deg={"right_elbow_flexion": (0, 100)}, rate_deg=5.0, recover=True)
    found = bounds_of(
        narrowed, LIMIT, np.eye(4), np.zeros(6), 0.01, posture=posture, sensitivity=sensitivity
    )
    assert found["upper"][joint] == pytest.approx(-np.radians(5.0))
    # Nor may it give way by more than to stand still.
    assert found["cap"][joint] == pytest.approx(np.radians(5.0) + ELBOW, rel=1e-9)


@pytest.mark.parametrize(
    "limit",
    [
        JointLimit(),
        JointLimit(recover=True),
        JointLimit(ranges_deg={"right_elbow_flexion": (0, 100)}),
    ],
    ids=["the range of a body", "which is never asked for", "narrowed"],
)
def test_a_joint_measured_outside_only_stops_what_leads_further_out(limit: JointLimit) -> None:
    """Only a range that was narrowed, with `recover`, may ask; an angle beyond what a body can do
    says: the sensor is off."""
    joint = INDEX["right_elbow_flexion"]
    posture, sensitivity = np.zeros(32), np.zeros((32, 6))
    posture[joint], sensitivity[joint, 0] = UPPER[joint] + 0.5, 1.0
    found = bounds_of(
        limit, LIMIT, np.eye(4), np.zeros(6), 0.01, posture=posture, sensitivity=sensitivity
    )
    assert found["upper"][joint] == 0
    assert found["lower"][joint] < -0.01


def test_coming_back_never_asks_for_more_than_the_box_holds() -> None:
    still, dt = np.zeros(6), 0.01
    flat = bounds_at(np.array([0.1, 0.1, 0.5]), still, dt, WorkspaceBox((0.0, 0, 0), (0.0, 1, 1)))
    assert flat["lower"][0] <= flat["upper"][0] < 0


def test_axes_that_cannot_move_have_no_rows() -> None:
    desk = TwistLimit(0.1, 0.3, 0.3, 1.0, axes=("z", "ry"))
    assert movable_of(SMALL, desk) == [2]
    assert movable_of(SMALL, LIMIT) == [0, 1, 2]
    bounds = bounds_of(SMALL, desk, np.eye(4), np.zeros(6), 0.01)
    assert bounds["upper"].shape == (1,)
    assert np.abs(bounds["upper"]).max() < FREE


def waits(point: np.ndarray, previous: np.ndarray, law: dict[str, float]) -> float:
    """The longest stop for which a box has room [s], by `patience`."""
    pose = np.eye(4)
    pose[:3, 3] = point
    parts = {
        name: ca.SX(ca.DM(np.atleast_2d(DEFAULTS.get(name, np.zeros(SIZES[name])))))
        for name in NAMES
    }
    parts["observed"], parts["pose"] = ca.SX.ones(32), ca.SX(ca.DM(pose))
    found = patience(
        [SMALL], LimitContext(**parts), ca.SX(ca.DM(previous)), ca.SX(0.01), Stop(LIMIT, **law)
    )
    return float(ca.evalf(found))


@pytest.mark.parametrize(
    "law", [{}, {"stretch": 1.2}, {"average": 0.05, "longest": 0.03}, {"hold": 0.1, "memory": 0.02}]
)
def test_the_longest_stop_is_the_one_that_the_nearest_wall_leaves_room_for(
    law: dict[str, float],
) -> None:
    """At a pace v a stop of t seconds goes v t / 2, after this period and what may be held on
    to."""
    rng, stop = np.random.default_rng(3), Stop(LIMIT, **law)
    for _ in range(40):
        point, previous = (
            rng.uniform(SMALL.lower, SMALL.upper),
            np.r_[rng.uniform(-0.2, 0.2, 3), rng.normal(size=3)],
        )
        room = np.where(previous[:3] > 0, SMALL.upper - point, point - SMALL.lower) - 1e-8
        pace = stop.stretch * np.abs(previous[:3])
        share = 0.5 if "average" in law else 1.0
        expected = np.min(2 * (room / pace - share * 0.01 - stop.held))
        assert waits(point, previous, law) == pytest.approx(expected, rel=1e-9)
    # Sliding along a wall, or away from it, is no approach.
    slides = np.array([-0.2, 0, 0, 0.5, 0, 0])
    assert (
        waits(np.array([SMALL.upper[0], 0.1, 0.5]), slides * [1e-6 / 0.2, 1, 1, 1, 1, 1], law)
        >= FREE
    )
    assert waits(np.array([SMALL.upper[0], 0.1, 0.5]), np.array([0.01, 0, 0, 0, 0, 0]), law) < 0


@pytest.mark.parametrize("longest", [-0.1, 0.0, 0.05, 0.2, 10.0])
def test_no_twist_is_allowed_from_which_stopping_takes_longer_than_there_is_time(
    longest: float,
) -> None:
    previous = ca.SX(ca.DM(np.array([0.1, -0.05, 0.0, 0.2, 0.0, 0.0])))
    brake = Stop(LIMIT).braking(previous, ca.SX(0.01))
    bound = unhurried(brake, ca.SX(longest))
    low, high, twist, free_low, free_high = (
        np.array(ca.evalf(part)).ravel()
        for part in (bound.low, bound.high, bound.twist, brake.low, brake.high)
    )
    most = LIMIT.acceleration * max(longest, 0)
    # What braking itself does is always allowed, and nothing that was not allowed before.
    np.testing.assert_allclose(high, np.maximum(np.minimum(free_high, most), twist), atol=1e-15)
    np.testing.assert_allclose(low, np.minimum(np.maximum(free_low, -most), twist), atol=1e-15)
    if longest > 1:
        np.testing.assert_array_equal(high, free_high)


@pytest.mark.parametrize("inward", [0.0, 0.3])
def test_outside_a_cone_even_what_gives_way_comes_back_as_fast_as_the_bend_leads_out(
    inward: float,
) -> None:
    cone, dt, reserve = AxisCone((1.0, 0.0, 0.0), 20.0), ca.SX(0.01), 1e-4
    brake = Stop(LIMIT).braking(ca.SX([0, 0, 0, 0, 0, -inward]), dt)
    row, away = ca.SX([[0, 0, 0, 0, 0, 1]]), 0.02
    rows = Rows(row, ca.SX([FREE]), ca.SX([-away]), ca.SX([np.inf]), ca.SX([reserve]))
    found = row_bounds(LIMIT, [cone], rows, [0], ca.SX([away, 0]), brake, ca.SX(1))
    upper, cap, bend, braked = (
        float(ca.evalf(part))
        for part in (
            found["ubA"],
            found["cap"],
            (reserve + CLEARANCE) / brake.swing,
            row @ brake.twist,
        )
    )
    assert upper == pytest.approx(-away / cone.recovery_time, rel=1e-9)
    assert 1e-3 < bend < -upper
    # Braking, where it does not come back as fast, stays possible.
    assert upper + cap == pytest.approx(max(-bend, braked) + ELBOW, abs=1e-9)
