"""The QP of a step as data: solved by others it gives what the step wants, and its parts are what
they are called."""

from __future__ import annotations

import json
from concurrent.futures import ThreadPoolExecutor
from dataclasses import FrozenInstanceError, replace
from functools import cache
from typing import Any

import casadi as ca
import numpy as np
import pytest
from step_samples import (
    NAMES,
    Held,
    bold_of,
    comfort_of,
    held_pose,
    near_comfort,
    plain_of,
    problem_of,
    small,
)

import ergoqp
from ergoqp.errors import InputError
from ergoqp.expressions import Evaluator
from ergoqp.joints import INDEX, JOINTS, LOWER, UPPER
from ergoqp.limits import AXES
from ergoqp.problem.settings import DeclaredRobot
from ergoqp.solvers import solver_named
from ergoqp.step.formulate import Formulation, Formulator
from ergoqp.step.function import FORMULATED, OUTPUTS, build_step
from ergoqp.step.objective import CAUTION_EPS
from ergoqp.step.qp import ELBOW, PENALTY
from ergoqp.step.stepper import Stepper

pytest.importorskip("qpsolvers", reason="qpsolvers (extra 'solvers') is absent")

from benchmarks.formulate import CASES, Solved, WatchedStepper, answer, apart, loop_of, same

EXACT = 1e-9


@cache
def formulator_of(name: str, plain: bool = False) -> Formulator:
    return Formulator((plain_of if plain else problem_of)(name))


def awkward(name: str, seed: int = 0) -> np.ndarray:
    return near_comfort(name, np.random.default_rng(seed), 15)


def qp_of(name: str, seed: int = 0, **given: Any) -> Formulation:
    return formulator_of(name)(None, awkward(name, seed), held_pose(name), **given)


def check(solved: list[Solved]) -> list[Solved]:
    """Check every step of a loop; return those in which no row gives way."""
    kept = [each for each in solved if each.qp.usable and not each.qp.gave_way]
    for each in kept:
        assert apart(answer(each.qp, "quadprog"), each.wanted) <= EXACT
        assert apart(answer(each.qp, "daqp"), each.wanted) <= EXACT
    assert all(same(each) for each in solved)
    assert all(each.qp.margins == each.step.margins for each in solved)
    return kept


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_other_solvers_find_the_twist_that_the_step_wants(case: str) -> None:
    solved = loop_of(case, 120)
    kept = check(solved)
    assert len(kept) > 90
    moved = [each for each in kept if each.whole and case != "forearm"]
    for each in moved:
        assert apart(answer(each.qp, "quadprog"), each.planned) <= EXACT
    assert len(moved) > 80 or case == "forearm"
    # The figure can be bad.
    assert max(apart(answer(each.qp, "", rows=False), each.wanted) for each in kept) > 1e-3
    assert max(apart(answer(each.unstated, "quadprog"), each.wanted) for each in kept) > 1e-3


@pytest.mark.slow
def test_rows_that_give_way_are_named_and_have_unknowns() -> None:
    solved = loop_of("disturbed", 150)
    gave_way = [each for each in solved if each.qp.gave_way]
    assert len(gave_way) > 10
    assert any(each.passes > 1 for each in gave_way)
    for each in gave_way:
        qp = each.qp
        assert {f"slack of {row}" for row in qp.gave_way} <= set(qp.unknowns[6:])
        # Hard rows are cut back to their exact end.
        assert apart(answer(qp, "quadprog"), each.wanted) <= 2 * ELBOW
        # Without slack no twist keeps these rows within the reach of this period.
        rows = [qp.rows.index(row) for row in qp.gave_way]
        value = qp.A[rows, :6] @ each.wanted
        assert ((value > qp.upper[rows]) | (value < qp.lower[rows])).all()


