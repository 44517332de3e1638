"""The interface of a QP solver, for the control step and for sequences of QPs outside it.

Equal bounds as equalities, for solvers that need a feasible set with an interior. Other solvers
need it because they lose multipliers between equal bounds.
"""

from __future__ import annotations

import abc
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Final

import casadi as ca
import numpy as np

from ergoqp.solvers.session import Array, Qp, Session, Workspace

if TYPE_CHECKING:
    from scipy import sparse

FREE: Final = 1e9
"""Stands for "no bound" in the step: large against all quantities there, but finite.

So residuals stay numbers.
"""

SOLVER: Final = "solver"
"""Name of the function of a solver in Python within a step."""

_ACCURACY: Final = 1e-7
"""Accuracy of solvers in the step, which accepts residuals below 1e-6."""

_KEPT: Final[dict[tuple[int, int, int], NumericFunction]] = {}
"""Functions by solver and size: CasADi does not keep the Python part of a callback alive."""

_INTERRUPTS: Final[dict[int, BaseException]] = {}
"""Exceptions that were to end the program while a solver ran, by thread.

CasADi would change their type.
"""


class QpSolver(abc.ABC):
    """A solver of min 1/2 x'Hx + g'x subject to lbA <= A x <= ubA and lb <= x <= ub.

    All data are dense. The step never relies on the status of a solver. It computes primal, dual
    and gap residuals of the answer, which show infeasible and failed answers. Multipliers are
    positive at upper bounds: H x + g + A' rows + box = 0.

    Attributes:
        name: name for users.
        method: method, in two words.
        warm: whether it can start from the last answer.

    Example:
        >>> from ergoqp.solvers import solver_named
        >>> solver = solver_named("daqp")
        >>> solver.name, solver.method, solver.warm
        ('daqp', 'active set', True)
    """

    name: str = "own"
    method: str = "own"
    warm: bool = False

    @abc.abstractmethod
    def workspace(self, n: int, m: int, accuracy: float) -> Workspace:
        """Return memory for `n` unknowns and `m` rows, for residuals of at most `accuracy`."""

    def function(self, n: int, m: int) -> ca.Function:
        """Return the solver as the control step calls it.

        It is ``(h (n, n), g (n,), a (m, n), lba, uba (m,), lbx, ubx (n,)) -> (x, lam_a, lam_x)``,
        where `FREE` means no bound. For finite data it never raises. If there is no answer it
        returns zeros, which the step rejects.

        Every call gets new memory. So the step is a pure function, and a replay gives the same
        twists, whatever else runs.
        """
        name = self.name

        def answer(parts: Sequence[ca.DM]) -> Sequence[Array]:
            session = Session(name, n, m, lambda: self.workspace(n, m, _ACCURACY))
            found = session.solve_qp(numeric(parts), warm=False)
            given = [np.asarray(part, float) for part in (found.x, found.rows, found.box)]
            return [np.where(np.abs(part) < FREE, part, 0.0) for part in given]

        # One operation, for concurrent threads. The kept function keeps the solver alive, so no
        # other solver has its id.
        made = NumericFunction(SOLVER, n, m, answer)
        return _KEPT.setdefault((id(self), n, m), made).expression()


Shapes = tuple[tuple[int, int], ...]


def shapes_of(n: int, m: int) -> tuple[Shapes, Shapes]:
    """Return the shapes of the inputs and outputs of a solver in the step."""
    return ((n, n), (n, 1), (m, n), (m, 1), (m, 1), (n, 1), (n, 1)), ((n, 1), (m, 1), (n, 1))


