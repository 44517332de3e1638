"""A term that gives no usable number brakes the object, and the reason names it."""

from __future__ import annotations

import re
import time
from dataclasses import dataclass, field, replace
from typing import Any, cast

import casadi as ca
import numpy as np
import pytest

from ergoqp.coordinates import Coordinates
from ergoqp.errors import InputError, ProblemError
from ergoqp.joints import JOINTS
from ergoqp.limits import LimitContext, OneClassBoundary, Rows, TwistLimit, WorkspaceBox
from ergoqp.limits.limit import straight_margins
from ergoqp.problem.problem import Problem
from ergoqp.problem.settings import Control
from ergoqp.step.certification import Margins, _shorten_function, smallest_margins
from ergoqp.step.function import step_function
from ergoqp.step.model import StepModel
from ergoqp.step.qp import qp_data
from ergoqp.step.stepper import Stepper

SOLVERS = ("daqp", "osqp", "highs")

Spoiled = dict[str, Any]
"""What is spoiled, and by which number. Terms are made with an empty one, which is filled once the
problem is made, so that its checks see nothing."""


def spoiled(value: Any, where: Any, bad: float | None) -> Any:
    """`value`, or `bad` where `where` is positive."""
    return value if bad is None else ca.if_else(where > 0, bad, value)


@dataclass(frozen=True, eq=False)
class Pull:
    """Draws the first six angles to zero."""

    bad: Spoiled = field(default_factory=dict)
    name = "pull"
    minimum = 0.0

    def __call__(self, postures: Any) -> np.ndarray:
        return 2.5 * (np.atleast_2d(postures)[:, :6] ** 2).sum(axis=1)

    def expression(self, q: Any) -> Any:
        value = 2.5 * ca.sumsqr(q[:6])
        if "ahead" in self.bad:
            # The domain ends a little ahead of where the posture is.
            return ca.if_else(q[0] > -2.999, np.nan, value)
        if "slope" in self.bad:
            value += ca.sqrt(ca.fmax(0, -q[0] - 3))  # infinite slope at its edge
        return spoiled(value, q[1], self.bad.get("value"))


@dataclass(frozen=True, eq=False)
class Direct:
    """Six angles are the object's six coordinates."""

    bad: Spoiled = field(default_factory=dict)
    coordinates = JOINTS
    largest = float(np.pi)
    joints = JOINTS[:6]
    weight_vector = np.ones(32)
    comfort = np.zeros(32)

    def expression(self, q: Any) -> Any:
        return self.sensitivity()(q, 0)[0]

    def sensitivity(self) -> ca.Function:
        q, locked = ca.SX.sym("q", 32), ca.SX.sym("locked", 32)
        S, E = ca.SX(32, 6), ca.SX(1, 6)
        for i in range(6):
            S[i, i] = 1 - locked[i]
        S[0, 0] = spoiled(S[0, 0], q[1], self.bad.get("S"))
        E[0, 0] = spoiled(E[0, 0], q[1], self.bad.get("E"))
        return ca.Function("sensitivity", [q, locked], [ca.densify(S), ca.densify(E)])

    def contact(self) -> ca.Function:
        q = ca.SX.sym("q", 32)
        pose = ca.SX.eye(4)
        pose[:3, 3] = 0.5
        pose[0, 3] = spoiled(pose[0, 3], q[1], self.bad.get("contact"))
        return ca.Function("contact", [q], [ca.densify(pose), ca.densify(ca.SX.eye(4))])


