"""Regions to keep out of: distances against plain NumPy, and loops that lead through them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from step_samples import problem_of

import ergoqp
from ergoqp.errors import InputError, OutOfReachError, ProblemError
from ergoqp.joints import LOWER, UPPER
from ergoqp.limits import Ball, Box, HalfSpace, KeepOut, TwistLimit, WorkspaceBox
from ergoqp.problem.load import load_problem, problem_from_dict
from ergoqp.problem.problem import Problem
from ergoqp.problem.settings import DeclaredRobot
from ergoqp.simulation.check import Checker
from ergoqp.simulation.robot import RobotKind, SimulatedRobot, moved
from ergoqp.step.delay import _hard_rows
from ergoqp.step.guide import Guide
from ergoqp.step.model import StepModel
from ergoqp.step.rest import THERE, TRIAL
from ergoqp.step.stepper import Stepper

REGIONS = {
    "half_space": HalfSpace((1, -2, 0.5), 0.1),
    "ball": Ball((0.1, 0.2, -0.1), 0.3),
    "box": Box((-0.2, -0.1, 0.0), (0.1, 0.3, 0.5)),
}


def distance(region: HalfSpace | Ball | Box, point: np.ndarray) -> float:
    """How far a point (3,) is from a region, in plain NumPy; negative inside."""
    if isinstance(region, HalfSpace):
        return float(np.dot(region.normal, point) - region.offset)
    if isinstance(region, Ball):
        return float(np.linalg.norm(point - region.centre) - region.radius)
    lower, upper = np.array(region.lower), np.array(region.upper)
    nearest = np.clip(point, lower, upper)
    if np.any(nearest != point):
        return float(np.linalg.norm(point - nearest))
    return -float(np.min(np.concatenate([point - lower, upper - point])))


def found(region: HalfSpace | Ball | Box, point: np.ndarray) -> tuple[float, np.ndarray]:
    p = ca.SX.sym("p", 3)
    values = ca.Function("nearest", [p], list(region.nearest(p)))(point)
    return float(values[0]), np.array(values[1]).ravel()


@pytest.mark.parametrize("name", REGIONS)
@settings(max_examples=60, deadline=None)
@given(point=st.tuples(*[st.floats(-1, 1)] * 3))
def test_the_distance_is_that_of_the_nearest_point(name: str, point: tuple) -> None:
    region, at = REGIONS[name], np.array(point)
    value, direction = found(region, at)
    assert value == pytest.approx(distance(region, at), abs=1e-8)
    assert np.linalg.norm(direction) == pytest.approx(1, abs=1e-6)
    # The half-space at the nearest point holds nothing of the region: it is convex.
    edge = at - value * direction
    for other in np.random.default_rng(0).uniform(-1, 1, (200, 3)):
        if distance(region, other) < 0:
            assert direction @ (other - edge) < 1e-7


def test_the_middle_of_a_ball_has_a_direction_too() -> None:
    value, direction = found(Ball((0.1, 0.2, -0.1), 0.3), np.array([0.1, 0.2, -0.1]))
    assert value == pytest.approx(-0.3)
    assert direction.tolist() == [0, 0, 1]


def walk(problem: Problem, kind: RobotKind, steps: int, seed: int) -> np.ndarray:
    """Where the contact point (steps, 3) goes while postures wander and a robot obeys."""
    rng, comfort = np.random.default_rng(seed), np.asarray(problem.response.comfort)  # type: ignore
    pose = np.array(problem.response.contact()(comfort)[0])
    stepper, robot, way = Stepper(problem), SimulatedRobot(kind, pose, rng), []
    posture = comfort
    for number in range(steps):
        if number % 50 == 0:
            posture = np.clip(comfort + 0.6 * rng.normal(size=32), LOWER, UPPER)
        step = stepper.step(posture, robot.measured_pose())
        for pose in robot.execute(step.twist, stepper.dt):
            way.append(pose[:3, 3].copy())
    return np.array(way)


def bold(problem: Problem) -> Problem:
    """The problem with an object that never rests by itself."""
    return problem.replace(control=replace(problem.control, rest_below=0.0, stall_after=1e6))


@pytest.mark.slow
@pytest.mark.parametrize("shape", ["ball", "box", "half_space"])
@pytest.mark.parametrize("late", [False, True])
def test_no_loop_leads_into_a_region(shape: str, late: bool) -> None:
    problem = bold(problem_of("screwing"))
    kind = RobotKind(delay=0.03, lag=0.05) if late else RobotKind()
    if late:
        problem = problem.replace(robot=DeclaredRobot(delay=0.03, lag=0.05))
    freely = walk(problem, kind, 600, 3)
    begin, span = freely[0], np.ptp(freely, axis=0)
    # Where it goes without the limit, some way from where it begins.
    far = freely[np.argmax(np.linalg.norm(freely - begin, axis=1))]
    away = (far - begin) / np.linalg.norm(far - begin)
    size = 0.3 * float(np.linalg.norm(far - begin))
    centre = begin + 0.6 * (far - begin)
    region = {
        "ball": Ball(tuple(centre), size),
        "box": Box(tuple(centre - size / 2), tuple(centre + size / 2)),
        "half_space": HalfSpace(tuple(-away), float(-away @ (begin + 0.5 * (far - begin)))),
    }[shape]
    assert span.max() > 0.05
    assert min(distance(region, point) for point in freely) < -0.2 * size
    limited = problem.replace(limits=[*problem.limits, KeepOut(region)])
    for seed in (3, 4):
        kept = [distance(region, point) for point in walk(limited, kind, 600, seed)]
        assert min(kept) > -1e-6
    # It comes close, so the limit is what keeps it out.
    assert min(distance(region, point) for point in walk(limited, kind, 600, 3)) < 0.02


LATE = {"delay": 0.03, "lag": 0.05}
NOISY = {"pose_noise": 0.001, "delay": 0.02}


GOAL = np.array([0.05, 0.25, 0.0])


def journey(
    region: HalfSpace | Ball | Box,
    given: dict[str, float],
    average: float | None,
    kept: bool = True,
) -> list[float]:
    """Distances from a region of an object that is drawn by `GOAL`, straight through it."""
    base = problem_of("screwing")
    control = replace(base.control, average=average)
    limits = [*base.limits, *([KeepOut(region)] if kept else [])]
    base = base.replace(control=control, robot=DeclaredRobot(**given), limits=limits)
    comfort = np.asarray(base.response.comfort)  # type: ignore[attr-defined]
    begin = np.array(base.response.contact()(comfort)[0])
    goal = begin.copy()
    goal[:3, 3] += GOAL
    stepper = Stepper(base, guide=Guide(goal, -100.0))
    # On the journey at once, see `ergoqp.step.rest.TRIAL`.
    state = stepper.state()
    state[-TRIAL:][:5] = THERE, 0.0, 0.0, 5.0, 1e9
    stepper.restore(state)
    robot = SimulatedRobot(RobotKind(**given), begin, np.random.default_rng(0))
    found = []
    for _ in range(400):
        step = stepper.step(comfort, robot.measured_pose())
        found += [distance(region, at[:3, 3]) for at in robot.execute(step.twist, stepper.dt)]
    return found


def half_way() -> np.ndarray:
    problem = problem_of("screwing")
    comfort = problem.response.comfort  # type: ignore[attr-defined]
    return np.array(problem.response.contact()(comfort)[0])[:3, 3] + GOAL / 2


@pytest.mark.slow
@pytest.mark.parametrize("radius", [0.015, 0.04, 0.1])
@pytest.mark.parametrize(("given", "average"), [({}, None), ({}, 0.0), (LATE, None), (NOISY, None)])
def test_a_journey_past_a_ball_slides_along_it(
    radius: float, given: dict[str, float], average: float | None
) -> None:
    """For hundreds of steps no half-space serves for two of them."""
    ball = Ball(tuple(half_way() + radius * np.array([0.2, 0.1, -0.2])), radius)
    kept = journey(ball, given, average, kept=True)
    assert min(kept) > 0
    # Noise is counted twice, see `ergoqp.limits.limit.Limit`: three thousandths of it here.
    near = 0.004 + 3 * given.get("pose_noise", 0.0)
    assert np.mean(np.array(kept) < near) > 0.01
    assert min(journey(ball, given, average, kept=False)) < -0.5 * radius


@pytest.mark.slow
@pytest.mark.parametrize("shape", ["wall", "post", "ball"])
@pytest.mark.parametrize("noise", [0.002, 0.01])
def test_noise_as_large_as_the_region_turns_nothing_round(shape: str, noise: float) -> None:
    """What is nearest by a noisy pose may be the other side: the object is never so near."""
    half = {"wall": np.array([1, noise / 4, 1]), "post": np.array([noise, noise, 1])}
    middle = half_way() + noise * np.array([0.3, 0.0, 0.2])
    region = (
        Ball(tuple(middle), 2 * noise)
        if shape == "ball"
        else Box(tuple(middle - half[shape]), tuple(middle + half[shape]))
    )
    kept = journey(region, {"pose_noise": noise}, None, kept=True)
    assert np.sqrt(3) * noise < min(kept) < 5 * noise
    # From one sample to the next it goes through the thinnest.
    assert min(journey(region, {"pose_noise": noise}, None, kept=False)) < noise / 4


def test_a_plane_does_not_turn_with_the_noise() -> None:
    """So noise counts once there, and twice where the direction is read off the pose."""
    plane, ball = HalfSpace((0, 0, 1), 0.0), Ball((0, 0, 0), 0.1)
    assert [KeepOut(region).tangent for region in (plane, ball)] == [False, True]


def test_the_half_space_is_that_of_where_the_object_is_and_not_where_it_lands() -> None:
    ball = Ball(tuple(half_way()), 0.05)
    problem = problem_of("screwing")
    limits = [*problem.limits, KeepOut(ball)]
    model = StepModel(problem.replace(limits=limits, robot=DeclaredRobot(**LATE)))
    comfort = problem.response.comfort  # type: ignore[attr-defined]
    pose = np.array(problem.response.contact()(comfort)[0])
    total = np.array([0.03, -0.02, 0.04, 0.0, 0.1, 0.0])
    found = _hard_rows(model)(pose, total, 0, np.zeros(7))
    landed, rows, _ = (np.array(part) for part in found)
    np.testing.assert_allclose(landed[:3, 3], pose[:3, 3] + total[:3])
    away = pose[:3, 3] - half_way()
    row = rows[model.under_way.names.index("keep out")]
    np.testing.assert_allclose(row, [*(away / np.linalg.norm(away)), 0, 0, 0], atol=1e-9)


@pytest.mark.slow
def test_an_object_that_was_put_into_a_region_comes_out_of_it() -> None:
    problem = bold(problem_of("screwing"))
    comfort = np.asarray(problem.response.comfort)  # type: ignore[attr-defined]
    pose = np.array(problem.response.contact()(comfort)[0])
    region = Ball(tuple(pose[:3, 3] + [0.02, 0, 0]), 0.05)
    stepper = Stepper(problem.replace(limits=[*problem.limits, KeepOut(region, name="head")]))
    assert stepper.step(comfort, pose).reason == "in head by 0.03 m, coming back"
    stepper.reset()
    depths = []
    for _ in range(800):
        step = stepper.step(comfort, pose)
        pose = moved(pose, step.twist * stepper.dt)
        depths.append(distance(region, pose[:3, 3]))
    assert depths[0] < -0.02
    assert depths[-1] > -1e-4
    inside = np.flatnonzero(np.array(depths) < 0)
    assert np.all(np.diff(depths)[inside[:-1]] > -1e-9)
    assert min(depths[inside[-1] + 1 :]) >= 0


@pytest.mark.slow
def test_the_best_place_is_out_of_the_region() -> None:
    problem = problem_of("screwing")
    free = ergoqp.optimise(problem, starts=3, seed=0)
    region = Ball(tuple(free.pose[:3, 3]), 0.08)
    limited = problem.replace(limits=[*problem.limits, KeepOut(region)])
    assert distance(region, free.pose[:3, 3]) < -0.07
    assert distance(region, ergoqp.optimise(limited, starts=3, seed=0).pose[:3, 3]) > -1e-5
    with pytest.raises(InputError, match="which is in keep out, allowed where all limits hold"):
        Stepper(limited, guide=free.pose)


@pytest.mark.slow
def test_a_region_that_leaves_no_place_is_named() -> None:
    problem = problem_of("screwing")
    # All but a far part of the workspace, which only the tallest might reach.
    box = WorkspaceBox((0.25, -0.55, 0.7), (1.8, 0.35, 1.75))
    others = [each for each in problem.limits if not isinstance(each, WorkspaceBox)]
    near = KeepOut(Box((0, -1, 0), (1.7, 1, 2)))
    everywhere = problem.replace(limits=[*others, box, near])
    with pytest.raises(
        OutOfReachError, match=r"can be a start \((\d+ out of reach, )?\d+ in keep out"
    ):
        ergoqp.optimise(everywhere, starts=1)
    comfort = np.asarray(problem.response.comfort)  # type: ignore[attr-defined]
    with pytest.raises(
        OutOfReachError, match=r"a place that counts \(1 (in keep out|out of reach)\)"
    ):
        ergoqp.optimise(everywhere, comfort, starts=1)


def test_one_that_the_object_cannot_leave_is_named() -> None:
    problem = problem_of("screwing")
    comfort = np.asarray(problem.response.comfort)  # type: ignore[attr-defined]
    pose = np.array(problem.response.contact()(comfort)[0])
    up = [each for each in problem.limits if not isinstance(each, TwistLimit)]
    region = HalfSpace((1, 0, 0), float(pose[0, 3]) + 0.05)
    limits = [*up, TwistLimit(axes=("z",)), KeepOut(region, name="wall")]
    step = Stepper(problem.replace(limits=limits)).step(comfort, pose)
    assert "in wall by 0.05 m, and the object cannot move it" in step.reason


def test_problem_files_have_regions(tmp_path) -> None:
    text = (
        'title = "t"\n[response.ik]\n[[limits.keep_out]]\nname = "head"\n'
        "ball = {centre = [0.1, 0, 1.6], radius = 0.2}\n[[limits.keep_out]]\n"
        'name = "shelf"\nbox = {lower = [0.4, -1, 1.2], upper = [0.9, 1, 1.3]}\n'
    )
    (tmp_path / "own.toml").write_text(text)
    problem = load_problem(tmp_path / "own.toml")
    assert problem.row_names[-2:] == ("head", "shelf")
    one = {"response": {"ik": {}}, "limits": {"keep_out": {"half_space": {"normal": [0, 0, 1.0]}}}}
    with pytest.raises(ProblemError, match=r"limits\.keep_out\.0\.half_space\.offset: got nothing"):
        problem_from_dict(one, "own")
    one["limits"]["keep_out"] = {"cube": {}}
    with pytest.raises(ProblemError, match=r"keep_out\.0\.cube: got a key that is not known"):
        problem_from_dict(one, "own")
    one["limits"]["keep_out"] = {}
    with pytest.raises(
        ProblemError,
        match=r"keep_out\.0: got none, allowed exactly one of half_space, ball and box$",
    ):
        problem_from_dict(one, "own")


def regions_of(*regions: dict[str, Any]) -> dict[str, Any]:
    return {"response": {"ik": {}}, "limits": {"keep_out": list(regions)}}


BALL = {"centre": [0.1, 0.0, 1.6], "radius": 0.2}
FLAT = {"lower": [0.4, -1.0, 1.3], "upper": [0.9, 1.0, 1.2]}


def test_regions_of_one_name_are_told_to_take_one_each() -> None:
    words = r"limits\.keep_out: got .*, allowed regions each with a `name` of its own"
    with pytest.raises(ProblemError, match=words):
        problem_from_dict(regions_of({"ball": BALL}, {"ball": BALL}), "own")
    problem, keep = problem_of("screwing"), KeepOut(Ball((0, 0, 5), 0.1))
    with pytest.raises(ProblemError, match=r"row named keep out, allowed one each \(a KeepOut"):
        problem.replace(limits=[*problem.limits, keep, keep])


def test_a_mistake_in_a_region_says_which() -> None:
    words = r"own: limits\.keep_out\.1: got lower .* not below upper"
    with pytest.raises(ProblemError, match=words):
        problem_from_dict(regions_of({"ball": BALL}, {"name": "shelf", "box": FLAT}), "own")
    words = r"own: limits\.keep_out\.0\.half_space\.normal: got .*, allowed any vector but zero"
    with pytest.raises(ProblemError, match=words):
        problem_from_dict(
            regions_of({"half_space": {"normal": [0.0, 0.0, 0.0], "offset": 0.0}}), "own"
        )


@pytest.mark.parametrize(
    ("region", "key", "value"),
    [
        ({"ball": BALL | {"radius": 250.0}}, "ball.radius", "250"),
        ({"ball": BALL | {"centre": [100.0, 0.0, 1.6]}}, "ball.centre", "100"),
        (
            {"box": {"lower": [400.0, -1.0, 0.0], "upper": [900.0, 1.0, 1.0]}},
            "box.lower",
            "400",
        ),
        ({"half_space": {"normal": [0.0, 0.0, 1.0], "offset": 700.0}}, "half_space.offset", "700"),
    ],
)
def test_millimetres_are_noticed_unless_they_are_meant(
    region: dict[str, Any], key: str, value: str
) -> None:
    raw = regions_of({"name": "first", "ball": BALL}, region)
    with pytest.raises(ProblemError, match=rf"limits\.keep_out\.{key}: got {value}, usual are"):
        problem_from_dict(raw, "own")
    meant = [f"limits.keep_out.{key}", "limits.keep_out.box.upper"]
    problem_from_dict(raw | {"unusual": meant}, "own")


class Own:
    """A region of one's own."""

    def __init__(self, nearest: Any) -> None:
        self.nearest = nearest


