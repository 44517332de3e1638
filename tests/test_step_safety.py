"""Whatever comes in, a safe twist comes out: a small, shrinking version of ``benchmarks.fuzz``."""

from __future__ import annotations

from collections import Counter
from functools import cache
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from step_samples import NAMES, comfort_of, held_pose, problem_of, stepper_of

from ergoqp.joints import LOWER, UPPER
from ergoqp.simulation.check import Checker
from ergoqp.simulation.robot import moved
from ergoqp.solvers.daqp import Daqp
from ergoqp.step_function import build_step

numbers = st.floats(allow_nan=True, allow_infinity=True)
periods = st.floats(0.001, 0.05)

FROM_OUTSIDE = ("posture", "observed", "pose", "executed", "dt", "age", "has_pose", "frame", "enable")
"""Inputs of the step function that users fill; the rest is its own state."""


@st.composite
def postures(draw: Any) -> Any:
    """Around comfort, at the ends of the ranges or beyond them, with a wrong entry now and then; or none at all."""
    kind = draw(st.sampled_from(["near", "ends", "beyond", "anywhere", "hole", "lost"]))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    q = comfort_of("screwing") + 0.2 * rng.normal(size=32)
    if kind == "ends":
        q = np.where(rng.random(32) < 0.5, LOWER, UPPER)
    elif kind == "beyond":
        q = np.where(rng.random(32) < 0.5, LOWER - 0.3, UPPER + 0.05)
    elif kind == "anywhere":
        q = rng.uniform(LOWER, UPPER)
    elif kind == "hole":
        q[draw(st.integers(0, 31))] = draw(numbers)
    return None if kind == "lost" else q


calls = st.fixed_dictionaries({"posture": postures(), "dt": periods, "age": st.sampled_from([0.0, 0.05, 0.2])})


@pytest.mark.parametrize("name", NAMES)
@given(sequence=st.lists(calls, min_size=1, max_size=8))
@settings(deadline=None, max_examples=25)
def test_twist_is_finite_and_within_speed_and_acceleration(name: str, sequence: list[dict[str, Any]]) -> None:
    stepper, checker = stepper_of(name), Checker(problem_of(name))
    previous = np.zeros(6)
    for call in sequence:
        step = stepper.step(call["posture"], dt=call["dt"], age=call["age"])
        assert np.isfinite(step.twist).all()
        assert np.isfinite(step.pose).all()
        broken = checker.check(step.twist, previous, step.pose, None, step.posture_rate, call["dt"])
        assert not set(broken) & {"speed", "acceleration", "axes"}, (broken, checker.max_violation)
        assert step.status in ("optimal", "settled", "relaxed", "recovering", "braking", "invalid")
        assert step.reason or step.status == "optimal"
        previous = step.twist


@pytest.mark.parametrize("name", NAMES)
def test_an_object_inside_stays_inside_whatever_the_person_does(name: str) -> None:
    rng = np.random.default_rng(0)
    for _ in range(3):
        stepper, checker = stepper_of(name), Checker(problem_of(name))
        pose, previous, dt = held_pose(name), np.zeros(6), 0.01
        target = rng.uniform(LOWER, UPPER)
        for number in range(150):
            if number % 40 == 0:
                target = np.clip(comfort_of(name) + rng.normal(size=32) * 0.6, LOWER, UPPER)
            dt = float(rng.uniform(0.001, 0.05))
            step = stepper.step(target, pose if number == 0 else None, dt=dt)
            np.testing.assert_allclose(step.pose, pose, atol=1e-9)
            assert checker.check(step.twist, previous, pose, None, step.posture_rate, dt) == []
            pose, previous = moved(pose, step.twist * dt), step.twist


class Sensitive:
    """DAQP, but NaN among its data, or anything infinite, shows in the multipliers."""

    name = "sensitive"

    def function(self, n: int, m: int) -> ca.Function:
        inner = Daqp().function(n, m)
        data = inner.mx_in()
        x, rows, box = inner(*data)
        size = sum((ca.sumsqr(part) for part in data), ca.MX(0))
        return ca.Function("sensitive", data, [x, rows + 1e-300 * size, box])


