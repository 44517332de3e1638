"""How long one control step takes, certification and account included. ``python -m benchmarks.step``.

A closed loop runs first, with a simulated person who is not the model, and everything that went into `Stepper.step` is kept:
noisy postures, measured poses, ages. Then those very calls are made again, in order, and each is timed from outside with
`time.perf_counter`: the whole call, from the user's arrays to the `Step`. The first pass over the trajectory warms up and is
not counted. ``median_us`` and the percentiles are of ``screwing``; every problem's own figures follow as ``PROBLEM.median_us``.

``function_us`` is the CasADi function alone on the same inputs, ``python_us`` what the call costs around it. For comparison,
``qpsolvers_us`` is one call of qpsolvers on a random QP of the step's size (six unknowns, 46 rows, bounds): the solve alone,
without the kinematics, cost, gradient, certification and account that the step includes.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from benchmarks.report import Report, run
from ergoqp.joints import LOWER, UPPER
from ergoqp.problem import Problem
from ergoqp.problem_file import TASKS, load_problem
from ergoqp.simulation.loop import run_loop, start_at
from ergoqp.simulation.people import sample_person
from ergoqp.step import Stepper

Call = tuple[Any, Any, float]


class Recorder:
    """Stands in for a stepper, passes every call on and remembers it."""

    def __init__(self, stepper: Stepper) -> None:
        """Start without calls."""
        self.stepper, self.dt = stepper, stepper.dt
        self.calls: list[Call] = []
        self.statuses: list[str] = []

    def reset(self) -> None:
        """Forget the loop, not the calls."""
        self.stepper.reset()

    def step(self, posture: Any, pose: Any = None, twist: Any = None, *, age: float = 0.0, **rest: Any) -> Any:
        """Keep what came in and answer."""
        self.calls.append((np.array(posture), np.array(pose), age))
        step = self.stepper.step(posture, pose, twist, age=age, **rest)
        self.statuses.append(step.status)
        return step


def trajectory(problem: Problem, stepper: Stepper, duration: float) -> Recorder:
    """Return the calls of closed loops that start some 15 degrees per joint away from comfort."""
    recorder = Recorder(stepper)
    for seed in (0, 1):
        person = sample_person(problem, seed)
        posture = person.response.comfort + np.radians(15) * np.random.default_rng(seed).normal(size=32)
        start = start_at(person, np.clip(posture, LOWER, UPPER))
        run_loop(problem, person, start, duration=duration / 2, seed=seed, stepper=recorder)  # type: ignore[arg-type]
    return recorder


def time_calls(stepper: Stepper, calls: list[Call]) -> tuple[np.ndarray, np.ndarray]:
    """Return the durations [us] of the whole calls, and of the function alone, over a recorded trajectory."""
    whole, alone = np.zeros(len(calls)), np.zeros(len(calls))
    for _ in ("warm-up", "counted"):
        stepper.reset()
        for i, (posture, pose, age) in enumerate(calls):
            start = time.perf_counter()
            stepper.step(posture, pose, age=age)
            whole[i] = time.perf_counter() - start
    stepper.reset()
    for i, (posture, pose, age) in enumerate(calls):
        stepper.step(posture, pose, age=age)
        # The inputs of this step are still in the buffers: the function again, by itself.
        start = time.perf_counter()
        stepper._call()
        alone[i] = time.perf_counter() - start
    return 1e6 * whole, 1e6 * alone


def qpsolvers_us(count: int) -> float | None:
    """Return the median time [us] of one qpsolvers call on a QP of the step's size and kind, None without qpsolvers."""
    try:
        import qpsolvers
    except ImportError:
        return None
    if "daqp" not in qpsolvers.available_solvers:
        return None
    rng = np.random.default_rng(0)
    root = rng.normal(size=(6, 6))
    H, g, G = root @ root.T + np.eye(6), rng.normal(size=6), rng.normal(size=(46, 6))
    h, box, times = 1 + rng.random(46), np.full(6, 0.5), []
    for _ in range(count):
        start = time.perf_counter()
        qpsolvers.solve_problem(qpsolvers.Problem(H, g, G, h, lb=-box, ub=box), solver="daqp")
        times.append(time.perf_counter() - start)
    return 1e6 * float(np.median(times))


def measure(report: Report) -> None:
    """Time every problem."""
    duration = report.pick(20.0, 100.0)
    medians: dict[str, float] = {}
    for name in ("screwing", *(other for other in TASKS if other != "screwing")):
        problem = load_problem(name)
        stepper = problem.stepper()
        recorder = trajectory(problem, stepper, duration if name == "screwing" else duration / 2)
        whole, alone = time_calls(stepper, recorder.calls)
        kinds = {status: recorder.statuses.count(status) for status in sorted(set(recorder.statuses))}
        report.say(f"{name}: {len(whole)} steps, {kinds}")
        prefix = "" if name == "screwing" else f"{name}."
        report.figure(f"{prefix}median_us", float(np.median(whole)), "whole Stepper.step call")
        report.figure(f"{prefix}p99_us", float(np.percentile(whole, 99)))
        if name == "screwing":
            report.figure("p999_us", float(np.percentile(whole, 99.9)))
            report.figure("max_us", float(whole.max()), "on a shared machine, not a promise")
            report.figure("function_us", float(np.median(alone)), "the CasADi function alone")
            report.figure("function_p99_us", float(np.percentile(alone, 99)))
            report.figure("python_us", float(np.median(whole - alone)), "checking inputs and the account, in Python")
            report.figure("steps", len(whole))
        medians[name] = float(np.median(whole))
    report.figure("worst_median_us", max(medians.values()), max(medians, key=medians.__getitem__))
    peer = qpsolvers_us(report.pick(2000, 20_000))
    if peer is None:
        report.say("qpsolvers with daqp (extra 'solvers') is absent: no comparison")
    else:
        report.figure("qpsolvers_us", peer, "one random QP of 6 unknowns and 46 rows by qpsolvers, the solve alone")


if __name__ == "__main__":
    run(measure, "One control step, from the user's arrays to the certified twist.")
