"""Numeric solvers that stay in memory, for sequences of QPs outside the control step.

The comparison of solvers uses them.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final, Protocol

import numpy as np
from numpy.typing import ArrayLike

from ergoqp.errors import InputError, in_words
from ergoqp.solvers.sequence import PARTS, Array, Qp

FLAGS: Final = ("solved", "infeasible", "stopped", "failed", "not a number", "bounds cross")
"""Possible results of a solver.

They are: solved; no answer exists; stopped at the limit of iterations; failed for another reason,
for example its numerics. The last two are found before the solver sees the data: NaN or infinity
where a number is needed, and a lower bound above the upper one.
"""


@dataclass(frozen=True, eq=False)
class QpAnswer:
    """Answer of a solver for one QP. Nothing in it has been checked; see `ergoqp.solvers.judge`.

    Attributes:
        x: the answer (n,), in the units of the QP; NaN if there is none.
        rows: multipliers of the rows (m,), in the units of the QP, positive at the upper bound: H x
            + g + A' rows + box = 0.
        box: multipliers of the bounds on x (n,), in the units of the QP, positive at the upper
            bound.
        flag: one of `FLAGS`.
        iterations: number of iterations of the solver. None: it does not report it.
        seconds: time of the solver, including its setup or its update with new data [s].

    Example:
        >>> import numpy as np
        >>> from ergoqp.solvers import open_session
        >>> answer = open_session("daqp", 1, 1).solve([[1]], [-3], [[1]], [0], [2], [-9], [9])
        >>> answer.found, answer.rows.round(6).tolist()
        (True, [1.0])
    """

    x: Array
    rows: Array
    box: Array
    flag: str
    iterations: int | None = None
    seconds: float = 0.0

    @property
    def found(self) -> bool:
        """Whether the solver reports that it solved the QP."""
        return self.flag == "solved"


class Workspace(Protocol):
    """Memory of one solver for QPs of one size."""

    def solve(self, qp: Qp, warm: bool) -> QpAnswer:
        """Solve finite data whose bounds do not cross.

        With `warm` it starts from the last answer if the solver can. Without it, the answer is the
        same as if this were the first QP, to the last bit (ProxQP: to 1e-13, because the order of
        its sums depends on the address of its memory).
        """
        ...


class Session:
    """A solver that keeps its memory from one QP to the next, all of one size.

    It checks the data first, measures the time, and never raises because of the data. If a solver
    raises, or its answer has another size, the QP counts as failed and the solver gets new memory.

    Args:
        name: name of the solver.
        n: number of unknowns.
        m: number of rows.
        make: function that returns memory for this size.

    Attributes:
        fault: what was wrong when the solver first failed in this way, in words. Empty: nothing.

    Example:
        >>> import numpy as np
        >>> from ergoqp.solvers import open_session
        >>> session = open_session("daqp", n=1, m=1)
        >>> session.solve([[1]], [-1], [[1]], [0], [2], [-9], [9]).x.round(6).tolist()
        [1.0]
        >>> session.solve([[1]], [-3], [[1]], [0], [2], [-9], [9]).x.round(6).tolist()
        [2.0]
    """

    def __init__(self, name: str, n: int, m: int, make: Callable[[], Workspace]) -> None:
        """Make the memory."""
        self.name, self._make = name, make
        self._workspace: Workspace | None = make()
        self.fault = ""
        self._sizes = [(n,), (m,), (n,)]
        self._shapes = dict(zip(PARTS, ((n, n), (n,), (m, n), (m,), (m,), (n,), (n,)), strict=True))

    def solve(
        self,
        H: ArrayLike,
        g: ArrayLike,
        A: ArrayLike,
        lbA: ArrayLike,
        ubA: ArrayLike,
        lb: ArrayLike,
        ub: ArrayLike,
        warm: bool = True,
    ) -> QpAnswer:
        """Solve min 1/2 x'Hx + g'x subject to lbA <= A x <= ubA and lb <= x <= ub.

        Args:
            H: symmetric, positive definite (n, n), in the units of the QP.
            g: (n,), in the units of the QP.
            A: (m, n), in the units of the QP.
            lbA: lower bounds of the rows (m,), in the units of the QP; -inf if a row has none.
            ubA: upper bounds of the rows (m,), in the units of the QP; inf if a row has none.
            lb: (n,), -inf allowed, in the units of the QP.
            ub: (n,), inf allowed, in the units of the QP.
            warm: whether to start from the last answer, if the solver can. False: as if this were
                the first QP.

        Raises:
            InputError: if a shape is not that of the session.
        """
        return self.solve_qp(Qp(*self._arrays(H, g, A, lbA, ubA, lb, ub)), warm)

    def solve_qp(self, qp: Qp, warm: bool = True) -> QpAnswer:
        """Solve a QP given as float arrays of the session's shapes in C order; see `solve`."""
        if flag := unusable(qp):
            return no_answer(*qp.size, flag)
        start = time.perf_counter()
        try:
            if self._workspace is None:
                self._workspace = self._make()
            answer = self._workspace.solve(qp, warm)
            sizes = [np.shape(part) for part in (answer.x, answer.rows, answer.box)]
            fault = "" if sizes == self._sizes else f"an answer of the shapes {sizes}"
        except Exception as error:  # any error of a solver
            answer, fault = None, in_words(error)
        seconds = time.perf_counter() - start
        if answer is None or fault:
            self._workspace, self.fault = None, self.fault or fault
            return replace(no_answer(*qp.size, "failed"), seconds=seconds)
        return replace(answer, seconds=seconds)

    def _arrays(self, *parts: ArrayLike) -> list[Array]:
        arrays = []
        for (name, shape), part in zip(self._shapes.items(), parts, strict=True):
            array = np.ascontiguousarray(part, dtype=float)
            if array.shape != shape:
                raise InputError(f"{name}: got shape {array.shape}, allowed {shape}")
            arrays.append(array)
        return arrays


def unusable(qp: Qp) -> str:
    """Return the flag for data that no solver should see, or an empty text."""
    # The sum is finite only if all entries are.
    if not math.isfinite(qp.H.sum() + qp.g.sum() + qp.A.sum()):
        return "not a number"
    for least, most in ((qp.lbA, qp.ubA), (qp.lb, qp.ub)):
        # A comparison with NaN is false, and no value lies between two bounds of inf.
        if not ((least <= most) & (least < math.inf) & (most > -math.inf)).all():
            return (
                "not a number" if np.isnan(least).any() or np.isnan(most).any() else "bounds cross"
            )
    return ""


def no_answer(n: int, m: int, flag: str, iterations: int | None = None) -> QpAnswer:
    """Return an answer without numbers."""
    return QpAnswer(np.full(n, np.nan), np.full(m, np.nan), np.full(n, np.nan), flag, iterations)
