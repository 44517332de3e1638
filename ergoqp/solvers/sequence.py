"""QPs as data: a single QP, and a sequence of one size along a trajectory."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from ergoqp.errors import InputError

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
        >>> from ergoqp.solvers.sequence import Qp
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
