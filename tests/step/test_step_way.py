"""What is under way against a plan that is sampled finely, and the mean that is sent, over uneven
periods."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from step_samples import comfort_of, held_pose, problem_of

from ergoqp.limits import WorkspaceBox
from ergoqp.problem.problem import Problem
from ergoqp.problem.settings import DeclaredRobot
from ergoqp.step.delay import landing, next_history, off_rows, under_way
from ergoqp.step.layout import FAR, count, initial_history, split
from ergoqp.step.model import StepModel
from ergoqp.step.qp import away_function
from ergoqp.step.stepper import Stepper

ROBOT = DeclaredRobot(delay=0.02, lag=0.05, pose_delay=0.01)
FOUND = ("total", "owed", "begun", "own", "fits", "parked", "up", "down", "turn")


def functions(problem: Problem) -> tuple[ca.Function, ca.Function]:
    """``(history, dt) -> FOUND`` and ``(history, planned, sent, still, dt) -> history``."""
    size = count(StepModel(problem).history.sizes)
    history, dt, planned, sent, still = (
        ca.MX.sym("h", size),
        ca.MX.sym("dt"),
        ca.MX.sym("u", 6),
        ca.MX.sym("s", 6),
        ca.MX.sym("z"),
    )
    found = under_way(StepModel(problem), history, dt)
    after = ca.vertcat(*next_history(StepModel(problem), history, found, planned, sent, still))
    seen = [found[name] for name in FOUND if name in found]
    return ca.Function("seen", [history, dt], seen), ca.Function(
        "after", [history, planned, sent, still, dt], [after]
    )


class Plan:
    """The planned twist as a line between knots, and what was sent, kept for ever."""

    def __init__(self) -> None:
        self.times, self.twists, self.sent = [0.0], [np.zeros(6)], []

    def at(self, times: Any) -> np.ndarray:
        return np.array(
            [
                np.interp(times, self.times, np.array(self.twists)[:, axis], left=0.0)
                for axis in range(6)
            ]
        )

    def remaining(self, now: float, robot: DeclaredRobot) -> np.ndarray:
        """What a robot has not done of what was sent, by the integral of what is left of each
        moment."""
        owed = np.zeros(6)
        for begin, end, twist in self.sent:
            ages = now - np.linspace(begin, end, 401)
            left = np.where(
                ages < robot.dead_time,
                1.0,
                np.exp(-np.maximum(ages - robot.dead_time, 0) / max(robot.lag, 1e-9)),
            )
            owed += twist * np.trapezoid(left, dx=(end - begin) / 400) if end > begin else 0.0
        return owed


@pytest.mark.parametrize("seed", [0, 1])
def test_mean_and_what_is_under_way_are_those_of_a_finely_sampled_plan(seed: int) -> None:
    problem = problem_of("screwing").replace(robot=ROBOT)
    W, rng, plan = problem.average, np.random.default_rng(seed), Plan()
    seen, after = functions(problem)
    history = np.concatenate(
        [
            part.ravel(order="F")
            for part in initial_history(StepModel(problem).history, np.zeros(6)).values()
        ]
    )
    now, twist = 0.0, np.zeros(6)
    for _ in range(80):
        dt = float(rng.uniform(0.007, 0.03))
        target = twist + rng.uniform(-1, 1, 6) * 2.0 * dt
        found = dict(
            zip(FOUND, (np.array(part).ravel() for part in seen(history, dt)), strict=True)
        )
        assert found["fits"]
        sent = found["begun"] + found["own"] * target
        plan.times.append(now + dt)
        plan.twists.append(target)
        window = np.linspace(now + dt - W, now + dt, 4001)
        np.testing.assert_allclose(sent, plan.at(window).mean(axis=1), atol=2e-5)
        window = np.linspace(now - W, now, 4001)
        unsent = (plan.at(window) * (window - (now - W)) / W).mean(axis=1) * W + twist * dt / 2
        owed = plan.remaining(now, ROBOT)
        np.testing.assert_allclose(found["owed"], owed, atol=3e-5)
        np.testing.assert_allclose(found["total"], unsent + owed, atol=5e-5)
        np.testing.assert_allclose(found["up"] - found["down"], owed, atol=3e-5)
        assert np.all(found["up"] >= -1e-12)
        assert found["turn"] >= np.linalg.norm(owed[3:]) - 1e-6
        plan.sent.append((now, now + dt, sent))
        history = np.array(after(history, target, sent, 0.0, dt)).ravel()
        now, twist = now + dt, target


def test_an_object_that_moved_for_ever_owes_its_whole_delay() -> None:
    problem = problem_of("screwing").replace(robot=ROBOT)
    twist = np.array([0.1, 0.0, -0.05, 0.0, 0.3, 0.0])
    history = np.concatenate(
        [
            part.ravel(order="F")
            for part in initial_history(StepModel(problem).history, twist).values()
        ]
    )
    found = dict(
        zip(
            FOUND,
            (np.array(part).ravel() for part in functions(problem)[0](history, 0.01)),
            strict=True,
        )
    )
    np.testing.assert_allclose(found["owed"], twist * (ROBOT.dead_time + ROBOT.lag), rtol=1e-12)
    np.testing.assert_allclose(found["begun"] + found["own"] * twist, twist, rtol=1e-12)
    assert not found["parked"]
    parts = split(StepModel(problem).history.sizes, history)
    assert np.all(np.asarray(parts["ages"]) == FAR)


def test_periods_that_are_too_short_are_noticed() -> None:
    problem = problem_of("screwing")
    seen, after = functions(problem)
    history = np.concatenate(
        [
            part.ravel(order="F")
            for part in initial_history(StepModel(problem).history, np.zeros(6)).values()
        ]
    )
    fits, twist, dt = [], np.full(6, 0.01), 0.002
    for _ in range(40):
        found = seen(history, dt)
        fits.append(bool(found[FOUND.index("fits")]))
        history = np.array(after(history, twist, twist, 0.0, dt)).ravel()
    assert fits[0]
    assert not fits[-1]
    # What the history has lost is taken to have been its oldest twist all along, which a steady
    # plan was.
    np.testing.assert_allclose(
        np.array(found[FOUND.index("total")]).ravel(), twist * (problem.average + dt) / 2, rtol=1e-9
    )


@pytest.mark.parametrize(
    "robot",
    [DeclaredRobot(), DeclaredRobot(delay=0.02, lag=0.05, gain_error=0.1, pose_noise=0.002)],
)
def test_what_an_end_cannot_count_on_is_that_of_a_finely_sampled_plan(robot: DeclaredRobot) -> None:
    """The plan speeds up along x alone: nothing under way is credited at the lower end, all of it
    counts at the upper."""
    problem = problem_of("screwing").replace(robot=robot)
    W, plan, dt, axis = problem.average, Plan(), 0.01, np.eye(6)[0]
    _, after = functions(problem)
    size, symbols = (
        count(StepModel(problem).history.sizes),
        [ca.MX.sym("pose", 4, 4), ca.MX.sym("dt")],
    )
    past = ca.MX.sym("history", size)
    found = under_way(StepModel(problem), past, symbols[1])
    counted = ca.Function(
        "counted",
        [*symbols, past],
        list(
            landing(
                StepModel(problem), found, {"pose": symbols[0], **undisturbed(StepModel(problem))}
            ).values()
        ),
    )
    planned = ca.Function("planned", [past, symbols[1]], [found["begun"], found["own"]])
    history = np.concatenate(
        [
            part.ravel(order="F")
            for part in initial_history(StepModel(problem).history, np.zeros(6)).values()
        ]
    )
    for number in range(1, 8):
        twist = 0.02 * number * axis
        begun, own = (np.array(part).ravel() for part in planned(history, dt))
        sent = begun + own * twist
        plan.times.append(number * dt)
        plan.twists.append(twist)
        plan.sent.append(((number - 1) * dt, number * dt, sent))
        history = np.array(after(history, twist, sent, 0.0, dt)).ravel()
    now = 7 * dt
    ages = np.linspace(0, W, 20001)
    speeds = plan.at(now - ages)[0]
    left = np.trapezoid(speeds * (1 - ages / W), ages) + speeds[0] * dt / 2
    left += plan.remaining(now, robot)[0] if robot.lag else 0.0
    rise = 3 * problem.dt * np.trapezoid(np.maximum(speeds[0] - speeds, 0), ages) / W
    lost = StepModel(problem).under_way.split(np.array(counted(np.eye(4), dt, history)[1]).ravel())[
        "margin_reduction"
    ]["workspace x"]
    below, above = (float(end[0]) for end in lost)
    assert rise > 1e-3
    # At the upper end what is under way is where the object lands; beyond it there are the rise,
    # the gain error and the noise.
    assert above == pytest.approx(
        (1 + robot.gain_error) * rise + robot.gain_error * left + robot.pose_noise, abs=3e-5
    )
    assert below == pytest.approx(left + robot.pose_noise, abs=3e-5)


def undisturbed(model: StepModel) -> dict[str, ca.MX]:
    """What `landing` takes of an object that is where it is measured, in no region."""
    return {name: ca.MX(ca.DM.zeros(*model.size(name))) for name in ("astray", "readings")}


def initial(problem: Problem) -> np.ndarray:
    """The history of an object that stands still, as one vector."""
    parts = initial_history(StepModel(problem).history, np.zeros(6))
    return np.concatenate([part.ravel(order="F") for part in parts.values()])


def lands(
    problem: Problem, history: np.ndarray, unsure: np.ndarray | None = None, held: bool = False
) -> dict[str, Any]:
    """What is under way, for limits, of an object at a pose of no consequence."""
    past, dt = ca.MX.sym("history", history.size), ca.MX.sym("dt")
    model = StepModel(problem)
    known = {"pose": ca.MX(ca.DM.eye(4)), **undisturbed(model)}
    if unsure is not None:
        known["doubt"] = ca.MX(ca.DM(unsure))
    counted = landing(model, under_way(model, past, dt), known)["way"]
    found = ca.Function("lands", [past, dt], [counted])(history, 0.01)
    return model.under_way.split(np.array(found).ravel(), held)


@pytest.mark.slow
@pytest.mark.parametrize("gain_error", [0.0, 0.1])
def test_a_hold_on_to_what_left_the_history_fades_with_the_lag(gain_error: float) -> None:
    """A twist of one period that was held on to: of its v h the robot still owes v tau (1 - exp(-h
    / tau)) exp(-t / tau)."""
    lag, hold, twist = 0.2, 0.3, np.array([0.1, 0, 0, 0, 0.2, 0])
    robot = DeclaredRobot(lag=lag, longest_hold=hold, gain_error=gain_error)
    base = problem_of("screwing")
    problem = base.replace(robot=robot, control=replace(base.control, average=0.0))
    _, after = functions(problem)
    history = np.concatenate(
        [
            part.ravel(order="F")
            for part in initial_history(StepModel(problem).history, np.zeros(6)).values()
        ]
    )
    for number in range(60):
        sent = twist * (number == 0)
        history = np.array(after(history, sent, sent, 0.0, 0.01)).ravel()
        if number < 3:
            continue
        way, other = lands(problem, history), lands(problem, history, held=True)
        left = (
            (1 + gain_error) * lag * (1 - np.exp(-hold / lag)) * np.exp(-0.01 * (number - 1) / lag)
        )
        held = float(
            other["margin_reduction"]["workspace x"][1][0]
            - way["margin_reduction"]["workspace x"][1][0]
        )
        assert left * 0.1 * 0.9 <= held <= left * 0.1 * 1.1
        # The lower end does not come nearer.
        assert other["margin_reduction"]["workspace x"][0][0] == pytest.approx(
            way["margin_reduction"]["workspace x"][0][0], abs=1e-12
        )
        assert left * 0.2 * 0.9 <= float(other["turn"][0] - way["turn"][0]) <= left * 0.2 * 1.1


def test_at_rest_a_cone_keeps_free_how_its_slope_may_be_mistaken_and_nothing_else() -> None:
    base = problem_of("screwing")
    problem = base.replace(
        robot=DeclaredRobot(pose_noise_deg=0.5), control=replace(base.control, average=0.2)
    )
    history = np.concatenate(
        [
            part.ravel(order="F")
            for part in initial_history(StepModel(problem).history, np.zeros(6)).values()
        ]
    )
    way = lands(problem, history)
    assert float(way["turn"][0]) == pytest.approx(np.sqrt(3) * np.radians(0.5))
    still = lands(problem.replace(robot=DeclaredRobot()), history)
    assert (
        float(still["margin_reduction"]["tool axis"][1][0])
        == float(still["direction_error"][0])
        == float(still["overshoot_angle"][0])
        == 0
    )


def test_what_an_object_may_be_behind_is_kept_free_at_the_ends_that_it_is_nearer_to() -> None:
    """Up to 2 mm less far along x than it is reckoned: nearer to the lower end, and no nearer to
    the upper one."""
    problem = problem_of("screwing").replace(robot=DeclaredRobot(delay=0.03))
    history = np.concatenate(
        [
            part.ravel(order="F")
            for part in initial_history(StepModel(problem).history, np.zeros(6)).values()
        ]
    )
    unsure = np.zeros((6, 2))
    unsure[0], unsure[1], unsure[4] = (0.002, 0.001), (0.003, 0.0), (0.02, 0.03)
    known, behind = lands(problem, history), lands(problem, history, unsure)
    for end, expected in ((0, [0.002, 0.003, 0.0]), (1, [0.001, 0.0, 0.0])):
        more = np.array(behind["margin_reduction"]["workspace x"][end]) - np.array(
            known["margin_reduction"]["workspace x"][end]
        )
        np.testing.assert_allclose(more.ravel(), expected, atol=1e-15)
    # It may be turned as much less, and how that bends is kept free too.
    assert float(behind["turn"][0] - known["turn"][0]) == pytest.approx(0.03)


def test_what_is_taken_over_and_not_seen_may_be_behind_from_its_first_posture_on() -> None:
    problem = problem_of("screwing").replace(robot=DeclaredRobot(delay=0.03))
    stepper, twist = (
        Stepper(problem),
        0.5 * problem.twist_limit.speed * np.array([1, -1, 0, 0, 1, 0]),
    )
    stepper.reset(twist=twist)
    for _ in range(3):
        state = split(
            StepModel(problem).state, stepper.step(problem.response.comfort).account("next_state")
        )
        unsure = np.array(state["unsure"]).T
        np.testing.assert_allclose(
            unsure, 0.03 * np.array([np.maximum(twist, 0), np.maximum(-twist, 0)]), atol=1e-12
        )


@pytest.mark.parametrize("angle", [0.2, 0.0])
def test_where_an_object_may_be_beside_its_computed_pose_is_kept_free(angle: float) -> None:
    """Nearer to the upper ends by what it may be ahead, to the lower ones by what it may be behind;
    an angle counts for the cone in full, in its middle too."""
    problem, astray = problem_of("screwing"), [0.01, 0.02, 0.03, 0.004, 0.005, 0.006, 0.1]
    model, lost, pose = StepModel(problem), {}, np.eye(4)
    pose[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    for name, off in (("none", np.zeros(7)), ("some", np.array(astray))):
        known = {"pose": ca.MX(ca.DM(pose)), **undisturbed(model), "astray": ca.MX(ca.DM(off))}
        past, dt = ca.MX.sym("history", initial(problem).size), ca.MX.sym("dt")
        counted = landing(model, under_way(model, past, dt), known)["way"]
        found = ca.Function("lands", [past, dt], [counted])(initial(problem), 0.01)
        lost[name] = model.under_way.split(np.array(found).ravel())["margin_reduction"]
    for first, below, above in (
        ("workspace x", astray[3:6], astray[:3]),
        ("tool axis", astray[6], astray[6]),
    ):
        ends = [lost["some"][first][end] - lost["none"][first][end] for end in (0, 1)]
        np.testing.assert_allclose(ends[0], below, atol=1e-12)
        np.testing.assert_allclose(ends[1], above, atol=1e-12)


def test_what_may_be_inside_is_not_asked_back() -> None:
    problem, q = problem_of("screwing"), comfort_of("screwing")
    box, model = problem.limit_of(WorkspaceBox), StepModel(problem)
    row, pose = problem.row_names.index("workspace x"), held_pose("screwing").copy()
    pose[0, 3] = box.upper[0] + 0.02
    for astray, asks in ((0.03, False), (0.01, True)):
        off = np.r_[astray, np.zeros(6)]
        readings = model.readings(q, pose)
        away, doubted = away_function(model)(q, np.ones(32), readings, pose, 1, off)
        assert (np.array(away).ravel()[row] > 0) == asks
        # The margin to the end, and what may be less of it.
        assert float(doubted[row]) == pytest.approx(astray)
        assert float(doubted[problem.row_names.index("workspace y")]) == 0


def test_of_a_row_that_touches_a_region_the_whole_way_beside_counts() -> None:
    """Its direction follows from the computed position, and is another at the true one."""
    row, off = ca.SX(1, 6), ca.SX([0.03, 0.0, 0.0, 0.0, 0.04, 0.0, 0.2])
    row[0, 2] = 1.0
    for tangent, expected in ((True, 0.05), (False, 0.0)):
        limit: Any = SimpleNamespace(names=("region",), unit="m", tangent=tangent)
        ends = [float(end) for end in off_rows(row, off, [limit])]
        assert ends == pytest.approx([expected, expected])
        # A turn moves the row by its slope at most.
        row[0, 3:] = [0.0, 0.3, 0.4]
        ends = [float(end) for end in off_rows(row, off, [limit])]
        assert ends == pytest.approx([expected + 0.1, expected + 0.1])
        row[0, 3:] = 0