def passing_on(call: Callable[[], object]) -> Callable[[], None]:
    """Return a call of a function with solvers in Python that passes on interrupts.

    A `KeyboardInterrupt` within a solver is raised after the call. CasADi may lose one at the edge
    between its code and the solver's.
    """

    def called() -> None:
        # One that is left was raised in a call that was interrupted once more.
        _INTERRUPTS.pop(threading.get_ident(), None)
        try:
            call()
        except Exception as error:
            end = _INTERRUPTS.pop(threading.get_ident(), None)
            raise end or (KeyboardInterrupt() if interrupted(error) else error) from None
        if end := _INTERRUPTS.pop(threading.get_ident(), None):
            raise end

    return called


def interrupted(error: Exception) -> bool:
    """Return whether an error of CasADi was an interrupt of Python code that it called."""
    return str(error).strip().endswith(KeyboardInterrupt.__name__)


class NumericFunction(ca.Callback):
    """A QP solver in Python as a CasADi function; it exists as long as this object is kept.

    Args:
        name: name of the function.
        n: number of unknowns.
        m: number of rows.
        answer: function of the parts of a `Qp` that returns x, row and box multipliers.
    """

    def __init__(
        self, name: str, n: int, m: int, answer: Callable[[Sequence[ca.DM]], Sequence[Any]]
    ) -> None:
        """Register the function with CasADi."""
        ca.Callback.__init__(self)
        self._answer = answer
        self._in, self._out = shapes_of(n, m)
        self.construct(name, {})

    def expression(self) -> ca.Function:
        """Return the function as an expression."""
        inputs = [ca.MX.sym(f"in{i}", *shape) for i, shape in enumerate(self._in)]
        return ca.Function(self.name(), inputs, list(self(*inputs)))

    def get_n_in(self) -> int:
        """Return the number of inputs."""
        return len(self._in)

    def get_n_out(self) -> int:
        """Return the number of outputs."""
        return len(self._out)

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        """Return the shape of an input."""
        return ca.Sparsity.dense(*self._in[i])

    def get_sparsity_out(self, i: int) -> ca.Sparsity:
        """Return the shape of an output."""
        return ca.Sparsity.dense(*self._out[i])

    def eval(self, arguments: Any) -> Any:
        """Solve one QP; zeros for any error of a user's solver, so that the control loop brakes."""
        try:
            return [ca.DM(part) for part in self._answer(arguments)]
        except BaseException as end:
            if not isinstance(end, Exception):
                _INTERRUPTS[threading.get_ident()] = end
            return [ca.DM.zeros(*shape) for shape in self._out]


def numeric(parts: Sequence[ca.DM]) -> Qp:
    """Return a QP of the step, with infinity in place of `FREE`."""
    arrays = [part.full() for part in parts]  # `__array__` of CasADi drops interrupts
    return Qp(arrays[0], arrays[1].ravel(), arrays[2], *(infinite(part) for part in arrays[3:]))


def infinite(values: Array) -> Array:
    """Return bounds of the step (k,), with infinity in place of `FREE`."""
    values = values.ravel()
    return np.where(np.abs(values) < FREE, values, np.copysign(np.inf, values))