@dataclass(frozen=True, eq=False)
class Wall:
    """x stays below 0.6 m; numbers are spoiled beyond 0.55 m."""

    bad: Spoiled = field(default_factory=dict)
    linear: bool = False
    tolerance: float = 1e-6
    recovery_time: float = 2.0
    names = ("wall",)
    unit = "m"
    hard = True
    recovers = (True,)
    yield_zone = 0.0
    margin_is_lower_bound = False

    def measure(self) -> None:
        return None

    def rows(self, context: LimitContext) -> Rows:
        beyond = context.pose[0, 3] - 0.55
        left = 0.6 - context.pose[0, 3]
        none, zero = left * 0 + ca.inf, left * 0
        ends = {"to_lower": none, "to_upper": left, "rate": none, "curvature_margin": zero}
        ends = {name: spoiled(end, beyond, self.bad.get(name)) for name, end in ends.items()}
        one = spoiled(zero + 1, beyond, self.bad.get("matrix"))
        return context.reduced("wall", Rows(ca.horzcat(one, *[zero] * 5), **ends))

    def margins(self, context: LimitContext, displacement: Any) -> Any:
        least = straight_margins(self.rows(context), displacement)
        if "margins ahead" in self.bad:
            return spoiled(least, context.pose[0, 3] + displacement[0] - 0.55, np.nan)
        if "margins here" in self.bad:
            return spoiled(least, 1e-14 - ca.sumsqr(displacement), np.nan)
        return spoiled(least, context.pose[0, 3] - 0.55, self.bad.get("margins"))


@dataclass(frozen=True, eq=False)
class Lean:
    """The second angle stays above -3 rad, by a reading."""

    bad: Spoiled = field(default_factory=dict)
    linear: bool = False
    tolerance: float = 1e-6
    recovery_time: float = 2.0
    names = ("lean",)
    unit = "rad"
    hard = False
    recovers = (False,)
    yield_zone = 0.0
    margin_is_lower_bound = False

    def measure(self) -> ca.Function:
        q = ca.MX.sym("q", 32)
        return ca.Function("measure", [q], [spoiled(q[1] + 3, q[1], self.bad.get("readings"))])

    def rows(self, context: LimitContext) -> Rows:
        left = context.readings["lean"] + context.shift[1]
        none, zero = left * 0 + ca.inf, left * 0
        below = spoiled(left, context.posture[1], self.bad.get("to_lower"))
        return Rows(context.sensitivity[1, :], below, none, none, zero)

    def margins(self, context: LimitContext, displacement: Any) -> Any:
        return straight_margins(self.rows(context), displacement)


BOX = WorkspaceBox((0, 0, 0), (1, 1, 1))


def problem_with(response: Any = None, cost: Any = None, limits: Any = ()) -> Problem:
    quiet = Control(comfort=0.0, stall_after=1e6, rest_below=0.0, move_above=0.0)
    return Problem(
        cost=cost or Pull(),
        response=response or Direct(),
        limits=[TwistLimit(0.2, 0.6, 0.6, 2.0), BOX, *limits],
        control=quiet,
    )


def begin() -> np.ndarray:
    """The pose at the start: in the middle."""
    pose = np.eye(4)
    pose[:3, 3] = 0.5
    return pose


def loop(
    stepper: Stepper, posture: np.ndarray, steps: int, pose: np.ndarray | None = None
) -> list[Any]:
    """Steps of an ideal robot, with x before each; `pose` is moved."""
    found, pose = [], begin() if pose is None else pose
    for _ in range(steps):
        step = stepper.step(posture, pose.copy())
        found.append((pose[0, 3], step))
        pose[:3, 3] += step.twist[:3] * stepper.dt
    return found


COST = "cost: got a value of pull that is NaN or infinite"
SENSITIVITY = "response: got a sensitivity that is NaN or infinite"

FORWARD = np.r_[-3.0, np.zeros(31)]
"""The cost draws the object along x."""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("where", "solver"),
    [
        *((where, "daqp") for where in ("margins ahead", "to_upper", "rate", "curvature_margin")),
        *((where, solver) for where in ("margins", "to_lower", "matrix") for solver in SOLVERS),
    ],
)
def test_nan_of_a_limit_brakes_and_is_named(where: str, solver: str) -> None:
    wall = Wall()
    problem = problem_with(limits=[wall])
    wall.bad[where] = np.nan
    steps = loop(Stepper(problem, solver=solver), FORWARD, 120)
    assert 0.55 - 0.02 < max(x for x, _ in steps) < 0.6  # it gets there, and no further than a stop
    beyond = [step for x, step in steps if x > 0.5501]
    if where != "margins ahead":
        assert len(beyond) > 50
        assert all(step.status == "braking" for step in beyond[1:])
    else:
        assert max(x for x, _ in steps) < 0.5501
    named = "limits: got NaN in rows or margins of wall, allowed numbers"
    told = [step for _, step in steps if step.reason == named]
    assert told
    assert {step.status for step in told} == {"braking"}
    if solver == "daqp":
        assert {step.reason for _, step in steps} == {"", named}


