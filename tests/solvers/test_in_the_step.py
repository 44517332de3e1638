"""A solver in the control step: cold whatever came before, silent whatever it does, kept alive."""

from __future__ import annotations

import gc
import json
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from recorded_qps import samples
from step_samples import comfort_of, problem_of

import ergoqp
from ergoqp import solvers
from ergoqp.comparison.compare import compare
from ergoqp.errors import InputError
from ergoqp.solvers import installed_solvers, open_session, solver_named
from ergoqp.solvers import solver as solver_module
from ergoqp.solvers.daqp import Daqp
from ergoqp.solvers.session import Qp, QpAnswer, Workspace, no_answer
from ergoqp.solvers.solver import FREE, QpSolver
from ergoqp.step.function import step_function
from ergoqp.step.stepper import Stepper

# One of each kind: a session that could go on from the last answer, qpsolvers, a plugin that
# always does unless its memory is new.
KINDS = [name for name in ("proxqp", "osqp", "quadprog", "qpoases") if name in installed_solvers()]


class Faulty(QpSolver):
    """Fails in the way it is told to."""

    method = "none"

    def __init__(self, way: str) -> None:
        self.way = way

    def workspace(self, n: int, m: int, accuracy: float) -> Workspace:
        if self.way == "no workspace":
            raise ZeroDivisionError
        return FaultyWorkspace(self.way)


class FaultyWorkspace:
    def __init__(self, way: str) -> None:
        self.way = way

    def solve(self, qp: Qp, warm: bool) -> Any:
        n, m = qp.size
        answers = {
            "nan": lambda: no_answer(n, m, "solved"),
            "huge": lambda: QpAnswer(
                np.full(n, np.inf), np.full(m, -np.inf), np.zeros(n), "solved"
            ),
            "size": lambda: QpAnswer(np.full(n + 1, 0.1), np.zeros(m), np.zeros(n), "solved"),
            "tenth": lambda: QpAnswer(np.full(n, 0.1), np.zeros(m), np.zeros(n), "solved"),
            "nothing": lambda: None,
            "raises": lambda: 1 / 0,
            "text": lambda: QpAnswer(*(np.full(k, "x") for k in (n, m, n)), "solved"),
            "exit": lambda: sys.exit(3),
        }
        if self.way == "interrupt":
            raise KeyboardInterrupt
        return answers[self.way]()


def with_solver(monkeypatch: pytest.MonkeyPatch, solver: Any) -> None:
    """Register a solver as if a package did: under the name ``mine 1.0``."""
    solvers._made.cache_clear()
    monkeypatch.setattr(solvers, "registered", lambda kind: ("mine 1.0",))
    monkeypatch.setattr(solvers, "own_term", lambda kind, name: solver)


@pytest.mark.parametrize(
    "way", ["raises", "nan", "huge", "size", "nothing", "text", "no workspace"]
)
def test_a_faulty_solver_brakes_the_loop_and_raises_nothing(
    way: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem = problem_of("screwing")
    with_solver(monkeypatch, lambda: Faulty(way))
    stepper = Stepper(problem, solver="mine 1.0")
    stepper.reset(twist=0.5 * problem.twist_limit.speed)
    sizes = [float(np.abs(stepper.step(comfort_of("screwing")).twist).max()) for _ in range(60)]
    assert stepper.step(comfort_of("screwing")).status == "braking"
    assert sizes[0] > 0
    assert sizes[-1] == 0.0


class Mine(QpSolver):
    """A user's solver: that of CasADi, which counts how often it is called."""

    name = "daqp"
    calls = 0

    def workspace(self, n: int, m: int, accuracy: float) -> Workspace:
        self.calls += 1
        return solver_named("qrqp").workspace(n, m, accuracy)


@pytest.mark.slow
def test_a_solver_that_is_given_as_an_object_is_used_logged_and_replayed() -> None:
    problem, log, mine = problem_of("screwing"), [], Mine()
    posture = comfort_of("screwing") + 0.1
    stepper, usual = Stepper(problem, solver=mine, log=log.append), Stepper(problem)
    mine.calls = 0
    for _ in range(10):
        step, other = stepper.step(posture), usual.step(posture)
        assert step.status == other.status
        np.testing.assert_allclose(step.twist, other.twist, atol=1e-5)
    assert step.twist.any()
    assert mine.calls >= 10
    # The log is plain data, and names it; a name that ergoqp has too is not taken for that one.
    log = json.loads(json.dumps(log))
    assert log[0]["loop"]["solver"] == "daqp"
    sentence = (
        "log: entry 0 is of a loop with a solver 'daqp' that was given as an object, which a log"
        " does not hold; give replay(..., solver=that object)"
    )
    with pytest.raises(InputError) as raised:
        ergoqp.replay(problem, log)
    assert str(raised.value) == sentence
    again = ergoqp.replay(problem, log, solver=Mine())
    assert again[-1].twist.tobytes() == step.twist.tobytes()
    plain: list = []
    Stepper(problem, log=plain.append).step(posture)
    with pytest.raises(InputError, match=r"solver: got .*, allowed only for a loop whose solver"):
        ergoqp.replay(problem, plain, solver=mine)
    assert step_function(problem, Mine()).size_out("twist") == (6, 1)


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        (Mine, "solver: got <class .*, allowed a name, or an object of a class that is derived"),
        (object(), "solver: got <object"),
        (None, "solver: got None, allowed a name"),
        (Faulty("no workspace"), r"solver own: got ZeroDivisionError .*, allowed a workspace with"),
        (type("Half", (QpSolver,), {"workspace": lambda *_: None})(), "a workspace without solve"),
    ],
)
def test_what_is_no_solver_is_one_sentence(given: Any, sentence: str) -> None:
    for make in (Stepper, step_function):
        with pytest.raises(InputError, match=sentence):
            make(problem_of("screwing"), solver=given)


