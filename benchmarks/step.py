"""How long one control step takes, certification and account included.

Run ``python -m benchmarks.step``.

A closed loop runs first, with a simulated person who is not the model, and everything that went
into `Stepper.step` is kept: noisy postures, measured poses, ages. Then those very calls are made
again, in order, and each is timed from outside with `time.perf_counter`: the whole call, from the
user's arrays to the `Step`. The first pass over the trajectory warms up and is not counted.
``median_us`` and the percentiles are of ``screwing``; every problem's own figures follow as
``PROBLEM.median_us``.

``function_us`` is the CasADi function alone on the same inputs, ``python_us`` what the call costs
around it; ``phase_...`` are its parts (`benchmarks.step_phases`), which add up to ``median_us``.

- ``compiled_...``: the same calls with ``compiled=True``. ``c_...``: the exported step in C, timed
  in C (`benchmarks.step_c`); ``c_max_difference`` is the largest difference of any of its twists
  from Python's.
- ``stop_us``: `Stepper.stop` compiled, from full speed at the problem's period; ``stop_loop_us``
  without a compiler; ``stop_c_us``: within C; ``stop_difference``: the largest difference of the
  stop in closed form from braking period by period, over all problems without a surface, plain,
  guided and with a declared robot (`benchmarks.step_stop`). ``.1ms``: at a period of 1 ms.
- ``largest_us``, ``iteration_us``, ``worst_us``: a step that takes every branch, one iteration of
  the solver, and both at the largest number of iterations (`ergoqp.benchmark_step`);
  ``compiled_...`` likewise.
- ``compiled_ratio``, ``interpreted_ratio``, ``c_ratio`` (for this processor), ``c_ratio.baseline``,
  ``TASK.c_ratio``: the CPU time of the plain mink program of the person (`benchmarks.mink_person`)
  over that of the step, the median of every call's shortest of several turns in one process.
- ``ready_ratio``, ``first_step_s``, ``stepper_s``: the same ratio for the hundredth step of a fresh
  process without a compiler, and what that process took before, of a person never seen before
  (`benchmarks.ready`).
- ``mink_us``: mink on the same QP, inputs to twist, the arm's joints as unknowns
  (`benchmarks.mink_peer`), the leanest there is: its terms come from the step's own CasADi
  functions. ``mink_whole_us``: posture and arm as unknowns, as in `ergoqp.whole_body`.
  ``mink_plain_us``: mink as people write it, which asks for less (`benchmarks.mink_plain`). The
  ratios are of each to the step's three forms, all in this run. ``mink_max_difference``: of its
  twists from the step's.
- ``pink_us``: pink on the same QP, the arm's joints as unknowns (`benchmarks.pink_peer`).
- ``qpsolvers_us``: one call of qpsolvers with DAQP on the step's own QPs, the solve alone, one
  after the other and warmed up.
- ``plain_us``: the EPFL report's way in NumPy and scikit-learn, without any constraint
  (`benchmarks.plain_peer`).
"""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import numpy as np

from benchmarks.mink_peer import mink_steps
from benchmarks.mink_person import ratios
from benchmarks.mink_plain import mink_plain_us
from benchmarks.plain_peer import plain_step_us
from benchmarks.ready import ready
from benchmarks.report import Report, run
from benchmarks.step_c import c_times
from benchmarks.step_phases import phases_us
from benchmarks.step_stop import from_full_speed, stop_c_us, stop_difference, stop_us
from ergoqp.joints import LOWER, UPPER
from ergoqp.problem.load import TASKS, load_problem
from ergoqp.problem.problem import Problem
from ergoqp.rest.model_person import sample_person
from ergoqp.simulation.loop import run_loop
from ergoqp.step.qp import qp_data
from ergoqp.step.stepper import Stepper
from ergoqp.step.timing import benchmark_step

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

    def step(
        self, posture: Any, pose: Any = None, twist: Any = None, *, age: float = 0.0, **rest: Any
    ) -> Any:
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
        posture = person.response.comfort + np.radians(15) * np.random.default_rng(seed).normal(
            size=32
        )
        start = person.start_at(np.clip(posture, LOWER, UPPER))
        half = duration / 2
        run_loop(
            problem,
            person.holding(start),
            duration=half,
            seed=seed,
            controller=recorder,  # type: ignore
        )
    return recorder


def time_calls(stepper: Stepper, calls: list[Call]) -> tuple[np.ndarray, np.ndarray]:
    """Return the durations [us] of whole calls and the function alone on a recorded trajectory."""
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


