"""Arguments of another kind or range: one sentence that says what, got and allowed, and nothing
else."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from fractions import Fraction
from typing import Any

import casadi as ca
import numpy as np
import pytest
from step_samples import comfort_of, held_pose, problem_of

import ergoqp
from ergoqp.datasets.data import DataSet
from ergoqp.errors import ErgoqpError
from ergoqp.human import Body
from ergoqp.learning.one_class import OneClass, load_one_class
from ergoqp.limits import (
    ArmLength,
    AxisCone,
    JointLimit,
    OneClassBoundary,
    TwistLimit,
    WorkspaceBox,
)
from ergoqp.limits.limit import LimitContext, Rows, straight_margins
from ergoqp.placing.optimise import optimise
from ergoqp.problem.problem import Problem
from ergoqp.problem.settings import Control, DeclaredRobot, Frames
from ergoqp.responses import IkResponse, LinearResponse
from ergoqp.rest.person_protocol import SensorModel
from ergoqp.simulation.points import run_points
from ergoqp.simulation.robot import RobotKind
from ergoqp.simulation.simulate import simulate
from ergoqp.step.function import step_function
from ergoqp.step.guide import Guide
from ergoqp.step.stepper import Stepper
from ergoqp.whole_body import WholeBody

THOUSANDS_OF_DIGITS = 10**5000


class Hostile:
    """Raises whatever is done with it."""

    def __repr__(self) -> str:
        raise RuntimeError

    def __array__(self, *_: Any, **__: Any) -> np.ndarray:
        raise RuntimeError

    def __float__(self) -> float:
        raise RuntimeError


WRONG: dict[str, Any] = {
    "none": None,
    "text": "a",
    "no text": "",
    "not finite": float("nan"),
    "infinite": float("inf"),
    "negative": -1,
    "digits": 10**400,
    "thousands of digits": THOUSANDS_OF_DIGITS,
    "complex": 0.01j,
    "list": [],
    "list of lists": [[1], [2, 3]],
    "list of texts": ["a"],
    "table": {},
    "odd table": {3: "a"},
    "table of texts": {"trunk_flexion": "a"},
    "array": np.array([0.01]),
    "masked": np.ma.masked_all(32),
    "object": object(),
    "hostile": Hostile(),
    "class": dict,
    "fraction": Fraction(1, 100),
}


def terms(**changed: Any) -> dict[str, Any]:
    given = problem_of("screwing")
    return {
        "cost": given.cost,
        "response": given.response,
        "limits": given.limits,
        "task": given.task,
    } | changed


def screwing(function: Callable[..., Any], **given: Any) -> Callable[..., Any]:
    def call(**changed: Any) -> Any:
        return function(
            **(
                {"problem": problem_of("screwing"), "posture": comfort_of("screwing")}
                | given
                | changed
            )
        )

    return call


CHEAP: dict[str, tuple[Callable[..., Any], dict[str, Any]]] = {
    "Problem": (Problem, terms()),
    "TwistLimit": (TwistLimit, {}),
    "WorkspaceBox": (WorkspaceBox, {"lower": (0, 0, 0), "upper": (1, 1, 1)}),
    "AxisCone": (AxisCone, {"direction": (1, 0, 0), "half_angle_deg": 30}),
    "JointLimit": (JointLimit, {}),
    "ArmLength": (ArmLength, {"length": 0.25}),
    "OneClassBoundary": (OneClassBoundary, {"model": 3}),
    "Control": (Control, {}),
    "DeclaredRobot": (DeclaredRobot, {}),
    "Frames": (Frames, {}),
    "RobotKind": (RobotKind, {}),
    "SensorModel": (SensorModel, {}),
    "Body": (Body, {}),
    "Body.of_stature": (Body.of_stature, {"stature": 1.7}),
    "Body.of_lengths": (Body.of_lengths, {"lengths": {"upper_arm": 0.3}}),
    "IkResponse": (IkResponse, {}),
    "LinearResponse": (LinearResponse, {}),
}


def answer(call: Callable[..., Any], given: dict[str, Any]) -> str | None:
    """The sentence of a refusal, None where there is none; anything else goes through."""
    try:
        call(**given)
    except ErgoqpError as error:
        return str(error)
    return None


@pytest.mark.parametrize("name", CHEAP)
def test_whatever_a_constructor_is_given_it_answers_with_one_sentence(name: str) -> None:
    call, given = CHEAP[name]
    refused = 0
    for parameter in inspect.signature(call).parameters:
        for kind, value in WRONG.items():
            said = answer(call, given | {parameter: value})
            if said is not None:
                refused += 1
                assert "\n" not in said, f"{name}({parameter}={kind})"
                assert "allowed" in said, f"{name}({parameter}={kind}): {said}"
                assert len(said) < 700, f"{name}({parameter}={kind}): {said}"
    assert refused > 10


LOOPS: dict[str, tuple[Callable[..., Any], dict[str, Any], tuple[str, ...]]] = {
    "stepper": (
        lambda **given: Stepper(problem_of("screwing"), **given),
        {},
        ("solver", "compiled", "dt", "log", "guide"),
    ),
    "step_function": (
        step_function,
        {"problem": problem_of("screwing")},
        ("problem", "solver", "compiled", "guided"),
    ),
    "simulate": (
        simulate,
        {"problem": problem_of("screwing"), "posture": comfort_of("screwing"), "duration": 0.02},
        (
            "problem",
            "posture",
            "duration",
            "seed",
            "person",
            "observed",
            "recording",
            "start_time",
            "assumptions",
            "progress",
            "guide",
            "robot",
            "senses",
        ),
    ),
    "optimise": (
        optimise,
        {"problem": problem_of("screwing"), "posture": comfort_of("screwing"), "starts": 1},
        (
            "problem",
            "posture",
            "starts",
            "seed",
            "jobs",
            "mode",
            "solver",
            "pose",
            "person",
            "tau_deg",
            "assumptions",
            "progress",
        ),
    ),
    "run_points": (
        run_points,
        {
            "problem": problem_of("forearm"),
            "start": [0.3, -0.2, 1.0, 0.5, -0.2, 1.1],
            "duration": 0.02,
        },
        ("problem", "start", "duration", "stop_when_still"),
    ),
    "WholeBody": (
        WholeBody,
        {"problem": problem_of("screwing")},
        (
            "problem",
            "robot",
            "frame",
            "tool_frame",
            "base",
            "posture",
            "start",
            "distance",
            "reserve",
            "object_size",
            "dt",
        ),
    ),
}

TAKEN = {
    ("recording", "text"),
    ("start_time", "negative"),
    ("assumptions", "list of texts"),
    ("out", "text"),
}
"""What is of the right kind after all."""

NOT_TRIED = ("none", "fraction", "class", "table", "list", "odd table", "no text")
"""What is taken here and there, by what then takes its time."""


@pytest.mark.slow
@pytest.mark.parametrize("name", LOOPS)
def test_whatever_a_loop_is_given_it_answers_with_one_sentence(name: str) -> None:
    call, given, parameters = LOOPS[name]
    for parameter in parameters:
        for kind, value in WRONG.items():
            if kind in NOT_TRIED or (parameter, kind) in TAKEN:
                continue
            said = answer(call, given | {parameter: value})
            assert said is not None, f"{name}({parameter}={kind}) was taken"
            assert "\n" not in said, f"{name}({parameter}={kind})"
            assert "allowed" in said, f"{name}({parameter}={kind}): {said}"


@pytest.mark.parametrize(
    ("changed", "sentence"),
    [
        ({"task": {"nonsense": 1}}, "task: got 'nonsense', allowed load_kg, shock, coupling"),
        ({"task": {"load_kg": float("nan")}}, "task.load_kg: got nan, allowed: a finite mass"),
        ({"task": {"load_kg": -5.0}}, "task.load_kg: got -5, allowed: a finite mass"),
        ({"task": {"load_kg": "a"}}, "task.load_kg: got 'a', allowed: a number"),
        ({"task": {"load_kg": [1.0]}}, "task.load_kg: got [1.0], allowed a single value"),
        ({"task": {"coupling": 9}}, "task.coupling: got 9, allowed: a whole number from 0 to 3"),
        (
            {"task": {"coupling": 1.5}},
            "task.coupling: got 1.5, allowed: a whole number from 0 to 3",
        ),
        ({"method": None}, "method: got None, allowed a Method"),
        ({"name": "../x"}, "name: got '../x', allowed one that a folder can have"),
        ({"name": ".."}, "name: got '..', allowed one that a folder can have"),
        ({"name": None}, "name: got None, allowed a text of one line, 1 to 250 characters"),
        ({"title": 3}, "title: got 3, allowed a text"),
        ({"dt": "0.01"}, "dt: got '0.01', allowed a number from 0.0001 to 0.1 s"),
        ({"limits": None}, "limits: got None, allowed a list"),
        ({"limits": [3]}, "limits: got 3, allowed a limit with names, unit, hard"),
        ({"control": "a"}, "control: got 'a', allowed a Control"),
        ({"robot": None}, "robot: got None, allowed a DeclaredRobot"),
        ({"cost": None}, "cost: got None, allowed a cost with name, minimum, expression, __call__"),
        ({"response": None}, "response: got None, allowed a response with coordinates"),
    ],
)
def test_terms_that_are_none_are_named_when_the_problem_is_made(
    changed: dict[str, Any], sentence: str
) -> None:
    said = answer(Problem, terms(**changed))
    assert said is not None
    assert said.startswith(sentence)
    assert answer(problem_of("screwing").replace, changed) == said


def test_a_cost_that_lacks_a_member_is_refused_by_its_name() -> None:
    class Unbounded:
        name = "unbounded"

        def expression(self, q: Any) -> Any:
            return q[0]

        def __call__(self, postures: Any) -> Any:
            return np.atleast_2d(postures)[:, 0]

    said = answer(Problem, terms(cost=Unbounded()))
    assert said is not None
    assert "without minimum, allowed a cost with name, minimum" in said
    assert answer(Problem, terms(cost=Unbounded)) is not None


class Shelf:
    """A limit of one's own: the object stays behind x = 2 m, far away."""

    names = ("shelf",)
    unit = "m"
    hard = True
    recovers = (True,)
    tolerance = 1e-6
    recovery_time = 1.0
    yield_zone = 0.0
    margin_is_lower_bound = False

    def measure(self) -> None:
        pass

    def rows(self, context: LimitContext) -> Any:
        matrix = ca.SX(1, 6)
        matrix[0, 0] = 1
        free = ca.SX([ca.inf])
        return context.reduced(
            self.names[0], Rows(matrix, free, ca.SX(2.0) - context.pose[0, 3], free, ca.SX(1, 1))
        )

    def margins(self, context: LimitContext, displacement: Any) -> Any:
        return straight_margins(self.rows(context), displacement)