@pytest.mark.parametrize(
    ("nearest", "sentence"),
    [
        (lambda p: (p[2], ca.DM([0, 0, 2])), "got a direction of length 2 at"),
        (lambda p: (ca.sumsqr(p), 2 * p), "got a direction of length"),
        (lambda p: (p[2], ca.DM([0, 0, np.nan])), "got a direction of length nan"),
        (lambda p: (p, ca.DM([0, 0, 1])), r"got shapes \(3, 1\) and \(3, 1\) from nearest"),
        (lambda p: 5, r"got TypeError \(.*\) from nearest of .*, allowed a distance"),
        (lambda: 5, "got TypeError"),
    ],
)
def test_a_region_of_ones_own_gives_a_distance_and_a_unit_vector(
    nearest: Any, sentence: str
) -> None:
    with pytest.raises(InputError, match=rf"keep_out region: {sentence}"):
        KeepOut(Own(nearest))
    KeepOut(Own(lambda p: (p[2], ca.SX(ca.DM([0, 0, 1])))))


@pytest.mark.parametrize("name", REGIONS)
def test_the_checker_sees_who_goes_further_in(name: str) -> None:
    region, base = REGIONS[name], problem_of("screwing")
    checker = Checker(base.replace(limits=[*base.limits, KeepOut(region)]))
    edge = np.array([0.35, 0.25, 0.2])
    edge_value, direction = found(region, edge)
    still, pose = np.zeros(6), np.eye(4)
    pose[:3, 3] = edge - edge_value * direction
    for further, broken in ((0.002, True), (-0.002, False)):
        after = pose.copy()
        after[:3, 3] -= further * direction
        names = checker.check(still, still, pose, None, np.zeros(32), base.dt, after=after)
        assert ("keep out" in names) == broken
        assert distance(region, after[:3, 3]) == pytest.approx(-further, abs=1e-7)
    assert checker.max_violation["keep out"] == pytest.approx(0.002, abs=1e-7)