def test_a_step_in_which_no_row_is_near() -> None:
    qp = qp_of("screwing")
    step = Stepper(problem_of("screwing")).step(awkward("screwing"), held_pose("screwing"))
    assert (qp.status, qp.reason, qp.usable, qp.gave_way) == ("optimal", "", True, ())
    assert np.array_equal(qp.step.twist, step.twist)
    assert (qp.cost, qp.margins, qp.dt) == (step.cost, step.margins, 0.01)
    m, n = len(qp.rows), len(qp.unknowns)
    assert qp.unknowns == AXES
    assert (qp.H.shape, qp.g.shape, qp.A.shape) == ((n, n), (n,), (m, n))
    assert (qp.lower.shape, qp.upper.shape, len(qp.units)) == ((m,), (m,), m)
    assert (qp.gradient.shape, qp.sensitivity.shape) == ((32,), (32, 6))
    assert np.array_equal(qp.H, qp.H.T)
    assert np.linalg.eigvalsh(qp.H).min() > 0
    assert (qp.lower <= qp.upper).all()
    assert len(set(qp.rows)) == m
    assert set(qp.rows[:-6]) <= set(problem_of("screwing").row_names)


def test_units_are_those_of_the_limits_per_second() -> None:
    units = dict(zip(qp_of("screwing").rows, qp_of("screwing").units, strict=True))
    assert units["workspace z"] == units["twist x"] == "m/s"
    assert units["trunk_flexion"] == units["twist rx"] == "rad/s"
    forearm = problem_of("forearm")
    points = np.array([0.0, -0.2, 0.2, 0.2555, -0.2, 0.2])
    qp = Formulator(forearm)(None, points)
    units = dict(zip(qp.rows, qp.units, strict=True))
    assert (units["twist x"], units["twist rz"]) == ("m/s", "m/s")
    assert "log/s" in qp.units


@pytest.mark.parametrize("name", NAMES)
def test_the_gradient_is_that_of_the_cost(name: str) -> None:
    problem, q = problem_of(name), awkward(name)
    qp, small = qp_of(name), 1e-5
    moved = small * np.eye(32)
    slope = (problem.cost(q + moved) - problem.cost(q - moved)) / (2 * small)
    assert qp.gradient == pytest.approx(slope, abs=1e-6)
    assert np.abs(qp.gradient).max() > 0.1
    assert qp.cost == pytest.approx(float(problem.cost(q)[0]), abs=1e-10)


def test_the_gradient_of_unseen_joints_is_zero() -> None:
    observed = np.ones(32)
    observed[INDEX["trunk_flexion"]] = 0
    qp, full = qp_of("screwing", observed=observed), qp_of("screwing")
    assert qp.gradient[INDEX["trunk_flexion"]] == 0 != full.gradient[INDEX["trunk_flexion"]]


@pytest.mark.parametrize("name", ["dentist", "overhead", "screwing"])
def test_the_posture_follows_by_the_sensitivity(name: str) -> None:
    """The hand follows the object, but for the free turn about the tool and what the soft rows of
    the model leave (E)."""
    q, qp, small = awkward(name), qp_of(name), 1e-5
    contact = problem_of(name).response.contact()
    here = np.array(contact(q)[0])
    motion = np.zeros((6, 6))
    for axis in range(6):
        ahead, behind = (
            np.array(contact(q + way * small * qp.sensitivity[:, axis])[0]) for way in (1, -1)
        )
        rate = (ahead - behind) / (2 * small)
        spin = rate[:3, :3] @ here[:3, :3].T
        motion[:, axis] = [*rate[:3, 3], spin[2, 1], spin[0, 2], spin[1, 0]]
    kept, tool = np.eye(6), here[:3, 0]
    kept[3:, 3:] -= np.outer(tool, tool)
    assert np.abs(kept @ (motion - np.eye(6))).max() < 0.02
    assert np.abs(qp.sensitivity).max() > 0.5


