"""Harder QPs derived from recorded ones, with properties known by construction."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np

from ergoqp.solvers.session import Array, Qp, QpSequence

CURVATURE: Final = 1e-8
"""Near singular: the smaller half of the eigenvalues of H, relative to the largest."""

TURN: Final = 1e-9
"""Near singular: largest difference of a row and its copy, in each entry."""

SLAB: Final = 1e-8
"""Nearly infeasible: width of the remaining feasible set in two directions."""

CONTRADICTIONS: Final = (1e-1, 1e-2, 1e-3)
"""Infeasible: by how much three rows contradict each other; used in turn."""


def derived(
    sequence: QpSequence, answers: list[Array], count: int, seed: int = 0
) -> list[QpSequence]:
    """Return near singular, nearly infeasible and infeasible sequences derived from a sequence.

    - ``near_singular``: the smaller half of the eigenvalues of H is set to `CURVATURE` times the
      largest. Every row gets a copy whose entries differ by up to `TURN`. The bounds of the copy
      are wide enough for every point within the bounds of the row. So the feasible set stays the
      same, and the multipliers are almost not unique.
    - ``nearly_infeasible``: two rows along a random direction, which differ by a thousandth, leave
      a slab of width `SLAB` around a feasible point. That point stays feasible.
    - ``infeasible``: rows a and b must be at most their values at a feasible point x0, and a + b
      must be at least one of `CONTRADICTIONS` above its value there. No x satisfies all three,
      whatever the other rows are.

    Args:
        sequence: recorded QPs.
        answers: a feasible point (n,) of each.
        count: largest number of QPs of each kind; taken evenly from the sequence.
        seed: seed of the directions.
    """
    rng = np.random.default_rng([seed, len(sequence)])
    chosen = np.unique(np.linspace(0, len(sequence) - 1, min(count, len(sequence))).astype(int))
    kinds: dict[str, Callable[[Qp, Array, int], Qp]] = {
        "near_singular": lambda qp, x, i: _near_singular(qp, rng),
        "nearly_infeasible": lambda qp, x, i: _nearly_infeasible(qp, x, rng),
        "infeasible": lambda qp, x, i: _infeasible(
            qp, x, CONTRADICTIONS[i % len(CONTRADICTIONS)], rng
        ),
    }
    return [
        QpSequence(
            f"{sequence.name}+{kind}",
            tuple(make(sequence.qps[at], answers[at], i) for i, at in enumerate(chosen)),
            feasible=kind != "infeasible",
            follows=False,
        )
        for kind, make in kinds.items()
    ]


def _near_singular(qp: Qp, rng: np.random.Generator) -> Qp:
    values, vectors = np.linalg.eigh(qp.H)
    values[: len(values) // 2] = CURVATURE * values[-1]
    H = (vectors * values) @ vectors.T
    turn = TURN * rng.uniform(-1, 1, qp.A.shape)
    farthest = np.maximum(np.abs(qp.lb), np.abs(qp.ub))
    room = np.abs(turn) @ np.where(np.isfinite(farthest), farthest, 1.0)
    return replace(
        qp,
        H=0.5 * (H + H.T),
        A=np.concatenate([qp.A, qp.A + turn]),
        lbA=np.concatenate([qp.lbA, qp.lbA - room]),
        ubA=np.concatenate([qp.ubA, qp.ubA + room]),
    )


def _nearly_infeasible(qp: Qp, x: Array, rng: np.random.Generator) -> Qp:
    first, other = _direction(qp, rng), _direction(qp, rng)
    rows = np.stack([first, first + 1e-3 * other])
    return _with_rows(qp, rows, rows @ x - SLAB / 2, rows @ x + SLAB / 2)


def _infeasible(qp: Qp, x: Array, by: float, rng: np.random.Generator) -> Qp:
    a, b = _direction(qp, rng), _direction(qp, rng)
    rows = np.stack([a, b, a + b])
    at = rows @ x
    return _with_rows(
        qp, rows, np.array([-np.inf, -np.inf, at[2] + by]), np.array([at[0], at[1], np.inf])
    )


def _direction(qp: Qp, rng: np.random.Generator) -> Array:
    direction = rng.normal(size=qp.size[0])
    return direction / np.linalg.norm(direction)


def _with_rows(qp: Qp, rows: Array, lower: Array, upper: Array) -> Qp:
    return replace(
        qp,
        A=np.concatenate([qp.A, rows]),
        lbA=np.concatenate([qp.lbA, lower]),
        ubA=np.concatenate([qp.ubA, upper]),
    )