@pytest.mark.parametrize(
    ("changed", "sentence"),
    [
        ({"tolerance": float("nan")}, "limits: tolerance of shelf: got nan, allowed 0 to 1e+06"),
        (
            {"tolerance": "x"},
            "limits: tolerance of shelf: got 'x', allowed a number from 0 to 1e+06",
        ),
        ({"recovery_time": 0.0}, "limits: recovery_time of shelf: got 0.0, allowed 0.001 to 1000"),
        ({"yield_zone": None}, "limits: yield_zone of shelf: got None, allowed a number from"),
        ({"hard": "no"}, "limits: hard of shelf: got 'no', allowed True or False"),
        ({"names": "shelf"}, "limits: names: got 'shelf', allowed a name for each row"),
        ({"names": ()}, "limits: names: got (), allowed a name for each row"),
        ({"names": (5,)}, "limits: names: got (5,), allowed a name for each row"),
        (
            {"names": ("a", "b"), "recovers": (True, True)},
            "limits: rows of a: got 1 rows and 1 margins, allowed",
        ),
        (
            {"margins": lambda situation, displacement: ca.SX(2, 1)},
            "limits: rows of shelf: got 1 rows and 2 margins, allowed",
        ),
        (
            {"recovers": True},
            "limits: recovers of shelf: got True, allowed one True or False for each row",
        ),
        (
            {"recovers": (True,) * 3},
            "limits: recovers of shelf: got (True, True, True), allowed one",
        ),
        ({"measure": None}, "limits: rows of shelf: got TypeError ("),
        ({"rows": lambda context: None}, "limits: rows of shelf: got AttributeError ("),
        (
            {"margins": lambda context, displacement: None},
            "limits: rows of shelf: got AttributeError (",
        ),
        (
            {"rows": lambda context: Rows(ca.SX(1, 6), 1.0, 1.0, 1.0, 1.0)},
            "limits: got rows whose to_lower has shape None",
        ),
    ],
)
def test_a_limit_of_ones_own_is_judged_when_the_problem_is_made(
    changed: dict[str, Any], sentence: str
) -> None:
    shelf = Shelf()
    assert answer(Problem, terms(limits=[*problem_of("screwing").limits, shelf])) is None
    for name, value in changed.items():
        setattr(shelf, name, value)
    said = answer(Problem, terms(limits=[*problem_of("screwing").limits, shelf]))
    assert said is not None
    assert said.startswith(sentence)