def test_the_objective_is_that_of_the_page() -> None:
    """Written again in NumPy, from gradient, S and the settings."""
    problem, stepper, q = plain_of("screwing"), Stepper(plain_of("screwing")), awkward("screwing")
    loop = Held(stepper, held_pose("screwing"))
    previous = [loop.step(q).twist for _ in range(5)][-1]
    qp = formulator_of("screwing", plain=True)(stepper.state(), q, loop.pose)
    control, S, response = problem.control, qp.sensitivity, problem.response
    moves = np.array([joint in problem.joints for joint in JOINTS])
    W = response.weight_vector
    away = q - comfort_of("screwing")
    slope = S.T @ (qp.gradient + control.comfort * W * away * moves)
    T, R = control.look_ahead, np.repeat([control.effort_linear, control.effort_angular], 3)
    smoothing = control.smoothing / qp.dt
    assert np.abs(previous).max() > 1e-3
    assert qp.g == pytest.approx(T * slope - smoothing * R * previous, abs=1e-12)
    total = qp.cost + control.comfort * float(W * moves @ away**2) / 2
    E = np.array(response.sensitivity()(q, np.zeros(32))[1])
    H = T**2 / 2 / (total - problem.cost.minimum + CAUTION_EPS) * np.outer(slope, slope)
    H += T**2 * control.caution * S.T @ (W[:, None] * S) + control.contact * E.T @ E
    H += np.diag(R * (1 + smoothing))
    assert np.abs(qp.H - H).max() < 1e-10


def test_bounds_of_the_twist_are_what_a_period_can_change() -> None:
    problem, q, pose = plain_of("screwing"), awkward("screwing"), held_pose("screwing")
    limit = problem.twist_limit
    for dt in (0.01, 0.02):
        qp = formulator_of("screwing", plain=True)(None, q, pose, dt=dt)
        assert qp.dt == dt
        assert qp.A[-6:].tolist() == np.eye(6).tolist()
        assert qp.upper[-6:] == pytest.approx(limit.acceleration * dt)
        assert qp.lower[-6:] == pytest.approx(-limit.acceleration * dt)


def test_rows_of_joints_are_rows_of_the_sensitivity() -> None:
    qp = qp_of("screwing")
    for joint in ("trunk_flexion", "right_elbow_flexion"):
        assert np.array_equal(qp.A[qp.rows.index(joint)], qp.sensitivity[INDEX[joint]])
    z = qp.rows.index("workspace z")
    assert np.array_equal(qp.A[z], np.eye(6)[2])
    # From rest the rows are far: the object could not use them up within a stop.
    assert qp.lower[z] < 0 < qp.upper[z]


def test_an_object_near_its_wall_may_not_go_there() -> None:
    problem, pose, q = bold_of("screwing"), held_pose("screwing"), awkward("screwing")
    box = problem.limit_of(ergoqp.limits.WorkspaceBox)
    formulator = Formulator(problem)
    for end, sign in ((box.upper, 1), (box.lower, -1)):
        pose[2, 3] = end[2]
        qp = formulator(None, q, pose)
        z = qp.rows.index("workspace z")
        there, back = sign * qp.upper[z], sign * qp.lower[z]
        there, back = (there, back) if sign > 0 else (back, there)
        assert there == pytest.approx(0, abs=1e-6)
        assert back < -1e-3
        assert qp.margins["workspace z"] == pytest.approx(0, abs=1e-12)


def test_an_object_outside_has_slack_at_a_price() -> None:
    problem, pose, q = bold_of("screwing"), held_pose("screwing"), awkward("screwing")
    pose[2, 3] = problem.limit_of(ergoqp.limits.WorkspaceBox).upper[2] + 0.05
    qp = Formulator(problem)(None, q, pose)
    assert qp.status == "recovering"
    assert qp.margins["workspace z"] == pytest.approx(-0.05)
    slack = qp.unknowns.index("slack of workspace z")
    assert (qp.g[slack], qp.H[slack, slack]) == (PENALTY, 1.0)
    z, own = qp.rows.index("workspace z"), qp.rows.index("slack of workspace z")
    assert qp.A[z, slack] == -1
    assert qp.A[own].tolist() == np.eye(len(qp.unknowns))[slack].tolist()
    assert qp.lower[own] == 0 < qp.upper[own]
    assert qp.units[own] == "m/s"
    # It is asked back faster than it can speed up within this period.
    assert qp.upper[z] < 0
    assert "workspace z" in qp.gave_way