def qpsolvers_us(problem: Problem, calls: list[Call]) -> float | None:
    """Return the median time [us] of one qpsolvers call on the QPs of a recorded loop.

    It is None unless both qpsolvers and DAQP are installed.
    """
    try:
        import qpsolvers
    except ImportError:
        return None
    if "daqp" not in qpsolvers.available_solvers:
        return None
    data, n, asked, previous = qp_data(problem), len(problem.coordinates), [], np.zeros(6)
    stepper = Stepper(problem, compiled=False)
    for posture, pose, age in calls:
        unimproved = stepper.stalled
        step = stepper.step(posture, pose, age=age)
        if step.status == "optimal":
            parts = data(
                posture, np.ones(n), step.pose, previous, problem.dt, unimproved, np.zeros(n), 0.0
            )
            H, g, A, lower, upper, _, _, low, high = (np.array(part) for part in parts[:9])
            G, h = np.vstack([A, -A]), np.concatenate([upper, -lower]).ravel()
            asked.append(qpsolvers.Problem(H, g.ravel(), G, h, lb=low.ravel(), ub=high.ravel()))
        previous = step.twist
    times: list[float] = []
    for _ in ("warm-up", "counted"):
        times.clear()
        for qp in asked:
            start = time.perf_counter()
            qpsolvers.solve_problem(qp, solver="daqp")
            times.append(time.perf_counter() - start)
    return 1e6 * float(np.median(times))


def sent_as_planned(problem: Problem) -> Problem:
    """Return a problem in which nothing is averaged.

    The QP of its step is one that others can solve by themselves.
    """
    return problem.replace(control=replace(problem.control, average=0.0))


def measure(report: Report) -> None:
    """Time every problem."""
    duration = report.pick(20.0, 100.0)
    medians: dict[str, float] = {}
    for name in ("screwing", *(other for other in TASKS if other != "screwing")):
        problem = load_problem(name)
        stepper = Stepper(problem, compiled=False)
        recorder = trajectory(problem, stepper, duration if name == "screwing" else duration / 2)
        whole, alone = time_calls(stepper, recorder.calls)
        kinds = {
            status: recorder.statuses.count(status) for status in sorted(set(recorder.statuses))
        }
        report.say(f"{name}: {len(whole)} steps, {kinds}")
        prefix = "" if name == "screwing" else f"{name}."
        report.figure(f"{prefix}median_us", float(np.median(whole)), "whole Stepper.step call")
        report.figure(f"{prefix}p99_us", float(np.percentile(whole, 99)))
        if name == "screwing":
            report.figure("p999_us", float(np.percentile(whole, 99.9)))
            report.figure("max_us", float(whole.max()), "on a shared machine, not a promise")
            report.figure("function_us", float(np.median(alone)), "the CasADi function alone")
            report.figure("function_p99_us", float(np.percentile(alone, 99)))
            report.figure(
                "python_us",
                float(np.median(whole - alone)),
                "checking inputs and the account, in Python",
            )
            report.figure("steps", len(whole))
        medians[name] = float(np.median(whole))
    report.figure("worst_median_us", max(medians.values()), max(medians, key=medians.__getitem__))
    _peers(report, medians["screwing"])


