"""The step's QP: solvers against an independent enumeration, the residual that trusts nobody, slack
only where needed."""

from __future__ import annotations

import itertools
from functools import cache

import casadi as ca
import numpy as np
import pytest
from scipy.optimize import linprog
from scipy.sparse import csc_matrix
from step_samples import NAMES, Held, bold_stepper, held_pose, near_comfort, problem_of

from ergoqp.limits import WorkspaceBox
from ergoqp.solvers import installed_solvers, solver_named
from ergoqp.solvers.solver import FREE
from ergoqp.step.qp import ELBOW, PENALTY, QP_DATA, TOLERANCE, _judge, build_qp, slack_function


@cache
def qp(solver: str, m: int) -> ca.Function:
    return build_qp(solver_named(solver), m)


@cache
def residual(m: int, relaxed: bool = False) -> ca.Function:
    return _judge(m, relaxed)


def random_qp(rng: np.random.Generator, m: int) -> dict[str, np.ndarray]:
    """A positive definite Hessian, rows that zero satisfies, a box around it; some rows doubled or
    empty."""
    root = rng.normal(size=(6, 6))
    A = rng.normal(size=(m, 6))
    if m > 2:
        A[-1], A[-2] = A[0], 0.0
    data = {"H": root @ root.T + 0.1 * np.eye(6), "g": 5 * rng.normal(size=6), "A": A}
    data |= {
        "lbA": -rng.uniform(0, 1, m),
        "ubA": rng.uniform(0, 1, m),
        "side": np.ones(m),
        "cap": np.zeros(m),
    }
    return data | {"lb": -rng.uniform(0.05, 1, 6), "ub": rng.uniform(0.05, 1, 6)}


