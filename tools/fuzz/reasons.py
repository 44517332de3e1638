"""The fuzzer's judge of statuses and sentences: every cause is named, and nothing else."""

from __future__ import annotations

from typing import Final

import numpy as np

from ergoqp.joints import JOINTS, spoken
from ergoqp.problem.problem import Problem
from ergoqp.step.stepper import Step
from tools.fuzz.inputs import Call
from tools.fuzz.judge import Joints, Tally
from tools.fuzz.regions import Regions
from tools.fuzz.robot import RobotReckoning
from tools.fuzz.world import HardRows

_STOPS: Final = ("braking", "invalid")

LATCHED: Final = "until a pose is measured"
_OF_ROBOT: Final = ("robot:", "comes to rest before it moves again", LATCHED)
_OF_STEP: Final = ("no twist but braking keeps every limit", "the QP was not solved")
_OF_TERMS: Final = ("cost: ", "response: ", "limits: ")
SHORT: Final = "much shorter than the loop"
_NO_WAY: Final = "none of the straight ways that are tried leads from there"
_UNMEASURED: Final = "no pose, and the robot is declared"


class ReasonJudge:
    """Judges what a step says, see the module."""

    def __init__(self, problem: Problem, rows: HardRows, joints: Joints, tally: Tally) -> None:
        """Keep what it goes by."""
        self._problem, self._rows, self._joints, self._tally = problem, rows, joints, tally
        self._regions = Regions(problem)
        noise = problem.robot.pose_noise, np.radians(problem.robot.pose_noise_deg)
        self._noise = np.array([noise[int(name == "tool axis")] for name in rows.names])

    def judge(
        self,
        call: Call,
        step: Step,
        robot: RobotReckoning,
        posture: np.ndarray | None,
        seen: np.ndarray,
        short: bool,
        unmeasured: bool,
        terms: list[str],
        where: str,
    ) -> None:
        """Judge one answer.

        Args:
            call: as it was made.
            step: the answer.
            robot: what has to be said of the robot.
            posture: that was usable, None: none was (32,) [rad].
            seen: joints that were (32,).
            short: whether the last periods may be called too short.
            unmeasured: whether a pose was needed and not given.
            terms: words with which a term may be named that gives no number.
            where: for the report.
        """
        reason = step.reason
        said = f"{step.status}: {reason!r}, causes {call.causes}"

        def wrong(kind: str, what: str = "") -> None:
            self._tally.wrong("reasons_wrong", kind, where, f"{what} {said}".strip())

        stops = step.status in _STOPS
        if call.causes and step.status != ("invalid" if call.invalid else "braking"):
            wrong(f"{call.names[-1]} is {step.status}")
        for cause in call.causes:
            if cause not in reason:
                wrong(f"{cause} not named")
        if unmeasured and not (stops and _UNMEASURED in reason):
            wrong("no pose, not named")
        if robot.named and not (stops and "robot:" in reason):
            wrong("fault not named")
        if robot.must and not stops:
            self._tally.wrong("unsafe", "moves before it has come to rest", where, said)
        if not stops:
            self._judge_rows(step, posture, seen, wrong)
            return
        if not robot.may and any(words in reason for words in _OF_ROBOT):
            wrong("the robot is blamed")
        known = [*call.causes, *(_OF_ROBOT if robot.may else ()), *_OF_STEP, *terms]
        known += [SHORT] * short + [_UNMEASURED] * unmeasured
        depths = self._regions.depths(step.pose[:3, 3])
        if depths.size and max(depths.max(), *self._rows.outside(step.pose), 0) > 1e-6:
            known.append(_NO_WAY)
        if step.status == "invalid" and not call.invalid:
            wrong("usable input refused")
        for part in reason.split("; "):
            if not any(words in part for words in known) and not any(
                words in part for words in _OF_ROBOT
            ):
                wrong("usable input refused", part)
        if not reason:
            wrong("no reason")

    def judge_term(self, step: Step, must: str, may: list[str], other: bool, where: str) -> None:
        """Judge what one answer says of a term that gives no number.

        Args:
            step: the answer.
            must: words with which it has to be named; empty: it need not be.
            may: words with which it may be.
            other: whether the step may brake for another cause, so that it need not look further.
            where: for the report.
        """
        reason, stops = step.reason, step.status in _STOPS
        if must:
            self._tally.spoiled += 1
            if not stops:
                self._tally.wrong("unsafe", "moves by no number", where, f"{must}, {step.status}")
            elif must not in reason and not other and _NO_WAY not in reason:
                self._tally.wrong("reasons_wrong", "term not named", where, f"{must}, {reason!r}")
        said = any(words in reason for words in _OF_TERMS)
        if said and not (stops and any(words in reason for words in may)):
            self._tally.wrong("reasons_wrong", "term named", where, f"{step.status}: {reason!r}")

    def _judge_rows(self, step: Step, posture: np.ndarray | None, seen: np.ndarray, wrong) -> None:
        """A step that does not stop names what is outside."""
        reason = step.reason
        if posture is None:
            wrong("moves without a posture")
            return
        out = np.where(seen, self._joints.outside(posture), 0) - self._joints.tolerance
        for joint, amount in zip(JOINTS, out, strict=True):
            named = spoken(joint) in reason
            if amount > 1e-9 and not named:
                wrong("joint outside not named", f"{joint} {np.degrees(amount):.2f}")
            if amount < -1e-9 and named and joint not in step.slack:
                wrong("joint inside named", joint)
        far = self._rows.outside(step.pose)
        for name, amount in zip(self._rows.names, far, strict=True):
            if amount > 2e-6 and name not in reason:
                wrong("workspace outside not named", f"{name} {amount:.2g}")
        depths = self._regions.depths(step.pose[:3, 3])
        for name, depth in zip(self._regions.names, depths, strict=True):
            if depth > 2e-6 and name not in reason:
                wrong("region not named", f"{name} {depth:.2g}")
        if step.status in ("settled", "relaxed", "recovering") and not reason:
            wrong("no reason")
        if step.status == "recovering":
            back = np.any((out > -1e-9) & self._joints.may_return) or np.any(far > self._noise)
            back |= bool(np.any(depths > 0))
            if "coming back" not in reason or not back:
                wrong("recovering from what", f"{far}")