@pytest.mark.slow
@pytest.mark.parametrize("where", ["readings", "to_lower"])
@pytest.mark.parametrize("linear", [False, True])
def test_nan_of_a_limit_of_the_posture_is_named(linear: bool, where: str) -> None:
    lean = Lean(linear=linear)
    problem = problem_with(limits=[lean])
    lean.bad[where] = np.nan
    stepper, posture, pose = Stepper(problem), FORWARD.copy(), begin()
    assert loop(stepper, posture, 20, pose)[-1][1].status == "optimal"
    posture[1] = 0.1
    step = loop(stepper, posture, 1, pose)[0][1]
    assert step.status == "braking"
    assert step.reason == "limits: got NaN in rows or margins of lean, allowed numbers"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("where", "bad", "reason", "solver"),
    [
        *(("value", np.nan, COST, solver) for solver in SOLVERS),
        ("value", np.inf, COST, "daqp"),
        ("value", 1e200, COST, "daqp"),
        *(("S", np.nan, SENSITIVITY, solver) for solver in SOLVERS),
        ("S", np.inf, SENSITIVITY, "daqp"),
        ("E", np.nan, "response: got contact motion that cannot be followed that is NaN", "daqp"),
        ("contact", np.nan, "response: got a contact that is no rigid pose", "daqp"),
        ("contact", np.inf, "response: got a contact that is no rigid pose", "daqp"),
    ],
)
def test_bad_numbers_of_cost_and_response_are_named(
    where: str, bad: float, reason: str, solver: str
) -> None:
    cost, response = Pull(), Direct()
    problem = problem_with(response, cost)
    (cost if where == "value" else response).bad[where] = bad
    stepper, spoils = Stepper(problem, solver=solver), FORWARD.copy()
    spoils[1] = 0.1
    if where == "contact" or solver == "highs":
        # The first pose would be that of the posture. HiGHS solves few of these QPs to 1e-6.
        step = stepper.step(spoils)
    else:
        pose = begin()
        assert loop(stepper, FORWARD, 30, pose)[-1][1].twist[0] > 0.05
        steps = [step for _, step in loop(stepper, spoils, 60, pose)]
        assert {step.status for step in steps} == {"braking"}
        assert not steps[-1].twist.any()
        step = steps[0]
    assert step.status == "braking"
    assert step.reason.startswith(reason), step.reason
    # The next good posture moves the object again: no NaN stays in the state.
    good = [stepper.step(FORWARD) for _ in range(30)]
    if solver != "highs":
        assert good[-1].status == "optimal"
        assert good[-1].twist[0] > 0.05
    assert np.isfinite(good[-1].account("next_state")).all()
    if where == "contact":
        np.testing.assert_allclose(good[0].pose[:3, 3], 0.5, atol=1e-12)


def test_a_cost_without_a_number_is_named_on_the_floor_too() -> None:
    cost, pose = Pull(), begin()
    problem = problem_with(cost=cost)
    cost.bad["value"] = np.nan
    pose[2, 3] = 0.0
    spoils = FORWARD.copy()
    spoils[1] = 0.1
    step = Stepper(problem).step(spoils, pose)
    assert step.reason.startswith(COST), step.reason


def test_a_slope_and_a_cost_ahead_without_a_number_are_named() -> None:
    for where, reason in (
        ("slope", "cost: got a slope of pull"),
        ("ahead", "cost: got a value on the way ahead of pull"),
    ):
        cost = Pull()
        problem = problem_with(cost=cost)
        cost.bad[where] = 1.0
        step = Stepper(problem).step(FORWARD)
        assert step.status == "braking"
        assert step.reason.startswith(reason)