def test_only_the_solver_of_ergoqp_is_compiled() -> None:
    with pytest.raises(InputError, match=r"compiled: got the solver .*, allowed only 'daqp'"):
        Stepper(problem_of("screwing"), solver=Mine(), compiled=True)


def test_solvers_of_one_class_and_name_are_not_taken_for_each_other() -> None:
    """A cold one that fails first, and then one that answers."""
    qp = [np.eye(2), [-3.0, 4.0], [[1.0, 1.0]], [-FREE], [FREE], [-FREE, -FREE], [FREE, FREE]]
    found = []
    for way in ("raises", "tenth"):
        function = Faulty(way).function(2, 1)
        found.append(function.call([ca.DM(part) for part in qp])[0].full().ravel().tolist())
    assert found == [[0.0, 0.0], [0.1, 0.1]]


@pytest.mark.parametrize(("way", "end"), [("interrupt", KeyboardInterrupt), ("exit", SystemExit)])
def test_who_ends_the_program_within_a_solver_ends_it(
    way: str, end: type[BaseException], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Faulty, "__init__", lambda self: None)
    monkeypatch.setattr(
        Faulty, "workspace", lambda self, n, m, accuracy: FaultyWorkspace(way), raising=True
    )
    with_solver(monkeypatch, Faulty)
    stepper = Stepper(problem_of("screwing"), solver="mine 1.0")
    with pytest.raises(end):
        stepper.step(comfort_of("screwing"))
    monkeypatch.setattr(Faulty, "workspace", lambda self, n, m, accuracy: FaultyWorkspace("nan"))
    assert stepper.brake().status == "braking"


