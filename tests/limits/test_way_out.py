"""An object in a region to keep out of is led out, or it is said that no way leads out.

The judge is plain NumPy: it walks along every direction in small steps and looks where it is.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import casadi as ca
import numpy as np
import pytest
from step_samples import problem_of

from ergoqp.errors import ProblemError
from ergoqp.joints import JOINTS
from ergoqp.limits import Ball, Box, HalfSpace, KeepOut, TwistLimit, WorkspaceBox
from ergoqp.problem.problem import Problem
from ergoqp.problem.settings import DeclaredRobot, Frames
from ergoqp.simulation.check import Checker, Ways
from ergoqp.step.model import StepModel
from ergoqp.step.objective import _led_function
from ergoqp.step.rows import STEADY_RETURN
from ergoqp.step.stepper import Stepper

DT, STEP, FAR = 0.02, 1e-3, 2.5
UNIT = WorkspaceBox((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))


@dataclass(frozen=True)
class Pull:
    """A cost that draws the object, by the posture that is given."""

    minimum: float = 0.0
    name: str = "pull"

    def __call__(self, postures: Any) -> np.ndarray:
        return 25.0 * (np.atleast_2d(postures)[:, :6] ** 2).sum(axis=1)

    def expression(self, q: Any) -> Any:
        return 25.0 * ca.sumsqr(q[:6])


@dataclass(frozen=True)
class Direct:
    """Six joints, each of which follows one axis of the object."""

    coordinates = JOINTS
    largest = float(np.pi)
    joints = JOINTS[:6]
    comfort = np.zeros(32)
    weight_vector = np.ones(32)

    def expression(self, q: Any) -> Any:
        return self.sensitivity()(q, 0)[0]

    def sensitivity(self) -> ca.Function:
        q, locked = ca.SX.sym("q", 32), ca.SX.sym("locked", 32)
        S = ca.SX(32, 6)
        for i in range(6):
            S[i, i] = 1 - locked[i]
        return ca.Function("sensitivity", [q, locked], [ca.densify(S), ca.SX.zeros(1, 6)])

    def contact(self) -> ca.Function:
        return ca.Function("contact", [ca.SX.sym("q", 32)], [ca.DM.eye(4), ca.DM.eye(4)])


def scene(
    regions: list[Any], box: WorkspaceBox | None = UNIT, axes: Any = None, **terms: Any
) -> Problem:
    base = problem_of("screwing")
    twist = TwistLimit(0.3, 0.6, 1.0, 2.0, **({} if axes is None else {"axes": axes}))
    kept = [
        KeepOut(region, name=f"k{number}", recovery_time=0.5)
        for number, region in enumerate(regions)
    ]
    control = replace(base.control, comfort=0.0, stall_after=1e6, rest_below=0.0, move_above=0.0)
    limits = [twist, *([] if box is None else [replace(box, recovery_time=0.5)]), *kept]
    given = {"cost": Pull(), "response": Direct(), "control": control, "dt": DT} | terms
    given["frames"] = Frames(compare=False)
    return base.replace(limits=limits, **given)


def distances(regions: list[Any], points: np.ndarray) -> np.ndarray:
    """How far points (n, 3) are from each region (k, n), negative inside."""
    found = []
    for region in regions:
        if isinstance(region, Ball):
            found.append(np.linalg.norm(points - region.centre, axis=1) - region.radius)
        elif isinstance(region, HalfSpace):
            found.append(points @ region.normal - region.offset)
        else:
            apart = np.maximum(np.subtract(region.lower, points), points - region.upper)
            outside = np.linalg.norm(np.maximum(apart, 0), axis=1)
            found.append(np.where(outside > 0, outside, apart.max(axis=1)))
    return np.array(found)


def directions(regions: list[Any], place: np.ndarray, moves: np.ndarray) -> list[np.ndarray]:
    found = [np.array(each, float) for each in product((-1, 0, 1), repeat=3) if any(each)]
    found = [each for each in found if not each[~moves].any()]
    found += [moves * (place - region.centre) for region in regions if isinstance(region, Ball)]
    found += [moves * region.normal for region in regions if isinstance(region, HalfSpace)]
    return [each / np.linalg.norm(each) for each in found if np.linalg.norm(each) > 0]


def way(
    regions: list[Any], place: np.ndarray, spare: float = 0.0, axes: tuple[str, ...] = tuple("xyz")
) -> float:
    """The shortest straight way out of all regions, with so much to spare at its end and beside
    it; infinite if there is none."""
    inside = distances(regions, place[None])[:, 0] < -1e-6
    steps = np.arange(0.0, FAR, STEP)
    best = np.inf
    for direction in directions(regions, place, np.array([axis in axes for axis in "xyz"])):
        points = place + steps[:, None] * direction
        far = distances(regions, points)
        free = (far >= 0).all(axis=0)
        if not free.any():
            continue
        first = int(np.argmax(free))
        last = np.searchsorted(steps, steps[first] + spare + STEP)
        end = points[min(last, len(points) - 1)]
        enters = (far[~inside, : last + 1] < spare - 1e-6).any()
        leaves = (np.abs(end - 0.5) > 0.5).any()
        if not enters and not leaves:
            best = min(best, steps[first])
    return best


def follow(
    problem: Problem, place: np.ndarray, pull: np.ndarray, seconds: float
) -> tuple[np.ndarray, list[Any], Checker]:
    """Where an object goes that starts at rest, what each step said, and the checker's verdict."""
    stepper, checker, pose = Stepper(problem), Checker(problem), np.eye(4)
    pose[:3, 3], last = place, np.zeros(6)
    posture, path, steps = np.zeros(32), [place.copy()], []
    posture[:6] = -pull
    for _ in range(int(seconds / DT)):
        step = stepper.step(posture, pose)
        before, pose = pose, pose.copy()
        pose[:3, 3] += step.twist[:3] * DT
        checker.check(step.twist, last, before, None, np.zeros(32), DT, after=pose)
        last = step.twist
        path.append(pose[:3, 3].copy())
        steps.append(step)
    return np.array(path), steps, checker


