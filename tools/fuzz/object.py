"""The fuzzer's judge of the true object: it stays in workspace and tool cone through every stop.

What is outside comes no further out. Where nobody sent the object (it was somewhere else all at
once, or was taken over in motion), it may be as far outside as braking forces from there: that stop
is really braked by a clone of the loop, with the true robot.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from ergoqp.problem.problem import Problem
from ergoqp.simulation.robot import RobotKind
from ergoqp.step.stepper import Stepper
from tools.fuzz.judge import Law, Sent, Tally
from tools.fuzz.regions import Regions
from tools.fuzz.world import TrueObject, Way

_ALLOWED: Final = 1e-8
"""Rounding of a place [m, rad]."""

_KEPT: Final = 1e-6
"""Tolerance of a region [m]."""

_ALLOWED_LATE: Final = (1e-5, float(np.radians(0.01)))
"""What is taken for inside of robots that are late: turns are put together in parts [m, rad]."""


class ObjectJudge:
    """Where one object is, and how far outside it may be.

    Attributes:
        rows: its workspace and cone.
        world: the object, None as long as nobody knows where it is.
        obeys: False while the robot does something else than it is sent.
        can_hold: whether the robot may hold on to a twist again, see `DeclaredRobot.longest_hold`.
    """

    def __init__(
        self, problem: Problem, stepper: Stepper, law: Law, tally: Tally, dice: np.random.Generator
    ) -> None:
        """Judge the objects of one loop after the other; see `begin`.

        Args:
            problem: the task.
            stepper: the loop's; it is left as it is.
            law: how the object stops.
            tally: takes what is found.
            dice: of the judge alone.
        """
        self.rows, self._problem, self._law, self._tally, self._dice = (
            law.rows,
            problem,
            law,
            tally,
            dice,
        )
        self._stepper, self._regions = stepper, Regions(problem)
        robot = problem.robot
        self._late = bool(robot.delay or robot.lag or robot.pose_delay)
        # A short history cannot hold two much shorter periods, one after the other.
        seconds = [span for span in (problem.average, robot.delay + robot.pose_delay) if span]
        self._uneven = 4 if all(span >= 4 * problem.dt for span in seconds) else 3
        limit = problem.twist_limit
        late = robot.delay + robot.pose_delay + 20 * robot.lag
        self._longest_stop = (
            float(np.max(limit.speed / limit.acceleration)) + problem.average + late + 0.1
        )

    def begin(
        self, kind: RobotKind, place: np.ndarray | None, twist: np.ndarray, undeclared: np.ndarray
    ) -> None:
        """Begin with another object.

        Args:
            kind: how its robot moves it.
            place: where it is measured (4, 4); None: nobody knows yet.
            twist: with which it moves (6,).
            undeclared: by how much its place may be mistaken without that being declared (6,).
        """
        self._kind, self._twist, self.obeys, self.can_hold, self._loose = (
            kind,
            twist,
            True,
            True,
            True,
        )
        self.world = None if place is None else TrueObject(kind, place, twist)
        self._least = np.zeros(len(self.rows.names))
        late = (
            np.array([_ALLOWED_LATE[int(name == "tool axis")] for name in self.rows.names])
            if self._late
            else _ALLOWED
        )
        self._tolerance = late + self.rows.reach(undeclared)
        # In which regions the object may be, because nobody sent it there.
        self._within = np.zeros(len(self._regions.names), dtype=bool)
        self._spared = (_ALLOWED_LATE[0] if self._late else _ALLOWED) + _KEPT
        self._spared += float(np.linalg.norm(undeclared[:3]))
        self._undeclared = bool(undeclared.any())

    def appear(self, measured: np.ndarray) -> None:
        """Be where nobody sent it (4, 4), as it is measured."""
        if self.world is None:
            self.world = TrueObject(self._kind, measured, self._twist)
        else:
            self.world.teleport(measured)
        self._loose = True

    def disobey(self, does: np.ndarray | None) -> None:
        """Let the robot make something else of every twist (6, 6), or obey again.

        That is judged from then on only.
        """
        if self.world is not None:
            self.world.disobey(does)
            self.obeys, self._loose = does is None, True

    def settle(self, state: np.ndarray, sent: Sent, dt: float) -> None:
        """Reckon how far outside the object may be from now on, if it is where nobody sent it.

        The stop is really braked, at the usual periods; by how much others may differ is allowed,
        and what the robot may do on for once.

        Args:
            state: of the stepper before the call.
            sent: what was sent until then.
            dt: first period [s].
        """
        if self.world is None or not self._loose:
            return
        self._loose, kept, usual = False, self._stepper.state(), self._problem.dt
        here = self.rows.outside(self.world.pose)
        self._stepper.restore(state)
        way, end = self._brake_down(
            self.world.copy(), sent.copy(), [dt, *[usual] * 3], "a stop that is forced"
        )
        worst = self.rows.worst(way)
        self._stepper.restore(kept)
        held = self._problem.robot.longest_hold * np.maximum(
            np.abs(sent.twist), np.abs(self._law.planned)
        )
        apart = self.rows.reach(self._law.apart(usual) + held)
        beside = float(np.linalg.norm((self._law.apart(usual) + held)[:3]))
        self._within = self._regions.met(way, beside)
        farthest = np.maximum(worst + np.where(worst > here + _ALLOWED, apart, 0), end + apart)
        self._least = np.maximum(farthest, 0)

    def see(self, pose: np.ndarray) -> None:
        """Take notice of the pose (4, 4) by which a step went.

        Where its noise is not declared, an object beside a region may be seen in it. The step then
        leads it out by a straight way that ends in the workspace, which may go through the region.
        """
        if self._undeclared:
            self._within |= self._regions.depths(pose[:3, 3]) > 0

    def send(self, twist: np.ndarray, seconds: float, kind: str, where: str, what: str) -> None:
        """Let the robot do what was sent (6,) for some seconds, and judge the way of the object.

        `kind` is what was special.
        """
        if self.world is None:
            return
        way = self.world.send(twist, seconds)
        worst = self.rows.worst(way)
        late = seconds > 1.001 * self._problem.longest_period
        if late or not self.obeys:
            # Where a robot that disobeys leads the object is not the step's, nor where a late call
            # does; from then on, it is.
            self._least = np.maximum(self._least, worst)
            self._within |= self._regions.met(way, _KEPT)
            self._loose |= late
        self._judge(worst, kind, where, what)
        self._judge_regions(way, kind, where, what)
        if self.obeys and self.world.at_rest:
            self._within &= self._regions.depths(self.world.pose[:3, 3]) > -_KEPT
            self._least = np.minimum(self._least, np.maximum(self.rows.outside(self.world.pose), 0))
            self.can_hold = True

    def stop(
        self, twist: np.ndarray, sent: Sent, even: bool, share: float, where: str, what: str
    ) -> None:
        """Really brake down from here for a share of the steps, smaller the longer a stop takes.

        Args:
            twist: sent last (6,).
            sent: and what was sent before.
            even: whether no period of late was much shorter than the loop's; else more of those
                would be too many.
            share: of the steps.
            where: for the report.
            what: for the report.
        """
        usual, robot = self._problem.dt, self._problem.robot
        if (
            self.world is None
            or self._loose
            or not self.obeys
            or self._dice.random() > share * min(1.0, 50 * usual / self._longest_stop)
        ):
            return
        self._tally.stops += 1
        here, world = self.rows.outside(self.world.pose), self.world.copy()
        before: Way = []
        if self.can_hold and robot.longest_hold and self._dice.random() < 0.5:
            before = world.send(twist, robot.longest_hold)
        # Not shorter than the loop's on average.
        periods = ([1.0], [3.0], [0.5, 1.5, 1.0], [3.0, 0.1, 0.2])[
            self._dice.integers(self._uneven if even else 2)
        ] * 3
        way, end = self._brake_down(world, sent.copy(), [usual * x for x in periods], where)
        way = [*before, *way]
        worst = np.maximum(here, self.rows.worst(way))
        self._judge(worst, "stop: ", where, f"periods {periods[:3]}, {what}")
        self._judge_regions(way, "stop: ", where, f"periods {periods[:3]}, {what}")
        # What comes in stays in, but for what other periods do.
        apart = self.rows.reach(self._law.apart(3 * usual))
        inward = (worst <= here + 1e-12) & (end < here - apart)
        self._least = np.where(
            inward, np.minimum(self._least, np.maximum(here + apart, 0)), self._least
        )

    def _judge(self, worst: np.ndarray, prefix: str, where: str, what: str) -> None:
        for i in np.flatnonzero(worst > self._least + self._tolerance):
            far = (
                f"{worst[i]:.6g} outside, {worst[i] - self._least[i]:.2g} more than allowed: {what}"
            )
            self._tally.wrong("unsafe", f"{prefix}{self.rows.names[i]}", where, far)
            # One example is enough.
            self._loose = True

    def _judge_regions(self, way: Way, prefix: str, where: str, what: str) -> None:
        """Judge that a way leads into no region that the object was not in.

        How it comes out of one is judged by the tests, `tests/limits/test_way_out.py`.
        """
        for i in np.flatnonzero(self._regions.met(way, -self._spared) & ~self._within):
            self._tally.wrong("unsafe", f"{prefix}into a region", where, f"region {i}: {what}")
            self._within[i] = self._loose = True

    def _brake_down(
        self, world: TrueObject, sent: Sent, periods: list[float], where: str
    ) -> tuple[Way, np.ndarray]:
        """Brake down to rest; the last three periods are taken in turns.

        Returns:
            The way, and how far outside the object is in the end (k,).
        """
        state, passed, number = self._stepper.state(), 0.0, 0
        way: Way = [(world.pose, np.zeros(6))]
        longest = self._longest_stop + 4 * max(periods)
        while not world.at_rest:
            if passed > longest:
                self._tally.wrong(
                    "unsafe",
                    "does not stop",
                    where,
                    f"still {sent.twist} after {passed:.2f} s of braking",
                )
                break
            dt = periods[number] if number < len(periods) else periods[-1 - number % 3]
            step = self._stepper.brake(dt)
            for name, by in sent.take(step.twist, dt).items():
                what = f"{by:.2g} beyond (relative), braking {step.twist} dt {dt:g}"
                self._tally.wrong("unsafe", f"stop: {name}", where, what)
            way += world.send(step.twist, dt)
            passed, number = passed + dt, number + 1
        self._stepper.restore(state)
        return way, self.rows.outside(world.pose)
