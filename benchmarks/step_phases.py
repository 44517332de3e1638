"""Where the interpreted step's time goes: its functions one by one, on a recorded loop's inputs.

Each function is called by itself at the same postures, so that its instructions are nearer at hand
than in the whole step; the rest of the whole call, `other`, holds what that hides, copying,
branches and further passes. The phases add up to the total.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from ergoqp.expressions import Evaluator
from ergoqp.problem.problem import Problem
from ergoqp.solvers import solver_named
from ergoqp.step.model import StepModel
from ergoqp.step.objective import cost_function, gain_function
from ergoqp.step.qp import QP_DATA, build_qp, qp_data
from ergoqp.step.stepper import Stepper


def phases_us(problem: Problem, calls: Sequence[tuple[Any, Any, float]]) -> dict[str, float]:
    """Return median times [us] of cost, response, rows and objective, QP with check, and gain."""
    data = qp_data(problem)
    solver = build_qp(solver_named("daqp"), data.size1_out("A"))
    cost, response, gain = (
        cost_function(StepModel(problem)),
        problem.response.sensitivity(),
        gain_function(StepModel(problem)),
    )
    everything = {"cost": cost, "response": response, "data": data, "qp": solver, "gain": gain}
    timers = {name: _Timer(function) for name, function in everything.items()}
    n = len(problem.coordinates)
    stepper, previous = Stepper(problem), np.zeros(6)
    for posture, pose, age in calls:
        unimproved = stepper.stalled
        step = stepper.step(posture, pose, age=age)
        if step.status == "invalid" or np.ndim(posture) == 0:
            previous = step.twist
            continue
        _, total, _ = timers["cost"](posture, np.ones(n))
        S, _ = timers["response"](posture, np.zeros(n))
        parts = timers["data"](
            posture, np.ones(n), step.pose, previous, problem.dt, unimproved, np.zeros(n), 0.0
        )
        timers["qp"](*parts[: len(QP_DATA)])
        timers["gain"](posture, total, step.twist, S)
        previous = step.twist
    times = {name: timer.median_us for name, timer in timers.items()}
    times["rows_and_objective"] = times.pop("data") - times["cost"] - times["response"]
    return times


class _Timer:
    """Calls a CasADi function through its buffers and remembers how long each call took."""

    def __init__(self, function: ca.Function) -> None:
        self._evaluator = Evaluator(function)
        self._times: list[float] = []

    def __call__(self, *values: Any) -> list[np.ndarray]:
        for array, value in zip(self._evaluator.inputs.values(), values, strict=True):
            array[:] = np.ravel(value, order="F")
        start = time.perf_counter()
        self._evaluator.evaluate()
        self._times.append(time.perf_counter() - start)
        return [array.copy() for array in self._evaluator.outputs.values()]

    @property
    def median_us(self) -> float:
        """Median time of all calls [us]."""
        return 1e6 * float(np.median(self._times))
