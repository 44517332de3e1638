"""Settings of a task: the control step, the declared robot, and the constant frames."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Annotated, Any, Final

import numpy as np

from ergoqp.arguments import Range, check_parameters, read_array, shown
from ergoqp.errors import InputError, ProblemError
from ergoqp.expressions import pose_at, quaternion_of, read_pose

NotNegative = Annotated[float, Range(0.0, 1e9)]
Time = Annotated[float, Range(0.0, 1e9, "s")]


@dataclass(frozen=True)
class Control:
    """Settings of the control step: how fast and how far the object moves.

    The defaults are suitable for all problems that come with the package.

    Attributes:
        look_ahead: T, time over which an improvement counts [s]; at least twice the person's delay.
        smoothing: t_s, time constant of changes of the twist [s].
        effort_linear: R of the linear axes [points / (m/s)^2].
        effort_angular: R of the angular axes [points / (rad/s)^2].
        caution: beta, curvature for moving the person's joints [points s^2/rad^2 per unit of joint
            weight].
        contact: weight of contact motion that the posture cannot follow [points / (m/s)^2, points /
            (rad/s)^2].
        comfort: weight of the person's comfort, which is added to V [points/rad^2 per unit of joint
            weight]. It sets the direction where the sheet is flat.
        rest_below: predicted gain of one second at full speed below which the object comes to rest
            [points].
        rest_after: how long the gain must be below [s].
        move_above: predicted gain above which the object moves again [points].
        move_after: how long the gain must be above [s].
        stall_gain: smallest decrease of the cost that counts as an improvement [points].
        stall_after: time without an improvement after which the object comes to rest [s]; it slows
            down from a quarter of that time on.
        rest_filter: time constant of the low-pass filter of predicted gain and cost, because both
            contain the noise of every angle [s].
        max_age: oldest posture that the step uses [s].
        average: W, length of the moving average [s]. The step sends the mean of the planned twist
            over the last W seconds. So its jerk is at most 2 acceleration / W, and a stop takes up
            to W longer. The step keeps a history of those seconds. Many periods in a row that are
            much shorter than the period of the loop fill the history: the step then reports it and
            brakes within its acceleration, but not within that jerk. None: 0.05 for an object that
            is held, and 0 where the twist is the velocity of points. Above 0.1 the step often
            brakes close to the edge of a cone.
        guide_weight: weight of the path to the guide, in multiples of the effort (dimensionless).
        guide_gain: the object travels to the guide if the guide promises a cost that is lower by
            more than this, and stays there if the cost exceeds the promise by at most this
            [points].
        guide_price: largest temporary increase of the cost on the way to the guide, before the
            object goes back [points].

    Raises:
        ProblemError: if a value has the wrong type or is out of range.

    Example:
        >>> import ergoqp
        >>> problem = ergoqp.load_problem("screwing")
        >>> problem.replace(control=ergoqp.Control(look_ahead=0.8)).control.look_ahead
        0.8
    """

    look_ahead: Time = 0.5
    smoothing: Time = 0.15
    effort_linear: NotNegative = 10.0
    effort_angular: NotNegative = 1.0
    caution: NotNegative = 0.02
    contact: NotNegative = 20.0
    comfort: NotNegative = 0.25
    rest_below: NotNegative = 0.03
    rest_after: Time = 0.5
    move_above: NotNegative = 0.50
    move_after: Time = 0.5
    stall_gain: NotNegative = 0.05
    stall_after: Time = 2.0
    rest_filter: Time = 0.5
    max_age: Time = 0.10
    average: Annotated[float, Range(0.0, 0.5, "s")] | None = None
    guide_weight: NotNegative = 20.0
    guide_gain: NotNegative = 0.3
    guide_price: NotNegative = 1.5

    def __post_init__(self) -> None:
        """Check the numbers."""
        check_parameters(self, "control.", ProblemError)
        for name in ("look_ahead", "effort_linear", "effort_angular", "rest_filter", "max_age"):
            if getattr(self, name) == 0:
                raise ProblemError(f"control.{name}: got 0, allowed a positive number")
        if self.move_above < self.rest_below:
            raise ProblemError(
                f"control.move_above: got {self.move_above}, allowed at least rest_below ="
                f" {self.rest_below}"
            )


_Seconds = Annotated[float, Range(0.0, 0.5, "s")]


@dataclass(frozen=True)
class DeclaredRobot:
    """Delays and errors between the twist that is sent and the pose that is measured.

    Every value is an upper bound.

    The twist w of the robot follows the sent twist s: w' = ((1 + g) s(t - delay) - w) / lag, with
    g between -`gain_error` and `gain_error`. Delay, lag and g may be smaller than declared, but
    must not change while the robot moves. Workspace and tool axis hold for every such robot. A
    measurement that no such robot can explain is a fault: the step names it, and the object stops.

    Attributes:
        delay: time from sending a twist until the robot begins to follow it [s].
        lag: time constant with which the robot then follows [s].
        gain_error: largest share by which the robot is faster or slower than sent. It needs a
            measured pose.
        pose_delay: age of the measured pose and of the reported twist [s].
        pose_noise: largest error of a measured position, per axis [m].
        pose_noise_deg: largest error of a measured orientation, about each axis [deg].
        longest_hold: how long the robot may go on with a twist because the next call is late [s].
            This may happen once per movement, until the object has stood still. It needs a
            measured pose.
        pose_from_posture: largest error, along each axis, of a first pose that is taken from the
            posture because none is measured [m]. The default is that of sensors that are 4 degrees
            off at trunk and shoulder, for a person of known lengths (2 degrees: 17 mm). It counts
            until a pose is measured.
        pose_from_posture_deg: the same for the orientation [deg]; the default is twice 4 degrees.

    Raises:
        ProblemError: if a value has the wrong type or is out of range.

    Example:
        >>> import ergoqp
        >>> robot = ergoqp.DeclaredRobot(delay=0.02, lag=0.05, pose_noise=0.001)
        >>> robot.declared, robot.owes
        (True, True)
        >>> robot.noise[:3].tolist()
        [0.001, 0.001, 0.001]
    """

    delay: _Seconds = 0.0
    lag: _Seconds = 0.0
    gain_error: Annotated[float, Range(0.0, 0.5, "share")] = 0.0
    pose_delay: _Seconds = 0.0
    pose_noise: Annotated[float, Range(0.0, 0.1, "m")] = 0.0
    pose_noise_deg: Annotated[float, Range(0.0, 10.0, "deg")] = 0.0
    longest_hold: Annotated[float, Range(0.0, 1.0, "s")] = 0.0
    pose_from_posture: Annotated[float, Range(0.0, 1.0, "m")] = 0.035
    pose_from_posture_deg: Annotated[float, Range(0.0, 90.0, "deg")] = 8.0

    def __post_init__(self) -> None:
        """Check the numbers."""
        check_parameters(self, "robot.", ProblemError)

    @property
    def dead_time(self) -> float:
        """Age up to which a sent twist has no effect on the measured pose yet [s]."""
        return self.delay + self.pose_delay

    @property
    def owes(self) -> bool:
        """Whether a part of what was sent is not in the measured pose yet."""
        return bool(self.dead_time or self.lag)

    @property
    def needs_pose(self) -> bool:
        """Whether the pose of the object is unknown without a measurement."""
        return bool(self.gain_error or self.longest_hold)

    @property
    def noise(self) -> np.ndarray:
        """Largest error of a measured pose, per axis of a twist (6,) [m, rad]."""
        return np.repeat([self.pose_noise, np.radians(self.pose_noise_deg)], 3)

    @property
    def declared(self) -> bool:
        """Whether anything of the robot itself is declared."""
        return any(getattr(self, entry.name) for entry in fields(self) if entry.default == 0)


_NAMES: Final = ("base", "flange", "camera")
_FARTHEST: Final = 100.0
"""Where a pose is not a place of a robot any more [m], as in `read_pose`."""


@dataclass(frozen=True, eq=False)
class Frames:
    """The constant frames of a workplace, given once: base, flange and camera.

    The world is that of the problem: on the floor between the soles of the person, or below the
    pelvis, with x along their heading. With `base` or `flange` the `pose` of a step is what the
    robot reports, its flange in its base. Twists stay those of the contact frame along the axes of
    the world; `twist_for_robot` and `twist_from_robot` convert them.

    Attributes:
        base: the robot's base in the world (4, 4) [m].
        flange: the contact frame in the robot's flange (4, 4) [m], x along the tool.
        camera: the camera in the world (4, 4) [m]. The step does not use it.
        offset: what `ergoqp.calibrate_frames` found of one person: where their contact frame is,
            less where the model's person has it, on average (3,) [m].
        spread: how far one rest of this person was from `offset` at most [m]. None: no
            calibration.
        spread_deg: the same of the tool's axis, from where the model's person has it [deg].
        compare: whether the step compares posture and pose. False: where they are not of one world,
            such as with people who walk about.

    Each frame is given as (4, 4), or as x, y, z [m] and a quaternion x, y, z, w (7,).

    Raises:
        ProblemError: if a frame is not a rigid motion, or a number is out of range.

    Example:
        >>> import numpy as np
        >>> import ergoqp
        >>> frames = ergoqp.Frames(base=[0.8, 0, 0.7, 0, 0, 1, 0], flange=[0, 0, 0.2, 0, 0, 0, 1])
        >>> contact = frames.contact_pose(np.eye(4))  # of the flange in the base
        >>> contact[:3, 3].round(3).tolist()
        [0.8, 0.0, 0.9]
        >>> frames.twist_for_robot([0.1, 0, 0, 0, 0, 0], np.eye(4)).round(3).tolist()
        [-0.1, 0.0, 0.0, 0.0, 0.0, 0.0]
    """

    base: Any = None
    flange: Any = None
    camera: Any = None
    offset: Any = (0.0, 0.0, 0.0)
    spread: Annotated[float, Range(0.0, 2.0, "m")] | None = None
    spread_deg: Annotated[float, Range(0.0, 180.0, "deg")] | None = None
    compare: bool = True

    def __post_init__(self) -> None:
        """Read the frames."""
        for name in _NAMES:
            object.__setattr__(self, name, _frame(f"frames.{name}", getattr(self, name)))
        three = "3 finite numbers [m]"
        offset = read_array("frames.offset", self.offset, (3,), three, ProblemError)
        object.__setattr__(self, "offset", offset)
        check_parameters(self, "frames.", ProblemError)
        if (self.spread is None) != (self.spread_deg is None):
            raise ProblemError("frames: got one of spread and spread_deg, allowed both or none")

    def __eq__(self, other: object) -> bool:
        """Return whether all frames and numbers are the same."""
        if not isinstance(other, Frames):
            return NotImplemented
        names = [each.name for each in fields(Frames)]
        return all(np.array_equal(getattr(self, n), getattr(other, n)) for n in names)

    __hash__ = None  # pyright: ignore[reportAssignmentType]

    @property
    def moved(self) -> bool:
        """Whether the pose that the robot reports is not the contact frame in the world already."""
        return any(not np.array_equal(frame, np.eye(4)) for frame in (self.base, self.flange))

    def contact_pose(self, pose: Any) -> np.ndarray:
        """Return the contact frame in the world (4, 4) [m] for what the robot reports.

        Args:
            pose: the flange in the base (4, 4) [m].

        Raises:
            InputError: if it is not a rigid motion.
        """
        return self.base @ read_pose("pose", pose) @ self.flange

    def reported_pose(self, contact: Any) -> np.ndarray:
        """Return what the robot reports, the flange in the base (4, 4) [m].

        Args:
            contact: the contact frame in the world (4, 4) [m].

        Raises:
            InputError: if it is not a rigid motion.
        """
        world = read_pose("contact", contact)
        return _inverse(self.base) @ world @ _inverse(self.flange)

    def twist_for_robot(self, twist: Any, pose: Any) -> np.ndarray:
        """Return the velocity of the flange along the axes of the base (6,) [m/s, rad/s].

        Args:
            twist: velocity at the contact frame along the axes of the world (6,) [m/s, rad/s], such
                as `Step.twist`.
            pose: the flange in the base (4, 4) [m], as the robot reports it.

        Raises:
            InputError: if the twist is not six finite numbers or the pose not a rigid motion.
        """
        given, lever = _six(twist), self._lever(pose)
        turn = given[3:] @ self.base[:3, :3]
        return np.concatenate([given[:3] @ self.base[:3, :3] - np.cross(turn, lever), turn])

    def twist_from_robot(self, twist: Any, pose: Any) -> np.ndarray:
        """Return the velocity at the contact frame along the axes of the world (6,) [m/s, rad/s].

        Args:
            twist: velocity of the flange along the axes of the base (6,) [m/s, rad/s].
            pose: the flange in the base (4, 4) [m], as the robot reports it.

        Raises:
            InputError: if the twist is not six finite numbers or the pose not a rigid motion.
        """
        given = _six(twist)
        shift = given[:3] + np.cross(given[3:], self._lever(pose))
        return np.concatenate([self.base[:3, :3] @ shift, self.base[:3, :3] @ given[3:]])

    def from_camera(self, points: Any) -> np.ndarray:
        """Return points (n, 3) [m] that the camera sees, in the world.

        Raises:
            InputError: if they are not rows of three numbers.
        """
        try:
            seen = np.asarray(points, dtype=float)
        except (TypeError, ValueError):
            seen = np.zeros(0)
        if seen.ndim != 2 or seen.shape[-1] != 3:
            raise InputError(f"points: got {shown(points)}, allowed rows of three numbers (n, 3)")
        return seen @ self.camera[:3, :3].T + self.camera[:3, 3]

    def toml(self) -> str:
        """Return the table ``[frames]`` of a problem file.

        Frames that change nothing are left out.
        """
        lines = ["[frames]"]
        for name in _NAMES:
            frame = getattr(self, name)
            if not np.array_equal(frame, np.eye(4)):
                turn = np.roll(quaternion_of(frame[:3, :3]), -1)
                lines.append(f"{name} = {np.round([*frame[:3, 3], *turn], 9).tolist()}")
        if self.spread is not None:
            lines.append(f"offset = {np.round(self.offset, 6).tolist()}")
            lines += [f"spread = {self.spread:.6f}", f"spread_deg = {self.spread_deg:.4f}"]
        if not self.compare:
            lines.append("compare = false")
        return "\n".join(lines) + "\n"

    def _lever(self, pose: Any) -> np.ndarray:
        """Return the contact frame's origin, seen from the flange's, along the base (3,) [m]."""
        return read_pose("pose", pose)[:3, :3] @ self.flange[:3, 3]


def _frame(what: str, given: Any) -> np.ndarray:
    """Return a user's frame as (4, 4)."""
    if given is None:
        return np.eye(4)
    in_words = "x, y, z [m] and a quaternion x, y, z, w"
    try:
        if _shape(given) != (7,):
            return read_pose(what, given)
        values = read_array(what, given, (7,), in_words)
    except InputError as error:
        others = "" if in_words in str(error) else f", or {in_words}"
        raise ProblemError(f"{error}{others}") from None
    size = float(np.linalg.norm(values[3:]))
    if not abs(size - 1) < 1e-3 or not np.linalg.norm(values[:3]) < _FARTHEST:
        raise ProblemError(
            f"{what}: got {shown(values.tolist())}, allowed x, y, z within {_FARTHEST:g} m and a"
            " quaternion x, y, z, w of length 1"
        )
    return pose_at(values[:3], values[3:])


def _shape(given: Any) -> tuple[int, ...]:
    try:
        return np.shape(given)
    except Exception:  # no array
        return ()


def _inverse(pose: np.ndarray) -> np.ndarray:
    """Return the inverse of a rigid motion (4, 4)."""
    inverse = np.eye(4)
    inverse[:3, :3] = pose[:3, :3].T
    inverse[:3, 3] = -pose[:3, :3].T @ pose[:3, 3]
    return inverse


def _six(twist: Any) -> np.ndarray:
    return read_array("twist", twist, (6,), "6 finite numbers")
