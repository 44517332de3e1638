"""QPs as data, numeric solvers that stay in memory for sequences of them, and the check of answers.

The comparison of solvers uses them.

Check of a QP solver's answer in plain NumPy, independent of the status of the solver. Three
residuals are those of qpbenchmark (Caron and others, 2024), absolute and in the infinity norm. A
fourth checks the signs of the multipliers, which those three do not show.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, replace
from typing import Final, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ergoqp.errors import InputError, in_words

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Qp:
    """min 1/2 x'Hx + g'x subject to lbA <= A x <= ubA and lb <= x <= ub.

    Attributes:
        H: symmetric (n, n), in the units of the QP.
        g: (n,), in the units of the QP.
        A: (m, n), in the units of the QP.
        lbA: lower bounds of the rows (m,), -inf if there is none, in the units of the QP.
        ubA: upper bounds of the rows (m,), inf if there is none, in the units of the QP.
        lb: lower bounds of x (n,), in the units of the QP.
        ub: upper bounds of x (n,), in the units of the QP.

    Example:
        >>> import numpy as np
        >>> from ergoqp.solvers.session import Qp
        >>> one = np.ones(1)
        >>> qp = Qp(np.eye(1), -one, np.eye(1), 0 * one, 2 * one, -9 * one, 9 * one)
        >>> qp.size, float(qp.value(one))
        ((1, 1), -0.5)
    """

    H: Array
    g: Array
    A: Array
    lbA: Array
    ubA: Array
    lb: Array
    ub: Array

    @property
    def size(self) -> tuple[int, int]:
        """Number of unknowns and of rows."""
        return self.A.shape[1], self.A.shape[0]

    def value(self, x: Array) -> float:
        """Return the objective at `x` (n,)."""
        return float(0.5 * x @ self.H @ x + self.g @ x)


PARTS: tuple[str, ...] = tuple(field.name for field in fields(Qp))
"""Names of the parts of a `Qp`, in the order that solvers use."""


@dataclass(frozen=True, eq=False)
class QpSequence:
    """QPs of one size, in the order of recording.

    Attributes:
        name: source of the QPs, for example ``screwing.0``.
        qps: the QPs.
        feasible: whether the QPs have an answer, by construction or because a certified one is
            known.
        follows: whether each QP is close to the one before, so that a warm start makes sense.
    """

    name: str
    qps: tuple[Qp, ...]
    feasible: bool = True
    follows: bool = True

    def __post_init__(self) -> None:
        """Check that all QPs have one size."""
        sizes = {qp.size for qp in self.qps}
        if len(sizes) != 1:
            raise InputError(
                f"sequence {self.name!r}: got QPs of {len(sizes)} sizes, allowed exactly one"
            )

    def __len__(self) -> int:
        """Return the number of QPs."""
        return len(self.qps)

    def __iter__(self) -> Iterator[Qp]:
        """Iterate over the QPs in order."""
        return iter(self.qps)

    @property
    def size(self) -> tuple[int, int]:
        """Number of unknowns and of rows."""
        return self.qps[0].size

    @property
    def family(self) -> str:
        """Kind of QPs: ``recorded``, or how they were derived.

        It is the part of the name after a plus sign.
        """
        return self.name.partition("+")[2] or "recorded"

    def thinned(self, count: int) -> QpSequence:
        """Return at most `count` of the QPs: consecutive ones from the middle.

        So each still follows the one before.
        """
        start = max(0, (len(self) - count) // 2)
        return replace(self, qps=self.qps[start : start + count])


FLAGS: Final = ("solved", "infeasible", "stopped", "failed", "not a number", "bounds cross")
"""Possible results of a solver.

They are: solved; no answer exists; stopped at the limit of iterations; failed for another reason,
for example its numerics. The last two are found before the solver sees the data: NaN or infinity
where a number is needed, and a lower bound above the upper one.
"""


@dataclass(frozen=True, eq=False)
class QpAnswer:
    """Answer of a solver for one QP. Nothing in it has been checked; see `ergoqp.solvers.session`.

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


