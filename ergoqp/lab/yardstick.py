"""The yardstick of closed loops: the best place that exists, and simple ways to move the object.

A place counts if the object is carried to it straight from the start. Its score is the exact
score of the person's own undisturbed rest there. Places are spread evenly over the workspace.
Then the neighbourhoods of the best are searched, by the person's own rests. Known places from
elsewhere may be added. No controller is involved, so the yardstick can be computed before any
controller runs.

Baselines for controllers: simple ways to move the object, with the same limits. The object stays in
place, or is carried to the place of a rule of thumb or to the best place of the model, or follows
the gradient of the EPFL report. All keep the speed, acceleration and axes of the twist, the
workspace and the cone of the tool axis.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from ergoqp.costs.cost import Cost
from ergoqp.costs.smooth_reba import SmoothReba
from ergoqp.expressions import Evaluator
from ergoqp.human import Body
from ergoqp.joints import JOINTS
from ergoqp.lab.people.habits import BodyTasks, Work
from ergoqp.limits import AXES, AxisCone, WorkspaceBox
from ergoqp.native.compiled import compiled as machine_code
from ergoqp.problem.geometry import Workspace, frame_of, pose_error, rotation_vector, turned
from ergoqp.problem.problem import Problem
from ergoqp.responses import Response
from ergoqp.rest.person_protocol import Holding
from ergoqp.step.answer import Step

NOISE_DEG = 2.0
"""Width of the smooth score that ranks places with equal exact scores [deg]."""

_STEPS = (0.25, 0.12, 0.06)
"""Steps of the search, as shares of the workspace and of the cone."""


@dataclass(frozen=True)
class Place:
    """A place that the object was carried to, and how the person rests there.

    Attributes:
        pose: pose of the object (4, 4) [m].
        score: exact score of the person's rest, 0 if the place is not reached.
        value: smooth score of the rest at `NOISE_DEG`; infinite if the place is not reached.
        posture: posture at rest (32,) [rad].
    """

    pose: np.ndarray
    score: int
    value: float
    posture: np.ndarray

    @property
    def rank(self) -> tuple[float, float]:
        """Sort key of the place; lower is better."""
        return (self.score or np.inf, self.value)


class Judge:
    """Scores places for one problem.

    Args:
        problem: the problem with the sheet and the limits.
    """

    def __init__(self, problem: Problem) -> None:
        """Prepare the smooth score."""
        self.problem, self.workspace = problem, Workspace(problem)
        self._smooth = SmoothReba((NOISE_DEG,), (1.0,), problem.method, **problem.task)

    def score(self, posture: np.ndarray) -> int:
        """Return the exact score of a posture (32,) [rad]."""
        return int(self.problem.assess(posture).final[0])

    def carried(self, start: Holding, pose: np.ndarray) -> Place:
        """Return the result of carrying the object straight to a pose (4, 4)."""
        person = start.copy()
        reached = person.carry(pose)
        posture = person.posture
        if not reached or self.problem.own_limits.broken(pose, posture):
            return Place(pose, 0, np.inf, posture)
        return Place(pose, self.score(posture), float(self._smooth(posture)[0]), posture)

    def best(
        self,
        start: Holding,
        known: Iterable[np.ndarray] = (),
        *,
        places: int = 48,
        around: int = 3,
        enough: int | None = None,
    ) -> list[Place]:
        """Return all places that were tried from a start, the best first.

        Args:
            start: start of all straight paths.
            known: further poses (4, 4) to try.
            places: number of places that are spread over the workspace.
            around: number of the best places whose neighbourhoods are searched.
            enough: score at which the search ends; None: that of standing at ease with hanging
                arms, the lowest for any work.
        """
        if enough is None:
            enough = self.score(np.zeros(len(JOINTS)))
        given, spread = list(known), self.workspace.spread(places)
        found: list[Place] = []
        for pose in [*given, *map(self.workspace.pose, spread)]:
            found.append(self.carried(start, pose))
            if 0 < found[-1].score <= enough:
                return _ranked(found)
        pairs = zip(found[len(given) :], spread, strict=True)
        for place, point in sorted(pairs, key=lambda pair: pair[0].rank)[:around]:
            if place.score:
                found += self._searched(start, point, place, enough)
        return _ranked(found)

    def _searched(
        self, start: Holding, point: np.ndarray, place: Place, enough: int
    ) -> Sequence[Place]:
        """Return the places that were tried around one place, continuing from the best so far."""
        looked: list[Place] = []
        for step in _STEPS:
            for axis in np.flatnonzero(self.workspace.moves):
                for way in (-step, step):
                    beside = point.copy()
                    beside[axis] = np.clip(point[axis] + way, -1.0, 1.0)
                    looked.append(self.carried(start, self.workspace.pose(beside)))
                    if looked[-1].rank < place.rank:
                        place, point = looked[-1], beside
                    if 0 < place.score <= enough:
                        return looked
        return looked


def _ranked(places: Sequence[Place]) -> list[Place]:
    return sorted(places, key=lambda place: place.rank)


AHEAD = 0.40
"""Distance of the object in front of the shoulder in the rule of thumb [m]."""

GRADIENT_GAIN = 0.1
"""The factor epsilon of the EPFL report's equation 3.2, which it leaves open [m^2/s per point].

