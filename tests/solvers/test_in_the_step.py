"""A solver in the control step: cold whatever came before, silent whatever it does, kept alive."""

from __future__ import annotations

import gc
from concurrent.futures import ThreadPoolExecutor

import casadi as ca
import numpy as np
import pytest
from step_samples import comfort_of, problem_of

from ergoqp.comparison.compare import compare
from ergoqp.errors import InputError
from ergoqp.solvers import installed_solvers, open_session, solver_named
from ergoqp.solvers.sequence import Qp
from ergoqp.solvers.session import QpAnswer, Workspace, no_answer
from ergoqp.solvers.solver import FREE, QpSolver
from ergoqp.step.function import build_step, step_function
from ergoqp.step.stepper import Stepper

# One of each kind: a session that could go on from the last answer, qpsolvers, a plugin that
# always does unless its memory is new.
KINDS = [name for name in ("proxqp", "osqp", "quadprog", "qpoases") if name in installed_solvers()]


class Faulty(QpSolver):
    """Fails in the way it is told to."""

    name = "faulty"
    method = "none"

    def __init__(self, way: str) -> None:
        self.name += way

    def workspace(self, n: int, m: int, accuracy: float) -> Workspace:
        return FaultyWorkspace(self.name)


class FaultyWorkspace:
    def __init__(self, name: str) -> None:
        self.name = name

    def solve(self, qp: Qp, warm: bool) -> QpAnswer:
        n, m = qp.size
        if self.name.endswith("raises"):
            raise ZeroDivisionError
        if self.name.endswith("nan"):
            return no_answer(n, m, "solved")
        if self.name.endswith("huge"):
            return QpAnswer(np.full(n, np.inf), np.full(m, -np.inf), np.zeros(n), "solved")
        return QpAnswer(np.full(n + 1, 0.1), np.zeros(m), np.zeros(n), "solved")


@pytest.mark.parametrize("way", ["raises", "nan", "huge", "size"])
def test_a_faulty_solver_brakes_the_loop_and_raises_nothing(way: str) -> None:
    problem = problem_of("screwing")
    step = build_step(problem, Faulty(way))
    stepper = Stepper(problem)
    stepper._bind(step)
    stepper.reset(twist=0.5 * problem.twist_limit.speed)
    sizes = [float(np.abs(stepper.step(comfort_of("screwing")).twist).max()) for _ in range(60)]
    assert stepper.step(comfort_of("screwing")).status == "braking"
    assert sizes[0] > 0
    assert sizes[-1] == 0.0


@pytest.mark.parametrize("name", KINDS)
def test_every_step_starts_cold(name: str) -> None:
    problem, rng = problem_of("screwing"), np.random.default_rng(0)
    postures = [comfort_of("screwing") + 0.1 * rng.normal(size=32) for _ in range(6)]
    stepper = Stepper(problem, solver=name)
    alone = []
    for posture in postures:
        stepper.reset()
        alone.append(stepper.step(posture).twist.copy())
    for i in (3, 0, 5):
        stepper.reset()
        np.testing.assert_array_equal(stepper.step(postures[i]).twist, alone[i])


@pytest.mark.parametrize("name", KINDS)
def test_steppers_in_threads_do_not_disturb_each_other(name: str) -> None:
    problem = problem_of("screwing")
    steppers = [Stepper(problem, solver=name) for _ in range(2)]

    def run(seed: int) -> np.ndarray:
        rng, stepper = np.random.default_rng(seed), steppers[seed]
        stepper.reset()
        postures = [comfort_of("screwing") + 0.1 * rng.normal(size=32) for _ in range(40)]
        return np.array([stepper.step(posture).twist for posture in postures])

    alone = [run(seed) for seed in (0, 1)]
    with ThreadPoolExecutor(2) as pool:
        together = list(pool.map(run, (0, 1)))
    np.testing.assert_array_equal(together, alone)


def test_the_step_function_outlives_who_made_it() -> None:
    function = step_function(problem_of("screwing"), "proxqp")
    gc.collect()
    given = {name: np.zeros(function.size_in(name)) for name in function.name_in()}
    given |= {"posture": comfort_of("screwing"), "dt": 0.01}
    # Margins to limits that are not there are infinite.
    assert not any(np.isnan(part.full()).any() for part in function(**given).values())


# HPIPM gives up on so small a QP, and says so.
@pytest.mark.parametrize("name", [name for name in installed_solvers() if name != "hpipm"])
def test_a_bound_that_is_none_is_none(name: str) -> None:
    function = solver_named(name).function(2, 1)
    ends = [[-FREE], [FREE], [-FREE, -1.0], [FREE, FREE]]
    x, rows, box = (
        np.array(part).ravel()
        for part in function.call(
            [ca.DM(one) for one in (np.eye(2), [-3.0, 4.0], [[1.0, 1.0]], *ends)]
        )
    )
    np.testing.assert_allclose(x, [3.0, -1.0], atol=1e-4)
    np.testing.assert_allclose(rows, 0, atol=1e-4)
    np.testing.assert_allclose(box, [0.0, -3.0], atol=1e-4)


def test_whatever_qpsolvers_offers_goes_by_its_name(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of those not in the package's own table none is installed here: quadprog by another name."""
    qpsolvers = pytest.importorskip("qpsolvers", reason="qpsolvers (extra 'solvers') is absent")
    from qpsolvers.solvers import solve_function

    pytest.importorskip("quadprog", reason="quadprog (extra 'solvers') is absent")
    monkeypatch.setitem(solve_function, "newcomer", solve_function["quadprog"])
    monkeypatch.setattr(qpsolvers, "available_solvers", [*qpsolvers.available_solvers, "newcomer"])
    monkeypatch.setattr(qpsolvers, "dense_solvers", [*qpsolvers.dense_solvers, "newcomer"])
    found = compare(problem_of("desk"), ["daqp", "newcomer"], steps=5, derive=2)
    assert found.figures["newcomer"]["success_1e-6"] > 0.9
    assert solver_named("newcomer").method == "by qpsolvers"


def test_the_same_names_serve_step_and_comparison() -> None:
    for name in installed_solvers():
        assert Stepper(problem_of("desk"), solver=name).step(comfort_of("desk")).status
        assert open_session(name, 2, 1).name == name
    for ask in (lambda: Stepper(problem_of("desk"), solver="ipopt"), lambda: solver_named("ipopt")):
        with pytest.raises(InputError, match=r"solver: got 'ipopt', allowed one of daqp, quadprog"):
            ask()