@pytest.mark.parametrize("noise", [0.0, 1e-3])
@pytest.mark.parametrize(("beyond", "needed"), [(0.9, False), (1.1, True)])
def test_a_place_within_the_tolerance_of_the_workspace_is_inside(
    noise: float, beyond: float, needed: bool
) -> None:
    """A region in between would else have to be passed."""
    box = replace(UNIT, tolerance=5e-3)
    problem = scene([Box((0.0, 0.0, 0.0), (0.1, 1.0, 1.0))], box)
    problem = problem.replace(robot=DeclaredRobot(pose_noise=noise / np.sqrt(3)))
    pose = np.eye(4)
    pose[:3, 3] = -beyond * (5e-3 + noise) - 1e-12, 0.5, 0.5
    assert problem.way_out is not None
    assert problem.way_out.recovery_time == 0.5
    exact = scene([EDGE], box).way_out
    assert exact is not None
    np.testing.assert_allclose(np.subtract(problem.way_out.room, exact.room), noise, atol=1e-12)
    back, _, behind = problem.way_out._where(pose[:3, 3], problem.way_out.numbers)
    assert bool(np.array(back).any()) == bool(np.array(behind).any()) == needed
    assert (Ways(problem).length(pose[:3, 3]) > 0) == needed


def lengths(problem: Problem, place: Any) -> tuple[float, float]:
    """The length of the way out that the step finds, and the one that the checker finds [m]."""
    assert problem.way_out is not None
    pose = np.eye(4)
    pose[:3, 3] = place
    told = np.array(problem.way_out.function(pose, problem.way_out.numbers)).ravel()
    return np.inf if told[4] else told[3], Ways(problem).length(pose[:3, 3])


def test_without_a_workspace_a_way_leads_anywhere() -> None:
    problem = scene([Ball((5.0, -4.0, 3.0), 0.2)], None)
    np.testing.assert_allclose(lengths(problem, (5.0, -4.0, 2.97)), 0.17, atol=1e-9)


def test_a_way_may_graze_another_region_as_deep_as_counts_as_outside() -> None:
    """Half a tolerance deep it counts; two tolerances deep the way leads aside."""
    inner = Box((0.3, 0.4, 0.3), (0.5, 0.7, 0.7))
    for depth, expected in ((5e-7, 0.05), (2e-6, 0.05 * np.sqrt(2))):
        beside = Box((0.46, 0.2, 0.3), (0.48, 0.5 + depth, 0.7))
        found = lengths(scene([inner, beside]), (0.45, 0.5, 0.5))
        np.testing.assert_allclose(found, expected, atol=1e-9)