Of the values from 0.01 to 1 it ends lowest with either cost (0.3 is as low on the smooth
score), on starts that are not used for figures: see ``benchmarks.gradient_gain``.
"""

_EDGE = float(np.radians(0.5))
"""The gradient turns back when the tool axis is this close to the edge of its cone [rad]."""

_BACK = 0.5
"""Approximate time within which it is back there [s]."""


class Sent(Step):
    """The step of a baseline: a twist and a status, without a program."""

    def __init__(self, twist: np.ndarray, status: str) -> None:
        """Keep both."""
        self.twist, self.status, self.solve_time = twist, status, 0.0

    @property
    def posture_rate(self) -> np.ndarray:
        """Zero, because there is no model of the person (32,)."""
        return np.zeros(32)

    @cached_property
    def slack(self) -> dict[str, float]:
        """Empty, because no row is soft."""
        return {}


class Still:
    """Keeps the object where it is."""

    def __init__(self, problem: Problem) -> None:
        """Take the period of the problem."""
        self.dt = problem.dt

    def reset(self) -> None:
        """Do nothing: there is no state."""

    def step(self, posture: np.ndarray, pose: np.ndarray, **rest: object) -> Sent:
        """Return the zero twist."""
        return Sent(np.zeros(6), "settled")


class Drive:
    """Carries the object straight to a place, as fast as the limits allow, and leaves it there.

    The tool axis moves along a great circle, which does not leave a cone. The rest of the turn
    is about the tool axis. Axes that are not allowed do not move.

    Args:
        problem: the problem with the limits.
        start: pose of the object at the start (4, 4) [m].
        goal: pose to which it is carried (4, 4) [m].

    Attributes:
        dt: period [s].
        duration: duration of the whole path [s].
    """

    def __init__(self, problem: Problem, start: np.ndarray, goal: np.ndarray) -> None:
        """Plan the whole path."""
        self.dt, limit = problem.dt, problem.twist_limit
        free = np.array([axis in limit.axes for axis in AXES])
        shift = np.where(free[:3], goal[:3, 3] - start[:3, 3], 0.0)
        swing = _swing(start[:3, 0], goal[:3, 0])
        roll = 0.0
        if free[3:].all():
            swung = turned(start[:3, :3], swing)
            roll = float(rotation_vector(swung, goal[:3, :3]) @ goal[:3, 0])
        swing = np.where(free[3:], swing, 0.0)
        most = np.concatenate([np.abs(shift), np.abs(swing) + abs(roll)])
        pace = _trapezoid(most, limit.speed, limit.acceleration, self.dt, problem.average)
        self._poses = [start]
        for share in np.cumsum(pace) * self.dt:
            pose = start.copy()
            pose[:3, 3] += share * shift
            pose[:3, :3] = turned(start[:3, :3], share * swing)
            pose[:3, :3] = turned(pose[:3, :3], share * roll * pose[:3, 0])
            self._poses.append(pose)
        self.duration, self._next = len(pace) * self.dt, 0

    def reset(self) -> None:
        """Go back to the start of the path."""
        self._next = 0

    def step(self, posture: np.ndarray, pose: np.ndarray, **rest: object) -> Sent:
        """Return the next twist of the path. The posture does not matter."""
        if self._next + 1 >= len(self._poses):
            return Sent(np.zeros(6), "settled")
        here, there = self._poses[self._next : self._next + 2]
        self._next += 1
        return Sent(pose_error(here, there) / self.dt, "optimal")


def downhill(cost: Cost, response: Response) -> ca.Function:
    """Return ``q (32,) -> -dV/dq dq/dx (6,)``: equation 3.3 of the EPFL report without epsilon."""
    q = ca.MX.sym("q", len(response.coordinates))
    down = -ca.gradient(cost.expression(q), q).T @ response.expression(q)
    return ca.Function("downhill", [q], [ca.densify(down.T)], ["q"], ["down"])


class Gradient:
    """The EPFL report's controller: xi = -epsilon dV/dq dq/dx (equation 3.2), kept within limits.

    The only rule for coming to rest in the report is to stop below a cost of 1.

    Args:
        problem: the problem with the response and the limits.
        cost: V(q).
        gain: epsilon.
        compiled: compile the gradient with a C compiler.
        policy: gives the twist (6,) of a posture in place of the gradient: theta Phi(q), eq. 3.1.

    Raises:
        CompilerError: if ``compiled=True`` and there is no C compiler.
    """

    def __init__(
        self,
        problem: Problem,
        cost: Cost,
        gain: float = GRADIENT_GAIN,
        compiled: bool = False,
        policy: Callable[[ca.MX], ca.MX] | None = None,
    ) -> None:
        """Build the function of the gradient."""
        limit = problem.twist_limit
        self.dt, self._gain, self._acceleration = problem.dt, gain, limit.acceleration
        self._free = np.array([axis in limit.axes for axis in AXES], dtype=float)
        self._allowed = np.where(self._free > 0, limit.speed, np.inf)
        robot = problem.robot
        self._lag, late = robot.lag, robot.delay + robot.pose_delay
        self._late = math.ceil(late / self.dt - 1e-9)
        box, self._cone = problem.limit_of(WorkspaceBox), problem.limit_of(AxisCone)
        self._box = None if box is None else (np.array(box.lower), np.array(box.upper))
        if self._cone is not None:
            self._toward = np.array(self._cone.direction) / np.linalg.norm(self._cone.direction)
            self._widest = np.radians(self._cone.half_angle_deg) - _EDGE
        q = ca.MX.sym("q", len(problem.coordinates))
        value = cost.expression(q)
        down = downhill(cost, problem.response)(q) if policy is None else policy(q) / gain
        function = ca.Function("down", [q], [down, value], ["q"], ["g", "v"])
        self._evaluator = Evaluator(machine_code(lambda _: function) if compiled else function)
        self.reset()

    def reset(self) -> None:
        """Reset the state to rest."""
        self._twist, self._done = np.zeros(6), np.zeros(6)
        self._sent = deque([np.zeros(6)] * self._late)

    def step(self, posture: np.ndarray, pose: np.ndarray, **rest: object) -> Sent:
        """Return the twist down the gradient at the measured posture."""
        evaluator = self._evaluator
        evaluator.inputs["q"][:] = posture
        evaluator.evaluate()
        wished = np.zeros(6)
        if evaluator.outputs["v"][0] > 1.0:
            wished = self._gain * evaluator.outputs["g"] * self._free
        wished = wished / max(1.0, float((np.abs(wished) / self._allowed).max()))
        # Components that would leave workspace or cone stop. The others continue along the
        # wall.
        most = self._acceleration * self.dt
        twist = self._twist + (wished - self._twist).clip(-most, most)
        # The measurement is old and sent twists are not executed yet, so the object moves
        # further.
        stop = 2 * self.dt + float((np.abs(twist) / self._acceleration).max()) / 2
        ahead = stop * twist + self._lag * self._done + self.dt * sum(self._sent)
        if self._box is not None:
            here, there = pose[:3, 3], pose[:3, 3] + ahead[:3]
            lower, upper = self._box
            leaves = (there > np.maximum(upper, here)) | (there < np.minimum(lower, here))
            stopped = self._twist - self._twist.clip(-most, most)
            twist[:3] = np.where(leaves, stopped[:3], twist[:3])
        if self._cone is not None:
            here, turn = pose[:3, 0], ahead[3:]
            angle = _angle(here, self._toward)
            if angle + math.hypot(*turn.tolist()) > self._widest:
                there = turned(pose[:3, :3], turn)[:, 0]
                if _angle(there, self._toward) > max(self._widest, angle):
                    twist[3:] = self._along_the_cone(here, wished[3:])
        self._twist = twist
        share = 1.0 if self._lag == 0.0 else 1.0 - math.exp(-self.dt / self._lag)
        self._sent.append(twist)
        self._done += share * (self._sent.popleft() - self._done)
        return Sent(self._twist.copy(), "optimal")

    def _along_the_cone(self, axis: np.ndarray, wished: np.ndarray) -> np.ndarray:
        """Return the next turn (3,) [rad/s]: not further out, and as wished along the cone.

        Braking comes first. The rest of the acceleration is used for the other components.
        """
        now, most, fastest = self._twist[3:], self._acceleration[3:] * self.dt, self._allowed[3:]
        out = np.cross(self._toward, axis)
        out = out / max(float(np.linalg.norm(out)), 1e-12) * self._free[3:]
        out /= max(float(np.linalg.norm(out)), 1e-12)
        over = max(0.0, _angle(axis, self._toward) - self._widest) / _BACK
        brake = -max(0.0, float(now @ out) + over) * out
        brake *= min(1.0, _fits(brake, most))
        along = wished - now
        along -= (along @ out) * out
        turn = now + brake + along * min(1.0, _fits(along, most - np.abs(brake)))
        return turn.clip(-fastest, fastest)


def _angle(one: np.ndarray, other: np.ndarray) -> float:
    """Return the angle between two unit vectors [rad]."""
    return math.acos(min(1.0, max(-1.0, float(one @ other))))


def _fits(change: np.ndarray, most: np.ndarray) -> float:
    """Return the share of a change that keeps a limit per axis."""
    there = np.abs(change) > 1e-15
    return float(np.min(most[there] / np.abs(change[there]), initial=np.inf))


def rule_pose(problem: Problem, body: Body) -> np.ndarray:
    """Return the pose of the rule of thumb (4, 4): elbow height, `AHEAD` of the shoulder, level.

    In front of the shoulder of the working hand, or in the middle for both; in the workspace.

    Args:
        problem: the problem with the workspace and the cone.
        body: body of the person.
    """
    work, tasks = Work.of(problem), BodyTasks(body)
    upright = np.zeros(32)
    if work.stance == "standing":
        tasks.standing(upright)
    else:
        legs = upright.copy()
        legs[[20, 26]] = legs[[23, 29]] = np.radians(85.0)
        seat = work.seat_height
        tasks.seated(upright, tasks.leg_height(legs) if seat is None else seat)
    shoulder, elbow = (
        np.mean([tasks.frame(f"{hand}_{part}")[:3, 3] for hand in work.hands], axis=0)
        for part in ("shoulder", "elbow")
    )
    box, cone = problem.limit_of(WorkspaceBox), problem.limit_of(AxisCone)
    pose, toward = np.eye(4), np.array(cone.direction)
    pose[:3, 3] = np.clip([shoulder[0] + AHEAD, shoulder[1], elbow[2]], box.lower, box.upper)
    level = np.array([toward[0], toward[1], 0.0])
    leans = np.degrees(np.arcsin(min(1.0, abs(toward[2]) / np.linalg.norm(toward))))
    is_level = leans < cone.half_angle_deg
    pose[:3, :3] = frame_of(level / np.linalg.norm(level) if is_level else toward)
    return pose


def _swing(have: np.ndarray, want: np.ndarray) -> np.ndarray:
    """Return the shortest turn (3,) [rad] from one direction to another."""
    across = np.cross(have, want)
    size = float(np.linalg.norm(across))
    return across / max(size, 1e-12) * np.arctan2(size, float(have @ want))


def _trapezoid(
    way: np.ndarray, speed: np.ndarray, acceleration: np.ndarray, dt: float, average: float
) -> np.ndarray:
    """Return the pace of a whole path (n,) [1/s], period by period. Its sum is 1 / dt."""
    if not way.any():
        return np.zeros(0)
    there = way > 1e-12
    fastest = float(np.min(speed[there] / way[there]))
    quickest = float(np.min(acceleration[there] / way[there]))
    ramp = fastest / quickest
    if fastest * ramp > 1.0:
        ramp = quickest**-0.5
        fastest = quickest * ramp
    count = int(np.ceil((1.0 / fastest + ramp) / dt)) + 1
    times = (np.arange(count) + 0.5) * dt
    end = times[-1] + 0.5 * dt
    pace = np.clip(quickest * np.minimum(times, end - times), 0.0, fastest)
    window = max(1, round(average / dt))
    pace = np.convolve(pace, np.full(window, 1 / window))
    return pace / (pace.sum() * dt)
