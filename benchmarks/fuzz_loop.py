"""One loop of the fuzzer: a stepper under attack, the true object, the person who follows, and the judge of every answer."""

from __future__ import annotations

import traceback
from collections import deque
from dataclasses import replace
from typing import Any, Final

import numpy as np

from benchmarks.fuzz_inputs import Call, moving, somewhere
from benchmarks.fuzz_judge import Law, Sent, Tally
from benchmarks.fuzz_reasons import ReasonJudge
from benchmarks.fuzz_robot import RobotReckoning
from benchmarks.fuzz_world import HardRows, TrueObject, Way, moved, turned
from ergoqp.errors import InputError
from ergoqp.joints import JOINTS, LOWER, UPPER
from ergoqp.problem import Problem
from ergoqp.simulation.robot import RobotKind
from ergoqp.step import Step

ALLOWED: Final = 1e-8
"""Rounding of a place [m, rad]."""

ALLOWED_LATE: Final = np.array([1e-5, np.radians(0.01)])
"""What is taken for inside of robots that are late: turns are put together in parts [m, rad]."""

_BRAKES: Final = ("braking", "invalid")

_STOPS: Final = 0.1
"""Share of the steps from which the object is really braked down."""


class Loop:
    """A stepper under test, and everything that the judge knows about it."""

    def __init__(self, problem: Problem, rng: np.random.Generator, judge: np.random.Generator, tally: Tally) -> None:
        """Build the stepper once.

        Args:
            problem: the task.
            rng: of the calls.
            judge: of the judge, so that calls are the same however they are judged.
            tally: takes what is found.
        """
        self.problem, self.rng, self.dice, self.tally = problem, rng, judge, tally
        self.rows, self.law, self.stepper = HardRows(problem), Law(problem), problem.stepper()
        self.joints, self._state = self.law.joints, self.stepper._inputs["state"]
        self.reasons = ReasonJudge(problem, self.rows, self.joints, tally)
        self._contact = problem.response.contact()
        robot = problem.robot
        self._late = bool(robot.delay or robot.lag or robot.pose_delay)
        self.restart()

    # --- a sequence ------------------------------------------------------------------------------------------------------

    def restart(self) -> None:
        """Start a new sequence: another person, another robot within its declaration, another way of calling."""
        rng, robot = self.rng, self.problem.robot
        comfort = np.asarray(self.problem.response.comfort)  # type: ignore[attr-defined]
        self.person = np.clip(comfort + np.radians(rng.choice([0, 10, 30])) * rng.normal(size=32), LOWER, UPPER)
        self.lying = bool(rng.random() < 0.3)
        measures = ("integrated", "placed", "measured", "now and then")[rng.choice(4, p=[0.3, 0.1, 0.4, 0.2])]
        self.measures = "measured" if robot.gain_error or robot.longest_hold else measures
        self.reports = ("no", "mean", "end")[rng.choice(3, p=[0.5, 0.3, 0.2])]
        kind = RobotKind.of(robot, rng, float(rng.choice([1.0, rng.random()])))
        if self.measures == "measured":
            kind = replace(kind, speed_noise=float(rng.choice([0.0, 0.05, 0.2])))
        elif self.reports == "end":
            # What is integrated must be what was done.
            self.reports = "mean"
        self.noise = np.repeat([kind.pose_noise, np.radians(kind.pose_noise_deg)], 3)
        if not robot.declared and self.measures == "measured" and rng.random() < 0.2:
            # Less than what is a fault, and not declared: it may be outside by that.
            kind = replace(kind, pose_noise=2e-4, pose_noise_deg=0.04)
            self.noise = 3 * np.repeat([2e-4, np.radians(0.04)], 3)
        self.kind = kind
        place = None
        if self.measures != "integrated":
            place = np.array(self._contact(self.person)[0]) if rng.random() < 0.3 else somewhere(rng, self.problem)
        self._begin(moving(rng, self.problem) if rng.random() < 0.25 else np.zeros(6), place)

    def _begin(self, twist: np.ndarray, place: np.ndarray | None) -> None:
        """Begin with an object that moves at a twist (6,), at a place (4, 4), or where the first posture says."""
        self.stepper.reset(twist if twist.any() else None)
        speed = self.problem.twist_limit.speed
        start = np.clip(twist, -speed, speed)
        self.sent, self.start = Sent.begin(self.problem, start), start
        self.law.restart(start)
        self.robot = RobotReckoning(self.problem, not self.lying, start)
        declared = self.problem.robot
        as_declared = RobotKind(delay=declared.delay + declared.pose_delay, lag=declared.lag)
        self._declared, self._done = TrueObject(as_declared, np.eye(4), start), np.zeros(6)
        self.world = None if place is None else TrueObject(self.kind, place, start)
        self.place = place
        self.before: np.ndarray | None = None
        self.least, self.can_hold = np.zeros(len(self.rows.names)), True
        self._disobeys, self._stray, self._anchored, self._fresh = 0, False, False, True
        self.periods: deque[float] = deque(maxlen=400)

    def sane(self) -> Call:
        """Return the call of a well-behaved loop."""
        rng = self.rng
        call = Call(np.clip(self.person + np.radians(0.5) * rng.normal(size=32), -3.1, 3.1))
        if self.world is not None:
            asked = {"measured": 1.0, "now and then": 0.5}.get(self.measures, 0.0)
            if rng.random() < asked or (self.before is None and self.measures != "integrated"):
                call.arguments["pose"] = self.world.measure(rng)
            if self.reports != "no" and self.before is not None:
                call.arguments["twist"] = self.world.report(rng, self.reports == "mean")
        return call

    def take(self, call: Call, where: str) -> None:
        """Make a call and judge the answer."""
        kind = "honest" if not self.lying else "lying"
        where = f"{where} {self.problem.name} {kind} {self.measures} [{' '.join(call.names) or 'sane'}]"
        self.tally.steps += 1
        self._prepare(call)
        state = self._state.copy()
        try:
            if call.kind == "reset":
                self._take_over(call)
                return
            if call.kind == "brake":
                state = self._ramped(call, where)
                step = self.stepper.brake(**call.arguments)
            else:
                step = self.stepper.step(call.posture, **call.arguments)
            reason = step.reason
        except BaseException as error:  # whatever it is, the loop must not see it
            if isinstance(error, KeyboardInterrupt):
                raise
            at = traceback.extract_tb(error.__traceback__)[-1]
            kind = f"{type(error).__name__} in {at.name}"
            self.tally.wrong("exceptions", kind, where, f"{error!r} of {call.arguments or call.posture!r}")
            self.restart()
            return
        self.tally.statuses[step.status] += 1
        self._judge(call, step, reason, state, where)

    def _prepare(self, call: Call) -> None:
        """Keep what is declared: one hold per stop, and none that the next pose does not show."""
        usual, dt = self.problem.dt, call.arguments.get("dt")
        allowed = self.can_hold and self.measures == "measured"
        long = isinstance(dt, float) and 3.01 * usual < dt <= self.problem.longest_period
        if long and not allowed:
            del call.arguments["dt"]
        if not allowed or long:
            call.hold = 0.0
        if call.hold or (long and allowed):
            self.can_hold = False

    def _take_over(self, call: Call) -> None:
        """Let the stepper begin anew with a moving object; what is no twist must raise what is documented, and change nothing."""
        place = None if self.world is None or self.measures == "integrated" else self.world.seen.pose
        if not call.invalid:
            self._begin(call.arguments["twist"], place)
            return
        before = self._state.copy()
        try:
            self.stepper.reset(call.arguments["twist"])
        except InputError:
            if np.array_equal(before, self._state):
                return
        self.tally.wrong("reasons_wrong", "reset takes what is no twist", "reset", f"{call.arguments}")
        self.restart()

    def _ramped(self, call: Call, where: str) -> np.ndarray:
        """Brake, call by call, for the time that the robot ramps down by itself: that must lead to the same stop.

        Returns:
            State from which the last call would be made.
        """
        try:
            left = float(call.arguments.get("elapsed", 0.0))
        except Exception:  # not a number: no time has passed
            return self._state.copy()
        if not left > 0:
            return self._state.copy()
        state = self._state.copy()
        self._settle_allowance(state, 3 * self.problem.dt, False)
        while left > 0 and (self.sent.twist.any() or self.law.braked(0.0).any()):
            period = min(left, 3 * self.problem.dt)
            left -= period
            if period < 1e-5:
                break
            step = self.stepper.brake(period)
            self._go(step, period, "asked to brake", where, stopped=bool(self.problem.robot.gain_error))
        then = self._state.copy()
        try:
            dt = float(call.arguments.get("dt", self.problem.dt))
        except Exception:
            dt = np.nan
        expected = self.stepper.brake(dt).twist if left <= 0 else np.zeros(6)
        self._state[:] = state
        got = self.stepper.brake(**call.arguments)
        if np.abs(got.twist - expected).max() > 1e-9:
            self.tally.wrong("unsafe", "elapsed", where, f"{got.twist} after {call.arguments}, by calls {expected}")
        self._state[:] = then
        # From here on the plain call is as good.
        call.arguments.pop("elapsed")
        return then

    # --- the judgement of one answer -------------------------------------------------------------------------------------

    def _judge(self, call: Call, step: Step, reason: str, state: np.ndarray, where: str) -> None:
        given, bad = call.arguments, {cause.strip() for cause in call.causes}
        dt = float(given["dt"]) if given.get("dt") is not None and "dt is" not in bad else self.problem.dt
        told = np.asarray(given["twist"], float) if given.get("twist") is not None and "twist" not in bad else None
        measured = given.get("pose") is not None and "pose" not in bad
        posture, seen = self._frame(call)
        if step.twist.shape != (6,) or not np.isfinite(step.twist).all() or not np.isfinite(step.pose).all():
            self.tally.wrong("unsafe", "not finite", where, f"{step.twist}")
            self.restart()
            return
        short = self._may_be_short(dt)
        jumped = self._place(call, step, posture, seen, measured, told, short, where)
        stopped = given.get("enable") is False or bool(self.problem.robot.gain_error and not measured)
        self._settle_allowance(state, dt, jumped)
        self.robot.look(self.before, step.pose, measured, told, bool(call.lies) or self._disobeys > 0, dt)
        self._certify(call, step, posture, seen, dt, short, stopped, where)
        unmeasured = bool(self.problem.robot.gain_error and not measured)
        self.reasons.judge(call, step, self.robot, posture, seen, short, unmeasured, where)
        self._judge_joints(call, step, posture, seen, dt, where)
        if step.status in _BRAKES and self.dice.random() < _STOPS:
            self._judge_braking(step, state, dt, where)
        self._go(step, dt, reason, where, stopped)
        if call.hold and self.world is not None:
            self._judge_way(self.world.send(step.twist, call.hold), step, f"{where} held on")
        if self.world is not None and not self._disobeys and self.dice.random() < _STOPS * min(1.0, 30 * self.problem.dt / self._longest_stop()):
            self._judge_stop(step, where)
        if call.kind == "step":
            self.person = np.clip(self.person + step.posture_rate * dt, LOWER, UPPER)

    def _go(self, step: Step, dt: float, reason: str, where: str, stopped: bool) -> None:
        """Let the object do what was sent, and judge that."""
        for name, by in self.sent.take(step.twist, dt).items():
            self.tally.wrong("unsafe", name, where, f"{by:.2g} beyond (relative), {step.status} {step.twist} dt {dt:g}")
        self.law.take(self._state[:6], step.twist, dt)
        if np.abs(self.law.mean() - step.twist).max() > 1e-9 and not self._may_be_short(dt):
            self.tally.wrong("unsafe", "not the mean", where, f"{step.twist} and {self.law.mean()}")
        self.robot.follow(reason, step.status in _BRAKES, stopped, step.twist, dt)
        self._done = sum((part for _, part in self._declared.send(step.twist, dt)), np.zeros(6))
        self.periods.appendleft(dt)
        self.before = step.pose.copy() if self._anchored else None
        if self.world is not None:
            self._judge_way(self.world.send(step.twist, dt), step, where)
            if self.world.at_rest and not self._disobeys:
                self.least = np.minimum(self.least, np.maximum(self.rows.outside(self.world.pose), 0))
                self.can_hold = True
        if self._disobeys:
            self._disobeys -= 1
            if not self._disobeys and self.world is not None:
                self.world.disobey(None)
                self._stray = True

    def _frame(self, call: Call) -> tuple[np.ndarray | None, np.ndarray]:
        """The posture that the step may use, None if it is not usable, and which joints of it are seen."""
        seen = np.ones(32, bool)
        unusable = any(cause in ("posture", "radians", "observed") for cause in call.causes)
        if call.kind != "step" or call.posture is None or unusable:
            return None, seen
        seen = np.asarray(call.arguments.get("observed", seen), dtype=bool)
        return np.asarray(call.posture, dtype=float), seen

    def _may_be_short(self, dt: float) -> bool:
        """Whether the last periods were 1.5 times shorter than the loop's, on average over what is averaged or under way."""
        robot, usual = self.problem.robot, self.problem.dt
        for seconds in (self.problem.average, robot.delay + robot.pose_delay):
            count = int(np.ceil(1.5 * seconds / usual))
            if len(self.periods) >= count > 0 and dt + sum(list(self.periods)[: count - 1]) < 1.05 * seconds:
                return True
        return False

    def _place(
        self,
        call: Call,
        step: Step,
        posture: np.ndarray | None,
        seen: np.ndarray,
        measured: bool,
        told: np.ndarray | None,
        short: bool,
        where: str,
    ) -> bool:
        """Judge the pose that the step reckoned with, and put the object where that makes it be; returns whether it jumped."""
        exact = True
        self._anchored |= measured or posture is not None
        if measured:
            expected: Any = np.asarray(call.arguments["pose"], dtype=float)
        elif self.before is None:
            if posture is None:
                return False
            comfort = np.asarray(self.problem.response.comfort)  # type: ignore[attr-defined]
            expected = np.array(self._contact(np.where(seen, posture, comfort))[0])
        else:
            done, sent = self._done, self.sent.twist
            if told is not None:
                exact = not self._late
                most = (1 + self.problem.robot.gain_error) * sent
                done = np.clip(told, np.minimum(most, 0), np.maximum(most, 0)) * self.sent.lasted
            expected = moved(self.before, done)
        exact &= not (short and not measured)
        if exact and np.abs(step.pose - expected).max() > 1e-8:
            self.tally.wrong("unsafe", "pose", where, f"reckoned with {step.pose[:3, 3]}, was at {expected[:3, 3]}")
        if call.does is not None and self.world is not None:
            self.world.disobey(call.does)
            self._disobeys = int(self.rng.integers(5, 40))
        if self.world is None:
            self.world = TrueObject(self.kind, step.pose, self.start)
            return True
        if measured:
            known = self.before is not None or self.place is not None
            if "pose" in call.lies or not known:
                self.world.teleport(step.pose)
            stray, self._stray = self._stray, False
            return not known or bool(call.lies) or self._disobeys > 0 or stray
        if self.before is None:
            # Nobody said otherwise, so it is where the posture says.
            self.world.teleport(step.pose)
            return True
        if ("twist" in call.lies and told is not None) or short:
            # The report is believed, as far as it goes: so it is true.
            off = turned(moved(self.before, self._done), step.pose)
            self.world.teleport(moved(self.world.seen.pose, off))
            return True
        return False

    # --- workspace and tool axis -----------------------------------------------------------------------------------------

    def _longest_stop(self) -> float:
        """Seconds that the longest stop takes."""
        limit, robot = self.problem.twist_limit, self.problem.robot
        late = robot.delay + robot.pose_delay + 20 * robot.lag
        return float(np.max(limit.speed / limit.acceleration)) + self.problem.average + late + 0.1

    def _brake_down(self, world: TrueObject, sent: Sent, periods: list[float], where: str) -> tuple[np.ndarray, np.ndarray]:
        """Brake down to rest in periods taken in turns; returns how far outside it is at worst on the way, and in the end (k,).

        The stepper is left as it is.
        """
        state, passed, number = self._state.copy(), 0.0, 0
        way: Way = [(world.pose, np.zeros(6))]
        longest = self._longest_stop() + 4 * max(periods)
        while not world.at_rest:
            if passed > longest:
                self.tally.wrong("unsafe", "does not stop", where, f"still {sent.twist} after {passed:.2f} s of braking")
                break
            dt = periods[number] if number < len(periods) else periods[-1 - number % 3]
            step = self.stepper.brake(dt)
            for name, by in sent.take(step.twist, dt).items():
                self.tally.wrong("unsafe", f"stop: {name}", where, f"{by:.2g} beyond (relative), braking {step.twist} dt {dt:g}")
            way += world.send(step.twist, dt)
            passed, number = passed + dt, number + 1
        self._state[:] = state
        return self.rows.worst(way), self.rows.outside(world.pose)

    def _settle_allowance(self, state: np.ndarray, dt: float, jumped: bool) -> None:
        """Where the object is where nobody sent it, it may be as far outside as braking forces from there, and no further.

        The stop is really braked, at the longest periods; by how much others may differ is allowed.
        """
        if self.world is None or not (jumped or self._fresh):
            return
        self._fresh, kept, h = False, self._state.copy(), 3 * self.problem.dt
        here = np.maximum(self.rows.outside(self.world.pose), 0)
        held = self.problem.robot.longest_hold * np.maximum(np.abs(self.sent.twist), np.abs(self.law.braked(0.0)))
        worst, apart = here, self.rows.reach(self.law.apart(min(dt, h)) + held)
        self._state[:] = state
        worst = np.maximum(worst, self._brake_down(self.world.copy(), self.sent.copy(), [dt, h, h, h], "a stop that is forced")[0])
        allowed = worst + np.where(worst > here + ALLOWED, apart, 0)
        self._state[:] = kept
        self.least = allowed

    def _tolerance(self) -> np.ndarray:
        noise = self.rows.reach(self.noise) if not self.problem.robot.declared else 0.0
        late = np.array([ALLOWED_LATE[int(name == "tool axis")] for name in self.rows.names]) if self._late else ALLOWED
        return late + noise

    def _judge_way(self, way: Way, step: Step, where: str) -> None:
        worst = self.rows.worst(way)
        if self._disobeys:
            # Where a robot that disobeys leads the object is not the step's; from when it obeys again on, it is.
            self.least = np.maximum(self.least, worst)
        for i in np.flatnonzero(worst > self.least + self._tolerance()):
            what = f"{worst[i]:.3g} outside, allowed {self.least[i]:.3g}: {step.status} {step.twist} {step.reason!r}"
            self.tally.wrong("unsafe", f"{self.rows.names[i]}", where, what)
            # One example is enough.
            self.least[i] = worst[i]

    def _judge_stop(self, step: Step, where: str) -> None:
        """Really brake down from here: nothing may come out of it that was inside."""
        assert self.world is not None
        self.tally.stops += 1
        usual, world, worst = self.problem.dt, self.world.copy(), self.rows.outside(self.world.pose)
        here = worst
        if self.can_hold and self.problem.robot.longest_hold and self.dice.random() < 0.5:
            worst = self.rows.worst(world.send(step.twist, self.problem.robot.longest_hold))
        # Not shorter than the loop's on average.
        periods = [usual * float(x) for x in ([1.0], [3.0], [0.5, 1.5, 1.0], [3.0, 0.1, 0.2])[self.dice.integers(4)] * 3]
        way, end = self._brake_down(world, self.sent.copy(), periods, where)
        worst = np.maximum(worst, way)
        for i in np.flatnonzero(worst > self.least + self._tolerance()):
            what = f"{worst[i]:.3g} outside, allowed {self.least[i]:.3g}, periods {periods}: {step.status} {step.twist}"
            self.tally.wrong("unsafe", f"stop: {self.rows.names[i]}", where, what)
            self.least[i] = worst[i]
        # What comes in stays in, but for what other periods do.
        apart = self.rows.reach(self.law.apart(usual))
        inward = (worst <= here + 1e-12) & (end < here - apart)
        self.least = np.where(inward, np.minimum(self.least, np.maximum(here + apart, 0)), self.least)

    def _judge_braking(self, step: Step, state: np.ndarray, dt: float, where: str) -> None:
        """A step that cannot do more sends what `Stepper.brake` does."""
        kept = self._state.copy()
        self._state[:] = state
        braked = self.stepper.brake(dt).twist
        self._state[:] = kept
        if np.abs(braked - step.twist).max() > 1e-12:
            self.tally.wrong("unsafe", "does not brake", where, f"{step.status} {step.twist}, braking is {braked}")

    # --- the person, and what could have been done instead ---------------------------------------------------------------

    def _judge_joints(
        self, call: Call, step: Step, posture: np.ndarray | None, seen: np.ndarray, dt: float, where: str
    ) -> None:
        if posture is None or not seen.any():
            return
        ahead, now = (self.joints.outside(q)[seen] for q in (posture + step.posture_rate * dt, posture))
        worst = float(np.max(ahead - np.maximum(now, 0), initial=0.0))
        if worst > ALLOWED:
            self.tally.wrong("unsafe", "joint range", where, f"{np.degrees(worst):.3g} deg further outside, {step.status}")
        fast = np.flatnonzero((np.abs(step.posture_rate) > self.joints.rate + 2e-7) & seen)
        if stray := [JOINTS[i] for i in fast if JOINTS[i] not in step.slack]:
            what = f"{stray} at {np.degrees(np.abs(step.posture_rate[fast]).max()):.4g} deg/s, {step.status} {step.reason!r}"
            self.tally.wrong("unsafe", "joint rate", where, what)

    def _certify(
        self,
        call: Call,
        step: Step,
        posture: np.ndarray | None,
        seen: np.ndarray,
        dt: float,
        short: bool,
        stopped: bool,
        where: str,
    ) -> None:
        """Count a step whose inputs were usable, and whether it found something else to do than to brake where there was."""
        if call.causes or posture is None or short or stopped or self.robot.may:
            return
        if step.status not in _BRAKES:
            self.tally.judged += 1
            self.tally.answered += 1
        elif self.law.another_way(posture, seen, step.locked, step.pose, dt, self.dice):
            self.tally.judged += 1
            self.tally.wrong("not certified", step.reason.split(":")[0], where, step.reason)
