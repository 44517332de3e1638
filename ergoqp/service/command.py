"""The command of one loop by a connection that speaks JSON: steps from lines to frames and back."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import numpy as np

from ergoqp.arguments import shown
from ergoqp.errors import ErgoqpError
from ergoqp.service.lines import LineError, flag, number, numbers, pose, posture, table
from ergoqp.service.links import Link, LinkError
from ergoqp.service.schema import (
    ANSWER_HEAD,
    HEAD,
    KNOTS,
    REQUEST_HEAD,
    VERSION,
    Ask,
    Flag,
    Tell,
    answer_frame,
    request_frame,
)
from ergoqp.step.causes import Status
from ergoqp.step.rest import UNKNOWN

STEP_KEYS: Final = (
    "loop",
    "posture",
    "pose",
    "twist",
    "dt",
    "age",
    "enable",
    "hold",
    "try_again",
    "guide",
    "standing",
    "moving",
    "followed",
)
"""Keys of a step."""

_MOST_FOLLOWED: Final = 1_000_000
_REPORT: Final = (
    'report what the robot did: "standing": true, or "moving": true with its measured "twist"'
)


class Refused(ErgoqpError):
    """A request that was understood, and not carried out.

    Example:
        >>> from ergoqp.errors import ErgoqpError
        >>> from ergoqp.service.command import Refused
        >>> issubclass(Refused, ErgoqpError)
        True
    """


class Ended(Refused):
    """The loop does not take this connection's command: another has it, or its problem is another.

    Example:
        >>> from ergoqp.service.command import Ended, Refused
        >>> issubclass(Ended, Refused)
        True
    """


class Command:
    """Steps of one loop for one connection.

    The robot is taken to execute the last answer, and as many periods of its stop as the next step
    says. What else it may have done in the time that passed has to be reported: nothing is assumed.

    Attributes:
        loop: name of the loop.
    """

    def __init__(
        self,
        loop: str,
        connect: Callable[[], Link],
        description: dict[str, Any],
        clock: Callable[[], float] | None,
    ) -> None:
        """Prepare the frames.

        Args:
            loop: name of the loop.
            connect: gives a new link to it.
            description: what the loop says that it is.
            clock: gives the time [s]. None: steps may come at any time.
        """
        self.loop, self._connect, self._clock = loop, connect, clock
        self._names: list[str] = description["coordinates"]
        self._rows: list[str] = description["rows"]
        self._guided: bool = description["guided"]
        self._dt: float = description["dt"]
        self._longest: float = description["longest_dt"]
        self._digest: int = description["digest"]
        self._link: Link | None = None
        layout = request_frame(len(self._names))
        self._request = bytearray(layout.length)
        self._given = {
            name: layout.numbers(self._request, name)
            for name in ("pose", "twist", "guide", "promise", "posture", "observed")
        }
        self._layout = answer_frame(len(self._names), len(self._rows))
        self._session, self._sequence, self._acted = 0, 0, 0
        self._answered, self._period, self._lasts = 0.0, 0.0, 0.0

    @property
    def begun(self) -> bool:
        """Whether the loop takes the steps."""
        return self._session != 0

    def step(self, said: dict[str, Any]) -> dict[str, Any]:
        """Return the answer to a step.

        Raises:
            LineError: if the step is written wrongly; the loop does not hear of it.
            Refused: if the loop cannot carry it out.
            LinkError: if the loop gives no answer.
        """
        table("step", said, STEP_KEYS)
        bits = self._read(said)
        dt = self._dt if "dt" not in said else number("step.dt", said["dt"], "s")
        age = 0.0 if "age" not in said else number("step.age", said["age"], "s")
        followed = self._followed(said, bits)
        begins = bits & (Flag.stands | Flag.takes_over)
        if not begins:
            self._check_time(followed)
        self._sequence += 1
        REQUEST_HEAD.pack_into(
            self._request,
            0,
            len(self._request),
            VERSION,
            Ask.step,
            self._session,
            self._sequence,
            0 if begins else self._acted,
            self._digest,
            0 if begins else followed or 0,
            bits | Flag.explain,
            len(self._names),
            0,
            age,
            dt,
        )
        answer = self._ask()
        kind = HEAD.unpack_from(answer)[2]
        if kind != Tell.step:
            raise self._refusal(kind, bytes(answer[ANSWER_HEAD.size :]))
        return self._told(answer)

    def close(self) -> None:
        """Give the loop free."""
        if self._link is not None:
            self._link.close()
        self._link = None

    def _ask(self) -> bytes | memoryview:
        """Send the request; a link that failed is replaced by the next step."""
        if self._link is None:
            self._link = self._connect()
        try:
            return self._link.ask(self._request)
        except LinkError:
            self.close()
            raise

    def _refusal(self, kind: int, text: bytes) -> Refused:
        words = text.rstrip(b"\0").decode(errors="replace")
        if kind == Tell.unknown:
            # Nobody may have begun, or the worker was replaced.
            self._session = 0
            return Refused(f"loop {self.loop}: does not know what the robot does; {_REPORT}")
        self.close()
        return Ended(words)

    def _read(self, said: dict[str, Any]) -> int:
        """Write what a step says into the request; return its flags."""
        bits = 0
        for name, bit, usually in (
            ("enable", Flag.enable, True),
            ("hold", Flag.hold, False),
            ("try_again", Flag.try_again, False),
            ("standing", Flag.stands, False),
            ("moving", Flag.takes_over, False),
        ):
            if flag(f"step.{name}", said.get(name, usually)):
                bits |= bit
        if bits & Flag.stands and bits & Flag.takes_over:
            raise LineError("step: got standing and moving, allowed one of them")
        if bits & Flag.hold and bits & Flag.try_again:
            raise LineError("step: got hold and try_again, allowed one of them")
        if said.get("posture") is not None:
            found = posture("step.posture", said["posture"], self._names)
            unseen = np.isnan(found)
            self._given["posture"][:] = np.where(unseen, 0.0, found)
            self._given["observed"][:] = ~unseen
            bits |= Flag.frame | (Flag.observed if unseen.any() else 0)
        if said.get("pose") is not None:
            self._given["pose"][:] = pose("step.pose", said["pose"]).ravel()
            bits |= Flag.pose
        if said.get("twist") is not None:
            allowed = "6 numbers, linear first [m/s, rad/s]"
            self._given["twist"][:] = numbers("step.twist", said["twist"], 6, allowed)
            bits |= Flag.twist
        elif bits & Flag.takes_over:
            raise LineError('step: got moving without "twist", allowed with the measured twist')
        if "guide" in said:
            bits |= self._read_guide(said["guide"])
        return bits

    def _read_guide(self, place: Any) -> int:
        if not self._guided:
            raise LineError("step.guide: the loop was started without one; allowed no guide")
        if place is None:
            return Flag.no_guide
        self._given["guide"][:] = pose("step.guide", place).ravel()
        self._given["promise"][:] = UNKNOWN
        return Flag.guide

    def _followed(self, said: dict[str, Any], bits: int) -> int | None:
        """Return how many periods of the stop were executed; None: nothing was said."""
        if "followed" not in said:
            return None
        followed = said["followed"]
        if type(followed) is not int or not 0 <= followed <= _MOST_FOLLOWED:
            raise LineError(
                f"step.followed: got {shown(followed)}, allowed a whole number of periods, 0 to"
                f" {_MOST_FOLLOWED}"
            )
        if bits & (Flag.stands | Flag.takes_over):
            raise LineError("step: got followed with standing or moving, allowed one of them")
        return followed

    def _check_time(self, followed: int | None) -> None:
        """Refuse a step if the robot may have done what nobody has reported."""
        if not self._session:
            raise Refused(f"loop {self.loop}: the first step needs a report; {_REPORT}")
        if self._clock is None:
            return
        gap = self._clock() - self._answered
        braked = (followed or 0) * self._period
        if gap > braked + self._longest and (not followed or braked < self._lasts):
            told = "" if followed is None else f' and "followed": {followed} tells of {braked:g} s'
            raise Refused(
                f"loop {self.loop}: {gap:.3g} s passed since the last twist{told}; say how many"
                f' periods of its stop the robot executed by "followed", or {_REPORT}'
            )

    def _told(self, answer: bytes | memoryview) -> dict[str, Any]:
        """Return an answer as it is written, and note what the robot executes now."""
        frame, session = bytes(answer), HEAD.unpack_from(answer)[3]
        head = ANSWER_HEAD.unpack_from(frame)
        _, status, _, reason, *_, knots, _ = head[6:]

        def part(name: str) -> np.ndarray:
            return self._layout.numbers(frame, name)

        words = frame[self._layout.at["text"]].rstrip(b"\0").decode(errors="ignore")
        times = part("times")[:knots]
        if self._clock is not None:
            self._answered = self._clock()
        self._session, self._acted = session, self._sequence
        # The period of the stop is not the one of the request where that was out of range.
        self._period, self._lasts = map(float, times[[0, -1]] if knots else (self._dt, 0.0))
        return {
            "twist": part("twist").tolist(),
            "status": Status(status).name,
            "reason": words if reason else "",
            "times": times.tolist(),
            "stop": part("stop").reshape(KNOTS, 6)[:knots].tolist(),
            "pose": part("pose").reshape(4, 4).tolist(),
            "cost": float(part("cost")[0]),
            "gain": float(part("gain")[0]),
            "posture_rate": part("posture_rate").tolist(),
            "margins": dict(zip(self._rows, part("margins").tolist(), strict=True)),
            "sequence": self._sequence,
        }
