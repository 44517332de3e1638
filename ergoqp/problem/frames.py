"""Where the robot, its tool and the camera are: the constant frames between them and the world."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from ergoqp.arguments import check_number, flag, read_array, shown
from ergoqp.errors import InputError, ProblemError
from ergoqp.expressions.quaternions import matrix_of, quaternion_of
from ergoqp.expressions.rigid import read_pose

_NAMES: Final = ("base", "flange", "camera")
_WIDEST: Final = 2.0
"""Largest distance of a calibration [m]."""
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
    spread: float | None = None
    spread_deg: float | None = None
    compare: bool = True

    def __post_init__(self) -> None:
        """Read the frames."""
        for name in _NAMES:
            object.__setattr__(self, name, _frame(f"frames.{name}", getattr(self, name)))
        try:
            offset = read_array("frames.offset", self.offset, (3,), "3 finite numbers [m]")
        except InputError as error:
            raise ProblemError(str(error)) from None
        object.__setattr__(self, "offset", offset)
        object.__setattr__(self, "compare", flag("frames.compare", self.compare, ProblemError))
        if (self.spread is None) != (self.spread_deg is None):
            raise ProblemError("frames: got one of spread and spread_deg, allowed both or none")
        if self.spread is not None:
            check_number("frames.spread", self.spread, 0.0, _WIDEST, "m", ProblemError)
            check_number("frames.spread_deg", self.spread_deg, 0.0, 180.0, "deg", ProblemError)

    def __eq__(self, other: object) -> bool:
        """Return whether all frames and numbers are the same."""
        if not isinstance(other, Frames):
            return NotImplemented
        same = all(np.array_equal(getattr(self, n), getattr(other, n)) for n in (*_NAMES, "offset"))
        numbers = ("spread", "spread_deg", "compare")
        return same and all(getattr(self, n) == getattr(other, n) for n in numbers)

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
    pose = np.eye(4)
    pose[:3, :3] = matrix_of(np.roll(values[3:] / size, 1))
    pose[:3, 3] = values[:3]
    return pose


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