def _peers(report: Report, median: float) -> None:
    """Report the other forms of the step on one recorded loop of ``screwing``.

    Also report what others need for the same.
    """
    problem = load_problem("screwing")
    calls = trajectory(problem, Stepper(problem, compiled=False), report.pick(20.0, 100.0)).calls
    phases = phases_us(problem, calls)
    for name, value in phases.items():
        report.figure(f"phase_{name}_us", value)
    report.figure(
        "phase_other_us",
        median - sum(phases.values()),
        "copying, certification, account, Python: the rest",
    )

    compiled = time_calls(Stepper(problem, compiled=True), calls)[0]
    report.figure(
        "compiled_median_us", float(np.median(compiled)), "whole Stepper.step call, compiled=True"
    )
    report.figure("compiled_p99_us", float(np.percentile(compiled, 99)))
    report.figure("compiled_p999_us", float(np.percentile(compiled, 99.9)))
    forms = {"mink_ratio": median, "mink_ratio_compiled": float(np.median(compiled))}
    if (c := c_times(problem, calls, report.pick(10, 20))) is None:
        report.say("no CMake or no C compiler: the exported step is not measured")
    else:
        for name in ("median", "p99", "p999", "max"):
            report.figure(
                f"c_{name}_us",
                getattr(c, f"{name}_us"),
                "exported step, timed in C" if name == "median" else "",
            )
        report.figure(
            "c_own_p999_us",
            c.own_p999_us,
            "the same, of every step's shortest time over the passes",
        )
        report.figure(
            "c_max_difference",
            c.difference,
            f"largest difference from Python over {c.states} steps [m/s, rad/s]",
        )
        forms["mink_ratio_c"] = c.median_us
    peer = ratios(report, problem, calls)
    soon = ready(report.pick(5, 20))
    report.figure("ready_ratio", peer / soon.step_us, f"{soon.engine}, {soon.step_us:.2f} us")
    report.figure("first_step_s", soon.first_step_s, "CPU, from the import to the first twist")
    report.figure("stepper_s", soon.stepper_s, "CPU of making a stepper")
    for name in TASKS:
        if name != "screwing":
            other = load_problem(name)
            loop = trajectory(other, Stepper(other), 5.0).calls
            ratios(report, other, loop, f"{name}.", few=True)
    _stop(report, problem)
    _largest(report, problem)
    problem = sent_as_planned(problem)
    calls = trajectory(problem, Stepper(problem, compiled=False), report.pick(20.0, 100.0)).calls
    arm = mink_steps(problem, calls, "arm")
    report.figure(
        "mink_us",
        float(np.median(arm.whole_us)),
        "mink on the same QP, arm as unknowns, inputs to twist",
    )
    report.figure(
        "mink_own_us", float(np.median(arm.own_us)), "of it in mink: building and solving the QP"
    )
    report.figure("mink_max_difference", arm.difference)
    plain = float(np.median(mink_plain_us(problem.dt, report.pick(1000, 5000))))
    report.figure(
        "mink_plain_us",
        plain,
        "a task for the hand, one for the posture, mink's limits: less is asked",
    )
    some = calls[: report.pick(300, 2000)]
    whole = float(np.median(mink_steps(problem, some, "whole").whole_us))
    report.figure("mink_whole_us", whole, "posture and arm as unknowns")
    for name, value in forms.items():
        report.figure(name, float(np.median(arm.whole_us)) / value)
        report.figure(name.replace("mink", "mink_whole"), whole / value)
        report.figure(name.replace("mink", "mink_plain"), plain / value)
    try:
        from benchmarks.pink_peer import pink_steps
    except ImportError as missing:
        report.say(f"pink is not measured: {missing}")
    else:
        report.figure(
            "pink_us", float(np.median(pink_steps(problem, calls).whole_us)), "pink on the same QP"
        )
    if (us := qpsolvers_us(problem, calls)) is not None:
        report.figure(
            "qpsolvers_us", us, "one qpsolvers call on the step's own QP, the solve alone"
        )
    if (plain := plain_step_us(problem, some)) is not None:
        report.figure(
            "plain_us",
            float(np.median(plain)),
            "NumPy and scikit-learn, the EPFL report's way, no constraints",
        )


def _largest(report: Report, problem: Problem) -> None:
    """Report how long a step can take at the largest number of its operations."""
    for prefix, compiled in (("", False), ("compiled_", True)):
        times = benchmark_step(problem, compiled, steps=report.pick(100, 2000))
        report.figure(f"{prefix}largest_us", times.operations_us, "every branch, slack in every QP")
        report.figure(f"{prefix}iteration_us", times.iteration_us, "one iteration of the solver")
        report.figure(f"{prefix}worst_us", times.worst_us, f"at {times.iterations} iterations")


def _stop(report: Report, problem: Problem) -> None:
    """Report what the stop takes, and whether it is the one that braking gives."""
    fast, given = Stepper(problem, compiled=True), from_full_speed(problem, 200)
    fast.restore(given[-1])
    rows = len(fast.stop())
    report.figure("stop_us", stop_us(fast, given), f"Stepper.stop, compiled, {rows} twists")
    loop = stop_us(Stepper(problem, compiled=False), given[:20])
    report.figure("stop_loop_us", loop, "the loop of brake, interpreted")
    for name, each in (("stop_c_us", problem), ("stop_c_us.1ms", problem.replace(dt=0.001))):
        us, rows = stop_c_us(each, from_full_speed(each, 200))
        report.figure(name, us, f"within C, {rows} twists")
    apart, count = stop_difference(report.pick(50, 500))
    report.figure("stop_difference", apart, f"of {count} stops [m/s, rad/s]")


if __name__ == "__main__":
    run(measure, "One control step, from the user's arrays to the certified twist.")
