"""One solver on one sequence: every answer is checked, every time is measured."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ergoqp.solvers import open_session
from ergoqp.solvers.judge import NOTHING, judge
from ergoqp.solvers.sequence import Array, QpSequence

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