@pytest.mark.slow
@pytest.mark.parametrize("solver", ["daqp", "osqp"])
def test_terms_without_a_fault_say_nothing(solver: str) -> None:
    stepper = Stepper(problem_with(limits=[Wall(linear=True), Lean()]), solver=solver)
    steps = loop(stepper, FORWARD, 300)
    assert not any(step.reason for _, step in steps if "QP" not in step.reason)
    assert not any(step.account("amiss").any() for _, step in steps)
    assert 0.599 < steps[-1][0] <= 0.6


@pytest.mark.slow
def test_the_compiled_step_brakes_by_the_same_names() -> None:
    wall, cost = Wall(), Pull()
    problem = problem_with(cost=cost, limits=[wall])
    wall.bad["to_lower"] = cost.bad["value"] = np.nan
    plain, compiled = Stepper(problem), Stepper(problem, compiled=True)
    postures = [FORWARD] * 80 + [FORWARD + 0.1 * np.eye(32)[1]] * 3
    reasons = set()
    poses = begin(), begin()
    for posture in postures:
        a, b = (
            loop(stepper, posture, 1, pose)[0][1]
            for stepper, pose in zip((plain, compiled), poses, strict=True)
        )
        assert (a.status, a.reason) == (b.status, b.reason)
        np.testing.assert_allclose(a.twist, b.twist, atol=1e-9)
        reasons.add(a.reason)
    assert any("wall" in reason for reason in reasons)
    assert any("pull" in reason for reason in reasons)


def test_nan_of_the_present_margin_alone_is_named() -> None:
    wall = Wall()
    problem = problem_with(limits=[wall])
    wall.bad["margins here"] = True
    step = Stepper(problem).step(FORWARD)
    assert step.status == "braking"
    assert step.reason == "limits: got NaN in rows or margins of wall, allowed numbers"
    assert np.flatnonzero(step.account("amiss")).tolist() == [5 + problem.row_names.index("wall")]


@pytest.mark.parametrize("linear", [False, True])
@pytest.mark.parametrize("where", ["to_lower", "to_upper", "rate", "curvature_margin", "matrix"])
def test_present_margins_and_the_objective_keep_the_nan_of_a_row(where: str, linear: bool) -> None:
    wall = Wall(linear=linear)
    problem = problem_with(limits=[wall])
    wall.bad[where] = np.nan
    model, pose = StepModel(problem), begin()
    pose[0, 3] = 0.56
    known = model.symbols(("posture", "observed", "readings", "pose", "S"), ca.MX)
    now = ca.Function("now", list(known.values()), [Margins(model, known).now])
    found = np.array(now(FORWARD, np.ones(32), [], pose, np.eye(32, 6))).ravel()
    assert np.isnan(found).tolist() == [name == "wall" for name in problem.row_names]
    data = qp_data(problem)(
        posture=FORWARD, observed=1, pose=pose, previous=0, dt=0.01, stalled=0, locked=0, final=0
    )
    assert np.isnan(np.array(data["A" if where == "matrix" else "g"])).any()


def test_no_share_of_the_way_is_certified_by_nan() -> None:
    class Hole(Wall):
        """Margins that are negative far ahead, NaN less far, and positive here."""

        def margins(self, context: LimitContext, displacement: Any) -> Any:
            ahead = displacement[0]
            near = ca.if_else(ahead > 0.75 * full, -1, 1 if holds else np.nan)
            return ca.if_else(ahead > 1e-9, near, 1)

    wanted, dt = np.r_[0.1, np.zeros(5)], 0.01
    full = float(problem_with().stop.displacement(ca.SX(ca.DM(wanted)), ca.SX(dt))[0])
    for holds in (True, False):
        hole = Hole()
        problem = problem_with(limits=[])
        object.__setattr__(problem, "limits", (*problem.limits, hole))
        vars(problem).pop("row_limits", None)
        vars(problem).pop("row_names", None)
        model = StepModel(problem)
        function = _shorten_function(model)
        sizes = {name: np.zeros(model.size(name)) for name in function.name_in()}
        given = sizes | {"landed": begin(), "wanted": wanted, "dt": dt, "observed": np.ones(32)}
        given["now"] = np.ones(model.size("now"))
        share = float(function(**given)["share"][0])
        assert share == (0.5 if holds else 0.0)