class Bowl:
    """A cost of one's own."""

    name = "bowl"
    minimum = 1.0

    def expression(self, q: Any) -> Any:
        return 1 + ca.sumsqr(q)

    def __call__(self, postures: Any) -> Any:
        return 1 + (np.atleast_2d(postures) ** 2).sum(axis=1)


def fails(q: Any) -> Any:
    raise ValueError("no such joint")


@pytest.mark.parametrize(
    ("changed", "sentence"),
    [
        ({"minimum": float("nan")}, "cost.minimum: got nan, allowed -1e+06 to 1e+06"),
        ({"minimum": float("inf")}, "cost.minimum: got inf, allowed"),
        ({"minimum": "x"}, "cost.minimum: got 'x', allowed a number from"),
        ({"name": 5}, "cost.name: got 5, allowed a text of one line"),
        (
            {"expression": lambda q: None},
            "cost: got the expression None of bowl, allowed a scalar of CasADi",
        ),
        (
            {"expression": lambda q: q},
            "cost: got the expression MX(q) of bowl, allowed a scalar of CasADi",
        ),
        (
            {"expression": fails},
            "cost: got ValueError (no such joint) from the expression of bowl, allowed a scalar",
        ),
        (
            {"expression": lambda q: ca.MX.sym("r")},
            "cost: got RuntimeError (",
        ),
    ],
)
def test_a_cost_of_ones_own_is_judged_before_the_loop(
    changed: dict[str, Any], sentence: str
) -> None:
    bowl = Bowl()
    for name, value in changed.items():
        setattr(bowl, name, value)
    said = answer(Problem, terms(cost=bowl))
    assert said is not None
    assert said.startswith(sentence)