TOLERANCES: Final = (1e-3, 1e-6, 1e-9)
"""The tolerances of qpbenchmark: low, middle and high accuracy."""

SHIFT: Final = 10e-6
"""Shift of the geometric mean of times [s], about the time of the fastest solver.

So no outlier dominates the mean.
"""


@dataclass(frozen=True)
class Residuals:
    """Residuals of an answer.

    Attributes:
        primal: largest violation of rows and bounds.
        dual: largest entry of H x + g + A' rows + box.
        gap: difference of the primal and the dual objective.
        sign: largest multiplier at the farther end of its row, or at an infinite end. If the
            distance to that end is smaller than the multiplier, it is that distance, because
            between almost equal ends either end may be active.
    """

    primal: float
    dual: float
    gap: float
    sign: float

    @property
    def worst(self) -> float:
        """The largest of the four; infinity if the answer has no numbers."""
        return max(self.primal, self.dual, self.gap, self.sign)

    def relative(self, qp: Qp) -> float:
        """Return the largest of the four, with the dual ones relative to 1 + max |g|.

        The control step uses the same scale.
        """
        scale = 1.0 + float(np.abs(qp.g).max())
        return max(self.primal, self.dual / scale, self.gap / scale, self.sign / scale)


NOTHING: Final = Residuals(np.inf, np.inf, np.inf, np.inf)


def judge(qp: Qp, answer: QpAnswer) -> Residuals:
    """Return the residuals of an answer.

    Args:
        qp: the QP.
        answer: x (n,) and multipliers of rows (m,) and bounds (n,), in the units of the QP.

    Source:
        Caron and others, qpbenchmark, 2024: primal and dual residual and duality gap.

    Example:
        >>> import numpy as np
        >>> from ergoqp.solvers.session import judge
        >>> from ergoqp.solvers.session import Qp
        >>> from ergoqp.solvers.session import QpAnswer
        >>> one = np.ones(1)
        >>> qp = Qp(one[:, None], -2 * one, one[:, None], -one, one, -5 * one, 5 * one)
        >>> judge(qp, QpAnswer(one, one, 0 * one, "solved")).worst
        0.0
        >>> judge(qp, QpAnswer(2 * one, 0 * one, 0 * one, "solved")).primal
        1.0
    """
    x, rows, box = answer.x, answer.rows, answer.box
    if not (np.isfinite(x).all() and np.isfinite(rows).all() and np.isfinite(box).all()):
        return NOTHING
    value = np.concatenate([qp.A @ x, x])
    least, most = np.concatenate([qp.lbA, qp.lb]), np.concatenate([qp.ubA, qp.ub])
    multiplier = np.concatenate([rows, box])
    below, above = value - least, most - value
    primal = float(max(0.0, -below.min(), -above.min()))
    dual = float(np.abs(qp.H @ x + qp.g + qp.A.T @ rows + box).max())
    at_most = np.where(np.isfinite(most), most, 0.0) @ np.maximum(multiplier, 0.0)
    at_least = np.where(np.isfinite(least), least, 0.0) @ np.minimum(multiplier, 0.0)
    gap = float(abs(x @ qp.H @ x + qp.g @ x + at_most + at_least))
    return Residuals(primal, dual, gap, _wrong_sign(multiplier, below, above))


def _wrong_sign(multiplier: Array, below: Array, above: Array) -> float:
    up = np.where(above > below, np.minimum(np.maximum(multiplier, 0.0), above), 0.0)
    down = np.where(below > above, np.minimum(np.maximum(-multiplier, 0.0), below), 0.0)
    return float(max(up.max(), down.max(), 0.0))


def tidy(tolerance: float) -> str:
    """Return a tolerance as in the names of figures, ``1e-6``."""
    return np.format_float_scientific(tolerance, trim="-", exp_digits=1)


def shifted_geometric_mean(seconds: Array, shift: float = SHIFT) -> float:
    """Return exp(mean(log(t + shift))) - shift of times [s]."""
    return float(np.exp(np.log(np.asarray(seconds) + shift).mean()) - shift)
