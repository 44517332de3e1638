"""All rows of a step at once, as vectors; what is curved goes through functions of scalars.

An interpreter runs a vector of forty numbers in the time of four scalars, and a curved row's few dozen operations as scalars in
the time of one vector.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import casadi as ca

from ergoqp.limits import Limit
from ergoqp.linear import dense
from ergoqp.step_objective import sensitivity_pattern, with_pattern
from ergoqp.step_readings import readings_size, situation_of

if TYPE_CHECKING:
    from ergoqp.problem import Problem

_KNOWN = ("posture", "observed", "readings", "pose")


class StepRows:
    """The rows of all limits where things are.

    Attributes:
        matrices: rate of each quantity per twist, (m, 6) for each limit.
        rates: largest rate allowed, (m,) for each limit; inf without one.
        now: margin (r,) of every row as it is.
    """

    def __init__(self, problem: Problem, known: Mapping[str, ca.MX], S: ca.MX) -> None:
        """Look at all limits once.

        Args:
            problem: the task.
            known: ``posture``, ``observed``, ``readings`` and ``pose`` of this step.
            S: sensitivity (n, 6), dense.
        """
        self._situation = situation_of(problem, known, S)
        self._place = [*(known[name] for name in _KNOWN), S]
        self._limits = [(limit, None if _linear(limit) else _curved(problem, limit)) for limit in problem.row_limits]
        self.matrices, self.rates, still = [], [], []
        for limit, curved in self._limits:
            if curved is None:
                rows = limit.rows(self._situation)
                matrix, rate, margins = rows.matrix, rows.rate, ca.fmin(rows.below, rows.above)
            else:
                matrix, rate, margins = curved[0](*self._place)
            self.matrices.append(matrix)
            self.rates.append(rate)
            still.append(margins)
        self.now = ca.vertcat(*still)

    def margins(self, displacement: ca.MX) -> ca.MX:
        """Return the smallest margin (r,) of every row on the straight way to a displacement (6,) [m, rad]."""
        found = []
        for limit, curved in self._limits:
            if curved is None:
                found.append(limit.margins(self._situation, displacement))  # pyright: ignore[reportArgumentType]
            else:
                found.append(curved[1](*self._place, displacement))
        return ca.vertcat(*found)


def _linear(limit: Limit) -> bool:
    """Whether a limit's rows and margins may be asked for as matrices: see `ergoqp.limits.limit.Limit`."""
    return getattr(limit, "linear", False)


def _curved(problem: Problem, limit: Limit) -> tuple[ca.Function, ca.Function]:
    """``place -> (matrix, rate, margins as they are)`` and ``(place, displacement) -> margins`` of one limit.

    The place is (posture, observed, readings, pose, S).
    """
    n = len(problem.coordinates)
    sizes = ((n, 1), (n, 1), (readings_size(problem), 1), (4, 4), (n, 6))
    place = [ca.SX.sym(name, *size) for name, size in zip((*_KNOWN, "S"), sizes, strict=True)]
    S, displacement = with_pattern(place[-1], sensitivity_pattern(problem)), ca.SX.sym("displacement", 6)
    situation = situation_of(problem, dict(zip(_KNOWN, place[:-1], strict=True)), S)
    rows = limit.rows(situation)
    still = [rows.matrix, rows.rate, limit.margins(situation, ca.SX(6, 1))]
    moved = [limit.margins(situation, displacement)]
    return (
        ca.Function("curved_here", place, ca.cse(dense(still))),
        ca.Function("curved_ahead", [*place, displacement], ca.cse(dense(moved))),
    )