def test_a_way_leads_no_nearer_to_an_end_of_the_workspace_than_the_object_can_rest() -> None:
    """1 mm, and what a mean that rises for one period more needs; the robot does a tenth more."""
    lasts = 3 * DT
    room = 1e-3 + 1.1 * (lasts * DT + lasts**2 / 8)
    for end in (1 - room - 1e-4, 1 - room + 1e-4):
        problem = scene([Box((0.3, 0.2, 0.2), (end, 0.8, 0.8))], axes=("x",))
        problem = problem.replace(robot=DeclaredRobot(gain_error=0.1))
        assert problem.average > 0
        expected = 0.1 if end < 1 - room else end - 0.1 - 0.3
        np.testing.assert_allclose(lengths(problem, (end - 0.1, 0.5, 0.5)), expected, atol=1e-9)


def test_an_object_that_only_turns_has_no_way_out() -> None:
    problem = scene([EDGE], axes=("rx", "ry", "rz"))
    assert problem.way_out is None
    assert Ways(problem).length(np.array([0.05, 0.5, 0.5])) == 0


@pytest.mark.parametrize(("deep", "needed"), [(0.9, False), (1.1, True)])
def test_a_place_in_a_region_by_less_than_tolerance_and_noise_is_outside(
    deep: float, needed: bool
) -> None:
    noise = 1e-3
    problem = scene([Box((0.0, 0.0, 0.0), (0.1, 1.0, 1.0))])
    problem = problem.replace(robot=DeclaredRobot(pose_noise=noise / np.sqrt(3)))
    tolerance = problem.limit_of(KeepOut).tolerance
    found = lengths(problem, (0.1 - deep * (tolerance + noise), 0.5, 0.5))
    np.testing.assert_allclose(found, deep * (tolerance + noise) if needed else 0.0, atol=1e-9)


EDGE = Box((0.0, 0.3, 0.3), (0.1, 0.7, 0.7))
SIDE = Box((-0.05, 0.2, 0.2), (0.05, 0.8, 0.8))
PAIR = [Box((0.3, 0.3, 0.3), (0.55, 0.7, 0.7)), Box((0.45, 0.3, 0.3), (0.7, 0.7, 0.7))]
NESTED = [Ball((0.5, 0.5, 0.5), 0.2), Ball((0.6, 0.5, 0.5), 0.05)]
FLOOR = [HalfSpace((0.0, 0.0, 1.0), 0.2), Box((0.3, 0.3, 0.0), (0.7, 0.7, 0.6))]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("regions", "place", "length"),
    [
        # 2 cm from the wall, 8 cm from the other side; 5 mm from the wall, 1 cm from a side.
        ([EDGE], (0.02, 0.5, 0.5), 0.08),
        ([EDGE], (0.005, 0.69, 0.5), 0.01),
        ([Box((0.3, 0.3, 0.9), (0.7, 0.7, 1.0))], (0.5, 0.5, 0.98), 0.08),
        (PAIR, (0.5, 0.5, 0.5), 0.2),
        (PAIR, (0.44, 0.5, 0.5), 0.14),
        (NESTED, (0.54, 0.5, 0.5), 0.196),
        (FLOOR, (0.5, 0.45, 0.1), 0.15 * 2**0.5),
        ([Ball((-0.05, 0.5, 0.5), 0.3)], (0.1, 0.5, 0.5), 0.15),
        ([Ball((0.05, 0.5, 0.5), 0.3)], (0.01, 0.6, 0.5), 0.197),
    ],
)
@pytest.mark.parametrize("pull", [0.0, 1.0])
def test_an_object_in_a_region_is_led_out_by_the_shortest_way_that_ends_in_the_workspace(
    regions: list[Any], place: tuple, length: float, pull: float
) -> None:
    # The cost draws it back in.
    at = np.array(place)
    path, steps, checker = follow(scene(regions), at, pull * np.array([0, 0.3, -1, 0, 0, 0]), 7.0)
    assert way(regions, at) == pytest.approx(length, abs=2 * STEP)
    assert steps[0].status == "recovering"
    assert "coming back" in steps[0].reason
    assert min(steps[0].margins[f"k{i}"] for i in range(len(regions))) == pytest.approx(
        -length, abs=2e-3
    )
    assert distances(regions, path[-1:]).min() >= -1e-6
    assert (np.abs(path[-1] - 0.5) <= 0.5).all()
    assert not any(checker.violations.values())
    assert steps[-1].status != "recovering"