class Wider(Ball):
    """A ball of the user's own that reaches further than its radius."""

    def nearest(self, point: ca.SX) -> tuple[ca.SX, ca.SX]:
        """So much less."""
        distance, direction = super().nearest(point)
        return distance - 0.1, direction


def test_a_region_of_ones_own_is_checked_by_what_it_says() -> None:
    base, still, pose = problem_of("screwing"), np.zeros(6), np.eye(4)
    pose[:3, 3] = 0.5, 0.0, 1.2
    region = Wider(tuple(pose[:3, 3] - [0.145, 0, 0]), 0.05)
    checker = Checker(base.replace(limits=[*base.limits, KeepOut(region)]))
    after = pose.copy()
    after[0, 3] -= 0.003
    names = checker.check(still, still, pose, None, np.zeros(32), base.dt, after=after)
    assert names == ["keep out"]


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: Ball((0, 0, 0), -1), "keep_out radius: got -1"),
        (lambda: Ball((0, 0, np.nan), 1), "keep_out centre"),
        (lambda: Box((0, 0, 0), (1, 1, 0)), "allowed lower < upper"),
        (lambda: HalfSpace((0, 0, 0), 1), "allowed any vector but zero"),
        (lambda: KeepOut(Ball), "an object, not the class: Ball"),  # type: ignore[arg-type]
    ],
)
def test_what_is_no_region_is_said_in_one_sentence(make, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        make()
