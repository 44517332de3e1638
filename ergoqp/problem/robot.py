"""Declared delays and errors of the robot that holds the object."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Final

import numpy as np

from ergoqp.arguments import check_number
from ergoqp.errors import ProblemError

_LARGEST: Final = {
    "delay": (0.5, "s"),
    "lag": (0.5, "s"),
    "gain_error": (0.5, ""),
    "pose_delay": (0.5, "s"),
    "pose_noise": (0.1, "m"),
    "pose_noise_deg": (10.0, "deg"),
    "longest_hold": (1.0, "s"),
    "pose_from_posture": (1.0, "m"),
    "pose_from_posture_deg": (90.0, "deg"),
}
"""Largest value of each entry, with its unit."""


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

    delay: float = 0.0
    lag: float = 0.0
    gain_error: float = 0.0
    pose_delay: float = 0.0
    pose_noise: float = 0.0
    pose_noise_deg: float = 0.0
    longest_hold: float = 0.0
    pose_from_posture: float = 0.035
    pose_from_posture_deg: float = 8.0

    def __post_init__(self) -> None:
        """Check the numbers."""
        for entry in fields(self):
            value, (most, unit) = getattr(self, entry.name), _LARGEST[entry.name]
            check_number(f"robot.{entry.name}", value, 0.0, most, unit, ProblemError)

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
