"""One solver on one sequence: every answer is checked, every time measured; and its figures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ergoqp.solvers import open_session
from ergoqp.solvers.session import (
    NOTHING,
    TOLERANCES,
    Array,
    QpSequence,
    judge,
    shifted_geometric_mean,
    tidy,
)

_SLOW: Final = 2.0
"""A first pass that took this long is the only one [s].

Interruptions by other programs do not matter then.
"""


@dataclass(frozen=True, eq=False)
class SolverTrial:
    """Result of one solver on one sequence.

    Attributes:
        solver: name of the solver.
        sequence: the QPs.
        warm: whether each QP but the first started from the answer before.
        residuals: primal, dual, gap and sign of every answer (k, 4); infinite if there is none.
        flags: result reported by the solver (k,).
        seconds: time of each QP (k,) [s].
        iterations: number of iterations of the solver (k,); NaN if it does not report it.
        points: the answers (k, n).
        fault: what was wrong when the solver first raised or returned an answer of the wrong size.
            Empty: nothing.
    """

    solver: str
    sequence: QpSequence
    warm: bool
    residuals: Array
    flags: NDArray[np.str_]
    seconds: Array
    iterations: Array
    points: Array
    fault: str = ""

    @property
    def worst(self) -> Array:
        """The largest residual of each answer (k,)."""
        return self.residuals.max(axis=1)

    @property
    def found(self) -> NDArray[np.bool_]:
        """Whether the solver reported each QP as solved (k,)."""
        return self.flags == "solved"

    def success(self, tolerance: float) -> NDArray[np.bool_]:
        """Return whether it did so and all four residuals are within a tolerance (k,)."""
        return self.found & (self.worst <= tolerance)

    def wrong(self, tolerance: float) -> NDArray[np.bool_]:
        """Return whether the report is wrong (k,): solved but not so, or infeasible but not so."""
        if not self.sequence.feasible:
            return self.found
        return (self.found & ~(self.worst <= tolerance)) | (self.flags == "infeasible")


def try_solver(
    solver: str, sequence: QpSequence, warm: bool, accuracy: float, passes: int = 1
) -> SolverTrial:
    """Solve a sequence in order by one solver that stays in memory, and check every answer.

    With more than one pass, the time of each QP is its smallest, because a solver takes the same
    steps every time and other programs do not interrupt every pass.

    Args:
        solver: name of the solver, see `ergoqp.solvers`.
        sequence: the QPs.
        warm: whether each QP starts from the answer before. False: as if it were the first.
        accuracy: accuracy that the solver is set to.
        passes: how often the whole sequence is solved, each time by a new session.

    Raises:
        MissingExtraError: if the solver is not installed.
    """
    session = open_session(solver, *sequence.size, accuracy)
    residuals, flags, seconds, iterations, points = [], [], [], [], []
    for qp in sequence:
        answer = session.solve_qp(qp, warm)
        found = judge(qp, answer) if answer.found else NOTHING
        residuals.append((found.primal, found.dual, found.gap, found.sign))
        flags.append(answer.flag)
        seconds.append(answer.seconds)
        iterations.append(np.nan if answer.iterations is None else answer.iterations)
        points.append(answer.x)
    fault = session.fault
    for _ in range(passes - 1 if sum(seconds) < _SLOW else 0):
        session = open_session(solver, *sequence.size, accuracy)
        seconds = [
            min(least, session.solve_qp(qp, warm).seconds)
            for least, qp in zip(seconds, sequence, strict=True)
        ]
    return SolverTrial(
        solver,
        sequence,
        warm,
        np.array(residuals),
        np.array(flags),
        np.array(seconds),
        np.array(iterations),
        np.array(points),
        fault,
    )


Mask = NDArray[np.bool_]

DEADLINE: Final = 0.01
"""Least time of an unsolved QP in the mean [s]: the control period that is lost."""


def figures_of(trials: Sequence[SolverTrial], accuracy: float) -> dict[str, float]:
    """Return the figures of one solver.

    - ``success_1e-3``, ``success_1e-6``, ``success_1e-9``: share of the feasible QPs, cold and
      warm, that it reported as solved, with primal residual, dual residual, gap and wrong-signed
      multipliers within that tolerance.
    - ``wrong_flags``: number of wrong reports at the accuracy. It is the sum of ``wrong_solved``
      (feasible QPs reported as solved that are not), ``wrong_infeasible`` (feasible QPs reported as
      infeasible) and ``solved_infeasible`` (infeasible QPs reported as solved).
    - ``infeasible_named``: share of the infeasible QPs that it reported as such.
    - ``sgm_us``: shifted geometric mean of the times of cold, feasible QPs. A QP that was not
      solved to the accuracy counts with at least `DEADLINE`. ``p50_us`` to ``max_us``: the times as
      measured.
    - ``warm_us``, ``warm_ratio``: shifted geometric mean of the warm times along trajectories, and
      its ratio to the cold one of the same QPs. ``warm_iterations_ratio``: the ratio of the mean
      iterations. ``iterations``: mean, cold.

    Args:
        trials: trials of one solver, with cold ones among them.
        accuracy: accuracy that the solver was set to [1e-9 to 1].
    """
    good = [trial for trial in trials if trial.sequence.feasible]
    bad = [trial for trial in trials if not trial.sequence.feasible]
    cold = [trial for trial in good if not trial.warm]
    figures: dict[str, float] = {
        "qps": sum(len(trial.sequence) for trial in trials if not trial.warm)
    }
    for tolerance in TOLERANCES:
        figures[f"success_{tidy(tolerance)}"] = _mean([trial.success(tolerance) for trial in good])
    figures["wrong_solved"] = _count([trial.wrong(accuracy) & trial.found for trial in good])
    figures["wrong_infeasible"] = _count([trial.flags == "infeasible" for trial in good])
    figures["solved_infeasible"] = _count([trial.found for trial in bad])
    figures["wrong_flags"] = (
        figures["wrong_solved"] + figures["wrong_infeasible"] + figures["solved_infeasible"]
    )
    if bad:
        figures["infeasible_named"] = _mean([trial.flags == "infeasible" for trial in bad])
    counted = [
        np.where(trial.success(accuracy), trial.seconds, np.maximum(trial.seconds, DEADLINE))
        for trial in cold
    ]
    figures["sgm_us"] = 1e6 * shifted_geometric_mean(np.concatenate(counted))
    seconds = np.concatenate([trial.seconds for trial in cold])
    for name, percent in (("p50_us", 50), ("p95_us", 95), ("p99_us", 99), ("max_us", 100)):
        figures[name] = 1e6 * float(np.percentile(seconds, percent))
    figures |= _iterations("iterations", cold)
    return figures | _warm(good)


def _warm(trials: Sequence[SolverTrial]) -> dict[str, float]:
    warm = [trial for trial in trials if trial.warm]
    names = {trial.sequence.name for trial in warm}
    cold = [trial for trial in trials if not trial.warm and trial.sequence.name in names]
    if not warm or not cold:
        return {}
    times = [
        shifted_geometric_mean(np.concatenate([trial.seconds for trial in kind]))
        for kind in (warm, cold)
    ]
    figures = {"warm_us": 1e6 * times[0], "warm_ratio": times[0] / times[1]}
    counts = [_iterations("i", kind).get("i", np.nan) for kind in (warm, cold)]
    if counts[1] > 0:
        figures["warm_iterations_ratio"] = counts[0] / counts[1]
    return figures


def _iterations(name: str, trials: Sequence[SolverTrial]) -> dict[str, float]:
    counts = np.concatenate([trial.iterations for trial in trials])
    return {} if np.isnan(counts).any() else {name: float(counts.mean())}


def _mean(parts: Sequence[Mask]) -> float:
    return float(np.concatenate(parts).mean()) if parts else 0.0


def _count(parts: Sequence[Mask]) -> float:
    return float(sum(part.sum() for part in parts))