def solve(
    solver: str, data: dict[str, np.ndarray]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    x, slack, multipliers, worst = (
        np.array(part).ravel() for part in qp(solver, len(data["A"]))(*data.values())
    )
    return x, slack, multipliers, float(worst[0])


# What cycles between active sets ends without an answer, and the step then brakes.
SHARE = {"qrqp": 0.4}


def _as(solver: str, matrix: np.ndarray) -> object:
    return csc_matrix(matrix) if solver == "osqp" else matrix


def by_enumeration(data: dict[str, np.ndarray]) -> np.ndarray:
    """The optimum by trying every set of active constraints of a tiny QP (only the first two axes
    are free)."""
    H, g = data["H"], data["g"]
    G = np.vstack([data["A"], -data["A"], np.eye(6), -np.eye(6)])
    h = np.concatenate([data["ubA"], -data["lbA"], data["ub"], -data["lb"]])
    fixed = [i for i in range(6) if data["lb"][i] == data["ub"][i]]
    base = np.eye(6)[fixed]
    best, least = None, np.inf
    for count in range(3):
        for chosen in itertools.combinations(range(len(G)), count):
            C = np.vstack([base, G[list(chosen)]])
            d = np.concatenate([data["lb"][fixed], h[list(chosen)]])
            kkt = np.block([[H, C.T], [C, np.zeros((len(C), len(C)))]])
            if np.linalg.cond(kkt) > 1e10:
                continue
            x = np.linalg.solve(kkt, np.concatenate([-g, d]))[:6]
            value = 0.5 * x @ H @ x + g @ x
            if np.all(G @ x <= h + 1e-9) and value < least:
                best, least = x, value
    assert best is not None
    return best


@pytest.mark.parametrize("solver", installed_solvers())
def test_answers_equal_the_enumeration_of_active_sets(solver: str) -> None:
    rng, solved = np.random.default_rng(0), 0
    for _ in range(25):
        data = random_qp(rng, 3)
        data["lb"][2:] = data["ub"][2:] = 0.0
        x, slack, _, worst = solve(solver, data)
        if not worst < TOLERANCE:
            continue
        solved += 1
        np.testing.assert_allclose(x, by_enumeration(data), atol=1e-6, err_msg=solver)
        assert np.abs(slack).max() < 1e-9
    assert solved >= 25 * SHARE.get(solver, 1)


@pytest.mark.filterwarnings("ignore::PendingDeprecationWarning")
@pytest.mark.parametrize("solver", installed_solvers())
def test_answers_equal_those_of_qpsolvers(solver: str) -> None:
    qpsolvers = pytest.importorskip("qpsolvers", reason="qpsolvers (extra 'solvers') is absent")
    others = [
        name
        for name in ("quadprog", "daqp", "osqp")
        if name in qpsolvers.available_solvers and name != solver
    ]
    if not others:
        pytest.skip(f"qpsolvers has no exact backend but {solver}")
    rng, compared = np.random.default_rng(1), 0
    for _ in range(30):
        data = random_qp(rng, 8)
        x, _, multipliers, worst = solve(solver, data)
        G, h = np.vstack([data["A"], -data["A"]]), np.concatenate([data["ubA"], -data["lbA"]])
        options = (
            {"eps_abs": 1e-10, "eps_rel": 1e-10, "max_iter": 50_000} if others[0] == "osqp" else {}
        )
        keep = np.abs(G).sum(axis=1) > 0
        H, G = _as(others[0], data["H"]), _as(others[0], G[keep])
        task = qpsolvers.Problem(H, data["g"], G, h[keep], lb=data["lb"], ub=data["ub"])
        expected = qpsolvers.solve_problem(task, solver=others[0], **options).x
        if worst >= TOLERANCE or expected is None:
            continue
        compared += 1
        np.testing.assert_allclose(x, expected, atol=1e-5)
        active = np.abs(multipliers) > 1e-5
        at_end = np.minimum(
            np.abs(data["A"] @ x - data["ubA"]), np.abs(data["A"] @ x - data["lbA"])
        )
        assert np.all(at_end[active] < 1e-5)
    assert compared >= 25 * SHARE.get(solver, 1)


@pytest.mark.parametrize(
    ("solver", "what"), [("daqp", "g"), ("daqp", "H"), ("daqp", "A"), ("osqp", "g"), ("qrqp", "g")]
)
def test_nan_never_passes_for_an_answer(solver: str, what: str) -> None:
    """CasADi's plugins refuse NaN elsewhere themselves; in a step there is none, see
    test_step_safety."""
    data = random_qp(np.random.default_rng(2), 4)
    for at in range(data[what].size):
        broken = data | {what: data[what].copy()}
        broken[what].flat[at] = np.nan
        assert solve(solver, broken)[3] == FREE, at


@pytest.mark.parametrize("solver", installed_solvers())
def test_rows_that_contradict_each_other_never_pass(solver: str) -> None:
    data = random_qp(np.random.default_rng(3), 4)
    data["A"][0] = data["A"][1] = [1, 0, 0, 0, 0, 0]
    data["lbA"][:2], data["ubA"][:2] = [0.02, -1], [1, 0.01]
    assert not solve(solver, data)[3] < TOLERANCE
    data["lbA"][0], data["ubA"][0] = 3.0, 4.0
    assert not solve(solver, data)[3] < TOLERANCE


def exact(rng: np.random.Generator, m: int = 5) -> list[np.ndarray]:
    """A QP made from its own answer: x, multipliers with complementary bounds, and g that makes
    them optimal."""
    root, A, x = rng.normal(size=(6, 6)), rng.normal(size=(m, 6)), rng.normal(size=6) * 0.1
    H, rows, box = root @ root.T + np.eye(6), np.zeros(m), np.zeros(6)
    value = A @ x
    low, high, lba, uba = x - 1, x + 1, value - 1, value + 1
    rows[0], uba[0] = 2.0, value[0]
    rows[1], lba[1] = -1.5, value[1]
    box[0], high[0] = 0.7, x[0]
    box[3], low[3] = -0.4, x[3]
    side, cap = rng.choice([-1.0, 1.0], m), np.zeros(m)
    return [H, -(H @ x + A.T @ rows + box), A, lba, uba, side, cap, low, high, x, rows, box]


X, ROWS, BOX = 9, 10, 11
"""Places of the answer in what `exact` gives."""


def test_the_residual_is_zero_at_the_optimum_and_nowhere_near_it() -> None:
    rng = np.random.default_rng(4)
    check = residual(5)
    for _ in range(20):
        data = exact(rng)
        assert float(check(*data)) < 1e-9
        for part in (X, ROWS, BOX):
            wrong = [value.copy() for value in data]
            wrong[part] += 1e-3 * rng.choice([-1, 1], wrong[part].shape)
            assert float(check(*wrong)) > 1e-5


def test_the_residual_sees_wrong_signs_absent_bounds_and_nan() -> None:
    check, data = residual(5), exact(np.random.default_rng(5))
    # A multiplier that pulls at the wrong end of its row: stationary all the same, but not
    # complementary.
    flipped = [value.copy() for value in data]
    flipped[ROWS][0] = -2.0
    flipped[1] = -(flipped[0] @ flipped[X] + flipped[2].T @ flipped[ROWS] + flipped[BOX])
    assert float(check(*flipped)) > 1e-3
    # A multiplier of a bound that is not there.
    absent = [value.copy() for value in data]
    absent[4][0] = 2 * FREE
    assert float(check(*absent)) > 1e-3
    infinite = [value.copy() for value in data]
    infinite[X][:] = np.inf
    assert float(check(*infinite)) >= TOLERANCE


@pytest.mark.parametrize("part", [0, 1, 2, 3, 4, 7, 8, X, ROWS, BOX])
def test_the_residual_never_passes_nan(part: int) -> None:
    """In no entry of any of its inputs: H, g, A, four bounds, x and both kinds of multipliers."""
    check, data = residual(5), exact(np.random.default_rng(5))
    assert len(data) == check.n_in()
    for at in range(data[part].size):
        broken = [value.copy() for value in data]
        broken[part].flat[at] = np.nan
        assert float(check(*broken)) == FREE, at


def test_the_residual_of_a_relaxed_qp_is_that_of_its_qp_written_out() -> None:
    """The QP over twist and slack as matrices, and its residuals from their definition in NumPy."""
    rng, m = np.random.default_rng(14), 6
    written, seen = slack_function(m), []
    for k in range(200):
        data = random_qp(rng, m)
        data |= {"side": rng.choice([-1.0, 1.0], m), "lbA": rng.uniform(-1, 1, m)}
        # Beside the price of slack a dual residual is small.
        data |= {"cap": rng.uniform(0, 1, m) * rng.integers(0, 2, m) * (k % 2)}
        H, g, A, lb, ub = (np.array(part) for part in written(*data.values()))
        x, rows, box = (rng.normal(size=count) for count in (6 + m, m, 6 + m))
        below = np.concatenate([A @ x - data["lbA"], x - lb.ravel()])
        above = np.concatenate([data["ubA"] - A @ x, ub.ravel() - x])
        both, off = np.concatenate([rows, box]), H @ x + g.ravel() + A.T @ rows + box
        gap = np.fmax(both, 0) @ above + np.fmax(-both, 0) @ below
        dual = max(np.abs(off).max(), abs(gap)) / (1 + np.abs(g).max())
        expected = max(0.0, -below.min(), -above.min(), dual)
        found = float(residual(m, relaxed=True)(*data.values(), x, rows, box))
        assert found == pytest.approx(expected, rel=1e-12)
        seen.append(expected == dual)
    assert 20 < sum(seen) < 180
    assert list(data) == list(QP_DATA)


@pytest.mark.parametrize("part", range(12))
def test_the_residual_of_a_relaxed_qp_never_passes_nan(part: int) -> None:
    data = exact(np.random.default_rng(5))
    data[6] = np.array([0.5, 0, 0.5, 0, 0.5])
    for k in (X, BOX):
        data[k] = np.concatenate([data[k], np.zeros(5)])
    assert float(residual(5, relaxed=True)(*data)) < FREE
    for at in range(data[part].size):
        broken = [value.copy() for value in data]
        broken[part].flat[at] = np.nan
        # Side and cap are numbers of the step's own: they only have to show where they are used.
        used = part not in (5, 6) or (part == 5 and data[6][at] > 0)
        assert (float(residual(5, relaxed=True)(*broken)) == FREE) == used, at


def test_relaxed_and_hard_paths_agree_where_the_rows_have_room() -> None:
    rng = np.random.default_rng(6)
    for _ in range(20):
        data = random_qp(rng, 6)
        hard = solve("daqp", data)
        relaxed = solve(
            "daqp", data | {"cap": rng.uniform(0.1, 1, 6), "side": rng.choice([-1.0, 1.0], 6)}
        )
        assert max(hard[3], relaxed[3]) < TOLERANCE
        np.testing.assert_allclose(relaxed[0], hard[0], atol=1e-6)
        assert relaxed[1].max() < 1e-7


def test_slack_is_used_only_where_the_rows_cannot_all_hold() -> None:
    """Against a feasibility LP; the cap is never exceeded, and with it there is always an
    answer."""
    rng, counts = np.random.default_rng(7), {True: 0, False: 0}
    for _ in range(80):
        data = random_qp(rng, 6)
        # One row asks to come back at some pace; its cap reaches down to standing still.
        pace = rng.uniform(0, 1.5)
        data["ubA"] = data["ubA"].copy()
        data["ubA"][0], data["lbA"][0] = -pace, -FREE
        data["lbA"][-1] = -FREE
        data["cap"] = np.where(np.arange(6) == 0, pace, 0.0)
        G, h = np.vstack([data["A"], -data["A"]]), np.concatenate([data["ubA"], -data["lbA"]])
        lp = linprog(np.zeros(6), A_ub=G, b_ub=h, bounds=np.column_stack([data["lb"], data["ub"]]))
        x, slack, _, worst = solve("daqp", data)
        assert worst < TOLERANCE
        assert np.all(data["A"] @ x <= data["ubA"] + data["cap"] + 1e-7)
        if lp.status == 0:
            # Exact penalty: not even a little is taken.
            room = linprog(
                np.r_[np.zeros(6), -1],
                A_ub=np.c_[G, np.ones(len(G))],
                b_ub=h,
                bounds=[*zip(data["lb"], data["ub"], strict=True), (0, 1)],
            )
            if -room.fun > 1e-3 or np.abs(data["A"][-2]).max() == 0:
                counts[True] += 1
                assert np.max(slack * data["cap"]) < 1e-5
        else:
            counts[False] += 1
            assert slack[0] > 1e-6
            # The least slack that there is.
            least = linprog(
                data["A"][0],
                A_ub=G[1:],
                b_ub=h[1:],
                bounds=np.column_stack([data["lb"], data["ub"]]),
            )
            assert data["A"][0] @ x == pytest.approx(least.fun, abs=2e-3)
    assert counts[True] > 5
    assert counts[False] > 5


@pytest.mark.slow
def test_the_penalty_is_above_every_multiplier_of_the_step() -> None:
    """Slack stays zero where the rows allow it as long as no multiplier of the problems' own QPs
    comes near the penalty."""
    largest = 0.0
    for name in NAMES:
        stepper, rng, pose = bold_stepper(name), np.random.default_rng(3), held_pose(name)
        stepper.reset()
        # In a corner of the box, where its walls push back.
        pose[:3, 3] = problem_of(name).limit_of(WorkspaceBox).upper
        pose[:3, 3] -= 1e-3 * (problem_of(name).twist_limit.speed[:3] > 0)
        loop = Held(stepper, pose)
        for _ in range(60):
            step = loop.step(near_comfort(name, rng, 30.0))
            if not step.account("slack").any():
                largest = max(largest, float(np.abs(step.account("multipliers")).max()))
    assert 0.01 < largest < PENALTY / 10


@pytest.mark.parametrize("seed", range(5))
def test_an_exact_row_gives_back_what_it_used_of_the_room_that_nobody_needs(seed: int) -> None:
    """Two rows that cannot both hold: the one whose cap is small gives way by what was needed, and
    not by `ELBOW` more."""
    rng, needed = np.random.default_rng(seed), 0.01
    row = np.zeros(6)
    row[0] = rng.uniform(0.5, 2.0)
    data = random_qp(rng, 2)
    data |= {
        "g": np.zeros(6),
        "A": np.vstack([row, -3 * row]),
        "lb": -np.ones(6),
        "ub": np.ones(6),
    }
    data |= {
        "lbA": np.full(2, -FREE),
        "ubA": np.array([0.0, -1.0]),
        "cap": np.array([needed + ELBOW, 9.0]),
    }
    for exact, most in (((), needed + ELBOW), ((0,), needed)):
        xi, slack, _, worst = build_qp(solver_named("daqp"), 2, exact=exact)(*data.values())
        assert float(worst) < TOLERANCE
        assert float(np.array(slack)[0, 0]) == pytest.approx(needed + ELBOW, abs=1e-9)
        assert float(row @ np.array(xi).ravel()) == pytest.approx(most, abs=1e-9)
