"""The simple ways of moving the object keep the limits, and do what they say."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest

from ergoqp.human import Body
from ergoqp.lab.yardstick import Drive, Gradient, Still, Workspace, downhill, rule_pose
from ergoqp.limits import AxisCone, WorkspaceBox
from ergoqp.problem.geometry import pose_error, turned
from ergoqp.problem.load import TASKS, load_problem
from ergoqp.rest.person_protocol import SensorModel
from ergoqp.simulation.check import Checker
from ergoqp.simulation.loop import run_loop
from ergoqp.simulation.people import person_of_kind
from ergoqp.simulation.robot import RobotKind, SimulatedRobot, moved

JUDGED = ("speed", "acceleration", "axes", "workspace", "tool axis")


def pull(controller: Gradient, twist: list[float] | np.ndarray) -> None:
    """Let the gradient pull this way, wherever the person is."""
    controller._evaluator = SimpleNamespace(  # type: ignore[assignment]
        inputs={"q": np.zeros(32)},
        evaluate=lambda: None,
        outputs={"v": np.array([5.0]), "g": np.array(twist, dtype=float)},
    )


@pytest.mark.parametrize("name", TASKS)
def test_a_drive_arrives_within_every_limit_of_the_object(name: str) -> None:
    problem = load_problem(name)
    places = Workspace(problem)
    points = places.spread(6)
    for begin, end in pairwise(points):
        start, goal = places.pose(begin), places.pose(end)
        drive, checker = Drive(problem, start, goal), Checker(problem)
        drive.reset()
        pose, previous, count = start, np.zeros(6), 0
        while (step := drive.step(np.zeros(32), pose)).status != "settled":
            after = moved(pose, step.twist * drive.dt)
            checker.check(
                step.twist, previous, pose, np.zeros(32), np.zeros(32), drive.dt, None, {}, after
            )
            pose, previous, count = after, step.twist, count + 1
        assert {row: checker.max_violation[row] for row in JUDGED} == dict.fromkeys(JUDGED, 0.0)
        left = pose_error(pose, goal)
        assert np.linalg.norm(left[:3]) < 1e-6
        assert np.linalg.norm(np.cross(pose[:3, 0], goal[:3, 0])) < 1e-6
        assert np.linalg.norm(left[3:]) < 1e-5, "turned about the tool as well"
        # Nor does it dawdle: some axis is at its speed, or the way is too short for that.
        way = np.abs(pose_error(start, goal))
        speed = np.where(problem.twist_limit.speed > 0, problem.twist_limit.speed, np.inf)
        assert count * drive.dt < 1.6 * (way / speed).max() + 1.0
        drive.reset()
        assert drive.step(np.zeros(32), start).status == "optimal", "begins again"


def test_a_drive_to_where_the_object_is_stays() -> None:
    problem = load_problem("screwing")
    pose = Workspace(problem).pose(np.zeros(5))
    step = Drive(problem, pose, pose).step(np.zeros(32), pose)
    assert step.status == "settled"
    assert not step.twist.any()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["screwing", "dentist", "desk"])
def test_the_gradient_goes_down_within_every_limit_of_the_object(name: str) -> None:
    problem = load_problem(name)
    person = person_of_kind("follower", problem, 1)
    start = person.hold(person.comfort, SensorModel(noise_deg=0.5, drift_deg=0.0, lost=0.0))
    places = Workspace(problem)
    for point in places.spread(8):
        away = start.copy()
        if away.carry(places.pose(point)) and problem.assess(away.posture).final[0] >= 4:
            break
    start, checker = away, Checker(problem)
    trace = run_loop(
        problem,
        start.copy(),
        duration=8.0,
        seed=0,
        controller=Gradient(problem, problem.cost),
        checker=checker,
    )
    assert {row: checker.max_violation[row] for row in JUDGED} == dict.fromkeys(JUDGED, 0.0)
    assert problem.cost(trace.postures[-1])[0] < problem.cost(trace.postures[0])[0] - 0.2


@pytest.mark.slow
@pytest.mark.parametrize("way", [1.0, -1.0])
def test_the_gradient_stops_at_the_walls_and_goes_on_along_them(way: float) -> None:
    """Pulled against the workspace's end, the cone's edge and along the floor at once."""
    problem = load_problem("screwing")
    box, cone = problem.limit_of(WorkspaceBox), problem.limit_of(AxisCone)
    controller, checker = Gradient(problem, problem.cost), Checker(problem)
    pull(controller, way * np.array([9, 0.1, 9, 0.5, 9, 9]))
    pose, previous = Workspace(problem).pose(np.zeros(5)), np.zeros(6)
    begin = pose
    for _ in range(1500):
        step = controller.step(problem.response.comfort, pose)
        after = moved(pose, step.twist * controller.dt)
        zeros = np.zeros(32)
        checker.check(step.twist, previous, pose, zeros, zeros, controller.dt, None, {}, after)
        pose, previous = after, step.twist
    assert {row: checker.max_violation[row] for row in JUDGED} == dict.fromkeys(JUDGED, 0.0)
    ends = box.upper if way > 0 else box.lower
    assert abs(pose[0, 3] - ends[0]) < 0.02
    assert abs(pose[2, 3] - ends[2]) < 0.02
    assert way * (pose[1, 3] - begin[1, 3]) > 0.02, "along the wall it goes on"
    assert np.degrees(np.arccos(pose[0, 0])) > 0.7 * cone.half_angle_deg


@pytest.mark.slow
def test_the_gradient_turns_on_along_the_edge_of_the_cone() -> None:
    """Pulled out it comes to the edge; pulled to another side, still outward, it goes around."""
    problem = load_problem("screwing")
    cone = problem.limit_of(AxisCone)
    controller, checker = Gradient(problem, problem.cost, 1.0), Checker(problem)
    pose, previous, angles, turns = Workspace(problem).pose(np.zeros(5)), np.zeros(6), [], []
    for number in range(1500):
        pull(controller, [0, 0, 0, 0, 0.6, 0.2 if number < 700 else -0.6])
        step = controller.step(problem.response.comfort, pose)
        after = moved(pose, step.twist * controller.dt)
        zeros = np.zeros(32)
        checker.check(step.twist, previous, pose, zeros, zeros, controller.dt, None, {}, after)
        pose, previous = after, step.twist
        toward = np.array(cone.direction) / np.linalg.norm(cone.direction)
        angles.append(np.degrees(np.arccos(pose[:3, 0] @ toward)))
        turns.append(np.arctan2(pose[2, 0], pose[1, 0]))
    assert {row: checker.max_violation[row] for row in JUDGED} == dict.fromkeys(JUDGED, 0.0)
    at_edge = int(np.argmax(np.array(angles) > cone.half_angle_deg - 2.0))
    assert 0 < at_edge < 500
    assert min(angles[at_edge:]) > cone.half_angle_deg - 3.0
    turned = np.degrees(np.arctan2(0.2, 0.6) - np.arctan2(-0.6, 0.6))
    assert abs(np.degrees(turns[-1] - turns[690])) == pytest.approx(turned, abs=3.0)


def test_the_gradient_comes_back_from_beyond_the_edge() -> None:
    """Whoever goes along an edge drifts over it: it is pulled out, and comes back all the same."""
    problem = load_problem("screwing")
    cone = problem.limit_of(AxisCone)
    toward = np.array(cone.direction) / np.linalg.norm(cone.direction)
    controller, pose = Gradient(problem, problem.cost, 1.0), Workspace(problem).pose(np.zeros(5))
    out = np.cross(toward, [0.0, 0.0, 1.0])
    pose[:3, :3] = turned(pose[:3, :3], np.radians(cone.half_angle_deg + 2.0) * out)
    pull(controller, np.concatenate([np.zeros(3), 0.3 * out]))
    for _ in range(600):
        twist = controller.step(problem.response.comfort, pose).twist
        pose = moved(pose, twist * controller.dt)
    assert np.degrees(np.arccos(pose[:3, 0] @ toward)) < cone.half_angle_deg + 0.1


def test_the_gradient_is_that_of_the_report() -> None:
    """Equation 3.2: against minus epsilon dV/dq dq/dx by finite differences of a quadratic cost."""
    problem = load_problem("screwing")
    cost, gain = problem.cost, 1e-4
    posture = problem.response.comfort + 0.2
    controller = Gradient(problem, cost, gain)
    pose = Workspace(problem).pose(np.zeros(5))
    for _ in range(400):
        step = controller.step(posture, pose)
    slopes = [
        (cost(posture + d)[0] - cost(posture - d)[0]) / 2e-6 for d in 1e-6 * np.eye(len(posture))
    ]
    sensitivity = np.array(problem.response.sensitivity()(posture, 0)[0])
    np.testing.assert_allclose(step.twist, -gain * np.array(slopes) @ sensitivity, rtol=1e-4)


LATE = {
    "at once": {},
    "lag": {"lag": 0.1},
    "delay": {"delay": 0.1},
    "old pose": {"pose_delay": 0.1},
    "all": {"lag": 0.05, "delay": 0.06, "pose_delay": 0.04},
}


@pytest.mark.parametrize("late", LATE.values(), ids=LATE)
def test_the_gradient_stops_for_a_robot_as_late_as_it_is_declared(late: dict[str, float]) -> None:
    problem = load_problem("screwing")
    problem = problem.replace(robot=replace(problem.robot, **late))
    box = problem.limit_of(WorkspaceBox)
    controller, pose = Gradient(problem, problem.cost), Workspace(problem).pose(np.zeros(5))
    pull(controller, [9, 0, 0, 0, 0, 0])
    arm = SimulatedRobot(RobotKind(**late), pose, np.random.default_rng(0))
    furthest = 0.0
    for _ in range(800):
        twist = controller.step(problem.response.comfort, arm.measured_pose()).twist
        for _ in arm.execute(twist, controller.dt):
            furthest = max(furthest, arm.pose[0, 3])
    assert box.upper[0] - 0.02 < furthest < box.upper[0] + 1e-4


def test_the_gradient_compiled_is_the_same() -> None:
    problem = load_problem("screwing")
    pose, posture = Workspace(problem).pose(np.zeros(5)), problem.response.comfort + 0.2
    plain, fast = (Gradient(problem, problem.cost, compiled=each) for each in (False, True))
    for _ in range(20):
        steps = [each.step(posture, pose).twist for each in (plain, fast)]
        np.testing.assert_allclose(steps[1], steps[0], rtol=1e-9, atol=1e-12)
    assert steps[0].any()


def test_a_policy_in_place_of_the_gradient_is_sent_within_the_same_limits() -> None:
    problem = load_problem("screwing")
    pose, posture = Workspace(problem).pose(np.zeros(5)), problem.response.comfort + 0.2
    down = downhill(problem.cost, problem.response)
    # Of eq. 3.3 by finite differences.
    S, h = np.array(problem.response.sensitivity()(posture, 0)[0]), 1e-6
    slope = [problem.cost(posture + h * e) - problem.cost(posture - h * e) for e in np.eye(32)]
    expected = -np.ravel(slope) / (2 * h) @ S
    np.testing.assert_allclose(np.array(down(posture)).ravel(), expected, atol=1e-5)
    given, taught = (
        Gradient(problem, problem.cost, 0.1, policy=each)
        for each in (None, lambda q: 0.1 * down(q))
    )
    for _ in range(20):
        steps = [each.step(posture, pose).twist for each in (given, taught)]
        np.testing.assert_allclose(steps[1], steps[0], rtol=1e-12)
    assert steps[0].any()
    fast = Gradient(problem, problem.cost, policy=lambda q: ca.DM(np.full(6, 9.0)))
    for _ in range(200):
        twist = fast.step(posture, pose).twist
        assert (np.abs(twist) <= problem.twist_limit.speed + 1e-12).all()


def test_the_gradient_stops_below_a_cost_of_one() -> None:
    problem = load_problem("screwing")

    class Low:
        name, minimum = "low", 0.0

        def expression(self, q):
            return 0.5 + 0 * q[0]

        def __call__(self, postures):
            return np.full(len(np.atleast_2d(postures)), 0.5)

    pose = Workspace(problem).pose(np.zeros(5))
    assert not Gradient(problem, Low()).step(problem.response.comfort, pose).twist.any()


@pytest.mark.parametrize("name", TASKS)
@pytest.mark.parametrize("stature", [1.5, 1.75, 1.95])
def test_the_rule_is_at_elbow_height_ahead_and_within_the_workspace(
    name: str, stature: float
) -> None:
    problem, body = load_problem(name), Body.of_stature(stature)
    pose = rule_pose(problem, body)
    box, cone = problem.limit_of(WorkspaceBox), problem.limit_of(AxisCone)
    assert np.all(pose[:3, 3] >= np.array(box.lower) - 1e-12)
    assert np.all(pose[:3, 3] <= np.array(box.upper) + 1e-12)
    toward = np.array(cone.direction) / np.linalg.norm(cone.direction)
    assert pose[:3, 0] @ toward >= np.cos(np.radians(cone.half_angle_deg)) - 1e-9
    if name == "screwing":
        lengths = body.lengths
        hips = lengths["thigh"] + lengths["shank"] + lengths["foot_height"]
        elbow = hips + lengths["shoulder_height"] - lengths["upper_arm"]
        assert pose[2, 3] == pytest.approx(elbow, abs=0.01)
        assert pose[0, 3] == pytest.approx(0.40, abs=0.05)
        assert pose[1, 3] == pytest.approx(-lengths["shoulder_width"] / 2, abs=0.01)
        assert abs(pose[2, 0]) < 1e-12
    if name == "desk":
        # Both hands: in the middle; the elbow of who sits on a seat that suits the legs.
        lengths = body.lengths
        below = lengths["thigh"] * np.cos(np.radians(85)) + lengths["shank"]
        elbow = below + lengths["foot_height"] + lengths["shoulder_height"] - lengths["upper_arm"]
        assert pose[1, 3] == 0.0
        assert pose[2, 3] == pytest.approx(elbow, abs=0.02)


def test_still_does_nothing() -> None:
    problem = load_problem("desk")
    person = person_of_kind("follower", problem, 1)
    held = person.hold(person.comfort)
    trace = run_loop(problem, held, duration=1.0, seed=0, controller=Still(problem))
    np.testing.assert_array_equal(trace.poses[0], trace.poses[-1])
    assert {step.status for step in trace.steps} == {"settled"}
