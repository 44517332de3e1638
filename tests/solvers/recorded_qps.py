"""QPs of a few control steps, recorded once, with certified answers."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from ergoqp.comparison.record import RecordedQps, record
from ergoqp.problem.load import load_problem
from ergoqp.solvers.session import Qp


@cache
def recordings() -> tuple[RecordedQps, ...]:
    """Twist QPs with and without slack; an equality row (forearm), and axes that do not move
    (desk)."""
    names = (("dentist", 400), ("desk", 40), ("forearm", 30))
    return tuple(part for name, steps in names for part in record(load_problem(name), steps))


@cache
def samples() -> tuple[tuple[tuple[Qp, np.ndarray], ...], ...]:
    """Per recorded sequence its last QPs, and what the step's own solver answered."""
    chosen = []
    for part in recordings():
        pairs = zip(part.sequence.qps, (answer.x for answer in part.answers), strict=True)
        chosen.append(tuple(pairs)[-12:])
    return tuple(chosen)


def contradictory(qp: Qp) -> Qp:
    """The QP with a row below -1 and above 1."""
    row = np.ones((2, qp.size[0]))
    ends = {"lbA": np.r_[qp.lbA, -np.inf, 1.0], "ubA": np.r_[qp.ubA, -1.0, np.inf]}
    return replace(qp, A=np.vstack([qp.A, row]), **ends)


def twice(qp: Qp) -> Qp:
    """The same QP with as many rows as `contradictory` has, without a contradiction."""
    row = np.ones((2, qp.size[0]))
    return replace(
        qp,
        A=np.vstack([qp.A, row]),
        lbA=np.r_[qp.lbA, -9.0, -9.0],
        ubA=np.r_[qp.ubA, 9.0, 9.0],
    )