@dataclass(frozen=True)
class Unfollowed(Direct):
    """A response whose part that cannot be followed is no number where it was not tried."""

    bad: float = np.nan

    def sensitivity(self) -> ca.Function:
        q, locked = ca.SX.sym("q", 32), ca.SX.sym("locked", 32)
        S, E = super().sensitivity()(q, locked)
        E[0, 0] = ca.if_else(ca.fabs(q[6] - 2.7) < 0.01, self.bad, 0)
        return ca.Function("sensitivity", [q, locked], [S, ca.densify(E)])


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_term_without_a_number_is_named_on_the_way_out_too(bad: float) -> None:
    stepper, pose = Stepper(scene([EDGE], response=Unfollowed(bad))), np.eye(4)
    pose[:3, 3], posture = (0.05, 0.5, 0.5), np.zeros(32)
    assert stepper.step(posture, pose).status == "recovering"
    posture[6] = 2.7
    step = stepper.step(posture, pose)
    assert step.status == "braking"
    assert "response: got contact motion that cannot be followed that is NaN" in step.reason


def test_out_of_a_region_the_object_goes_no_faster_than_all_axes_together_can() -> None:
    problem = scene([EDGE])
    assert problem.way_out is not None
    assert problem.way_out.recovery_time == 0.5
    led = _led_function(StepModel(problem))
    acceleration = problem.twist_limit.linear_acceleration
    way, H, g = np.array([0.6, 0.0, 0.8, 0.1]), np.eye(6), np.ones(6)
    for along, far, pace in (
        (0.0, 0.1, 0.01 * acceleration),
        (0.03, 0.1, 0.03 + 0.01 * acceleration),
        (-0.03, 0.1, 0.01 * acceleration),
        (0.3, 0.1, 0.2),
        (0.2, 1e-3, STEADY_RETURN),
    ):
        way[3] = far
        # What it moves beside the way does not count.
        previous = np.r_[along * way[:3] + 0.04 * np.array([0.8, 0.0, -0.6]), np.zeros(3)]
        led_H, led_g = (np.array(part) for part in led(H, g, way, previous, 0.01))
        np.testing.assert_allclose(np.linalg.solve(led_H, -led_g)[:3, 0], pace * way[:3])
        np.testing.assert_array_equal(led_g[3:, 0], g[3:])


def test_an_object_outside_the_workspace_is_led_past_a_region_in_between() -> None:
    # Nothing draws it aside.
    path, steps, checker = follow(scene([SIDE]), np.array([-0.2, 0.5, 0.5]), np.zeros(6), 9.0)
    assert distances([SIDE], path).min() >= -1e-9
    assert path[-1, 0] >= -1e-6
    assert steps[-1].status != "recovering"
    assert not any(checker.violations.values())


@pytest.mark.parametrize("place", [(-0.02, 0.5, 0.5), (-0.04, 0.75, 0.5)])
def test_an_object_outside_the_workspace_and_in_a_region_comes_back(place: tuple) -> None:
    path, steps, _ = follow(scene([SIDE]), np.array(place), np.zeros(6), 9.0)
    assert distances([SIDE], path[-1:]).min() >= -1e-6
    assert path[-1, 0] >= -1e-6
    assert steps[-1].status != "recovering"


@pytest.mark.parametrize(
    ("regions", "box", "axes", "said"),
    [
        # Both ends of all axes of the object are shut.
        ([Box((0.2, -1, -1), (0.4, 2, 2))], UNIT, ("y", "z", "rx"), "in k0"),
        ([Box((0.2, 0.2, -1), (0.4, 0.4, 2))], UNIT, ("z", "rx"), "in k0"),
    ],
)
def test_where_no_way_leads_out_the_object_rests_and_says_so_once(
    regions: list[Any], box: WorkspaceBox, axes: Any, said: str | None
) -> None:
    place = np.array([0.3, 0.3, 0.3])
    path, steps, _ = follow(scene(regions, box, axes), place, np.ones(6), 3.0)
    assert {step.status for step in steps} == {"braking"}
    assert {step.reason for step in steps} == {
        f"the object is {said}, and none of the straight ways that are tried leads from there to a"
        " place where all limits hold: it rests until it is moved by hand"
    }
    assert np.abs(path - place).max() == 0


def random_scene(rng: np.random.Generator) -> tuple[list[Any], np.ndarray] | None:
    """Regions at edges, over each other and one in the other, and a place in one of them."""
    regions: list[Any] = []
    for kind in rng.integers(4, size=rng.integers(1, 5)):
        at, size = rng.uniform(0, 1, 3), rng.uniform(0.08, 0.4)
        if kind < 2:
            if rng.random() < 0.5:
                at[rng.integers(3)] = rng.integers(2)
            half = size * rng.uniform(0.3, 1, 3)
            regions.append(Box(tuple(at - half), tuple(at + half)))
        elif kind == 2:
            regions.append(Ball(tuple(at), size))
        else:
            normal = rng.normal(size=3)
            normal /= np.linalg.norm(normal)
            regions.append(HalfSpace(tuple(normal), float(normal @ (0.5 - 0.3 * normal))))
    places = rng.uniform(0.001, 0.999, (400, 3))
    inside = places[distances(regions, places).min(axis=0) < -0.01]
    return (regions, inside[0]) if len(inside) else None