class Pattern:
    """Which bounds of a QP are equal, and which are finite.

    The shapes of a solver's data depend on it.

    Attributes:
        fixed_rows: rows whose bounds are equal (m,).
        fixed: unknowns whose bounds are equal (n,).
    """

    def __init__(self, qp: Qp) -> None:
        """Compare the bounds."""
        self._qp, self._unit = qp, np.eye(len(qp.g))
        self.fixed_rows, self.fixed = qp.lbA == qp.ubA, qp.lb == qp.ub
        # Other rows and other unknowns that have an upper bound, or a lower one.
        self._above = np.isfinite(qp.ubA) & ~self.fixed_rows
        self._below = np.isfinite(qp.lbA) & ~self.fixed_rows
        self._high, self._low = (np.isfinite(end) & ~self.fixed for end in (qp.ub, qp.lb))

    def equalities(self) -> tuple[Array, Array]:
        """Return C and d of C x = d: the fixed rows, then the fixed unknowns."""
        qp = self._qp
        matrix = np.concatenate([qp.A[self.fixed_rows], self._unit[self.fixed]])
        return matrix, np.concatenate([qp.ubA[self.fixed_rows], qp.ub[self.fixed]])

    def inequalities(self) -> tuple[Array, Array]:
        """Return G and h of G x <= h: rows above, rows below, unknowns above, unknowns below."""
        qp, above, below, high, low = self._qp, self._above, self._below, self._high, self._low
        matrix = [qp.A[above], -qp.A[below], self._unit[high], -self._unit[low]]
        bounds = [qp.ubA[above], -qp.lbA[below], qp.ub[high], -qp.lb[low]]
        return np.concatenate(matrix), np.concatenate(bounds)

    def multipliers(self, equal: Array, unequal: Array) -> tuple[Array, Array]:
        """Return row and unknown multipliers from those of `equalities` and `inequalities`."""
        rows, box = np.zeros(len(self.fixed_rows)), np.zeros(len(self.fixed))
        count = int(self.fixed_rows.sum())
        rows[self.fixed_rows], box[self.fixed] = equal[:count], equal[count:]
        ends = np.cumsum([mask.sum() for mask in (self._above, self._below, self._high)])
        above, below, high, low = np.split(unequal, ends)
        rows[self._above] += above
        rows[self._below] -= below
        box[self._high] += high
        box[self._low] -= low
        return rows, box


class GrowingPattern:
    """The entries of a matrix that were ever nonzero; entries that are zero now are explicit zeros.

    A full pattern would work too. But the rows of bounds are unit vectors and each slack has its
    own column, and the time of most solvers grows with the number of entries.
    """

    def __init__(self) -> None:
        """Start without entries."""
        self._mask = np.zeros((0, 0), dtype=bool)

    def grow(self, matrix: Array) -> bool:
        """Add a matrix; return whether it has new entries or another shape."""
        there = matrix != 0
        if there.shape != self._mask.shape:
            self._mask = there
        elif (there & ~self._mask).any():
            self._mask = there | self._mask
        else:
            return False
        # Column by column, as CSC matrices are stored.
        self._columns, self._rows = np.nonzero(self._mask.T)
        self._ends = np.concatenate([[0], np.cumsum(self._mask.sum(axis=0))])
        return True

    def holds_only(self, matrix: Array) -> bool:
        """Return whether the pattern is exactly that of this matrix."""
        return np.array_equal(self._mask, matrix != 0)

    def values(self, matrix: Array) -> Array:
        """Return the entries of a matrix in the pattern, column by column."""
        return matrix[self._rows, self._columns]

    def csc(self, matrix: Array) -> sparse.csc_matrix:
        """Return a matrix in the pattern."""
        from scipy import sparse  # slow to import, and needed by few solvers

        return sparse.csc_matrix((self.values(matrix), self._rows, self._ends), shape=matrix.shape)


_LOCK: Final = threading.Lock()
_THREADS: Final[set[int]] = set()


class _Sieve:
    """A stream that drops what the threads in `_THREADS` write."""

    def __init__(self, stream: Any) -> None:
        self.stream = stream

    def write(self, text: str) -> int:
        return len(text) if threading.get_ident() in _THREADS else self.stream.write(text)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.stream, name)


@contextmanager
def suppress_stdout() -> Iterator[None]:
    """Drop what this thread writes to `sys.stdout`; must not be nested.

    CasADi prints the messages of its plugins there. The stream is replaced only while a thread uses
    this. If another stream was set in the meantime, that one stays.
    """
    me = threading.get_ident()
    with _LOCK:
        _THREADS.add(me)
        if not isinstance(sys.stdout, _Sieve):
            sys.stdout = _Sieve(sys.stdout)
    try:
        yield
    finally:
        with _LOCK:
            _THREADS.discard(me)
            if not _THREADS and isinstance(sys.stdout, _Sieve):
                sys.stdout = sys.stdout.stream