def test_a_hold_does_not_hide_nan() -> None:
    class Far(Wall):
        def margins(self, context: LimitContext, displacement: Any) -> Any:
            return ca.if_else(displacement[0] > 0.5, np.nan, ca.DM([1.0]))

    ways = ca.DM([[0.0, 1.0], *[[0.0, 0.0]] * 5])
    here: Any = None
    for order in ([0, 1], [1, 0]):
        found = smallest_margins(Far(), (here, here), ways[:, order])
        assert np.isnan(float(found))


def test_a_model_of_a_user_that_gives_nan_is_named() -> None:
    class Model:
        """What a boundary needs of a one-class machine."""

        coordinates = Coordinates(JOINTS[:2])
        gamma, scale = 1.0, np.ones(2)

        @property
        def margin_and_slope(self) -> ca.Function:
            x = ca.MX.sym("x", 2)
            value = ca.if_else(x[1] > 0, np.nan, 1.0)
            return ca.Function("margin", [x], [value, ca.MX(ca.DM.zeros(2))])

    boundary: Any = OneClassBoundary(cast("Any", Model()))
    stepper, posture = Stepper(problem_with(limits=[boundary])), FORWARD.copy()
    assert stepper.step(posture).reason == ""
    posture[1] = 0.1
    step = stepper.step(posture)
    assert step.status == "braking"
    assert step.reason == "limits: got NaN in rows or margins of boundary, allowed numbers"


class AskedCost(ca.Callback):
    """A cost in Python, which can raise or be slow; the steps of its `does` come first."""

    def __init__(self, size: int = 32) -> None:
        ca.Callback.__init__(self)
        self.does: Any = lambda q: None
        self.size = size
        self.construct("asked", {"enable_fd": True})

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        return ca.Sparsity.dense(self.size, 1)

    def eval(self, arguments: Any) -> Any:
        q = np.array(arguments[0]).ravel()
        self.does(q)
        return [2.5 * (q[:6] ** 2).sum()]


class AsPlain(Pull):
    """`Pull` through Python, with the four members that every cost has."""

    asked = AskedCost(6)

    def expression(self, q: Any) -> Any:
        return self.asked(q[:6])


class InPython(Pull):
    """`Pull` through Python."""

    dense = True
    asked = AskedCost()

    def expression(self, q: Any) -> Any:
        return self.asked(q)

    def value_and_gradient(self, q: Any) -> Any:
        return self.asked(q), 5 * ca.vertcat(q[:6], ca.MX(26, 1))


@pytest.mark.slow
@pytest.mark.parametrize("cost", [InPython(), AsPlain()], ids=["dense", "plain"])
@pytest.mark.parametrize("solver", ["daqp", "osqp"])
def test_a_cost_that_raises_brakes_and_is_named(solver: str, cost: Any) -> None:
    stepper, pose = Stepper(problem_with(cost=cost), solver=solver), begin()
    before = loop(stepper, FORWARD, 30, pose)[-1][1]
    assert before.twist[0] > 0.05

    def does(q: np.ndarray) -> None:
        raise OSError("the card is gone")

    try:
        cost.asked.does = does
        steps = [step for _, step in loop(stepper, FORWARD, 60, pose)]
        assert not stepper.brake().twist.any()
        assert not stepper.stop().any()
    finally:
        cost.asked.does = lambda q: None
    # On a busy machine a step may be late as well.
    assert {step.reason.partition("; the step took")[0] for step in steps} == {
        "cost: pull: got an error (the card is gone), allowed a number"
    }
    assert {step.status for step in steps} == {"braking"}
    sent = np.array([before.twist, *(step.twist for step in steps)])
    assert np.abs(np.diff(sent[:, 0])).max() <= 0.6 * 0.01 + 1e-9
    assert not sent[-1].any()
    assert loop(stepper, FORWARD, 30, pose)[-1][1].twist[0] > 0.05


