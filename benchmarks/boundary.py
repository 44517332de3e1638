"""The one-class boundary as a row, attacked, to see whether the true boundary ever gives way.

Run ``python -m benchmarks.boundary``.

Random one-class SVMs with a scaler in 3 to 32 dimensions, random sensitivities, and costs that want
out: one descends the margin itself (the worst direction at every step), one is a random field of
waves. Each state is driven by the control step alone, with twist acceleration limits active and
periods drawn from 1 to 50 ms, and judged afterwards by scikit-learn.

- ``steps``: steps taken. ``violations``: those after which scikit-learn's own decision function is
  negative (beyond 1e-9 in the logarithm). ``twist_violations``: twists beyond speed or
  acceleration. ``least_margin``: the smallest margin seen.
- ``first_order_violations``, ``first_order_share``: the same with a row that believes the slope
  alone, on ``first_order_steps`` steps.
- ``margin_ratio``: median of gamma |D|^2 / (g + grad g . D - g(q + D)) over the stopping
  displacements of the sent twists: how much more than the true loss the row sets aside. Infinite
  where nothing was lost.
- ``near_share``: share of the steps within 0.05 of the boundary, where the row has something to do;
  ``braking_share``: share in which only braking could be certified.
"""

from __future__ import annotations

import os
from concurrent.futures import ProcessPoolExecutor
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any
from unittest import mock

import casadi as ca
import numpy as np

from benchmarks.report import Report, run
from ergoqp.learning.one_class import OneClass
from ergoqp.limits import LimitContext, OneClassBoundary, Rows, TwistLimit
from ergoqp.limits.custom import OwnRates
from ergoqp.problem.problem import Problem
from ergoqp.problem.settings import Control
from ergoqp.responses import LinearResponse
from ergoqp.step.stepper import Stepper

DIMENSIONS = (3, 4, 6, 8, 12, 16, 20, 26, 32)
LOOP = 150
"""Steps from one start."""
NEAR = 0.05
ROUNDING = 1e-9


class FirstOrder(OneClassBoundary):
    """The same row without its reserve: what a linearised constraint does."""

    def rows(self, context: LimitContext) -> Rows:
        """Return the row with nothing set aside."""
        rows = super().rows(context)
        return Rows(rows.matrix, rows.to_lower, rows.to_upper, rows.rate, ca.SX(1, 1))

    def margins(self, context: LimitContext, displacement: ca.SX) -> ca.SX:
        """Return what the slope alone promises."""
        value, slope = self._reading(context)
        return value + ca.fmin(0, ca.dot(slope, self._moves(context) @ displacement))


def unchecked() -> AbstractContextManager[Any]:
    """Let a problem take a limit whose margins are no bounds, as `FirstOrder`'s: it is refused."""
    return mock.patch.object(OwnRates, "judge")


class Outward:
    """Cost that descends the margin."""

    name, minimum, dense = "outward", -1e6, True

    def __init__(self, model: OneClass) -> None:
        """Take the margin itself for the cost."""
        x = ca.MX.sym("x", len(model.coordinates))
        value, slope = model.margin_and_slope(x)
        self.value_and_gradient = ca.Function("outward", [x], [100 * value, 100 * slope])

    def expression(self, q: ca.MX) -> ca.MX:
        """Return the cost."""
        return self.value_and_gradient(q)[0]

    def __call__(self, postures: Any) -> np.ndarray:
        """Return the cost of each state."""
        return np.array([float(self.value_and_gradient(row)[0]) for row in np.atleast_2d(postures)])


class Waves(Outward):
    """Cost of random waves: the way out changes all the time."""

    name = "waves"

    def __init__(self, model: OneClass, rng: np.random.Generator) -> None:
        """Draw the waves."""
        n = len(model.coordinates)
        x = ca.MX.sym("x", n)
        waves = rng.normal(size=(12, n)) / model.scale / np.sqrt(n)
        value = 100 * ca.sum1(
            ca.sin(ca.DM(waves) @ x + ca.DM(rng.uniform(0, 6.3, 12)))
        ) + 100 * ca.dot(ca.DM(waves[0]), x)
        self.value_and_gradient = ca.Function("waves", [x], [value, ca.gradient(value, x)])


@dataclass(frozen=True)
class Case:
    """One system: its boundary, the data inside, and scikit-learn's pipeline that judges."""

    model: OneClass
    estimator: Any
    inside: np.ndarray
    sensitivity: np.ndarray

    def margin(self, points: np.ndarray) -> np.ndarray:
        """Log margin (n,) from scikit-learn's decision function, without our arithmetic."""
        rho = self.estimator[-1].offset_[0]
        return np.log(np.maximum(self.estimator.score_samples(points) / rho, 1e-300))


def draw_case(n: int, rng: np.random.Generator) -> Case:
    """Draw data and a sensitivity, and fit a boundary to the data.

    The data are three clouds, of different scale along every axis.
    """
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import StandardScaler
    from sklearn.svm import OneClassSVM

    scales = np.exp(rng.uniform(np.log(0.05), np.log(1.0), n))
    centres = rng.normal(size=(3, n))
    points = (centres[rng.integers(3, size=600)] + rng.normal(size=(600, n))) * scales
    gamma: Any = rng.uniform(0.3, 2.0) / n  # the stub knows words only
    estimator = make_pipeline(
        StandardScaler(), OneClassSVM(nu=rng.uniform(0.02, 0.15), gamma=gamma)
    ).fit(points)
    names = tuple(f"x{i}" for i in range(n))
    model = OneClass.from_estimator(estimator, names)
    inside = points[estimator.decision_function(points) > 0.01]
    sensitivity = np.eye(6) if n == 6 else rng.normal(size=(n, 6)) * scales[:, None]
    return Case(model, estimator, inside, sensitivity)