@pytest.mark.parametrize(
    "call",
    [
        lambda: problem_of("screwing").replace(
            limits=(limit for limit in problem_of("screwing").limits)
        ),
        lambda: problem_of("screwing").replace(
            name="visser : dix", title="visser\u00a0: dix\nlignes"
        ),
        lambda: IkResponse(free_about_tool=np.bool_(True), hands=np.array(["right"])),
        lambda: TwistLimit(axes={"x"}),
        lambda: Stepper(problem_of("screwing"), compiled=np.bool_(False), dt=np.float32(0.01)),
        lambda: DataSet(
            np.eye(30)[:, :3], np.arange(30), ("trunk_flexion", "neck_flexion", "trunk_twist")
        ),
        lambda: SensorModel(delay=np.float64(0.1), lost=0),
    ],
)
def test_what_is_right_is_taken_however_it_is_written(call: Callable[[], Any]) -> None:
    assert call() is not None


def test_what_a_mask_hides_and_what_is_complex_is_not_learned_from() -> None:
    points = np.random.default_rng(0).normal(size=(40, 2))
    hidden = np.ma.masked_where(points > 1.5, points)
    for wrong in (hidden, points + 1j, points.astype(str)):
        for make in (
            lambda wrong=wrong: OneClass.fit(wrong, ["neck_flexion", "trunk_flexion"]),
            lambda wrong=wrong: DataSet(wrong, np.ones(40), ("neck_flexion", "trunk_flexion")),
        ):
            said = answer(make, {})
            assert said is not None
            assert "allowed" in said


def test_a_place_is_judged_in_whatever_it_comes() -> None:
    problem = problem_of("screwing")
    for place in (
        np.eye(4),
        Guide(np.eye(4)),
        Guide(np.eye(3)),
        Guide(np.full((4, 4), np.nan)),
        Guide(held_pose("screwing"), "x"),
    ):  # pyright: ignore
        assert answer(Stepper, {"problem": problem, "guide": place}) is not None
    assert answer(Stepper, {"problem": problem, "guide": Guide(held_pose("screwing"), 3.0)}) is None


@pytest.mark.parametrize("path", [5, None, b"screwing", "", "x" * 5000 + ".toml"])
def test_what_is_no_path_is_one_sentence(path: Any) -> None:
    for load in (ergoqp.load_problem, ergoqp.load_cost, ergoqp.load_recording, load_one_class):
        said = answer(load, {"name" if load is ergoqp.load_problem else "path": path})
        assert said is not None
        assert any(words in said for words in ("allowed", "; give", "cannot be read"))


def test_a_log_that_is_none_is_one_sentence() -> None:
    problem: Any = problem_of("screwing")
    for given in ((3, []), (problem, None), (problem, "a"), (problem, [3])):
        said = answer(lambda given=given: ergoqp.replay(*given), {})
        assert said is not None
        assert "allowed" in said or "; give" in said
    assert ergoqp.replay(problem, []) == []