@cache
def sensitive_step(name: str) -> ca.Function:
    return build_step(problem_of(name), Sensitive())


@pytest.mark.parametrize("name", ["dentist", "screwing"])
@given(data=st.data())
@settings(deadline=None, max_examples=60)
def test_the_data_of_the_qp_are_finite_whatever_comes_in(name: str, data: st.DataObject) -> None:
    """CasADi's QP plugins raise on NaN, so none may get there: every input that users fill is attacked."""
    step, rng = sensitive_step(name), np.random.default_rng(data.draw(st.integers(0, 2**32 - 1)))
    usual = {name: np.zeros(step.size_in(i)) for i, name in enumerate(step.name_in())}
    usual |= {"posture": comfort_of(name) + 0.2 * rng.normal(size=32), "observed": np.ones(32), "dt": np.array(0.01)}
    usual |= {"pose": held_pose(name), "has_pose": np.ones(1), "frame": np.ones(1), "enable": np.ones(1)}
    for attacked in data.draw(st.lists(st.sampled_from(FROM_OUTSIDE), max_size=4)):
        values = np.array(usual[attacked], dtype=float).reshape(step.size_in(attacked), order="F")
        values.flat[rng.integers(values.size)] = data.draw(numbers)
        usual[attacked] = values if data.draw(st.booleans()) else np.full_like(values, data.draw(numbers))
    answer = step(**usual)
    assert np.isfinite(np.array(answer["multipliers"])).all()
    assert np.isfinite(np.array(answer["twist"])).all()


@given(st.integers(0, 2**32 - 1), periods, st.floats(0.1, 3.0))
@settings(deadline=None, max_examples=60)
def test_from_whatever_the_robot_really_did(seed: int, dt: float, factor: float) -> None:
    """Acceleration holds always; a speed above the limit only comes down."""
    rng = np.random.default_rng(seed)
    limit = problem_of("screwing").twist_limit
    executed = rng.uniform(-1, 1, 6) * factor * limit.speed
    step = stepper_of("screwing").step(comfort_of("screwing"), held_pose("screwing"), executed, dt=dt)
    assert np.all(np.abs(step.twist - executed) <= limit.acceleration * dt * (1 + 1e-9) + 1e-12)
    assert np.all(np.abs(step.twist) <= np.maximum(limit.speed, np.abs(executed)) + 1e-12)


def test_contradictory_limits_brake_or_hold_and_never_raise() -> None:
    from ergoqp.limits import AxisCone, JointLimit, WorkspaceBox

    problem, pose = problem_of("screwing"), held_pose("screwing")
    point = tuple(pose[:3, 3])
    flat = WorkspaceBox(point, point)  # type: ignore[arg-type]
    opposite = AxisCone(tuple(-pose[:3, 0]), 5.0)  # type: ignore[arg-type]
    narrow = JointLimit(ranges_deg={"right_elbow_flexion": (10, 10.2), "trunk_flexion": (60, 60.1)})
    for limits in ([flat], [opposite], [flat, opposite], [flat, opposite, narrow]):
        hard = [problem.twist_limit, *limits, *([] if narrow in limits else [JointLimit()])]
        stepper, checker = problem.replace(limits=hard).stepper(), Checker(problem.replace(limits=hard))
        previous = np.zeros(6)
        for number in range(40):
            step = stepper.step(comfort_of("screwing"), pose if number == 0 else None)
            broken = checker.check(step.twist, previous, step.pose, None, step.posture_rate, 0.01)
            assert broken == [], (broken, checker.max_violation, step.status)
            previous = step.twist


def test_a_short_fuzz_finds_nothing_wrong() -> None:
    fuzz = pytest.importorskip("benchmarks.fuzz", reason="the benchmarks of the checkout are not importable here")
    counts: Counter = Counter()
    examples: list[str] = []
    for number in range(8):
        with np.errstate(all="ignore"):
            tally = fuzz.run_chunk((number, 250))
        assert tally.steps == 250
        counts += tally.counts
        examples += tally.examples
    found = {figure: counts[figure] for figure in ("unsafe", "exceptions", "reasons_wrong")}
    assert found == {"unsafe": 0, "exceptions": 0, "reasons_wrong": 0}, examples