@pytest.mark.parametrize(
    ("cap", "slack", "gives_way"),
    [
        (0.0, 0.0, False),
        (0.5, 0.0, False),
        (0.5, 2e-9, True),
        (ELBOW, 0.0, False),
        (ELBOW - 2e-9, 0.0, True),
    ],
)
def test_which_slack_changes_the_twist(cap: float, slack: float, gives_way: bool) -> None:
    formulator = formulator_of("screwing")
    step = formulator(None, awkward("screwing"), held_pose("screwing")).step
    values = {"cap": cap, "gave": slack}
    for name, value in values.items():
        step.account(name)[3] = value
    qp = formulator._formulation(step)
    assert qp.gave_way == ((qp.rows[3],) if gives_way else ())
    assert qp.unknowns == (AXES if cap == 0 else (*AXES, f"slack of {qp.rows[3]}"))


def test_joints_that_yield_do_not_follow() -> None:
    q = np.clip(awkward("low_bin", 3), LOWER, UPPER)
    q[INDEX["neck_flexion"]], q[INDEX["right_elbow_flexion"]] = UPPER[3] + 0.05, -0.05
    found = False
    for seed in range(6):
        rng = np.random.default_rng(seed)
        posture = np.clip(q + 0.4 * rng.normal(size=32), LOWER - 0.05, UPPER + 0.05)
        qp = formulator_of("low_bin")(None, posture, held_pose("low_bin"))
        for joint in qp.step.locked:
            found = True
            assert np.abs(qp.sensitivity[INDEX[joint]]).max() < 1e-6
    assert found


def test_a_problem_without_rows_has_the_bounds_of_the_twist() -> None:
    problem = problem_of("screwing")
    free = problem.replace(limits=[problem.twist_limit])
    qp = Formulator(free)(None, awkward("screwing"), held_pose("screwing"))
    assert qp.rows == tuple(f"twist {axis}" for axis in AXES)
    assert (qp.A.tolist(), qp.margins, qp.status) == (np.eye(6).tolist(), {}, "optimal")


@pytest.mark.slow
def test_a_step_that_no_twist_is_certified_for_still_has_its_qp() -> None:
    robot = DeclaredRobot(lag=0.1, delay=0.02, pose_noise=0.001, pose_noise_deg=0.2)
    stepper = WatchedStepper(small("dentist", robot, None))
    loop, rng = Held(stepper, held_pose("dentist")), np.random.default_rng(0)
    for _ in range(5):
        posture = near_comfort("dentist", rng, 25)
        for _ in range(60):
            loop.step(posture)
    kept = check(stepper.solved)
    braking = [each.qp for each in stepper.solved if each.qp.status == "braking"]
    assert braking
    assert len(kept) > 100
    for qp in braking:
        assert qp.usable
        assert "keeps every limit" in qp.reason
        assert np.isfinite(qp.H).all()
        assert qp.step.residuals["accepted"] == 0


UNUSABLE: dict[str, tuple[dict[str, Any], str]] = {
    "no frame": ({"posture": None}, "no posture arrived"),
    "NaN": ({"posture": np.full(32, np.nan)}, "posture"),
    "disabled": ({"enable": False}, "enable"),
    "late": ({"age": 5.0}, "5 s old"),
    "negative": ({"age": -1.0}, "age"),
    "period": ({"dt": 9.0}, "dt"),
    "pose": ({"pose": np.zeros((4, 4))}, "pose"),
    "twist": ({"twist": np.full(6, np.inf)}, "twist"),
}


@pytest.mark.parametrize("case", UNUSABLE)
def test_unusable_inputs_are_named_and_give_nothing_to_solve(case: str) -> None:
    given, word = UNUSABLE[case]
    call = {"posture": awkward("screwing"), **given}
    qp = formulator_of("screwing")(None, **call)
    assert not qp.usable
    assert qp.status in ("braking", "invalid")
    assert word in qp.reason
    for part in (qp.H, qp.g, qp.A, qp.lower, qp.upper, qp.gradient, qp.sensitivity):
        assert np.isnan(part).all()
    assert (len(qp.rows), 6) == qp.A.shape
    assert qp.gave_way == ()
    assert np.array_equal(qp.step.twist, np.zeros(6))
    assert json.loads(json.dumps(qp.as_dict(), allow_nan=False))["g"] == [None] * 6


def test_a_loop_on_hold_has_nothing_to_solve() -> None:
    stepper, q = Stepper(problem_of("screwing")), awkward("screwing")
    stepper.hold()
    qp = formulator_of("screwing")(stepper.state(), q)
    assert not qp.usable
    assert "held" in qp.reason
    assert formulator_of("screwing")(None, q).usable


