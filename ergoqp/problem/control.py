"""Settings of the control step: how fast and how far the object moves."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from ergoqp.arguments import check_number
from ergoqp.errors import ProblemError

_LONGEST_AVERAGE: Final = 0.5
_LARGEST: Final = 1e9


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

    look_ahead: float = 0.5
    smoothing: float = 0.15
    effort_linear: float = 10.0
    effort_angular: float = 1.0
    caution: float = 0.02
    contact: float = 20.0
    comfort: float = 0.25
    rest_below: float = 0.03
    rest_after: float = 0.5
    move_above: float = 0.50
    move_after: float = 0.5
    stall_gain: float = 0.05
    stall_after: float = 2.0
    rest_filter: float = 0.5
    max_age: float = 0.10
    average: float | None = None
    guide_weight: float = 20.0
    guide_gain: float = 0.3
    guide_price: float = 1.5

    def __post_init__(self) -> None:
        """Check the numbers."""
        for name in self.__dataclass_fields__:
            value = getattr(self, name)
            if name == "average" and value is None:
                continue
            check_number(f"control.{name}", value, 0.0, _LARGEST, error=ProblemError)
        for name in ("look_ahead", "effort_linear", "effort_angular", "rest_filter", "max_age"):
            if getattr(self, name) == 0:
                raise ProblemError(f"control.{name}: got 0, allowed a positive number")
        if self.average is not None and self.average > _LONGEST_AVERAGE:
            raise ProblemError(
                f"control.average: got {self.average!r} s, allowed 0 to {_LONGEST_AVERAGE:g} s"
            )
        if self.move_above < self.rest_below:
            raise ProblemError(
                f"control.move_above: got {self.move_above}, allowed at least rest_below ="
                f" {self.rest_below}"
            )