def judge_scenes(seed: int, count: int) -> dict[str, int]:
    """Follow objects out of random regions; counts of what happened."""
    rng, found = np.random.default_rng(seed), {"led": 0, "none": 0, "close": 0}
    while sum(found.values()) < count:
        made = random_scene(rng)
        if made is None:
            continue
        regions, place = made
        axes = tuple(axis for axis in "xyz" if rng.random() < 0.7) or ("y",)
        try:
            problem = scene(regions, axes=axes)
        except ProblemError:  # nothing is left of the workspace
            continue
        sure, likely = (way(regions, place, spare, axes) for spare in (0.008, 0.0))
        pull = np.append(rng.uniform(-1, 1, 3), np.zeros(3)) * rng.choice([0.0, 1.0])
        path, steps, checker = follow(problem, place, pull, 10.0 if np.isfinite(likely) else 1.0)
        where = f"seed {seed}: {regions} from {place}"
        assert not any(checker.violations.values()), f"{where}: {checker.max_violation}"
        if not np.isfinite(likely):
            found["none"] += 1
            assert {step.status for step in steps} == {"braking"}, where
            assert len({step.reason for step in steps}) == 1, where
            assert np.abs(path - place).max() == 0, where
            continue
        if not np.isfinite(sure):
            found["close"] += 1
            continue
        found["led"] += 1
        assert distances(regions, path[-1:]).min() >= -1e-6, where
        assert (np.abs(path[-1] - 0.5) <= 0.5 + 1e-6).all(), where
        assert steps[-1].status != "recovering", where
        # Never further in than before, by the judge's own measure.
        outside = distances(regions, path).min(axis=0) >= -1e-6
        last = len(path) if not outside.any() else int(np.argmax(outside))
        lengths = [way(regions, path[i], axes=axes) for i in range(0, last, 25)]
        assert np.all(np.diff(lengths) <= 2 * STEP), f"{where}: {lengths}"
        # What is outside of a region never gets into it, and what is out stays out.
        for far in distances(regions, path):
            assert far[int(np.argmax(far >= -1e-6)) :].min() >= -1e-6 or far.max() < -1e-6, where
    return found


@pytest.mark.slow
def test_every_object_with_a_straight_way_out_comes_out() -> None:
    found = judge_scenes(0, 12)
    assert found["led"] >= 8


def test_outside_of_all_regions_nothing_is_led() -> None:
    problem = scene([EDGE, *NESTED])
    way_out, pose = problem.way_out, np.eye(4)
    assert way_out is not None
    for place in np.random.default_rng(0).uniform(0, 1, (300, 3)):
        pose[:3, 3] = place
        inside = distances([EDGE, *NESTED], place[None]).min() < -1e-6
        assert np.any(np.array(way_out.function(pose, way_out.numbers))) == inside


@pytest.mark.slow
def test_step_and_checker_find_the_same_length_of_the_way() -> None:
    """Two codes that share nothing, inside the workspace and outside, for some or all axes."""
    rng, found = np.random.default_rng(5), []
    while len(found) < 600:
        made = random_scene(rng)
        axes = tuple(axis for axis in "xyz" if rng.random() < 0.4) or ("y",)
        try:
            problem = scene(made[0] if made else [EDGE], axes=axes)
        except ProblemError:  # nothing is left of the workspace
            continue
        if problem.way_out is None:  # no axis of the object leads out
            continue
        # Few places drawn anywhere are in a ball, where the nearest point may be the way out.
        balls = [each for each in (made[0] if made else []) if isinstance(each, Ball)]
        inside = [each.centre + each.radius * rng.uniform(-0.5, 0.5, (10, 3)) for each in balls]
        for place in np.concatenate([rng.uniform(-0.4, 1.4, (40, 3)), *inside]):
            length, checked = lengths(problem, place)
            assert length == pytest.approx(checked, abs=1e-6)
            found.append(length)
    kinds = [sum(np.isinf(found)), sum(np.array(found) == 0), sum(np.isfinite(found))]
    assert min(kinds) > 15