def test_a_term_without_numbers_is_named() -> None:
    class Broken(ca.Callback):
        def __init__(self) -> None:
            ca.Callback.__init__(self)
            self.construct("broken", {"enable_fd": True})

        def get_sparsity_in(self, i: int) -> ca.Sparsity:
            return ca.Sparsity.dense(32, 1)

        def eval(self, arg: Any) -> Any:
            if broken:
                raise RuntimeError("no licence")
            return [1 + ca.sumsqr(arg[0])]

    class Cost:
        name, minimum = "remote", 1.0

        def expression(self, q: Any) -> Any:
            return callback(q)

        def __call__(self, postures: Any) -> np.ndarray:
            return 1 + (np.atleast_2d(postures) ** 2).sum(axis=1)

    broken, callback = False, Broken()
    problem = problem_of("screwing").replace(cost=Cost())
    formulator, q = Formulator(problem), awkward("screwing")
    assert formulator(None, q).usable
    broken = True
    qp = formulator(None, q)
    assert not qp.usable
    assert "remote" in qp.reason
    assert "no licence" in qp.reason
    assert np.isnan(qp.H).all()


WRONG: dict[str, tuple[dict[str, Any], str]] = {
    "shape": ({"posture": np.zeros(31)}, r"formulate: posture has shape \(31,\), allowed \(32,\)"),
    "text": ({"posture": "upright"}, "formulate: posture "),
    "pose": ({"pose": np.eye(3)}, r"formulate: pose has shape \(3, 3\), allowed \(4, 4\)"),
    "twist": ({"twist": [1, 2]}, r"formulate: twist has shape \(2,\), allowed \(6,\)"),
    "dt": ({"dt": "fast"}, "formulate: dt is 'fast', allowed a number in s"),
    "age": ({"age": None}, "formulate: age is None, allowed a number in s"),
    "enable": ({"enable": "yes"}, "enable: got 'yes', allowed True or False"),
    "observed": ({"observed": np.full(32, 0.5)}, "formulate: observed is not a mask"),
    "state": ({"state": np.zeros(3)}, r"state: got array\(\[0., 0., 0.\]\), allowed \d+ finite"),
    "old": ({"state": "initial"}, "state: got 'initial', allowed"),
}


@pytest.mark.parametrize("case", WRONG)
def test_what_is_no_input_at_all_is_refused_in_one_sentence(case: str) -> None:
    given, sentence = WRONG[case]
    call = {"state": None, "posture": awkward("screwing"), **given}
    before = qp_of("screwing")
    with pytest.raises(InputError, match=sentence) as caught:
        formulator_of("screwing")(**call)
    assert "\n" not in str(caught.value)
    assert np.array_equal(qp_of("screwing").H, before.H)


def test_what_is_no_problem_is_refused() -> None:
    for value in ("screwing", None, ergoqp.Problem):
        with pytest.raises(InputError, match="problem: got"):
            ergoqp.formulate(value, None, np.zeros(32))  # type: ignore[arg-type]
        with pytest.raises(InputError, match="problem: got"):
            Formulator(value)  # type: ignore[arg-type]


def test_the_state_of_a_guided_loop_needs_the_guide() -> None:
    problem, q = problem_of("screwing"), awkward("screwing")
    stepper = Stepper(problem, guide=held_pose("screwing"))
    with pytest.raises(InputError, match="state: got"):
        formulator_of("screwing")(stepper.state(), q)
    guided = Formulator(problem, guide=held_pose("screwing"))
    assert guided(stepper.state(), q).status == stepper.step(q).status
    with pytest.raises(InputError, match="guide: "):
        Formulator(problem, guide=np.eye(4))


