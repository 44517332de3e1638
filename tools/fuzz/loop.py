"""One fuzzer loop: a stepper under attack, the person who follows, the judge of every answer."""

from __future__ import annotations

import traceback
from collections import deque
from dataclasses import replace
from typing import Any, Final

import numpy as np

from ergoqp.errors import InputError
from ergoqp.joints import JOINTS, LOWER, UPPER
from ergoqp.problem.problem import Problem
from ergoqp.simulation.robot import RobotKind
from ergoqp.step.stepper import Step, Stepper
from tools.fuzz.inputs import Call
from tools.fuzz.interruptions import Interruptions
from tools.fuzz.judge import Law, Sent, Tally
from tools.fuzz.object import ObjectJudge
from tools.fuzz.problems import moving, somewhere
from tools.fuzz.reasons import LATCHED, SHORT, ReasonJudge
from tools.fuzz.robot import RobotReckoning
from tools.fuzz.terms import Spoiled
from tools.fuzz.world import TrueObject, moved

_BRAKES: Final = ("braking", "invalid")

_ACKNOWLEDGED: Final = 0.1
"""Share of the calls after a fault without a pose before which it is acknowledged."""

_STOPS: Final = 0.1
"""Share of the steps from which the object is really braked down."""


class Loop:
    """A stepper under test, and everything that the judge knows about it.

    Attributes:
        lying: whether calls may lie about the robot in this sequence.
    """

    def __init__(
        self,
        problem: Problem,
        spoiled: Spoiled,
        dice: tuple[np.random.Generator, np.random.Generator, np.random.Generator],
        tally: Tally,
    ) -> None:
        """Build the stepper once.

        Args:
            problem: the task.
            spoiled: where a term of it gives no number.
            dice: of the calls, of the judge, and of the interruptions, so that calls are the same
                however they are judged and interrupted.
            tally: takes what is found.
        """
        rng, judge, interrupts = dice
        self._problem, self._rng, self._dice, self._tally = problem, rng, judge, tally
        self._law, self._stepper = Law(problem), Stepper(problem)
        self._joints = self._law.joints
        self._object = ObjectJudge(problem, self._stepper, self._law, tally, judge)
        self._spoiled = spoiled
        self._reasons = ReasonJudge(problem, self._law.rows, self._joints, tally)
        self._interruptions = Interruptions(self._stepper, interrupts, tally)
        self._contact = problem.response.contact()
        self._comfort = np.asarray(problem.response.comfort)  # type: ignore[attr-defined]
        self.restart()

    # --- a sequence -------------------------------------------------------------------------------

    def restart(self) -> None:
        """Start a sequence with another person, robot within its declaration and way of calling."""
        rng, robot = self._rng, self._problem.robot
        self._person = np.clip(
            self._comfort + np.radians(rng.choice([0, 10, 30])) * rng.normal(size=32), LOWER, UPPER
        )
        self.lying = bool(rng.random() < 0.3)
        measures = ("integrated", "placed", "measured", "now and then")[
            rng.choice(4, p=[0.3, 0.1, 0.4, 0.2])
        ]
        self._measures = "measured" if robot.gain_error or robot.longest_hold else measures
        self._reports = ("no", "mean", "end")[rng.choice(3, p=[0.5, 0.3, 0.2])]
        kind = RobotKind.of(robot, rng, float(rng.choice([1.0, rng.random()])))
        if self._measures == "measured":
            kind = replace(kind, speed_noise=float(rng.choice([0.0, 0.05, 0.2])))
        elif self._reports == "end":
            # What is integrated must be what was done.
            self._reports = "mean"
        self._undeclared = np.zeros(6)
        if not robot.declared and self._measures == "measured" and rng.random() < 0.2:
            # Less than what is a fault, and not declared: it may be outside by that.
            kind = replace(kind, pose_noise=2e-4, pose_noise_deg=0.04)
            self._undeclared = 3 * np.repeat([2e-4, np.radians(0.04)], 3)
        twist, place = moving(rng, self._problem) if rng.random() < 0.25 else np.zeros(6), None
        self._kind = kind
        if self._measures != "integrated":
            place = (
                np.array(self._contact(self._person)[0])
                if rng.random() < 0.3
                else somewhere(rng, self._problem)
            )
        self._begin(twist, place)

    def _begin(self, twist: np.ndarray, place: np.ndarray | None) -> None:
        """Begin with an object that moves at a twist (6,).

        It begins at a place (4, 4), or where the first posture says.
        """
        declared = self._problem.robot
        self._stepper.reset(twist if twist.any() else None)
        speed = self._problem.twist_limit.speed
        start = np.clip(twist, -speed, speed)
        self._sent = Sent.begin(self._problem, start)
        self._law.restart(start)
        self._robot = RobotReckoning(self._problem, not self.lying, start)
        self._object.begin(self._kind, place, start, self._undeclared)
        as_declared = RobotKind(delay=declared.delay + declared.pose_delay, lag=declared.lag)
        self._declared, self._done = TrueObject(as_declared, np.eye(4), start), np.zeros(6)
        self._placed, self._anchored, self._disobeys = place is not None, False, 0
        self._before: np.ndarray | None = None
        self._presumed, self._reason, self._was_short = True, "", False
        self._periods: deque[float] = deque(maxlen=100)

    def sane(self) -> Call:
        """Return the call of a well-behaved loop."""
        rng, world = self._rng, self._object.world
        call = Call(np.clip(self._person + np.radians(0.5) * rng.normal(size=32), -3.1, 3.1))
        if world is not None:
            asked = {"measured": 1.0, "now and then": 0.5}.get(self._measures, 0.0)
            if rng.random() < asked or (self._before is None and self._measures != "integrated"):
                call.arguments["pose"] = world.measure(rng)
            if self._reports != "no" and self._before is not None:
                call.arguments["twist"] = world.report(rng, self._reports == "mean")
        return call

    def take(self, call: Call, where: str) -> None:
        """Make a call and judge the answer."""
        kind = "lying" if self.lying else "honest"
        where = (
            f"{where} {self._problem.name} {kind} {self._measures}"
            f" [{' '.join(call.names) or 'sane'}]"
        )
        self._tally.steps += 1
        self._keep_declared(call)
        if LATCHED in self._reason and self._rng.random() < _ACKNOWLEDGED:
            self._stepper.try_again()
            self._robot.acknowledge()
        self._interruptions.before(call, where)
        state = self._stepper.state()
        try:
            if call.kind == "reset":
                self._take_over(call, where)
                return
            if call.kind == "brake":
                self._ramp_down(call, where)
                state = self._stepper.state()
                step = self._stepper.brake(**call.arguments)
            else:
                step = self._stepper.step(call.posture, **call.arguments)
            step.reason  # noqa: B018 (whatever is said must be sayable)
        except BaseException as error:  # whatever it is, the loop must not see it
            if isinstance(error, KeyboardInterrupt):
                raise
            at = traceback.extract_tb(error.__traceback__)[-1]
            self._tally.wrong(
                "exceptions",
                f"{type(error).__name__} in {at.name}",
                where,
                f"{error!r} of {call.arguments}",
            )
            self.restart()
            return
        self._tally.statuses[step.status] += 1
        self._object.see(step.pose)
        self._judge(call, step, state, where)

    def _keep_declared(self, call: Call) -> None:
        """One hold per stop, and none that the next pose does not show."""
        dt, can = call.arguments.get("dt"), self._object.can_hold and self._measures == "measured"
        long = (
            isinstance(dt, float) and 3.01 * self._problem.dt < dt <= self._problem.longest_period
        )
        if long and not can:
            del call.arguments["dt"]
        if long or not can:
            call.hold = 0.0
        if call.hold or (long and can):
            self._object.can_hold = False

    def _take_over(self, call: Call, where: str) -> None:
        """Let the stepper begin anew with a moving object.

        What is no twist must raise as documented, and change nothing.
        """
        world = self._object.world
        if not call.invalid:
            self._begin(
                call.arguments["twist"],
                None if world is None or self._measures == "integrated" else world.seen.pose,
            )
            return
        before = self._stepper.state()
        try:
            self._stepper.reset(call.arguments["twist"])
        except InputError:
            if np.array_equal(before, self._stepper.state()):
                return
        self._tally.wrong(
            "reasons_wrong", "reset takes what is no twist", where, f"{call.arguments}"
        )
        self.restart()

    def _ramp_down(self, call: Call, where: str) -> None:
        """Brake, call by call, for the time that the robot ramps down by itself.

        Saying that time at once must lead to the same.
        """
        elapsed, dt = (
            _number(call.arguments.pop("elapsed", 0.0)),
            _number(call.arguments.get("dt", self._problem.dt)),
        )
        if not elapsed > 0:
            return
        state, left = self._stepper.state(), elapsed
        if elapsed >= 1e-5:
            self._robot.ramped()
        self._object.settle(state, self._sent, self._problem.dt)
        while left >= 1e-5 and (self._sent.twist.any() or self._law.planned.any()):
            period = min(left, self._problem.dt)
            left -= period
            braked = self._stepper.step(None, dt=period, enable=False)
            self._go(braked, period, "asked to brake", True, where)
        then = self._stepper.state()
        expected = self._stepper.brake(dt).twist
        self._stepper.restore(state)
        got = self._stepper.brake(dt, elapsed=elapsed).twist
        if np.abs(got - expected).max() > 1e-9:
            self._tally.wrong(
                "unsafe",
                "elapsed",
                where,
                f"{got} for dt {dt:g} after {elapsed:g} s, call by call {expected}",
            )
        self._stepper.restore(then)

    # --- the judgement of one answer --------------------------------------------------------------

    def _judge(self, call: Call, step: Step, state: np.ndarray, where: str) -> None:
        given, bad = call.arguments, {cause.strip() for cause in call.causes}
        dt = (
            float(given["dt"])
            if given.get("dt") is not None and "dt is" not in bad
            else self._problem.dt
        )
        told = (
            np.asarray(given["twist"], float)
            if given.get("twist") is not None and "twist" not in bad
            else None
        )
        measured = given.get("pose") is not None and "pose" not in bad
        posture, seen = _frame(call)
        if (
            step.twist.shape != (6,)
            or not np.isfinite(step.twist).all()
            or not np.isfinite(step.pose).all()
            or not np.isfinite(self._stepper.state()).all()
        ):
            self._tally.wrong("unsafe", "not finite", where, f"{step.twist}")
            self.restart()
            return
        short, unmeasured = (
            self._may_be_short(dt) or self._was_short,
            bool(self._problem.robot.needs_pose and not measured),
        )
        self._place(call, step, posture, seen, measured, short, where)
        self._presumed &= not measured
        self._object.settle(state, self._sent, dt)
        lied = bool(call.lies) or self._disobeys > 0
        self._robot.look(
            self._before, step.pose, measured, told, lied, dt, given.get("enable") is not False
        )
        unknown = unmeasured or self._robot.may or self._robot.doubted
        must, may = self._without_number(call, step, posture, seen, dt)
        if not (call.causes or posture is None or short or unknown or may):
            self._certify(step, posture, seen, dt, where)
        self._reasons.judge_term(step, must, may, bool(short or unknown), where)
        self._reasons.judge(call, step, self._robot, posture, seen, short, unmeasured, may, where)
        self._judge_joints(step, posture, seen, dt, where)
        if step.status in _BRAKES and self._dice.random() < _STOPS:
            self._judge_braking(step, state, dt, where)
        self._go(step, dt, step.reason, given.get("enable") is False or unmeasured, where)
        if call.hold:
            self._object.send(
                step.twist, call.hold, "held on: ", where, f"{step.status} {step.twist}"
            )
        if not self._may_be_short(self._problem.dt):
            even = min(self._periods) > 0.9 * self._problem.dt
            self._object.stop(
                step.twist, self._sent, even, _STOPS, where, f"{step.status} {step.twist}"
            )
        if call.kind == "step":
            rate = np.where(np.isfinite(step.posture_rate), step.posture_rate, 0.0)
            self._person = np.clip(self._person + rate * dt, LOWER, UPPER)

    def _known(self, posture: np.ndarray, seen: np.ndarray) -> np.ndarray:
        """Return a posture (32,) in which joints that are not seen are those of comfort."""
        return np.where(seen, posture, self._comfort)

    def _without_number(
        self, call: Call, step: Step, posture: np.ndarray | None, seen: np.ndarray, dt: float
    ) -> tuple[str, list[str]]:
        """Return with which words this step has to name a term, and with which it may."""
        spoiled = self._spoiled
        if posture is None or call.causes or not spoiled.words:
            return "", []
        q, gain = self._known(posture, seen), 1 + self._problem.robot.gain_error
        lands = gain * (np.abs(self._law.under_way(dt)) + np.abs(self._law.owed()).sum(axis=0))
        may = [spoiled.words] if spoiled.may(q, step.pose, lands) else []
        if spoiled.ahead and spoiled.may_ahead(q, self._law.fastest(q, step.locked)):
            may.append(spoiled.ahead)
        return spoiled.words if spoiled.must(q, step.pose) else "", may

    def _go(self, step: Step, dt: float, reason: str, stopped: bool, where: str) -> None:
        """Let the object do what was sent, and judge that."""
        for name, by in self._sent.take(step.twist, dt).items():
            # The jerk is that of a mean, and a history that much shorter periods have used up holds
            # none: that is named, and the acceleration is kept all the same.
            named = name == "jerk" and SHORT in reason and self._may_be_short(dt)
            kind = "named short" if named else "unsafe"
            self._tally.wrong(
                kind,
                name,
                where,
                f"{by:.2g} beyond (relative), {step.status} {step.twist} dt {dt:g}",
            )
        self._law.take(self._stepper.state()[:6], step.twist, dt)
        if np.abs(self._law.mean() - step.twist).max() > 1e-9 and not self._may_be_short(dt):
            self._tally.wrong(
                "unsafe", "not the mean", where, f"{step.twist} and {self._law.mean()}"
            )
        self._reason = reason
        self._robot.follow(reason, step.status in _BRAKES, stopped, step.twist, dt)
        self._done = sum((part for _, part in self._declared.send(step.twist, dt)), np.zeros(6))
        self._was_short = self._may_be_short(dt)
        self._periods.appendleft(dt)
        self._before = step.pose.copy() if self._anchored else None
        self._object.send(
            step.twist, dt, "", where, f"{step.status} {step.twist} dt {dt:g} {reason!r}"
        )
        if self._disobeys:
            self._disobeys -= 1
            if not self._disobeys:
                self._object.disobey(None)

    def _may_be_short(self, dt: float) -> bool:
        """Whether the last periods were 1.5 times shorter than the loop's.

        This is meant on average over what is averaged or under way. One period later it may still
        be said: that period begins at a mean of too few.
        """
        robot, usual = self._problem.robot, self._problem.dt
        for seconds in (self._problem.average, robot.delay + robot.pose_delay):
            count = int(np.ceil(1.5 * seconds / usual))
            if (
                len(self._periods) >= count > 0
                and dt + sum(list(self._periods)[: count - 1]) < 1.05 * seconds
            ):
                return True
        return False

    def _place(
        self,
        call: Call,
        step: Step,
        posture: np.ndarray | None,
        seen: np.ndarray,
        measured: bool,
        short: bool,
        where: str,
    ) -> None:
        """Judge the pose that the step reckoned with, and put the object where that makes it be."""
        first = not self._anchored
        self._anchored |= measured or posture is not None
        if not self._anchored:
            return
        if measured:
            expected: Any = np.asarray(call.arguments["pose"], dtype=float)
        elif self._before is None:
            expected = np.array(
                self._contact(np.where(seen, np.asarray(posture, dtype=float), self._comfort))[0]
            )
        else:
            expected = moved(self._before, self._done)
        off = np.abs(step.pose - expected).max() > 1e-8
        if off and not (self._before is not None and not measured and short):
            self._tally.wrong(
                "unsafe",
                "pose",
                where,
                f"reckoned with {step.pose[:3, 3]}, was at {expected[:3, 3]}",
            )
        if call.does is not None:
            self._object.disobey(call.does)
            self._disobeys = int(self._rng.integers(5, 40))
        world = self._object.world
        if (
            world is None
            or (measured and "pose" in call.lies)
            or (first and not (measured and self._placed))
        ):
            # Whoever measures it elsewhere moved it; where nobody measures it, it is where the
            # posture says.
            self._object.appear(step.pose)

    def _judge_braking(self, step: Step, state: np.ndarray, dt: float, where: str) -> None:
        """A step that cannot do more sends what `Stepper.brake` does."""
        kept = self._stepper.state()
        self._stepper.restore(state)
        braked = self._stepper.brake(dt).twist
        self._stepper.restore(kept)
        if np.abs(braked - step.twist).max() > 1e-12:
            self._tally.wrong(
                "unsafe",
                "does not brake",
                where,
                f"{step.status} {step.twist}, braking is {braked}",
            )

    def _judge_joints(
        self, step: Step, posture: np.ndarray | None, seen: np.ndarray, dt: float, where: str
    ) -> None:
        """No model joint is led further out of its range, and none too fast without being named."""
        if posture is None or not seen.any():
            return
        of_response = self._spoiled.words.startswith("response")
        if of_response and self._spoiled.may(self._known(posture, seen), step.pose, np.zeros(6)):
            # Nobody knows how the person follows.
            return
        if not np.isfinite(step.posture_rate).all():
            self._tally.wrong("unsafe", "joint rate", where, "not finite")
            return
        ahead, now = (
            self._joints.outside(q)[seen] for q in (posture + step.posture_rate * dt, posture)
        )
        worst = float(np.max(ahead - np.maximum(now, 0), initial=0.0))
        if worst > 1e-8:
            self._tally.wrong(
                "unsafe",
                "joint range",
                where,
                f"{np.degrees(worst):.3g} deg further outside, {step.status}",
            )
        # Rows through S hold to the accuracy of the QP, not to the last digit.
        fast = np.flatnonzero((np.abs(step.posture_rate) > self._joints.rate + 2e-7) & seen)
        if stray := [JOINTS[i] for i in fast if JOINTS[i] not in step.slack]:
            what = (
                f"{stray} at {np.degrees(np.abs(step.posture_rate[fast]).max()):.4g} deg/s,"
                f" {step.status} {step.reason!r}"
            )
            self._tally.wrong("unsafe", "joint rate", where, what)

    def _certify(
        self, step: Step, posture: np.ndarray, seen: np.ndarray, dt: float, where: str
    ) -> None:
        """Count a step whose inputs were usable.

        Also count whether it found something else to do than to brake, where there was something.
        """
        if step.status not in _BRAKES:
            self._tally.judged += 1
            self._tally.answered += 1
        elif self._problem.way_out is None and self._law.another_way(
            posture, seen, step.locked, step.pose, dt, self._dice, self._presumed
        ):
            self._tally.judged += 1
            self._tally.wrong("not certified", step.reason.split(":")[0], where, step.reason)


def _number(value: Any) -> float:
    """Return what is passed as a number of seconds; NaN where it is none."""
    try:
        return np.nan if isinstance(value, str) else float(value)
    except Exception:  # not a number, whatever it is
        return np.nan


def _frame(call: Call) -> tuple[np.ndarray | None, np.ndarray]:
    """Return the posture the step may use (None: not usable), and which joints of it are seen."""
    seen = np.ones(32, bool)
    unusable = any(cause in ("posture", "radians", "observed") for cause in call.causes)
    if call.kind != "step" or call.posture is None or unusable:
        return None, seen
    seen = np.asarray(call.arguments.get("observed", seen), dtype=bool)
    return np.asarray(call.posture, dtype=float), seen
