"""What a client keeps of the answers of the service: twist and stop, and the members of a step."""

from __future__ import annotations

import time
from collections.abc import Mapping
from functools import cached_property
from typing import Final

import numpy as np

from ergoqp.service.asking import address_of
from ergoqp.service.schema import KNOTS, Frame

STATUSES: Final = ("optimal", "settled", "relaxed", "recovering", "braking", "invalid")
"""Statuses of a step; the number in an answer is the place in this tuple."""
_HUGE: Final = 1e12


class Plan:
    """A twist, and the stop that follows it.

    Attributes:
        twist: the twist (6,); times: of the knots [s]; stop: their twists (k, 6).
        knots: how many knots count; behind the last one the twist is zero.
    """

    def __init__(self, twist: np.ndarray, times: np.ndarray, stop: np.ndarray) -> None:
        """Keep the memory for it."""
        self.twist, self.times, self.stop, self.knots = twist, times, stop, 0

    def at(self, seconds: float) -> np.ndarray:
        """Return the twist at a time from the plan's own twist on."""
        times, stop = self.times[: self.knots], self.stop
        # Times that are equal but for rounding are equal, so that the twists of whole periods come
        # out to the bit.
        later = int(np.searchsorted(times, seconds * (1 - 1e-12)))
        if later == self.knots:
            return np.zeros(6)
        if times[later] <= seconds * (1 + 1e-12):
            return stop[later].copy()
        before, old = (times[later - 1], stop[later - 1]) if later else (0.0, self.twist)
        return old + (stop[later] - old) * ((seconds - before) / (times[later] - before))


def ramp(twist: np.ndarray, acceleration: np.ndarray, shortest: float) -> Plan:
    """Return a straight line from a twist (6,) to zero, within acceleration limits (6,).

    It lasts at least `shortest` [s].
    """
    needed = np.abs(twist) / np.where(acceleration > 0, acceleration, np.inf)
    plan = Plan(twist.copy(), np.array([max(shortest, float(needed.max()))]), np.zeros((1, 6)))
    plan.knots = 1
    return plan


class Answer(Plan):
    """Memory for one answer, and views of its numbers.

    Attributes:
        layout: where its fields are.
        view: all its bytes, and address: of the first.
    """

    def __init__(self, layout: Frame) -> None:
        """Allocate it, with zeros."""
        buffer = bytearray(layout.length)
        self.layout, self.view = layout, memoryview(buffer)
        self.address = address_of(buffer)
        numbers = layout.numbers
        super().__init__(
            numbers(buffer, "twist"),
            numbers(buffer, "times"),
            numbers(buffer, "stop").reshape(KNOTS, 6),
        )
        self._sent = numbers(buffer, "twist", "posture_rate")
        self._knots = numbers(buffer, "times", "stop")

    def wrong(self, status: int, knots: int) -> str:
        """Take the number of knots; return what keeps a robot and a person from executing it."""
        # A product with itself is infinite or NaN if any number is.
        sent, line = self._sent, self._knots
        with np.errstate(all="ignore"):
            if not (sent.dot(sent) < _HUGE and line.dot(line) < _HUGE):
                return "with twists that are no numbers"
        if status >= len(STATUSES):
            return f"of status {status}, which is unknown"
        if knots > KNOTS:
            return f"of {knots} knots, allowed {KNOTS}"
        times = self.times[:knots]
        if knots and not (times[0] > 0.0 and (times[1:] > times[:-1]).all()):
            return "with a stop whose times do not grow"
        if knots and self.stop[knots - 1].any():
            return "with a stop that does not end at rest"
        self.knots = knots
        return ""


class ClientStep:
    """The answer of one step, with the members of `ergoqp.Step`.

    Attributes:
        twist: twist to send (6,) [m/s, rad/s].
        status: as of `ergoqp.Step`. An answer that did not come in time gives ``braking``.
        reason: one sentence; empty for a plain optimal step.
        fresh: whether the service answered in time. Otherwise the twist is the next one of the
            stop that came with the last answer.
        solve_time: duration of the call [s].
        send: whether the robot is to be sent the twist. Not where a relay moves it; and not after a
            pause in which a robot may have slowed down by itself, until `Client.reset`.
        computed: time that the step took in the service [s]; 0 if it is not fresh.
    """

    def __init__(
        self,
        twist: np.ndarray,
        status: str,
        reason: str,
        fresh: bool,
        start: float,
        answer: Answer,
        names: Mapping[str, tuple[str, ...]],
        computed: float = 0.0,
        drawn: int = 0,
        send: bool = True,
    ) -> None:
        """Keep the bytes of the last answer; members are read from them on demand."""
        self.twist, self.status, self.reason, self.fresh = twist, status, reason, fresh
        self.computed, self.drawn, self.send = computed, drawn, send
        self._frame, self._layout, self._names = answer.view.tobytes(), answer.layout, names
        self.solve_time = time.perf_counter() - start

    def __repr__(self) -> str:
        """Show twist, status and reason."""
        twist = np.array2string(self.twist, precision=4, suppress_small=True)
        return f"ClientStep(twist={twist}, status={self.status!r}, reason={self.reason!r})"

    def _value(self, name: str) -> np.ndarray:
        return self._layout.numbers(self._frame, name).copy()

    @property
    def pose(self) -> np.ndarray:
        """Contact frame in the world that the last answered step used (4, 4) [m]."""
        return self._value("pose").reshape(4, 4)

    @property
    def posture_rate(self) -> np.ndarray:
        """How the model person follows [rad/s]; zero if the step is not fresh."""
        rate = self._value("posture_rate")
        return rate if self.fresh else np.zeros_like(rate)

    @property
    def cost(self) -> float:
        """V of the posture, at the last answer [points]."""
        return float(self._value("cost")[0])

    @property
    def gain(self) -> float:
        """Predicted improvement within one second at full speed, at the last answer [points]."""
        return float(self._value("gain")[0])

    @property
    def residuals(self) -> dict[str, float]:
        """Residuals by name, see `ergoqp.Step`."""
        return dict(
            zip(("qp", "contact", "accepted"), self._value("residuals").tolist(), strict=True)
        )

    @cached_property
    def margins(self) -> dict[str, float]:
        """Distance of every row to its nearer end, in the unit of the row."""
        return dict(zip(self._names["rows"], self._value("margins").tolist(), strict=True))

    @cached_property
    def slack(self) -> dict[str, float]:
        """By how much the QP missed a row, in its unit per second; only missed rows."""
        found = zip(self._names["rows"], self._value("slack").tolist(), strict=True)
        return {name: value for name, value in found if value > 1e-7}

    @cached_property
    def locked(self) -> tuple[str, ...]:
        """Joints at their end that the model person holds still."""
        held = np.flatnonzero(self._value("locked") > 0.5)
        return tuple(self._names["coordinates"][i] for i in held)

    @cached_property
    def active(self) -> tuple[str, ...]:
        """Names of the rows that hold the object back, and of the joints that yield."""
        pushing = np.flatnonzero(np.abs(self._value("multipliers")) > 1e-6)
        rows = [self._names["rows"][i] for i in pushing]
        return (*rows, *(joint for joint in self.locked if joint not in rows))


__all__ = ["STATUSES", "Answer", "ClientStep", "Plan"]
