"""The control step of person, robot and object together: inputs, answer, and causes in words.

Inputs are posture and robot; outputs are joint velocities of the robot.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from ergoqp.arguments import check_number, read_array, shown, unmasked
from ergoqp.errors import InputError
from ergoqp.expressions import read_pose
from ergoqp.joints import JOINTS
from ergoqp.problem.geometry import pose_error
from ergoqp.problem.problem import Problem
from ergoqp.problem.settings import Frames
from ergoqp.step.answer import Step
from ergoqp.step.stepper import Stepper
from ergoqp.whole_body.formulation import Formulation, solve_ladder
from ergoqp.whole_body.grasp import default_base, grasp
from ergoqp.whole_body.robot import Robot, load_robot
from ergoqp.whole_body.scene import Load, Scene, default_tool_frame
from ergoqp.whole_body.state import (
    Closeness,
    Moment,
    Sight,
    StepTerms,
    joint_bounds,
    own_objective,
    person_of,
)

_PLAUSIBLE: Final = 2.0
"""A joint measured faster than its largest speed times this is a measurement error."""


_TURN: Final = 2 * np.pi
"""A joint measured farther outside its range than this is a measurement error [rad]."""


def size_of(value: Any) -> tuple[float, float, float]:
    """Return the side lengths of a box [m].

    Raises:
        InputError: if they are not three numbers from 0.001 to 1 m.
    """
    sides = numbers(value, 3)
    if sides is None or (sides < 0.001).any() or (sides > 1.0).any():
        raise InputError(
            f"object_size: got {shown(value)}, allowed three side lengths from 0.001 to 1 m"
        )
    return float(sides[0]), float(sides[1]), float(sides[2])


def robot_of(robot: Any, frame: str | None) -> Robot:
    """Return a given robot, or load one from a file.

    Raises:
        InputError: if a frame is given in addition to a robot that has one, or as in `load_robot`.
    """
    if not isinstance(robot, Robot):
        return load_robot(robot, frame)
    if frame is not None:
        raise InputError(
            f"frame: got {shown(frame)} beside a robot whose frame is {robot.frame!r}, allowed"
            " None: name it to load_robot"
        )
    return robot


def start_of(start: Any, robot: Robot) -> np.ndarray:
    """Return joint positions (k,) [rad].

    Raises:
        InputError: if they are not k numbers within the ranges of the arm.
    """
    joints = numbers(start, len(robot.joints))
    if joints is None or (joints < robot.lower).any() or (joints > robot.upper).any():
        raise InputError(
            f"start: got {shown(start)}, allowed {len(robot.joints)} joint positions within their"
            " ranges"
        )
    return joints


def implausible(robot: Robot, positions: np.ndarray, speeds: np.ndarray) -> str:
    """Return in words which joint is measured at an impossible position or speed, or nothing.

    Args:
        robot: the robot.
        positions: measured positions of its joints (k,) [rad].
        speeds: measured speeds of its joints (k,) [rad/s].
    """
    beyond = np.maximum(robot.lower - positions, positions - robot.upper)
    worst = int(np.argmax(beyond))
    if beyond[worst] > _TURN:
        low, high = robot.lower[worst], robot.upper[worst]
        return (
            f"arm: {robot.joints[worst]} is {positions[worst]:.4g} rad, allowed {low:.4g} to"
            f" {high:.4g}, and a turn beyond"
        )
    most = _PLAUSIBLE * robot.velocity
    worst = int(np.argmax(np.abs(speeds) - most))
    if abs(speeds[worst]) > most[worst]:
        return (
            f"arm_speed: {robot.joints[worst]} is {speeds[worst]:.4g} rad/s, allowed within"
            f" +-{most[worst]:.4g}, twice its largest speed"
        )
    return ""


def numbers(value: Any, count: int) -> np.ndarray | None:
    """Return a finite vector of this length, or None."""
    try:
        vector = np.asarray(unmasked(value), dtype=float)
    except Exception:  # any error of a user's object; the loop goes on
        return None
    return vector.copy() if vector.shape == (count,) and np.isfinite(vector).all() else None


@dataclass(frozen=True)
class WholeBodyStep:
    """The answer of one step.

    Attributes:
        joint_velocities: velocities of the arm's joints to send (k,) [rad/s].
        twist: twist of the object with these velocities (6,) [m/s, rad/s].
        posture_rate: how the model person follows this twist (32,) [rad/s].
        status: that of the object's own step if the robot does the same. ``slower``: limits of the
            robot or the distance hold the object back. ``braking``: the object brakes, or robot and
            object cannot keep all limits. ``invalid``: an input cannot be used.
        reason: one sentence that names the cause, empty for a plain optimal step.
        min_distance: smallest present distance of all kept pairs [m]; infinite if no distance is
            kept.
        object_step: the object's own step (`ergoqp.step.stepper.Step`), without limits of the
            robot.
        solve_time: duration of the call [s].

    Example:
        >>> import ergoqp
        >>> from ergoqp.whole_body import WholeBody
        >>> problem = ergoqp.load_problem("screwing")
        >>> whole = WholeBody(problem)
        >>> step = whole.step(None, whole.start)
        >>> step.status, step.twist.shape
        ('braking', (6,))
    """

    joint_velocities: np.ndarray
    twist: np.ndarray
    posture_rate: np.ndarray
    status: str
    reason: str
    min_distance: float
    object_step: Step
    solve_time: float


_REST_TIME: Final = 1.0
_REST_SPEED: Final = 0.5
_OFFSET: Final = 1e-3


class WholeBody:
    """The whole-body step of one control loop. Make one per loop.

    Args:
        problem: the task; its state must be a person's posture.
        robot: ``"panda"``, the path of an MJCF or URDF file, or a `Robot` from `load_robot`.
        frame: the robot's end-effector frame. None: ``"flange"``, or that of a `Robot`.
        tool_frame: the contact frame in the end-effector frame (4, 4) [m]. None: 0.20 m in front of
            it, with the tool's axis pointing back into it, and turned about it in steps of 45
            degrees so that the arm holds the object best at `posture`.
        base: base of the robot in the world of the problem (4, 4) [m]. None: see
            `ergoqp.whole_body.grasp.default_base`.
        posture: posture at the start of the loop (32,) [rad]. None: the comfort posture.
        start: joints with which the arm holds the object then (k,) [rad]. None: found, see
            `ergoqp.whole_body.grasp`. If given, the object starts where they hold it.
        distance: distance of robot and object to the person, and of the object to the arm [m], see
            `Scene.pairs`. None: none.
        reserve: distance kept in addition, for motions of the person within the robot's reaction
            time [m].
        object_size: side lengths of the box on the end-effector frame [m].
        dt: control period [s]. None: that of the problem.

    Attributes:
        scene: the MuJoCo model.
        start: joints with which the arm holds the object at the start (k,) [rad].

    Raises:
        ProblemError: if the state of the problem is not a person's posture.
        InputError: if an argument is unusable, or the arm cannot hold the object at the start.

    Example:
        >>> import ergoqp
        >>> from ergoqp.whole_body import WholeBody
        >>> problem = ergoqp.load_problem("screwing")
        >>> whole = WholeBody(problem)
        >>> step = whole.step(problem.response.comfort, whole.start)
        >>> step.joint_velocities.shape, step.status in ("optimal", "settled", "slower")
        ((7,), True)
    """

    def __init__(
        self,
        problem: Problem,
        robot: str | Path | Robot = "panda",
        *,
        frame: str | None = None,
        tool_frame: Any = None,
        base: Any = None,
        posture: Any = None,
        start: Any = None,
        distance: float | None = 0.05,
        reserve: float = 0.01,
        object_size: tuple[float, float, float] = (0.12, 0.12, 0.10),
        dt: float | None = None,
    ) -> None:
        """Build the model, the functions and the QP's terms once; this takes about a second."""
        self._person = person_of(problem)
        check_number("distance", distance if distance is not None else 0.0, 0.0, 0.5, "m")
        check_number("reserve", reserve, 0.0, 0.2, "m")
        self.distance, self.reserve, object_size = distance, reserve, size_of(object_size)
        placed = default_base(problem, 0.20) if base is None else read_pose("base", base)
        held = read_pose("tool_frame", tool_frame) if tool_frame is not None else None
        allowed = f"{len(JOINTS)} finite numbers"
        begin = self._person.comfort
        if posture is not None:
            begin = read_array("posture", posture, (len(JOINTS),), allowed)
        self.robot = robot_of(robot, frame)
        joints = None if start is None else start_of(start, self.robot)
        # The object does what the arm can, which may differ from its own step. So there is no
        # averaging.
        self.stepper = Stepper(
            # The poses are those of the model: contact frames in the world.
            problem.replace(control=replace(problem.control, average=0.0), frames=Frames()),
            dt=dt,
        )
        self.problem, self.dt = self.stepper.problem, self.stepper.dt
        self._terms = StepTerms(self.problem)
        apart = None if distance is None else distance + reserve
        if joints is None:
            self.scene, self.start = grasp(
                self._person, self.robot, placed, held, object_size, begin, apart
            )
        else:
            load = Load(default_tool_frame(0.0) if held is None else held, object_size)
            self.scene = Scene(self._person.body, self.robot, placed, load, self._person.hands)
            self.start = joints
        self._formulation = Formulation(self.scene)
        limit = self.problem.twist_limit
        self._pace = float(np.max(limit.speed / limit.acceleration))
        positions = self._formulation.configuration
        self._sight = Sight(self.scene, self._person, positions, distance, reserve, self._pace)
        self.reset()

    def reset(self) -> None:
        """Reset the state of the loop: it starts again from standstill."""
        self.stepper.reset()
        self._posture = self._person.comfort.copy()
        self._sent = np.zeros(len(self.robot.joints))
        self._before: tuple[np.ndarray, np.ndarray] | None = None
        self._offset = np.zeros(6)

    def step(
        self,
        posture: Any,
        arm: Any,
        arm_speed: Any = None,
        pose: Any = None,
        *,
        age: float = 0.0,
        enable: bool = True,
        observed: Any = None,
    ) -> WholeBodyStep:
        """Return the next joint velocities of the arm; it never raises.

        Args:
            posture: joint angles of the person (32,) [rad]. None: no frame arrived.
            arm: joint positions of the arm (k,) [rad].
            arm_speed: measured joint speeds of the last period (k,) [rad/s]. None: what was sent.
                The limits of speed and acceleration always continue from what was sent.
            pose: measured contact frame in the world (4, 4) [m]. None: where the arm holds it.
            age: age of the posture [s].
            enable: False decelerates to rest.
            observed: (32,) bool, joints of the person that the sensors see. None: all.
        """
        begin = time.perf_counter()
        k = len(self.robot.joints)
        positions = numbers(arm, k)
        measured = self._sent if arm_speed is None else numbers(arm_speed, k)
        if positions is None or measured is None:
            what = "arm" if positions is None else "arm_speed"
            return self._blind(begin, posture, f"{what} is not {k} finite numbers")
        if wrong := implausible(self.robot, positions, measured):
            return self._blind(begin, posture, wrong)
        # The limits continue from what was sent. The measurement gives the position of the arm
        # only.
        speeds = self._sent
        # The last speeds give the position in the middle of the period.
        middle = positions + measured * self.dt / 2
        contact, jacobian = self._sight.look(self._posture, positions, middle)
        done = self._done(contact, jacobian, speeds)
        seen = contact if pose is None else pose
        # To keep a distance, the robot may have moved the object faster than its limits. It returns
        # to them at once.
        fastest = self.problem.twist_limit.speed
        self.stepper.sent_instead(np.clip(done, -fastest, fastest))
        unimproved = self.stepper.stalled
        object_step = self.stepper.step(posture, seen, age=age, enable=enable, observed=observed)
        usable = object_step.status != "invalid"
        # Use what the step has read: a user's object may change when it is read again.
        angles, sees = self.stepper.frame
        if usable and posture is not None:
            self._posture = np.where(sees > 0.5, angles, self._person.comfort)
        self._sight.place(self._posture, positions)
        close, least = self._sight.near()
        moment = self._moment(
            object_step, positions, speeds, jacobian, done, close, sees, unimproved
        )
        velocities, status, why = solve_ladder(
            self.problem, self._formulation, object_step, moment, done
        )
        velocities = np.clip(velocities, moment.arm_low, moment.arm_high)
        self._sent = velocities
        reason = "; ".join(part for part in (object_step.reason, why) if part)
        twist = jacobian @ velocities - self._offset
        rate, took = moment.terms["S"] @ twist, time.perf_counter() - begin
        return WholeBodyStep(velocities, twist, rate, status, reason, least, object_step, took)

    def _done(self, contact: np.ndarray, jacobian: np.ndarray, speeds: np.ndarray) -> np.ndarray:
        """Return the object's twist in the last period (6,), and update the offset.

        See `Moment.offset`.
        """
        if self._before is None:
            done = jacobian @ speeds
        else:
            there, then = self._before
            done = then @ speeds - self._offset
            missed = (self._offset + done) * self.dt - pose_error(there, contact)
            self._offset = np.clip(missed / self.dt, -_OFFSET, _OFFSET)
        self._before = contact, jacobian
        return done

    def _moment(
        self,
        object_step: Step,
        positions: np.ndarray,
        speeds: np.ndarray,
        jacobian: np.ndarray,
        done: np.ndarray,
        close: Closeness | None,
        sees: np.ndarray,
        unimproved: float,
    ) -> Moment:
        robot = self.robot
        terms, slack = self._terms(object_step, self._posture, done, sees, unimproved)
        self._formulation.rows.slack = slack
        ranges = (robot.lower, robot.upper)
        low, high = joint_bounds(
            positions, speeds, ranges, robot.velocity, robot.acceleration, self.dt, self._pace
        )
        smooth = self.problem.control.smoothing / self.dt
        home = np.clip((self.start - positions) / _REST_TIME, -_REST_SPEED, _REST_SPEED)
        wish = (home + smooth * speeds) / (1 + smooth)
        H, g = own_objective(terms)
        moment = Moment(
            self.dt,
            jacobian,
            terms,
            H,
            g,
            terms["lb"],
            terms["ub"],
            speeds,
            low,
            high,
            wish,
            self._offset,
            close,
        )
        if close is not None:
            moment.approach = self._sight.approach(close, low, high)
        return moment

    def _blind(self, begin: float, posture: Any, cause: str) -> WholeBodyStep:
        """Slow down every joint from what was sent, because the arm is unknown."""
        slower = np.sign(self._sent) * np.maximum(
            np.abs(self._sent) - self.robot.acceleration * self.dt, 0.0
        )
        object_step = self.stepper.step(posture, enable=False)
        twist = np.zeros(6) if self._before is None else self._before[1] @ slower
        # The motion of the object meanwhile is unknown, so there is nothing to correct.
        self._sent, self._before, self._offset = slower, None, np.zeros(6)
        reason = f"{cause}: every joint of the robot stops by itself"
        rate, took = object_step.posture_rate, time.perf_counter() - begin
        return WholeBodyStep(slower, twist, rate, "invalid", reason, np.nan, object_step, took)