@pytest.mark.slow
@pytest.mark.parametrize("way", ["raises", "nothing", "size"])
def test_a_faulty_solver_is_compared_with_its_fault(
    way: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    with_solver(monkeypatch, lambda: Faulty(way))
    found = compare(problem_of("desk"), ["mine 1.0"], steps=3, derive=0)
    assert found.figures["mine 1.0"]["success_1e-3"] == 0.0
    assert all(trial.fault for trial in found.trials)
    assert way != "raises" or "ZeroDivisionError (division by zero)" in found.trials[0].fault


@pytest.mark.parametrize(
    ("made", "said"),
    [
        (lambda: 5, "got 5, allowed a QpSolver"),
        (lambda: 1 / 0, r"got ZeroDivisionError \(division by zero\) when it was made"),
        (Faulty, "got TypeError"),
        (5, "got TypeError"),
        (type("Half", (QpSolver,), {}), "abstract"),
    ],
)
def test_what_is_no_solver_is_said(made: Any, said: str, monkeypatch: pytest.MonkeyPatch) -> None:
    with_solver(monkeypatch, made)
    with pytest.raises(InputError, match=said) as error:
        solver_named("mine 1.0")
    assert str(error.value).startswith("solver mine 1.0: got ")


def assert_same(name: str, one: Any, other: Any) -> None:
    """Whoever started warm is 1e-9 off at the least, where it is an iterative one.

    ProxQP adds up in an order that hangs on where its memory begins, which nobody here decides: the
    same QP in the same process differs by 5e-17.
    """
    np.testing.assert_allclose(one, other, rtol=0, atol=1e-13 if name == "proxqp" else 0)


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
        assert_same(name, stepper.step(postures[i]).twist, alone[i])


@pytest.mark.slow
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
    assert_same(name, together, alone)


@pytest.mark.slow
@pytest.mark.parametrize("name", KINDS)
def test_a_replay_in_another_process_gives_the_same_twists(name: str, tmp_path: Path) -> None:
    """Also after another loop with QPs of the same size has left its traces here."""
    rng, log, twists = np.random.default_rng(3), [], []
    for number in range(2):
        log.clear()
        twists.clear()
        stepper = Stepper(problem_of("screwing"), solver=name, log=log.append)
        for _ in range(25):
            posture = comfort_of("screwing") + (0.1 + 0.1 * number) * rng.normal(size=32)
            twists.append(stepper.step(posture).twist)
    path = tmp_path / "log.json"
    path.write_text(json.dumps(log, default=lambda value: np.asarray(value).tolist()))
    code = (
        "import json, sys, numpy as np, ergoqp; log = json.load(open(sys.argv[1]));"
        " steps = ergoqp.replay(ergoqp.load_problem('screwing'), log);"
        " print(json.dumps([step.twist.tolist() for step in steps]))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(path)], capture_output=True, text=True, check=True
    )
    here = [step.twist for step in ergoqp.replay(problem_of("screwing"), log)]
    assert_same(name, json.loads(done.stdout), here)
    assert_same(name, here, twists)


@pytest.mark.slow
@pytest.mark.parametrize("name", KINDS)
def test_a_cold_answer_depends_on_nothing_before(name: str) -> None:
    qps = [qp for qps in samples() for qp, _ in qps]
    session = {qp.size: open_session(name, *qp.size) for qp in qps}
    for qp in qps:
        alone = open_session(name, *qp.size).solve_qp(qp, warm=False)
        # Without a zero, so that whoever remembers entries has them all.
        session[qp.size].solve_qp(replace(qp, A=qp.A + 1e-3, H=qp.H + 1e-3))
        assert_same(name, session[qp.size].solve_qp(qp, warm=False).x, alone.x)
        session[qp.size].solve_qp(qp, warm=True)


@pytest.mark.slow
def test_steppers_made_in_threads_have_solvers_that_live() -> None:
    problem = problem_of("screwing")

    def run(_: int) -> str:
        stepper = Stepper(problem, solver="proxqp")
        gc.collect()
        return stepper.step(comfort_of("screwing")).status

    solver_module._KEPT.clear()
    with ThreadPoolExecutor(4) as pool:
        assert set(pool.map(run, range(8))) <= {"optimal", "settled"}


@pytest.mark.slow
def test_nobody_elses_lines_are_lost_while_a_loud_solver_runs(
    capsys: pytest.CaptureFixture[str],
) -> None:
    steppers = [Stepper(problem_of("screwing"), solver="qpoases") for _ in range(2)]
    before, stop = sys.stdout, threading.Event()

    def run(stepper: Stepper) -> None:
        while not stop.is_set():
            stepper.step(comfort_of("screwing"))

    threads = [threading.Thread(target=run, args=(stepper,)) for stepper in steppers]
    for thread in threads:
        thread.start()
    for number in range(300):
        print(number)
        time.sleep(1e-4)
    stop.set()
    for thread in threads:
        thread.join()
    assert sys.stdout is before
    assert capsys.readouterr().out == "".join(f"{number}\n" for number in range(300))


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


@pytest.mark.slow
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


@pytest.mark.slow
def test_the_same_names_serve_step_and_comparison() -> None:
    for name in installed_solvers():
        assert Stepper(problem_of("desk"), solver=name).step(comfort_of("desk")).status
        assert open_session(name, 2, 1).name == name
    for ask in (lambda: Stepper(problem_of("desk"), solver="ipopt"), lambda: solver_named("ipopt")):
        with pytest.raises(InputError, match=r"solver: got 'ipopt', allowed one of daqp, quadprog"):
            ask()


def test_newton_first_gives_the_answer_of_the_active_set_method() -> None:
    """With no active bound, with one that is touched, with many, and with data of no number."""
    rng, free = np.random.default_rng(8), 0
    daqp = solver_named("daqp")
    assert isinstance(daqp, Daqp)
    for m in (0, 1, 9):
        first, alone = daqp.function(6, m), daqp.active_set(6, m)
        for k in range(120):
            root, A, x = rng.normal(size=(6, 6)), rng.normal(size=(m, 6)), rng.normal(size=6)
            H = root @ root.T + 0.1 * np.eye(6)
            room = (0.2, 3.0)[k % 2] + 1e-3
            ends = [-room * np.ones(m), room * np.ones(m), -room * np.ones(6), room * np.ones(6)]
            if k % 3 == 0:
                ends[3][x > 0] = x[x > 0]
            data = [H, -H @ x, A, *ends]
            got, expected = ([np.array(part) for part in solve(*data)] for solve in (first, alone))
            free += not any(np.any(part) for part in got[1:])
            for one, other in zip(got, expected, strict=True):
                np.testing.assert_allclose(one, other, atol=1e-8)
    assert 60 < free < 300


def test_newton_is_no_answer_of_a_problem_that_is_not_convex() -> None:
    """Its stationary point lies within all bounds, and is a saddle."""
    H = np.diag([1.0, 1, 1, 1, 1, -1])
    x, _, _ = solver_named("daqp").function(6, 0)(
        H, np.zeros(6), np.zeros((0, 6)), [], [], -np.ones(6), np.ones(6)
    )
    saddle, _, _ = solver_named("daqp").active_set(6, 0)(
        H, np.zeros(6), np.zeros((0, 6)), [], [], -np.ones(6), np.ones(6)
    )
    assert np.array_equal(np.array(x), np.array(saddle), equal_nan=True)