@dataclass
class Attack:
    """Counts of one case."""

    steps: int = 0
    violations: int = 0
    twist_violations: int = 0
    least_margin: float = np.inf
    near: int = 0
    braking: int = 0
    ratios: list[float] | None = None


def attack(seed: int, n: int, steps: int, first_order: bool) -> Attack:
    """Drive one random case for so many steps."""
    rng = np.random.default_rng([seed, n])
    case = draw_case(n, rng)
    limit = TwistLimit(*rng.uniform([0.1, 0.1, 0.5, 0.5], [0.5, 0.5, 3.0, 3.0]))
    boundary = (
        FirstOrder(case.model, hard=True, name="first order")
        if first_order
        else OneClassBoundary(case.model, hard=True)
    )
    response = LinearResponse(case.model.coordinates.names, case.sensitivity, largest=1e3)
    found = Attack(ratios=[])
    for cost in (Outward(case.model), Waves(case.model, rng)):
        control = Control(
            comfort=0.0, rest_below=0.0, stall_after=1e6, effort_linear=0.1, effort_angular=0.1
        )
        limits: list[Any] = [limit, boundary]
        with unchecked():
            problem = Problem(cost=cost, response=response, limits=limits, control=control)
            _drive(problem, case, steps // 2, rng, found)
    return found


def _drive(
    problem: Problem, case: Case, steps: int, rng: np.random.Generator, found: Attack
) -> None:
    stepper, limit = Stepper(problem), problem.twist_limit
    before, after, stops = [], [], []
    state, previous = case.inside[0], np.zeros(6)
    for number in range(steps):
        if number % LOOP == 0:
            stepper.reset()
            state, previous = case.inside[rng.integers(len(case.inside))], np.zeros(6)
        dt = float(np.exp(rng.uniform(np.log(1e-3), np.log(50e-3))))
        step = stepper.step(state, dt=dt)
        change = np.abs(step.twist - previous) - limit.acceleration * dt
        found.twist_violations += bool(
            (change > 1e-9).any() or (np.abs(step.twist) > limit.speed + 1e-9).any()
        )
        found.braking += step.status in ("braking", "invalid")
        before.append(state)
        stop_time = float(np.max(np.abs(step.twist) / limit.acceleration))
        stops.append(case.sensitivity @ step.twist * (dt + stop_time / 2))
        state, previous = state + case.sensitivity @ step.twist * dt, step.twist
        after.append(state)
    margins = case.margin(np.array(after))
    found.steps += steps
    found.violations += int((margins < -ROUNDING).sum())
    found.least_margin = min(found.least_margin, float(margins.min()))
    found.near += int((margins < NEAR).sum())
    found.ratios = [*(found.ratios or []), *_ratios(case, np.array(before), np.array(stops))]


def _ratios(case: Case, states: np.ndarray, stops: np.ndarray) -> list[float]:
    some = slice(None, None, 10)
    states, stops = states[some], stops[some]
    length = ((stops / case.model.scale) ** 2).sum(axis=1)
    moving = length > 1e-8
    states, stops, length = states[moving], stops[moving], length[moving]
    if not len(states):
        return []
    value, slope = (
        np.asarray(part) for part in case.model.margin_and_slope.map(len(states))(states.T)
    )
    lost = value.ravel() + (slope.T * stops).sum(axis=1) - case.margin(states + stops)
    return np.where(lost > 0, case.model.gamma * length / np.maximum(lost, 1e-300), np.inf).tolist()


def measure(report: Report) -> None:
    """Attack every dimension in two processes, ours and first order."""
    per_case, seeds = report.pick((2_400, 1), (18_600, 6))
    jobs = [(seed, n, per_case, False) for seed in range(seeds) for n in DIMENSIONS]
    jobs += [(seed, n, per_case // 10, True) for seed in range(seeds) for n in DIMENSIONS]
    with ProcessPoolExecutor(min(2, os.cpu_count() or 1)) as pool:
        found = list(pool.map(attack, *zip(*jobs, strict=True)))
    ours, linear = found[: len(jobs) // 2], found[len(jobs) // 2 :]
    steps = sum(one.steps for one in ours)
    report.figure("steps", steps)
    report.figure(
        "violations", sum(one.violations for one in ours), "steps outside the true boundary"
    )
    report.figure(
        "twist_violations",
        sum(one.twist_violations for one in ours),
        "twists beyond speed or acceleration",
    )
    report.figure("least_margin", min(one.least_margin for one in ours), "logarithm")
    report.figure(
        "near_share",
        sum(one.near for one in ours) / steps,
        f"of the steps within {NEAR} of the boundary",
    )
    report.figure("braking_share", sum(one.braking for one in ours) / steps)
    linear_steps = sum(one.steps for one in linear)
    violations = sum(one.violations for one in linear)
    report.figure("first_order_steps", linear_steps)
    report.figure("first_order_violations", violations)
    report.figure("first_order_share", violations / linear_steps, "of its steps")
    report.figure(
        "margin_ratio",
        float(np.median([ratio for one in ours for ratio in one.ratios or []])),
        "median",
    )


if __name__ == "__main__":
    run(measure, "The one-class boundary as a row, attacked in 3 to 32 dimensions.")
