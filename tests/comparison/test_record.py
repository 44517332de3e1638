"""What is recorded is what the steps solve; what is derived from it is what it is called."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scipy.optimize import linprog

from ergoqp.comparison.compare import relatives
from ergoqp.comparison.derive import CONTRADICTIONS, CURVATURE, SLAB
from ergoqp.comparison.record import RecordedQps, record
from ergoqp.errors import InputError
from ergoqp.limits import Limit
from ergoqp.problem.load import load_problem
from ergoqp.responses import LinearResponse
from ergoqp.solvers.session import Qp, QpSequence, judge
from ergoqp.step.layout import split
from ergoqp.step.model import StepModel


@cache
def recorded(name: str, steps: int) -> tuple[RecordedQps, ...]:
    return tuple(record(load_problem(name), steps))


def feasible(qp: Qp) -> bool:
    """By a linear program of SciPy's."""
    rows = np.concatenate([qp.A, -qp.A])
    ends = np.concatenate([qp.ubA, -qp.lbA])
    there = np.isfinite(ends)
    bounds = np.column_stack([qp.lb, qp.ub])
    return (
        linprog(np.zeros(qp.size[0]), A_ub=rows[there], b_ub=ends[there], bounds=bounds).status == 0
    )


@pytest.mark.slow
@pytest.mark.parametrize(("name", "steps"), [("screwing", 60), ("low_bin", 150), ("forearm", 40)])
def test_every_step_gives_its_qps_and_the_accepted_ones_are_solved(name: str, steps: int) -> None:
    parts = recorded(name, steps)
    problem = load_problem(name)
    assert sum(part.accepted.sum() for part in parts) == steps
    for part in parts:
        n, m = part.sequence.size
        assert n == 6 + (m if part.sequence.name.endswith(".relaxed") else 0)
        assert len(part.sequence) == len(part.answers) == len(part.accepted)
        worst = [
            judge(qp, answer).relative(qp)
            for qp, answer in zip(part.sequence, part.answers, strict=True)
        ]
        assert max(np.array(worst)[part.accepted]) <= 1e-6
        speed = problem.twist_limit.speed
        for qp in part.sequence:
            assert np.all(qp.ub[:6] <= speed + 1e-12)
            assert np.all(np.linalg.eigvalsh(qp.H) > 0)
            assert not np.isnan(qp.ubA).any()
    assert any(part.sequence.name.endswith(".relaxed") for part in parts) == (name == "low_bin")


@pytest.mark.slow
def test_the_recorded_twists_are_those_that_a_loop_plans() -> None:
    """Of a loop of its own, step by step: the first QPs' answers lead where the stepper goes. Sent
    is the mean of the plan."""
    from ergoqp.rest.best_place import awkward_start
    from ergoqp.rest.model_person import sample_person
    from ergoqp.simulation.loop import run_loop

    problem = load_problem("screwing")
    (part,) = recorded("screwing", 60)
    person = sample_person(problem, 0)
    start = person.start_at(awkward_start(problem, person, 0, 20))
    trace = run_loop(problem, person.holding(start), duration=60 * problem.dt, seed=0)
    last = [
        answer.x for answer, accepted in zip(part.answers, part.accepted, strict=True) if accepted
    ]
    sizes = StepModel(problem).state
    planned = [
        np.array(split(sizes, step.account("next_state"))["history"][:6]) for step in trace.steps
    ]
    shares = [step.residuals["accepted"] for step in trace.steps]
    assert shares.count(1.0) > 40
    for x, share, twist in zip(last, shares, planned, strict=True):
        if share == 1.0:
            np.testing.assert_allclose(x, twist, atol=1e-9)


@pytest.mark.slow
def test_recording_is_repeatable_and_goes_on_with_another_person() -> None:
    one, same = record(load_problem("dentist"), 30), record(load_problem("dentist"), 30)
    assert [part.sequence.name for part in one] == [part.sequence.name for part in same]
    for first, second in zip(one[0].sequence, same[0].sequence, strict=True):
        assert first.g.tobytes() == second.g.tobytes()
    other = record(load_problem("dentist"), 30, seed=2)
    assert other[0].sequence.name == "dentist.2"
    assert other[0].sequence.qps[0].g.tobytes() != one[0].sequence.qps[0].g.tobytes()
    # A loop of points is over soon: the next one starts elsewhere.
    assert {part.sequence.name for part in record(load_problem("forearm"), 900)} >= {
        "forearm.0",
        "forearm.1",
    }


@pytest.mark.slow
def test_derived_qps_are_what_they_are_called() -> None:
    for part in (*recorded("screwing", 60), *recorded("forearm", 40)):
        singular, nearly, infeasible = relatives(part, 9, seed=3)
        assert [one.family for one in (singular, nearly, infeasible)] == [
            "near_singular",
            "nearly_infeasible",
            "infeasible",
        ]
        assert [one.feasible for one in (singular, nearly, infeasible)] == [True, True, False]
        rows = part.sequence.size[1]
        for qp in singular:
            values = np.linalg.eigvalsh(qp.H)
            np.testing.assert_allclose(values[:3] / values[-1], CURVATURE, rtol=1e-4)
            assert qp.size[1] == 2 * rows
            assert feasible(qp)
        for qp in nearly:
            assert np.allclose(qp.ubA[rows:] - qp.lbA[rows:], SLAB, rtol=1e-3)
            assert feasible(qp)
        for i, qp in enumerate(infeasible):
            assert not feasible(qp)
            # The three rows alone, without any other: what they leave is by how much they
            # contradict each other.
            left = qp.lbA[rows + 2] - qp.ubA[rows] - qp.ubA[rows + 1]
            assert left == pytest.approx(CONTRADICTIONS[i % 3])
            np.testing.assert_allclose(qp.A[rows + 2], qp.A[rows] + qp.A[rows + 1])


@pytest.mark.slow
def test_relaxed_qps_have_no_relatives() -> None:
    relaxed = next(
        part for part in recorded("low_bin", 150) if part.sequence.name.endswith(".relaxed")
    )
    assert relatives(relaxed, 5, 0) == []


@pytest.mark.slow
def test_mistakes_are_named() -> None:
    problem = load_problem("forearm")
    with pytest.raises(InputError, match="steps: got 0"):
        record(problem, 0)
    state = LinearResponse(tuple("abcdef"))
    limits: list[Limit] = [problem.twist_limit]  # type: ignore[list-item]
    other = problem.replace(response=state, limits=limits, cost=_Plain(), name="mine")
    with pytest.raises(InputError, match="problem mine: got the state a, b, c, d, e, f, allowed"):
        record(other, 5)
    with pytest.raises(InputError, match="sequence 'mixed': got QPs of 2 sizes"):
        QpSequence(
            "mixed",
            (
                recorded("screwing", 60)[0].sequence.qps[0],
                recorded("forearm", 40)[0].sequence.qps[0],
            ),
        )


class _Plain:
    name, minimum = "plain", 0.0

    def __call__(self, postures: np.ndarray) -> np.ndarray:
        return (np.atleast_2d(postures) ** 2).sum(axis=1)

    def expression(self, q):
        return q.T @ q