def test_a_call_leaves_nothing_behind() -> None:
    problem, q = problem_of("screwing"), awkward("screwing")
    stepper = Stepper(problem)
    for _ in range(8):
        stepper.step(q)
    state = stepper.state()
    kept, posture = state.copy(), q.copy()
    formulator = Formulator(problem)
    first = formulator(state, posture)
    formulator(None, None)
    formulator(None, awkward("screwing", 1), held_pose("screwing"), np.zeros(6), enable=False)
    again = formulator(state, posture)
    assert np.array_equal(state, kept)
    assert np.array_equal(posture, q)
    for name in ("H", "g", "A", "lower", "upper", "gradient", "sensitivity"):
        assert np.array_equal(getattr(first, name), getattr(again, name))
    assert not np.array_equal(first.g, formulator(None, q).g)
    with pytest.raises(FrozenInstanceError):
        first.dt = 1.0  # type: ignore[misc]
    first.H[:] = 0
    assert again.H.any()


def test_threads_wait_for_each_other() -> None:
    formulator, seeds = formulator_of("screwing"), range(40)
    alone = [formulator(None, awkward("screwing", seed)).g for seed in seeds]
    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(lambda seed: formulator(None, awkward("screwing", seed)).g, seeds))
    assert all(np.array_equal(a, b) for a, b in zip(alone, found, strict=True))


def test_the_function_of_a_problem_is_built_once(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[Any] = []

    class Counted:
        def __init__(self, problem: Any) -> None:
            self.problem = problem
            made.append(problem)

        def __call__(self, *args: Any, **kwargs: Any) -> Any:
            return self.problem

    monkeypatch.setattr("ergoqp.step.formulate.Formulator", Counted)
    monkeypatch.setattr("ergoqp.step.formulate._kept", [])
    problems = [problem_of("screwing").replace(dt=0.001 * (5 + i)) for i in range(5)]
    for problem in (*problems[:4], *problems[:4]):
        assert ergoqp.formulate(problem, None, None) is problem
    assert len(made) == 4
    ergoqp.formulate(problems[4], None, None)
    ergoqp.formulate(problems[0], None, None)
    assert made[4:] == [problems[4], problems[0]]
    equal = problems[4].replace()
    assert ergoqp.formulate(equal, None, None) is equal


def test_as_a_dictionary_it_is_plain_json() -> None:
    qp = qp_of("screwing")
    told = json.loads(json.dumps(qp.as_dict(), allow_nan=False))
    assert set(told) == {
        *("H", "g", "A", "lower", "upper", "rows", "units", "unknowns", "gave_way", "cost"),
        *("gradient", "sensitivity", "margins", "dt", "usable", "status", "reason"),
    }
    assert told["H"] == qp.H.tolist()
    lower = [-np.inf if value is None else value for value in told["lower"]]
    upper = [np.inf if value is None else value for value in told["upper"]]
    assert lower == qp.lower.tolist()
    assert upper == qp.upper.tolist()
    assert told["margins"] == qp.margins
    assert (told["rows"], told["unknowns"]) == (list(qp.rows), list(AXES))
    assert (told["usable"], told["status"], told["reason"]) == (True, "optimal", "")
    free = replace(qp, upper=np.full_like(qp.upper, np.inf))
    assert free.as_dict()["upper"] == [None] * len(qp.rows)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["screwing", "forearm"])
def test_the_step_is_the_same_with_and_without_these_outputs(name: str) -> None:
    problem, solver = problem_of(name), solver_named("daqp")
    plain, more = (
        build_step(problem, solver, formulated=formulated) for formulated in (False, True)
    )
    assert plain.name_out() == list(OUTPUTS)
    assert more.name_out() == [*OUTPUTS, *FORMULATED]
    rng, calls = np.random.default_rng(0), [Evaluator(function) for function in (plain, more)]
    n = len(problem.coordinates)
    start = comfort_of(name) if n == 32 else np.array([0.0, -0.2, 0.2, 0.2555, -0.2, 0.2])
    state = ergoqp.initial_state(problem)
    for _ in range(30):
        given = dict.fromkeys(plain.name_in(), 0.0)
        given |= {"posture": start + 0.02 * rng.normal(size=n), "observed": np.ones(n)}
        given |= {"pose": np.eye(4), "executed": np.zeros(6), "dt": 0.01}
        given |= {"frame": 1.0, "enable": 1.0, "state": state}
        a, b = (call(given) for call in calls)
        assert all(np.array_equal(a[name], b[name], equal_nan=True) for name in OUTPUTS)
        state = a["next_state"]