@pytest.mark.slow
def test_an_interrupt_within_a_term_is_no_error_of_it() -> None:
    cost = AsPlain()
    stepper = Stepper(problem_with(cost=cost))
    stepper.step(FORWARD)
    before = stepper.state()

    def does(q: np.ndarray) -> None:
        raise KeyboardInterrupt

    try:
        cost.asked.does = does
        for call in (lambda: stepper.step(FORWARD), stepper.brake, stepper.stop):
            with pytest.raises(KeyboardInterrupt):
                call()
    finally:
        cost.asked.does = lambda q: None
    np.testing.assert_array_equal(stepper.state(), before)
    assert stepper.step(FORWARD).status == "optimal"


class Nothing(AskedCost):
    """Adds nothing to a response, but asks Python for it."""

    def eval(self, arguments: Any) -> Any:
        self.does(np.array(arguments[0]).ravel())
        return [0.0]


class DirectInPython(Direct):
    """`Direct`, one of whose functions asks Python."""

    asked = Nothing()

    def __init__(self, which: str) -> None:
        super().__init__()
        object.__setattr__(self, "which", which)

    def _through(self, function: ca.Function) -> ca.Function:
        if self.which != function.name():  # type: ignore[attr-defined]
            return function
        inputs = function.mx_in()
        first, *others = function.call(inputs)
        first *= 1 + self.asked(inputs[0])
        return ca.Function(function.name(), inputs, [first, *others])

    def sensitivity(self) -> ca.Function:
        return self._through(super().sensitivity())

    def contact(self) -> ca.Function:
        return self._through(super().contact())


@pytest.mark.slow
@pytest.mark.parametrize("which", ["contact", "sensitivity"])
def test_a_response_that_raises_brakes_and_is_named(which: str) -> None:
    response = DirectInPython(which)
    stepper, pose = Stepper(problem_with(response=response)), begin()
    before = loop(stepper, FORWARD, 30, pose)[-1][1]
    assert before.twist[0] > 0.05

    def does(q: np.ndarray) -> None:
        raise OSError("the card is gone")

    try:
        response.asked.does = does
        steps = [step for _, step in loop(stepper, FORWARD, 60, pose)]
        stepper.reset()
        steps.append(stepper.step(FORWARD))
    finally:
        response.asked.does = lambda q: None
    sent = np.array([before.twist, *(step.twist for step in steps)])
    assert np.abs(np.diff(sent[:-1, 0])).max() <= 0.6 * 0.01 + 1e-9
    named = "response: DirectInPython: got an error (the card is gone), allowed a number"
    reasons = [step.reason.partition("the step took")[0].removesuffix("; ") for step in steps]
    assert reasons[-1] == named
    assert set(reasons) <= {"", named}
    if which == "sensitivity":
        assert {step.status for step in steps} == {"braking"}


class WallInPython(Wall):
    """`Wall`, whose end asks Python."""

    asked = AskedCost()

    def rows(self, context: LimitContext) -> Rows:
        rows = super().rows(context)
        return replace(rows, to_upper=rows.to_upper + 1e-9 * self.asked(context.posture))


@pytest.mark.slow
def test_what_calls_python_where_it_cannot_is_refused() -> None:
    limit = WallInPython()
    rows = replace(limit, linear=True)
    for wall in (limit, rows):
        with pytest.raises(ProblemError, match="limits: got rows or margins that call 'asked' in"):
            Stepper(problem_with(limits=[wall]))
    with pytest.raises(InputError, match="compiled: got cost: pull, which calls Python"):
        step_function(problem_with(cost=AsPlain()), compiled=True)


def test_a_step_that_a_slow_term_made_late_says_so() -> None:
    cost = InPython()
    try:
        cost.asked.does = lambda q: time.sleep(0.004)
        stepper = Stepper(problem_with(cost=cost))
        cost.asked.does = lambda q: None
        assert "slowest" not in stepper.step(FORWARD).reason
        cost.asked.does = lambda q: time.sleep(0.012)
        reason = stepper.step(FORWARD).reason
    finally:
        cost.asked.does = lambda q: None
    assert re.fullmatch(
        r"the step took [\d.]+ ms of its period of 10 ms;"
        r" the slowest term is cost pull \([\d.]+ ms when it was tried\)",
        reason,
    )


def test_the_function_says_which_part() -> None:
    wall = Wall()
    problem = problem_with(limits=[wall])
    assert step_function(problem).size_out("amiss") == (5 + len(problem.row_names), 1)
