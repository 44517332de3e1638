"""What the step has to say of the robot, reckoned by the fuzzer from the calls alone.

See `RobotReckoning`.

Measured motion is compared with what was sent since the object last came to stand still. Beyond 1
mm and 0.2 deg, and what is declared, it is a fault. Near the threshold, and where a declared robot
leaves room, saying so and not saying so are both right.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from ergoqp.problem.problem import Problem
from tools.fuzz.world import moved, turned

_UNIT: Final = np.repeat([1e-3, np.radians(0.2)], 3)
_FEW: Final = 0.8
"""So much of the difference that is a fault certainly is none."""

_MANY: Final = 1.25
"""So much certainly is one."""

_CALM: Final = 0.5
"""For how long the object stands still after a fault [s]."""


class RobotReckoning:
    """Whether the object may move, must not, or either, as far as the robot is concerned.

    Attributes:
        must: whether this step has to brake: there certainly is a fault, or the object has not come
            to rest since one.
        may: whether it may brake because of the robot.
        named: whether it has to say ``robot: ...``.
        doubted: whether there may have been a fault since a pose was measured.
    """

    def __init__(self, problem: Problem, honest: bool, twist: np.ndarray) -> None:
        """Begin a loop.

        Args:
            problem: the task, and what it declares of the robot.
            honest: whether the robot keeps what is declared and nothing that is reported is a lie.
            twist: with which the object moves already (6,).
        """
        self._robot, self._average, self._dt, self._honest = (
            problem.robot,
            problem.average,
            problem.dt,
            honest,
        )
        limit = problem.twist_limit
        self._credible = 0.5 * np.repeat([limit.linear_speed, limit.angular_speed], 3)
        # Seen in the axes of the object, the error of an orientation may lie along any axis.
        spread = np.sqrt(3) * np.radians(problem.robot.pose_noise_deg)
        self._noise = np.repeat([problem.robot.pose_noise, spread], 3)
        self.must = self.may = self.named = self._blamed = False
        self._still, self._since, self._phase = (0.0 if twist.any() else np.inf), np.inf, ""
        self._sent, self._lasted = np.array(twist), problem.dt
        self._most = np.abs(self._sent)
        self._surprise, self._heard, self._heard_perhaps = np.zeros(6), 0.0, 0.0
        self._parked, self._crept, self._pose = False, np.zeros(6), np.eye(4)
        self.doubted = self._latched = False
        self._stand_still(False, False)

    def _stand_still(self, measured: bool, lied: bool) -> None:
        """Begin to compare again."""
        self._apart, self._path, self._lied = np.zeros(6), np.zeros(6), lied
        self._surprise, self._area = np.zeros(6), 0.0
        self._sent_to = self._pose.copy()
        self._low = self._high = np.zeros(6) if measured else None
        self._drift, self._blur = np.zeros(6), np.zeros(6)
        # What lags fades, also after everything has stood still for as long as the robot is late.
        fade = np.exp(-self._lasted / self._robot.lag) if self._robot.lag else 0.0
        self._most = np.maximum(np.abs(self._sent), fade * self._most)

    def ramped(self) -> None:
        """Judge nothing of what the robot did by itself.

        What is measured after it has nothing to be compared with.
        """
        self._stand_still(False, False)

    def acknowledge(self) -> None:
        """Let the object move again, though no pose shows where it is."""
        self._latched = False

    @property
    def _pause(self) -> float:
        """Seconds of standing still after which nothing is under way any more."""
        return max(self._average, self._robot.delay + self._robot.pose_delay)

    def look(
        self,
        before: np.ndarray | None,
        pose: np.ndarray,
        measured: bool,
        told: np.ndarray | None,
        lied: bool,
        dt: float,
        enabled: bool = True,
    ) -> None:
        """Reckon with one call, before its answer is judged.

        Args:
            before: pose that the last step reckoned with (4, 4); None: none was known.
            pose: that this step reckons with (4, 4).
            measured: whether it was given.
            told: reported twist, if a usable one was given (6,).
            lied: whether pose or twist are made up.
            dt: period [s].
            enabled: whether what moves the object is judged at all.
        """
        parked = self._still >= max(self._pause, 1e-9)
        self._lied |= lied
        surely, perhaps = [0.0], [0.0]
        self._pose = pose
        if before is None:
            self._sent_to = pose.copy()
        else:
            self._compare(
                turned(before, pose), self._sent * self._lasted, measured, surely, perhaps
            )
        if before is None and measured:
            self._low = self._high = self._apart
        if (parked and (not self._parked or self._blamed or max(surely) > _MANY)) or not enabled:
            # What it moved at rest while it was blamed may count on, or not.
            low, high = self._low, self._high
            if parked and self._parked and low is not None and high is not None:
                self._crept = self._crept + (high - low)
            else:
                self._crept = np.zeros(6)
            self._stand_still(measured, lied)
        self._parked = parked
        # What a reported twist shows may be said a step later.
        surely.append(self._heard)
        perhaps.append(self._heard_perhaps)
        self._heard = self._heard_perhaps = 0.0
        # What is reported while it is not enabled is judged neither now nor later.
        if told is not None and before is not None and enabled:
            self._listen(told, perhaps)
        fault = enabled and not self._honest and max(surely) > _MANY
        possible = not self._honest and (
            max(perhaps) > _FEW or (self._robot.declared and self._lied)
        )
        limit = (
            self._pause
            + (0.0 if self._phase == "halted" else _CALM)
            + self._robot.delay
            + self._robot.pose_delay
        )
        limit += 3 * self._robot.lag + 4 * max(self._lasted, self._dt)
        owes = bool(self._phase) and min(self._still, self._since) < limit
        # The period that begins counts already.
        rests = self._still == 0 or (self._phase == "fault" and self._still + dt < _CALM - 1e-9)
        # Without a pose it rests from a fault on until it is acknowledged, which is judged where it
        # certainly is one; where there may be one, it may.
        self._latched = not measured and (fault or self._latched)
        self.doubted = not measured and (possible or fault or self._blamed or self.doubted)
        self.named, self.must = fault, fault or self._latched or (bool(self._phase) and rests)
        self.may = self.must or possible or owes or self.doubted
        if fault:
            self._begin("fault")

    def _compare(
        self,
        went: np.ndarray,
        done: np.ndarray,
        measured: bool,
        surely: list[float],
        perhaps: list[float],
    ) -> None:
        """Compare motion with what was sent."""
        robot = self._robot
        self._path = self._path + np.abs(done)
        self._most = np.maximum(self._most, np.abs(self._sent))
        self._apart = self._apart + went - done
        self._sent_to = moved(self._sent_to, done)
        if robot.pose_noise_deg:
            # Differences of noisy orientations do not add up, so the whole turns are compared, in
            # the axes of the sent one: an error that is present turns with the object.
            off = turned(self._sent_to, self._pose)[3:]
            self._apart[3:] = self._sent_to[:3, :3].T @ off
        if not measured:
            return
        if self._low is None or self._high is None:
            # Between two measured poses there is a measured motion.
            self._low = self._high = self._apart
        self._low, self._high = (
            np.minimum(self._low, self._apart),
            np.maximum(self._high, self._apart),
        )
        # Whatever the robot may owe, not do, or do on for once. Which way it held on is unknown: a
        # hold along an axis and one against it both count.
        slow = 2 * (
            (1 + robot.gain_error) * (robot.delay + robot.pose_delay + robot.lag)
            + robot.longest_hold
        )
        reach = self._most.copy()
        if robot.pose_noise_deg:
            # In the axes of the object what it owes may be along any axis.
            reach[3:] = np.linalg.norm(self._most[3:])
        alone = robot.longest_hold and not (robot.delay or robot.lag or robot.pose_delay)
        # A hold that does not stand out of the noise cannot be told from it.
        room = (
            (6 if alone else 2) * self._noise
            + slow * reach
            + robot.gain_error * np.linalg.norm(self._path)
        )
        # The turns of a late robot do not commute with those that it still owes.
        lagged = robot.delay + robot.pose_delay + robot.lag
        self._area += lagged * float(np.linalg.norm(self._most[3:]) * np.linalg.norm(done[3:]))
        room[3:] += 2 * self._area
        fast = (1 + robot.gain_error) * self._most * self._lasted
        least, most = (
            (-fast, fast) if robot.declared else (np.minimum(done, 0), np.maximum(done, 0))
        )
        leap, apart = np.abs(went - np.clip(went, least, most)), self._high - self._low
        surely.append(float(np.max((apart - room) / _UNIT)))
        perhaps.append(_size(apart + self._crept))
        perhaps.append(_size(leap))

    def _listen(self, told: np.ndarray, perhaps: list[float]) -> None:
        """Compare a reported twist with the sent one, over time.

        What scatters, up to half the speed limit, is noise.
        """
        robot, lasted = self._robot, self._lasted
        if lasted > 3.003 * self._dt:
            # One sample over so long a period shows nothing.
            return
        surprise = told - self._sent
        scatter = np.minimum(np.abs(surprise - self._surprise), self._credible) * lasted
        self._surprise = surprise
        self._drift, self._blur = self._drift + surprise * lasted, self._blur + scatter**2 / 2
        late = robot.delay + robot.pose_delay + robot.lag
        # What a late robot does on while a call is late is not reported.
        slow = 2 * (1 + robot.gain_error) * (late + robot.longest_hold * (late > 0)) + self._dt
        path = float(np.linalg.norm(self._path + np.abs(told) * lasted))
        room = 6 * np.sqrt(self._blur) + slow * self._most + robot.gain_error * path
        far = np.maximum(np.abs(self._drift), np.abs(surprise) * lasted) - room
        self._heard = float(np.max(far / _UNIT))
        self._heard_perhaps = max(_size(self._drift), _size(surprise * lasted))
        perhaps.append(self._heard_perhaps)

    def _begin(self, phase: str) -> None:
        if phase == "fault" or not self._phase:
            self._phase, self._since = phase, 0.0

    def follow(
        self, reason: str, braked: bool, stopped: bool, twist: np.ndarray, dt: float
    ) -> None:
        """Take over what was answered.

        Args:
            reason: of the step.
            braked: whether it was to brake.
            stopped: whether the object was not allowed to move: not enabled, or no pose of a robot
                that needs one.
            twist: sent (6,).
            dt: for how long [s].
        """
        self._blamed = "robot:" in reason
        if self._blamed and self.may:
            self._begin("fault")
        elif stopped:
            self._begin("halted")
        elif self._phase and not braked:
            self._phase = ""
        self._still, self._since = (0.0 if twist.any() else self._still + dt), self._since + dt
        self._sent, self._lasted = np.array(twist), dt


def _size(difference: np.ndarray) -> float:
    """How large a difference (6,) is in units of what is none yet: the longer of shift and turn."""
    parts = difference / _UNIT
    return float(max(np.linalg.norm(parts[:3]), np.linalg.norm(parts[3:])))
