"""How long a step can take on this machine, at the largest number of its operations."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any, Final

import casadi as ca
import numpy as np

from ergoqp.arguments import check_kind, check_number, check_whole, flag
from ergoqp.expressions import Evaluator
from ergoqp.native.compiled import compiled as machine_code
from ergoqp.problem.problem import Problem
from ergoqp.problem.validate import PERIODS, shortest
from ergoqp.solvers import solver_named
from ergoqp.solvers.daqp import ITERATIONS, in_step
from ergoqp.step.constants import stand_in
from ergoqp.step.function import build_shared_step
from ergoqp.step.guide import RECORDED
from ergoqp.step.model import StepModel
from ergoqp.step.qp import PASSES
from ergoqp.step.stepper import Stepper

LARGEST_ITERATIONS: Final = PASSES * ITERATIONS
"""Largest number of solver iterations of one step: 3 QPs of at most 500 iterations each.

Everything else in a step is a fixed number of operations, without loops. A step with joints at
their ends solves up to 3 QPs (locking passes). DAQP gives up after 500 iterations, and the object
then brakes.

Example:
    >>> from ergoqp.step.timing import LARGEST_ITERATIONS
    >>> LARGEST_ITERATIONS
    1500
"""

_REPEATS: Final = 20
"""The shortest of so many times counts: what the step itself takes, without interruptions."""


@dataclass(frozen=True)
class StepTimes:
    """How long a step takes on this machine, see `benchmark_step`.

    Attributes:
        median_us: median of whole calls of `Stepper.step` [us].
        p99_us: 99th percentile of these calls [us].
        max_us: longest of these calls [us], with whatever interrupted it.
        operations_us: a step with its largest number of operations: every branch, all locking
            passes, rows that give way in every QP [us]. The QPs take as many iterations as they
            need.
        iteration_us: one iteration of the solver with the most unknowns and active rows [us].
        iterations: largest number of iterations of a step, see `LARGEST_ITERATIONS`.

    Example:
        >>> from ergoqp.step.timing import StepTimes
        >>> times = StepTimes(100.0, 120.0, 300.0, 500.0, 2.0, 1500)
        >>> times.worst_us
        3500.0
    """

    median_us: float
    p99_us: float
    max_us: float
    operations_us: float
    iteration_us: float
    iterations: int = LARGEST_ITERATIONS

    @property
    def worst_us(self) -> float:
        """Time of a step at the largest number of operations and solver iterations [us]."""
        return self.operations_us + self.iterations * self.iteration_us


def benchmark_step(
    problem: Problem,
    compiled: bool = False,
    dt: float | None = None,
    *,
    guided: bool = False,
    steps: int = 500,
    seed: int = 0,
) -> StepTimes:
    """Measure on this machine how long a step of a problem takes, and how long it can take.

    The largest number of operations is run, not waited for: a second form of the step takes every
    branch and solves every QP of its locking passes in the largest form. The solver's iterations
    are measured by themselves, because no QP of a step is known that needs nearly as many as are
    allowed. Measure on the machine of the loop, under its scheduler and load: what interrupts the
    program comes on top.

    Args:
        problem: the task.
        compiled: whether the step is compiled. The first time this compiles two functions.
        dt: control period [s]. None: that of the problem.
        guided: whether the step has a guide.
        steps: number of calls that are timed.
        seed: seed of the drawn postures.

    Returns:
        The times, in microseconds.

    Raises:
        InputError: if an argument has the wrong type or is out of range.
        CompilerError: if there is no C compiler for ``compiled=True``.

    Example:
        >>> import ergoqp
        >>> times = ergoqp.benchmark_step(ergoqp.load_problem("screwing"), steps=20)
        >>> times.iterations, times.worst_us > times.operations_us > 0
        (1500, True)
    """
    check_kind("problem", problem, Problem, "a Problem, such as ergoqp.load_problem gives")
    compiled, guided = flag("compiled", compiled), flag("guided", guided)
    check_whole("steps", steps, 1, 1_000_000)
    check_whole("seed", seed, 0)
    if dt is not None:
        check_number("dt", dt, *PERIODS, "s")
        problem = problem.replace(dt=float(dt))
    place = RECORDED if guided else None
    stepper, rng = Stepper(problem, compiled=compiled, guide=place), np.random.default_rng(seed)
    calls = [_posture(problem, rng) for _ in range(steps)]
    times = []
    for posture in calls:
        start = time.perf_counter()
        stepper.step(posture)
        times.append(time.perf_counter() - start)
    largest = Evaluator(_largest_step(problem, compiled, guided))
    most = 0.0
    for posture in calls[:: max(1, steps // 50)]:
        stepper.step(posture)
        # The inputs of this step, for the form that takes every branch.
        largest.given[:] = stepper._given
        most = max(most, shortest(largest.evaluate, _REPEATS))
    median, p99 = 1e6 * np.percentile(times, [50, 99])
    rows = len(StepModel(problem, guided).movable)
    iteration = _iteration_us(rows, rng)
    return StepTimes(float(median), float(p99), 1e6 * max(times), 1e6 * most, iteration)


def _posture(problem: Problem, rng: np.random.Generator) -> np.ndarray:
    usual = stand_in(problem)
    return usual + 0.3 * np.minimum(1.0, problem.response.largest) * rng.normal(size=len(usual))


def _largest_step(problem: Problem, compiled: bool, guided: bool) -> ca.Function:
    """Return the step that takes every branch."""

    def build(solver: Any) -> ca.Function:
        name = "largest_step"
        return build_shared_step(
            problem, solver, name, guided, unrolled=compiled, every_branch=True
        )

    return machine_code(build) if compiled else build(solver_named("daqp"))


def _iteration_us(rows: int, rng: np.random.Generator) -> float:
    """Return the time of one iteration of DAQP in a QP with slack in all rows [us].

    It is that of the second half of the iterations of random QPs with narrow bounds, where most
    unknowns are at a bound.
    """
    n, longest = 6 + rows, 0.0
    for _ in range(3):
        root, A = rng.normal(size=(n, n)), rng.normal(size=(rows, n))
        data = {"h": root @ root.T + np.eye(n), "g": 30 * rng.normal(size=n), "a": A}
        data |= {"lba": -0.1 * np.ones(rows), "uba": 0.1 * np.ones(rows)}
        data |= {"lbx": -0.1 * np.ones(n), "ubx": 0.1 * np.ones(n)}

        def limited(most: int, data: dict[str, np.ndarray] = data) -> Evaluator:
            evaluator = Evaluator(in_step(n, rows, most))
            for name, values in data.items():
                evaluator.inputs[name][:] = values.ravel(order="F")
            return evaluator

        def solved(most: int) -> bool:
            evaluator = limited(most)
            evaluator.evaluate()
            return evaluator.stats()["success"]

        low, high = 1, ITERATIONS
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (low, middle) if solved(middle) else (middle, high)
        half = max(1, high // 2)
        # Both are kept: `evaluate` uses their memory.
        timed = [limited(most) for most in (high, half)]
        slow, fast = (shortest(each.evaluate, _REPEATS) for each in timed)
        spent = slow - fast
        longest = max(longest, spent / max(1, high - half))
    return 1e6 * longest
