"""The judge against answers that are known, answers that are spoilt, and qpsolvers' own
residuals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ergoqp.solvers.session import Qp, QpAnswer, judge, shifted_geometric_mean


def known(rng: np.random.Generator, n: int = 6, m: int = 5) -> tuple[Qp, QpAnswer]:
    """A QP made from its own answer; row 0 at its upper end, row 1 at its lower one, row 2 an
    equality, two bounds active."""
    root, A, x = rng.normal(size=(n, n)), rng.normal(size=(m, n)), 0.1 * rng.normal(size=n)
    H, rows, box, value = root @ root.T + np.eye(n), np.zeros(m), np.zeros(n), A @ x
    lower, upper, low, high = value - 1, value + 1, x - 1, x + 1
    rows[:3], upper[0], lower[1] = (2.0, -1.5, -0.3), value[0], value[1]
    lower[2] = upper[2] = value[2]
    box[0], high[0], box[3], low[3] = 0.7, x[0], -0.4, x[3]
    lower[0], upper[4] = -np.inf, np.inf
    return Qp(H, -(H @ x + A.T @ rows + box), A, lower, upper, low, high), QpAnswer(
        x, rows, box, "solved"
    )


def test_the_answer_is_one_and_whatever_is_spoilt_shows_where_it_should() -> None:
    for seed in range(20):
        qp, answer = known(np.random.default_rng(seed))
        assert judge(qp, answer).worst < 1e-12
        outside = replace(answer, x=answer.x + 1e-3 * np.eye(6)[0])
        assert judge(qp, outside).primal == pytest.approx(1e-3) or judge(qp, outside).primal > 1e-3
        unbalanced = replace(answer, box=answer.box + 1e-3 * np.eye(6)[1])
        assert judge(qp, unbalanced).dual == pytest.approx(1e-3)
        assert judge(qp, unbalanced).gap > 1e-4
        shifted = replace(qp, g=qp.g + 1e-3)
        assert judge(shifted, answer).dual == pytest.approx(1e-3)


def test_the_sign_of_a_multiplier_is_seen_apart_from_the_other_three() -> None:
    qp, answer = known(np.random.default_rng(0))
    # Row 4 has no upper end, and zero distance to nothing: pulled up all the same, and balanced by
    # g.
    rows = answer.rows + 0.5 * np.eye(5)[4]
    pulled = replace(qp, g=qp.g - 0.5 * qp.A[4])
    found = judge(pulled, replace(answer, rows=rows))
    assert found.dual < 1e-12
    assert found.sign == pytest.approx(0.5)
    # An equality may pull either way.
    either = answer.rows.copy()
    either[2] = -either[2]
    assert (
        judge(
            replace(qp, g=qp.g - (either[2] - answer.rows[2]) * qp.A[2]),
            replace(answer, rows=either),
        ).worst
        < 1e-12
    )
    # Between ends that all but meet, the wrong one counts no more than their distance.
    narrow = replace(qp, lbA=np.where(np.arange(5) == 0, qp.ubA[0] - 1e-8, qp.lbA))
    flipped = np.where(np.arange(5) == 0, -2.0, answer.rows)
    moved = replace(narrow, g=qp.g + 4.0 * qp.A[0])
    assert judge(moved, replace(answer, rows=flipped)).sign <= 1e-8


def test_no_number_is_no_answer() -> None:
    qp, answer = known(np.random.default_rng(1))
    for part in ("x", "rows", "box"):
        for value in (np.nan, np.inf):
            broken = getattr(answer, part).copy()
            broken[0] = value
            assert judge(qp, replace(answer, **{part: broken})).worst == np.inf


def test_the_three_residuals_are_those_of_qpsolvers() -> None:
    qpsolvers = pytest.importorskip("qpsolvers", reason="qpsolvers (extra 'solvers') is absent")
    rng = np.random.default_rng(2)
    for _ in range(10):
        qp, answer = known(rng)
        spoilt = replace(
            answer,
            x=answer.x + 0.1 * rng.normal(size=6),
            rows=answer.rows + 0.1 * rng.uniform(size=5),
        )
        # Its form has one-sided rows; rows here that have one multiplier use one side.
        up = spoilt.rows > 0
        G = np.where(up[:, None], qp.A, -qp.A)
        h = np.where(up, qp.ubA, -qp.lbA)
        there = np.isfinite(h)
        problem = qpsolvers.Problem(qp.H, qp.g, G[there], h[there], lb=qp.lb, ub=qp.ub)
        solution = qpsolvers.Solution(problem)
        solution.x, solution.z, solution.z_box = spoilt.x, np.abs(spoilt.rows)[there], spoilt.box
        solution.found, solution.y = True, np.empty(0)
        found = judge(qp, replace(spoilt, rows=np.where(there, spoilt.rows, 0.0)))
        assert found.dual == pytest.approx(solution.dual_residual(), rel=1e-12)
        assert found.gap == pytest.approx(solution.duality_gap(), rel=1e-9)
        assert found.primal >= solution.primal_residual() - 1e-12


def test_the_mean_of_times_is_shifted() -> None:
    assert shifted_geometric_mean(np.array([5e-6, 5e-6])) == pytest.approx(5e-6)
    assert shifted_geometric_mean(np.array([1.0, 4.0]), shift=0.0) == pytest.approx(2.0)
    few = shifted_geometric_mean(np.array([1e-9] * 50 + [10e-6] * 50))
    assert 4e-6 < few < 5e-6
